"""
What was filled
===============

Every marker in every frame: measured, filled, rejected.
"""

import mocap

mocap.load("out/demo").plot.gaps()
