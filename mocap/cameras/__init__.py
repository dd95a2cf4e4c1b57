"""Cameras: projection, lenses, triangulation, and the corner that pixels are counted from."""
