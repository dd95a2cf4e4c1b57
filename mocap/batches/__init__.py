"""Many trials in one go: find them, track each on Dask, and say how each went."""
