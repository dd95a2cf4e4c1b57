"""Plots of results for a notebook or a paper, as matplotlib axes."""
