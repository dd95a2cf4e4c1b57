"""Angles, speeds, strokes and strides of tracked markers, each with its standard deviation."""
