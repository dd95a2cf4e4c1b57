"""Calibration: cameras from pictures of boards, wands, known points, or the marker tracks themselves."""
