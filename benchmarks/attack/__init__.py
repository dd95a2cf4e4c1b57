"""Attacks on the program: damaged files, interrupted writing: ``python -m benchmarks.attack``."""
