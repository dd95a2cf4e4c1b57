"""
What a Gaussian cannot say
==========================

The same samples on an arc: a Gaussian (left: its level curves) thinks the middle of the arc most usual, where no
sample is; the empirical potential (right) does not.
"""

import matplotlib.pyplot as plt
import numpy as np

import eal

rng = np.random.default_rng(1)
angle = rng.uniform(0, 1.6 * np.pi, 300)
samples = np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.normal(1, 0.05, (300, 1))
x, y = np.meshgrid(np.linspace(-1.8, 1.8, 121), np.linspace(-1.8, 1.8, 121))
off = np.stack([x, y], axis=-1) - samples.mean(axis=0)
away = np.einsum("...i,ij,...j", off, np.linalg.inv(np.cov(samples.T)), off)
fig, (left, right) = plt.subplots(1, 2, figsize=(8, 4))
left.contourf(x, y, away, levels=12)
left.plot(*samples.T, "w.", markersize=2)
left.set(title="Gaussian", aspect="equal")
right.contourf(x, y, eal.fit_potential(samples, lam=1e-2).value(np.stack([x, y], axis=-1)), levels=20)
right.plot(*samples.T, "w.", markersize=2)
right.set(title="empirical potential", aspect="equal")
