"""Runs as rerun recordings."""
