"""The animal as a stick figure at three phases of its motion, and the path of its body."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.plots.kinematics import COLOURS, styled
from mocap.records import Status
from mocap.tracking.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED, FILLED = COLOURS[0], COLOURS[1]


def draw_animal(run: Result) -> "Figure":
    """Three phases of the motion, markers measured and filled, and the path of the body.

    The plane of the image holds the animal's longest axis and the direction across it in which it moves most. Phases
    are those of the largest component of that motion: its two extremes, and the frame half-way between.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(180 / 25.4, 62 / 25.4), layout="constrained")
    axes = figure.subplots(1, 4, width_ratios=(1, 1, 1, 0.9))
    markers = run.tracks
    xyz, status = 1e3 * markers.xyz_m, markers.status
    frames, flat = _phases(xyz, status == Status.MEASURED)
    for ax, frame, title in zip(axes, frames, ("one extreme", "half-way", "other extreme"), strict=False):
        _draw(ax, flat[frame], status[frame] == Status.MEASURED, run)
        ax.set_title(f"{title}: frame {frame + 1}", fontsize=7)
    if len(frames):
        every = flat[frames].reshape(-1, 2)
        low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
        room = 0.06 * float((high - low).max()) or 1.0  # all markers may be at one place
        for ax in axes[:3]:
            ax.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room), aspect="equal")
            ax.axis("off")
        _scale_bar(axes[0], low, high)
    else:
        for ax in axes:
            ax.axis("off")
        axes[0].text(0, 0.5, "no frame shows nine tenths of the markers", fontsize=7)
    trunk = [markers.names.index(name) for name in run.skeleton.trunk] or slice(None)
    if len(frames):
        there = np.isfinite(xyz[:, trunk, 0])
        known = there.sum(axis=1) >= 0.9 * there.any(axis=0).sum()  # the mean of other markers is another place
        _path(axes[3], np.where(known[:, None], _middle(xyz[:, trunk]), np.nan))
    measured = status == Status.MEASURED
    kinds = (("measured", MEASURED, measured), ("filled", FILLED, ~measured & np.isfinite(xyz[..., 0])))
    keys = [
        Line2D([], [], marker="o", linestyle="", markersize=3.5, color=colour, label=name)
        for name, colour, where in kinds
        if where[frames].any()
    ]
    if keys:
        figure.legend(handles=keys, fontsize=7, frameon=False, ncols=2, loc="outside lower left")
    return figure


def _phases(xyz: Array, measured: NDArray[np.bool_]) -> tuple[list[int], Array]:
    """Three frames in which most markers have a position, and all positions (T, M, 2) in the plane of the image.

    Of these frames they are some in which nine tenths of the markers were measured or, where that is rarer, of the
    quarter in which most were. A single marker has no phases.
    """
    there = np.isfinite(xyz[..., 0])
    usual = there.any(axis=0)
    full = np.flatnonzero(there.sum(axis=1) >= 0.9 * usual.sum()) if usual.any() else np.zeros(0, dtype=int)
    if not len(full) or usual.sum() < 2:
        return [], np.full((*xyz.shape[:2], 2), np.nan)
    count = measured[full].sum(axis=1)
    full = full[count >= min(0.9 * usual.sum(), np.quantile(count, 0.75))]
    body = xyz - _middle(xyz)[:, None]
    some = np.nan_to_num(body[full])
    long = np.linalg.svd(some.mean(axis=0), full_matrices=False)[2][0]
    moves = some - some.mean(axis=0)
    moves = moves - (moves @ long)[..., None] * long
    up = np.linalg.svd(moves.reshape(-1, 3), full_matrices=False)[2][0]
    first = np.linalg.svd(moves.reshape(len(moves), -1), full_matrices=False)[0][:, 0]
    middle = int(np.argmin(np.abs(first - 0.5 * (first.min() + first.max()))))
    return [int(full[k]) for k in (np.argmin(first), middle, np.argmax(first))], body @ np.column_stack([long, up])


def _draw(ax: "Axes", xy: Array, measured: np.ndarray, run: Result) -> None:
    names = list(run.names)
    for bone in run.skeleton.bones:
        a, b = names.index(bone.a), names.index(bone.b)
        ax.plot(*xy[[a, b]].T, color="0.6", linewidth=1.2, zorder=1)
    for where, colour in ((measured, MEASURED), (~measured, FILLED)):
        ax.plot(*xy[where].T, "o", color=colour, markersize=3, zorder=2)


def _scale_bar(ax: "Axes", low: Array, high: Array) -> None:
    """A bar of a round length, about a quarter of the animal."""
    quarter = 0.25 * float((high - low).max())
    length = max((k * 10.0**e for e in range(-4, 6) for k in (1, 2, 5) if k * 10.0**e <= quarter), default=quarter)
    ax.plot([low[0], low[0] + length], [low[1]] * 2, color="0.2", linewidth=1.5, solid_capstyle="butt")
    below = {"xytext": (0, -2), "textcoords": "offset points", "va": "top", "annotation_clip": False}
    ax.annotate(f"{length:g} mm", tuple(low), fontsize=6.5, **below)


def _middle(xyz: Array) -> Array:
    """(T, 3) mean of the markers that have a position; NaN without any."""
    seen = np.isfinite(xyz)
    count = seen.sum(axis=1)
    return np.where(count > 0, np.where(seen, xyz, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)


def _path(ax: "Axes", middle: Array) -> None:
    """The body (T, 3) in the plane in which it moves most, equal axes, its direction; broken where it is not known."""
    seen = np.isfinite(middle[:, 0])
    ax.set_title("path of the body", fontsize=7)
    styled(ax)
    if seen.sum() < 2:
        return
    away = middle - middle[seen].mean(axis=0)
    path = away @ np.linalg.svd(away[seen], full_matrices=False)[2][:2].T
    path = path - path[seen][0]
    ax.plot(*path.T, color=COLOURS[0], linewidth=0.9)
    path = path[seen]
    ax.plot(*path[0], "o", color=COLOURS[0], markersize=3)
    tip = {"arrowstyle": "->", "color": COLOURS[0]}
    ax.annotate("", path[-1], path[max(0, len(path) - 1 - len(path) // 20)], arrowprops=tip)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("mm", fontsize=7)
