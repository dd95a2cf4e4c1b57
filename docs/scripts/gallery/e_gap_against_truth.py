"""
A gap, filled, and the truth
============================

The demo's bat is synthetic, so the truth is known. The longest gap of a wing tip: what a straight line makes of it,
what the filter makes of it with its 95 % interval, and where the tip really was.
"""

import matplotlib.pyplot as plt
import mocap.datasets
import numpy as np

import mocap

tip = mocap.load("out/demo").markers.sel(keypoint="d4_tip_l", individual="id_0")
truth = mocap.datasets.bat(seed=0).truth
z, t, filled = tip.position.sel(space="z"), tip.time.values, (tip.status != 1).values
sd = np.sqrt(tip.covariance.sel(space="z", space_to="z"))
runs = np.split(np.arange(len(t)), np.flatnonzero(np.diff(filled)) + 1)
gap = max((run for run in runs if filled[run[0]]), key=len)
w = slice(gap[0] - 15, gap[-1] + 16)
plt.fill_between(t[w], (z - 1.96 * sd)[w], (z + 1.96 * sd)[w], alpha=0.4, label="95 % interval")
plt.plot(t[w], truth.xyz_m[w, truth.names.index("d4_tip_l"), 2], "k--", label="truth")
plt.plot(t[gap], np.interp(t[gap], t[~filled], z[~filled]), ":", label="straight line")
plt.axvspan(t[gap[0]], t[gap[-1]], alpha=0.1, color="k")
plt.gca().set(xlabel="time (s)", ylabel="height of the tip (m)")
plt.legend()
