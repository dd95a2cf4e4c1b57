"""Coordinates of a joint over time."""

from typing import TYPE_CHECKING

import numpy as np

from eal.arrays import Z95, Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

SERIES = ("#0072B2", "#D55E00", "#009E73")
"""Blue, vermillion and green of Okabe & Ito 2008."""


def plot_coordinates(
    t_s: Array,
    q_m: Array,
    sd_m: Array,
    filled: "NDArray[np.bool_]",
    *,
    labels: tuple[str, ...],
    title: str,
    ax: "Axes | None" = None,
) -> "Axes":
    """Lines with their 95 % interval; where a sample is filled, a grey bar below.

    Args:
        t_s: (T,) times.
        q_m: (T, d) coordinates in metres.
        sd_m: (T,) standard deviation of a coordinate.
        filled: (T,) frames that rest on at least one sample that was not measured.
        labels: Of the d coordinates.
        title: Of the axes.
        ax: To draw on; None: new ones.
    """
    from matplotlib import pyplot

    ax = pyplot.subplots(figsize=(8, 3.2), layout="constrained")[1] if ax is None else ax
    for k, label in enumerate(labels):
        value, half = 1e3 * q_m[:, k], 1e3 * Z95 * sd_m
        color = SERIES[k % len(SERIES)]
        ax.fill_between(t_s, value - half, value + half, color=color, alpha=0.2, linewidth=0)
        ax.plot(t_s, value, color=color, linewidth=1.2, label=label)
    if filled.any():
        ax.fill_between(
            t_s, 0, 0.02, where=filled.tolist(), transform=ax.get_xaxis_transform(), color="0.45", label="filled"
        )
    there = np.flatnonzero(np.isfinite(q_m).any(axis=1))
    if len(there) > 1:
        first, last = float(t_s[there[0]]), float(t_s[there[-1]])
        ax.set_xlim(first - 0.03 * (last - first), last + 0.03 * (last - first))
    ax.set_xlabel("time (s)")
    ax.set_ylabel("mm")
    ax.set_title(title, fontsize=10)
    ax.legend(fontsize=8, frameon=False, ncols=4)
    return ax
