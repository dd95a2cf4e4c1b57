"""The empirical potential of a joint as a map."""

from typing import TYPE_CHECKING

import numpy as np

from mocap.pipeline.run import JointPotential

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS = 120
MARGIN = 0.35
"""Of the samples' range, on each side."""


def plot_potential(joint: JointPotential, *, ax: "Axes | None" = None) -> "Axes":
    """V_z over the plane of the limb, from 0 (where the joint was seen) to 1 (far from there), with its samples.

    Args:
        joint: A potential in two coordinates.
        ax: To draw on; None: new ones.

    Raises:
        ValueError: it has other than two coordinates.
    """
    from matplotlib import pyplot

    samples = joint.samples_m
    if samples.shape[1] != 2:
        raise ValueError(f"the potential of {joint.joint!r} has {samples.shape[1]} coordinates, and a map has two")
    ax = pyplot.subplots(figsize=(4.6, 4), layout="constrained")[1] if ax is None else ax
    low, high = samples.min(axis=0), samples.max(axis=0)
    margin = MARGIN * float((high - low).max())
    x, y = (np.linspace(a - margin, b + margin, POINTS) for a, b in zip(low, high, strict=True))
    v = joint.value(np.stack(np.meshgrid(x, y), axis=-1))
    filled = ax.contourf(1e3 * x, 1e3 * y, v, levels=np.linspace(0.0, 1.0, 21), cmap="viridis")
    ax.plot(1e3 * samples[:, 0], 1e3 * samples[:, 1], ".", color="white", markersize=2, alpha=0.7)
    ax.set_aspect("equal")
    ax.set_xlabel("along the limb (mm)")
    ax.set_ylabel("across (mm)")
    ax.set_title(f"V_z of {joint.joint}", fontsize=10)
    ax.figure.colorbar(filled, ax=ax, label="V_z: 0 where it was seen, 1 far from there")
    return ax
