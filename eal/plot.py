"""A potential of one or two coordinates as a curve or a map."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from eal.arrays import Z95, Array

if TYPE_CHECKING:
    from eal.potential import EmpiricalPotential

POINTS = 160
"""Of the grid in each coordinate; of the samples' range, on each side."""
COLORS = "viridis_r"
"""Of every potential: 0, where the data are, is yellow, and 1 dark violet."""
SD_STEP = 0.1
"""Between the lines of equal standard deviation, where V is between 0 and 1. Chosen."""


def plot_potential(
    potential: "EmpiricalPotential", ax: Any = None, *, scale: float = 1.0, labels: Sequence[str] | None = None
) -> Any:
    """V_z from 0 (on the samples) to 1 (far from them), with the samples and its own standard deviation.

    That is of ``eal.radius.value_deviation``: what other recordings of the kind would change. Of two coordinates red
    lines show where it is 0.1, 0.2, ..., of one a band of 95 %.

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

    from eal.radius import value_deviation

    ax = pyplot.subplots(figsize=(4.6, 4), layout="constrained")[1] if ax is None else ax
    samples = potential.samples
    grid = grid_of(samples)
    labels = axis_labels(potential.names, potential.units) if labels is None else labels
    ax.set_xlabel(labels[0])
    deviation = partial(value_deviation, potential, rng=np.random.default_rng(0))  # the same image each time
    if potential.dimension == 1:
        v, sd = (f(grid[0][:, None]) for f in (potential.value, deviation))
        ax.fill_between(scale * grid[0], np.maximum(v - Z95 * sd, 0), np.minimum(v + Z95 * sd, 1), color="0.8")
        ax.plot(scale * grid[0], v, color="#0072B2")
        ax.plot(scale * samples[:, 0], np.zeros(len(samples)), "|", color="0.3")
        ax.set_ylabel("V_z")
        return ax
    v = potential.value(np.stack(np.meshgrid(*grid), axis=-1))
    filled = ax.contourf(*(scale * axis for axis in grid), v, levels=np.linspace(0.0, 1.0, 21), cmap=COLORS)
    ax.plot(scale * samples[:, 0], scale * samples[:, 1], ".", color="black", markersize=1.5, alpha=0.5)
    coarse = [axis[:: POINTS // 40] for axis in grid]
    sd = deviation(np.stack(np.meshgrid(*coarse), axis=-1))
    if sd.max() > SD_STEP:
        levels = np.arange(SD_STEP, sd.max(), SD_STEP)
        lines = ax.contour(*(scale * axis for axis in coarse), sd, levels=levels, colors="#D55E00", linewidths=0.8)
        ax.clabel(lines, fontsize=6, fmt="%.1f")
    ax.set_aspect("equal")
    ax.set_ylabel(labels[1])
    beside = ax.inset_axes((1.04, 0, 0.05, 1))  # as high as the map
    ax.figure.colorbar(filled, cax=beside, label="V_z: 0 on the samples, 1 far from them")
    return ax


def grid_of(samples: Array, *, points: int = POINTS) -> list[Array]:
    """Values along each coordinate, over the samples (N, d) and a margin."""
    low, high = samples.min(axis=0), samples.max(axis=0)
    margin = 0.35 * max(float((high - low).max()), 1e-12)  # of the samples' range, on each side
    return [np.linspace(a - margin, b + margin, points) for a, b in zip(low, high, strict=True)]


def axis_labels(names: Sequence[str], units: Sequence[str]) -> list[str]:
    """Names of coordinates with their units, where they have one."""
    return [name if unit == "1" else f"{name} ({unit})" for name, unit in zip(names, units, strict=True)]
