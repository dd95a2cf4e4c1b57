"""Attacks on the program, from seeds: damaged and foreign files, interrupted writing, killed workers, the page."""
