"""Cameras: projection, lenses, triangulation, and the corner that pixels are counted from.

Projections, lens parameters and pixels come in, as arrays. Pixels, positions with covariance, and decisions about
origin, axes and order go out. It touches no file.
"""
