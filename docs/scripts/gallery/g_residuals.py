"""
Residuals of the cameras
========================

How far each camera's clicks lie from the tracked markers.
"""

import mocap

mocap.load("out/demo").plot.residuals()
