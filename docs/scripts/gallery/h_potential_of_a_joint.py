"""
The potential of a joint
========================

Where the left wrist goes, in the plane of the arm: 0 (dark) where it was seen, 1 far from there.
"""

import mocap

mocap.load("out/demo").potential("wrist_l").plot()
