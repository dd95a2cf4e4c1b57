"""Attacks on the program, from seeds: damaged files, interrupted writing, the page; what becomes of each is counted."""
