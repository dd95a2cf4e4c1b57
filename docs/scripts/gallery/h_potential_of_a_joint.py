"""
The potential of a joint
========================

Where the left wrist goes, in the plane of the arm: yellow where it was held, violet where it never was.
"""

import mocap

mocap.load("out/demo").potential("wrist_l").plot()
