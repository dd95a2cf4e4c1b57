"""Attacks on the program: damaged and foreign files, interrupted writing; what becomes of each is counted."""
