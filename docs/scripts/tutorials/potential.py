"""
Inspecting a potential
======================

An *empirical potential* is a map: 0 where the animal was seen, 1 where it never was. This page looks at that of a
bat's wrist, in the result of the demo. As a notebook: first run ``mocap demo bat --out out/demo`` in its folder.
"""

import matplotlib.pyplot as plt
import numpy as np

import mocap

result = mocap.load("out/demo")
wrist = result.potential("wrist_l")

# %%
# The map
# -------
# The wrist's child marker (the next joint of the hand) as the elbow sees it, in the plane of the arm: yellow
# where it was held, violet where it never was. Dots are samples of this flight, bars say how often.

wrist.plot()

# %%
# Asking it
# ---------
# ``value`` takes coordinates in metres. At samples it is nearly 0; a finger's length away it is 1.

samples = wrist.samples_m
print(f"at the samples:  median {np.median(wrist.value(samples)):.4f}, largest {wrist.value(samples).max():.3f}")
print(f"at 90 degrees:   {wrist.at(degrees=90):.3f}")
print(f"20 mm further:   {wrist.value(samples.mean(axis=0) + 0.02):.3f}")

# %%
# ``gradient`` points to where poses become less usual; ``hessian`` says how firmly the animal stays where it is.

here = samples[0]
print("gradient in 1/m:", np.round(wrist.gradient(here), 2))
stiffness, directions = np.linalg.eigh(wrist.hessian(here))
print("stiffness in 1/m^2:", np.round(stiffness), "along", np.round(directions[:, -1], 2))

# %%
# How much it knows
# -----------------
# The report gives for each joint the *effective rank*: how many independent directions the samples have, on the scale
# of the kernel. A joint that was seen in few poses has a low one: do not rely on its map.

rank = {name: joint["effective_rank"] for name, joint in result.report["joints"].items()}
for name in ("shoulder_l", "elbow_l", "wrist_l", "d5_mcp_l"):
    print(f"{name:12} {rank[name]:5.1f}")

# %%
# Would the other half of the flight give the same map?
# -----------------------------------------------------
# Learn it from the first and from the second half, and compare them at all samples. Where they
# differ, trust neither.

import eal

half = len(samples) // 2
maps = [eal.fit_potential(part / wrist.scale_m, lam=1e-3) for part in (samples[:half], samples[half:])]
fig, axes = plt.subplots(1, 2, figsize=(9, 4), sharex=True, sharey=True)
for ax, one, name in zip(axes, maps, ("first half", "second half"), strict=True):
    one.plot(ax)
    ax.set_title(name)
knows = [np.mean(maps[k].value(part / wrist.scale_m) < 0.5) for k, part in ((0, samples[half:]), (1, samples[:half]))]
print(f"samples of one half that the other half's map knows (V < 0.5): {knows[0]:.0%} and {knows[1]:.0%}")

# %%
# Your own samples
# ----------------
# ``eal.fit_potential(samples)`` takes any (N, d) table: joint angles, pressures, footholds. Scale the coordinates to
# like magnitudes first. Its ``findings`` say what to be careful about.

angles = np.stack([result.kinematics[f"{j}_flexion_deg"].value for j in ("elbow_l", "wrist_l")], axis=1)
angles = angles[np.isfinite(angles).all(axis=1)]
pair = eal.fit_potential(angles / 20, lam=1e-3, names=("elbow", "wrist"), units=("20 deg", "20 deg"))
print(*pair.findings, sep="\n")
pair.plot()
