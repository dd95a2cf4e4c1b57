"""Calibration: cameras from images of boards, wands, known points, or the marker tracks themselves.

Pixels of known things come in, as arrays. Cameras with their lenses and residuals go out, or an error that says what is
implausible. It touches no file.
"""
