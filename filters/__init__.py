"""Tracking: cameras and a motion model in, motion with covariance out (of eal-mocap)."""
