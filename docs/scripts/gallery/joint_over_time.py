"""
A joint over time
=================

Where the left elbow's child marker is, seen from the plane of the arm, with 95 % intervals.
"""

import mocap

result = mocap.load("out/demo")
result.joints["elbow_l"].plot()
