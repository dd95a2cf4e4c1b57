"""Angles, speeds, strokes and strides of tracked markers, each with its standard deviation.

Positions and velocities with their joint covariances come in, and a skeleton. Quantities over time, cycles and
footfalls go out, with notes on what cannot be known. It touches no file.
"""
