"""A potential of one or two coordinates as a curve or a map."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from eal.potential import EmpiricalPotential

POINTS, MARGIN = 160, 0.35
"""Of the grid in each coordinate; of the samples' range, on each side."""


def plot_potential(
    potential: "EmpiricalPotential", ax: Any = None, *, scale: float = 1.0, labels: Sequence[str] | None = None
) -> Any:
    """V_z from 0 (on the samples) to 1 (far from them), with the samples.

    Args:
        potential: Of one or two coordinates.
        ax: Matplotlib axes to draw on; None: new ones.
        scale: The axes show so many times the coordinates, as for another unit.
        labels: Of the coordinates, as shown; None: the potential's own names and units.

    Returns:
        The axes.

    Raises:
        ValueError: it has more coordinates.
    """
    if potential.dimension > 2:
        raise ValueError(
            f"a potential of {potential.dimension} coordinates has no map: fix all but two, and draw value() of these"
        )
    from matplotlib import pyplot

    ax = pyplot.subplots(figsize=(4.6, 4), layout="constrained")[1] if ax is None else ax
    samples = potential.samples
    low, high = samples.min(axis=0), samples.max(axis=0)
    margin = MARGIN * max(float((high - low).max()), 1e-12)
    grid = [np.linspace(a - margin, b + margin, POINTS) for a, b in zip(low, high, strict=True)]
    named = zip(potential.names, potential.units, strict=True)
    labels = [name if unit == "1" else f"{name} ({unit})" for name, unit in named] if labels is None else labels
    ax.set_xlabel(labels[0])
    if potential.dimension == 1:
        ax.plot(scale * grid[0], potential.value(grid[0][:, None]), color="#0072B2")
        ax.plot(scale * samples[:, 0], np.zeros(len(samples)), "|", color="0.3")
        ax.set_ylabel("V_z")
        return ax
    v = potential.value(np.stack(np.meshgrid(*grid), axis=-1))
    filled = ax.contourf(*(scale * axis for axis in grid), v, levels=np.linspace(0.0, 1.0, 21), cmap="viridis_r")
    ax.plot(scale * samples[:, 0], scale * samples[:, 1], ".", color="black", markersize=1.5, alpha=0.5)
    ax.set_aspect("equal")
    ax.set_ylabel(labels[1])
    beside = ax.inset_axes((1.04, 0, 0.05, 1))  # as high as the map
    ax.figure.colorbar(filled, cax=beside, label="V_z: 0 on the samples, 1 far from them")
    return ax
