"""
A wing beat
===========

The wrists over the phase of a wing beat: thin lines are single beats, bands the 95 % interval of the mean.
"""

import mocap

result = mocap.load("out/demo")
result.plot.by_phase("wrist_l_flexion_deg", "wrist_r_flexion_deg", of="wing_l")
