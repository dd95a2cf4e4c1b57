"""Attacks on the program, from seeds: damaged files, and interrupted writing; what becomes of each is counted."""
