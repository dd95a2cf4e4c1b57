"""
From samples to a map
=====================

Four times as many samples, four times: the map of where points were seen gets sharper, and keeps the hole in their
middle.
"""

import matplotlib.pyplot as plt
import numpy as np

import eal

rng = np.random.default_rng(0)
x, y = np.meshgrid(np.linspace(-1.8, 1.8, 121), np.linspace(-1.8, 1.8, 121))
fig, axes = plt.subplots(1, 4, figsize=(12, 3), sharex=True, sharey=True)
for ax, n in zip(axes, (5, 20, 80, 320), strict=True):
    angle, radius = rng.uniform(0, 1.6 * np.pi, n), rng.normal(1, 0.05, n)
    samples = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    ax.contourf(x, y, eal.fit_potential(samples, lam=1e-2).value(np.stack([x, y], axis=-1)), levels=20)
    ax.plot(*samples.T, "w.", markersize=2)
    ax.set(title=f"{n} samples", aspect="equal")
