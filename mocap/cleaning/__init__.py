"""Cleaning: outliers and identity switches in tracks, and the noise of cameras, markers and points.

Pixels and positions come in, as arrays. Masks of what is not believed, exchanged names, deviations and slow errors go
out. It touches no file.
"""
