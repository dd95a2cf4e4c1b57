"""A potential of one or two coordinates as a curve or a map."""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from eal.potential import EmpiricalPotential

POINTS, MARGIN = 160, 0.35
"""Of the grid in each coordinate; of the samples' range, on each side."""


def plot_potential(potential: "EmpiricalPotential", ax: Any = None) -> Any:
    """V_z from 0 (on the samples) to 1 (far from them), with the samples.

    Args:
        potential: Of one or two coordinates.
        ax: Matplotlib axes to draw on; None: new ones.

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
    title = [
        f"{name} ({unit})" if unit != "1" else name for name, unit in zip(potential.names, potential.units, strict=True)
    ]
    ax.set_xlabel(title[0])
    if potential.dimension == 1:
        ax.plot(grid[0], potential.value(grid[0][:, None]), color="#0072B2")
        ax.plot(samples[:, 0], np.zeros(len(samples)), "|", color="0.3")
        ax.set_ylabel("V_z")
        return ax
    v = potential.value(np.stack(np.meshgrid(*grid), axis=-1))
    filled = ax.contourf(*grid, v, levels=np.linspace(0.0, 1.0, 21), cmap="viridis")
    ax.plot(samples[:, 0], samples[:, 1], ".", color="white", markersize=2, alpha=0.7)
    ax.set_aspect("equal")
    ax.set_ylabel(title[1])
    ax.figure.colorbar(filled, ax=ax, label="V_z: 0 on the samples, 1 far from them")
    return ax
