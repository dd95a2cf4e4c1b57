"""
Several flights and one model
=============================

One flight may show a movement once that others show often. This page learns a model from two flights and tracks a
third, in which a wing was hidden for a while. On the command line the same is ``mocap learn`` and ``mocap track
--model``.
"""

# %%
# Three flights
# -------------
# Synthetic bats of 34 markers; only 90 frames each, to be quick. Positions are enough for learning, so the cameras
# are left out.

from pathlib import Path
from tempfile import mkdtemp

import mocap.datasets
import numpy as np

import mocap


def recording(seed, hidden=None):
    """A flight as positions in a table; ``hidden``: frames in which the left hand is not seen."""
    flight = mocap.datasets.bat(seed=seed, n_frames=90)
    names, true = flight.truth.names, flight.truth.xyz_m
    xyz = true + np.random.default_rng(seed).normal(0, 2e-4, true.shape)
    hand = [m for m, name in enumerate(names) if name.startswith(("d3", "d4", "wrist")) and name.endswith("_l")]
    if hidden is not None:
        xyz[hidden, hand] = np.nan
    path = Path(mkdtemp()) / f"flight{seed}_xyzpts.csv"
    header = ",".join(f"{name}_{axis}" for name in names for axis in "XYZ")
    np.savetxt(path, xyz.reshape(len(xyz), -1), delimiter=",", header=header, comments="")
    return mocap.read(path, fps=flight.fps, unit="m"), flight.truth, hand


gap = slice(40, 65)
trials = [recording(seed)[0] for seed in (1, 2)]
third, truth, hand = recording(3, hidden=gap)
print(third)

# %%
# Learn
# -----
# ``learn`` hides gaps in the trials and prints how well they are filled, by length.

model = mocap.learn(trials)
print(model.report_text)

# %%
# Track the third
# ---------------

learned = mocap.track(third, model=model, validate=False)
alone = mocap.track(third, model="constant_velocity", validate=False)

for name, result in (("learned from two flights", learned), ("constant velocity", alone)):
    error = result.tracks.xyz_m[gap][:, hand] - truth.xyz_m[gap][:, hand]
    print(f"{name:26} {1e3 * np.sqrt((error**2).sum(axis=-1).mean()):6.2f} mm RMSE in the gap")

# %%
# A picture of one finger tip
# ---------------------------

import matplotlib.pyplot as plt

m = truth.names.index("d3_tip_l")
window = slice(25, 80)
for name, result in (("learned", learned), ("constant velocity", alone)):
    markers = result.tracks
    z, sd = markers.xyz_m[window, m, 2], np.sqrt(markers.cov_m2[window, m, 2, 2])
    plt.plot(markers.t_s[window], 1e3 * z, label=name)
    plt.fill_between(markers.t_s[window], 1e3 * (z - 1.96 * sd), 1e3 * (z + 1.96 * sd), alpha=0.2)
plt.plot(truth.t_s[window], 1e3 * truth.xyz_m[window, m, 2], "k--", label="truth")
height = 1e3 * truth.xyz_m[window, m, 2]
plt.gca().set(xlabel="time (s)", ylabel="height (mm)", ylim=(height.min() - 30, height.max() + 30))
plt.legend()

# %%
# Keep it
# -------

model.save(Path(mkdtemp()) / "bat.npz")

# %%
# What to bring to a model of your own: :doc:`/howto/several_recordings`. When to believe what it fills:
# :doc:`/howto/trust`.
