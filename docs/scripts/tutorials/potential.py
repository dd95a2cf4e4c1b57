"""
Inspecting a potential
======================

"""

import mocap

result = mocap.load("out/demo")
V = result.potential("elbow_l")
V.plot()
