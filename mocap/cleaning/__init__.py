"""Cleaning: what is wrong in tracks, and how sure each ray and point is."""
