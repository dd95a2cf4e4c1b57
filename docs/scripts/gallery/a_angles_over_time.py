"""
Angles over time
================

Both elbows of the demo's bat with 95 % intervals. Shaded: frames in which a marker of the joint was filled.
"""

import mocap

result = mocap.load("out/demo")
result.plot.over_time("elbow_l_flexion_deg", "elbow_r_flexion_deg")
