"""Attacks on the program, from seeds: damaged files, foreign folders, and interrupted writing; what becomes of each is counted."""
