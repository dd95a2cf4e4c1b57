"""
The path of a wing
==================

Stroke angle and deviation from the stroke plane of the left wing.
"""

import mocap

mocap.load("out/demo").plot.stroke("wing_l")
