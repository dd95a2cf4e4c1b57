"""Cleaning: outliers and identity switches in tracks, and the noise of cameras, markers and points."""
