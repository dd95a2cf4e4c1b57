"""The paper's axes: double logarithmic curves with spread and a reference slope, maps, and paths."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure as Canvas

from eal.arrays import Array
from eal.plot import COLORS


@dataclass(frozen=True, eq=False, kw_only=True)
class Curve:
    """One curve with its spread over seeds.

    Attributes:
        label: Legend.
        x: (n,) abscissae.
        y: (n, seeds) or (n,) ordinates; the median is drawn, and the range shaded.
        state: (n,) another error at the same abscissae, drawn dotted; empty: none.
        dashed: Drawn as a dashed line.
    """

    label: str
    x: Array
    y: Array
    state: Array = field(default_factory=lambda: np.empty(0))
    dashed: bool = False


def log_log(
    canvas: Canvas, curves: Sequence[Curve], *, x_label: str, y_label: str, title: str, slope: float | None = -0.5
) -> None:
    """Curves on logarithmic axes, with a dashed reference line of the given slope above them."""
    axes = canvas.subplots()
    colours = _colours(sum(not curve.dashed for curve in curves)) * 2  # dashed ones repeat the colours of the others
    top = 0.0
    for curve, colour in zip(curves, colours, strict=False):
        y = curve.y if curve.y.ndim == 2 else curve.y[:, None]
        line = "s--" if curve.dashed else "o-"
        axes.loglog(curve.x, np.median(y, axis=1), line, color=colour, label=curve.label, markersize=3, linewidth=1.2)
        if y.shape[1] > 1:
            axes.fill_between(curve.x, y.min(axis=1), y.max(axis=1), color=colour, alpha=0.18, linewidth=0)
        if len(curve.state):
            axes.loglog(curve.x, curve.state, ":", color=colour, linewidth=1)
        top = max(top, float(np.median(y, axis=1)[0]))
    if slope is not None:
        x = curves[0].x
        axes.loglog(x, 2.0 * top * (x / x[0]) ** slope, "k--", linewidth=1, label=f"slope {slope:g}")
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.set_title(title, fontsize=10)
    axes.grid(visible=True, which="major", alpha=0.3)
    axes.legend(fontsize=7, frameon=False)


def landscape(canvas: Canvas, x: Array, y: Array, v: Array, samples: Array, *, unit: str, title: str) -> None:
    """A normalised potential as a filled map with the samples on it."""
    axes = canvas.subplots()
    filled = axes.contourf(x, y, v, levels=np.linspace(0.0, 1.0, 21), cmap=COLORS)
    axes.plot(samples[:, 0], samples[:, 1], ".", color="black", markersize=1.5, alpha=0.6)
    axes.set_aspect("equal")
    axes.set_xlabel(f"$q_1$ ({unit})")
    axes.set_ylabel(f"$q_2$ ({unit})")
    axes.set_title(title, fontsize=10)
    canvas.colorbar(filled, ax=axes, label="normalised V")


def over_time(
    canvas: Canvas, t_s: Array, panels: Sequence[tuple[str, Sequence[tuple[str, Array]]]], title: str
) -> None:
    """Stacked panels over time: (ordinate label, [(legend, values)])."""
    rows = canvas.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (label, lines) in zip(rows, panels, strict=True):
        for colour, (name, values) in zip(["black", *_colours(len(lines))], lines, strict=False):
            axes.plot(t_s, values, label=name, linewidth=1, color=colour)
        axes.set_ylabel(label)
        axes.grid(visible=True, alpha=0.3)
        axes.legend(fontsize=7, frameon=False, loc="upper right")
    rows[-1].set_xlabel("t (s)")
    rows[0].set_title(title, fontsize=10)


def paths(canvas: Canvas, samples: Array, runs: Sequence[tuple[str, Array]], *, unit: str, title: str) -> None:
    """Trajectories in the plane over the samples they were learned from, one panel a trajectory."""
    width, height = np.ptp(samples, axis=0)
    shape = (len(runs), 1) if width > height else (1, len(runs))
    panels = canvas.subplots(*shape, sharex=True, sharey=True, squeeze=False).reshape(-1)
    for axes, (label, path) in zip(panels, runs, strict=True):
        axes.plot(samples[:, 0], samples[:, 1], ".", color="0.6", markersize=3)
        axes.plot(path[:, 0], path[:, 1], color="C3", linewidth=1)
        axes.set_aspect("equal")
        axes.set_title(label, fontsize=8)
        axes.set_ylabel(f"y ({unit})")
    panels[-1].set_xlabel(f"x ({unit})")
    canvas.suptitle(title, fontsize=10)


def _colours(n: int) -> list[tuple[float, ...]]:
    return [tuple(c) for c in colormaps["viridis"](np.linspace(0.0, 0.85, max(n, 1)))]
