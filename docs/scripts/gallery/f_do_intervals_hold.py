"""
Do intervals hold?
==================

Errors divided by their stated standard deviations, where markers were measured and where they were filled. If
intervals were exact, both would follow the curve; narrower means that intervals are too wide.
"""

import matplotlib.pyplot as plt
import mocap.datasets
import numpy as np

import mocap

markers = mocap.load("out/demo").tracks
error = markers.xyz_m - mocap.datasets.bat(seed=0).truth.xyz_m
sd = np.sqrt(np.diagonal(markers.cov_m2, axis1=-2, axis2=-1))
x = np.linspace(-4, 4, 81)
for name, code in (("measured", 1), ("filled", 4)):
    plt.hist((error / sd)[markers.status == code].ravel(), bins=x, density=True, histtype="step", label=name)
plt.plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), "k--", label="exact")
plt.xlabel("error / standard deviation")
plt.legend()
