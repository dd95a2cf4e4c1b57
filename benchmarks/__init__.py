"""Scripts that measure us beside peers in one run and print a table: ``python -m benchmarks.NAME [--quick]``."""
