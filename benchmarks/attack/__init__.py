"""Attacks on the program, from seeds: damaged files; what becomes of each is counted."""
