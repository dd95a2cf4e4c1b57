"""Figures of kinematics: angles with their intervals, curves over the phase, gait diagrams, gaps, residuals.

Colours are those of Okabe & Ito (2008), which the colour-blind can tell apart; figures are one or two columns of a
journal wide.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Z95, Array, true_runs
from mocap.kinematics.cycles import Cycle, Ensemble, Footfalls, ensemble
from mocap.kinematics.records import Kinematics, Quantity, Rests
from mocap.records import Status
from mocap.sides import words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Blue, vermillion, green, purple, orange, sky blue."""
GAP = "#E8E8E8"
LEAVES = "interval leaves the axes"
"""What a triangle at the edge of the axes says: an interval wider than all that is drawn of the curve."""
UNITS = {
    "deg": "°",
    "deg_s": "°/s",
    "deg_s2": "°/s²",
    "m": "m",
    "m_s": "m/s",
    "m_s2": "m/s²",
    "m2": "m²",
    "m2_s": "m²/s",
    "m2_s2": "m²/s²",
}


def new_axes(*, width_mm: float = 86.0, height_mm: float = 60.0, left_mm: float = 13.0, rows: int = 1) -> "Axes":
    """Axes of a figure of its own, with room on the left for labels and above for so many rows of a legend."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_mm / 25.4, height_mm / 25.4))
    top, bottom, right = 2.0 + 3.6 * rows, 10.0, 3.0
    whole = (left_mm / width_mm, bottom / height_mm, 1 - (left_mm + right) / width_mm, 1 - (top + bottom) / height_mm)
    ax = figure.add_axes(whole)
    styled(ax)
    return ax


def styled(ax: "Axes") -> None:
    """Text of 7 points, no frame above and to the right."""
    ax.tick_params(labelsize=7, length=3, width=0.6)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        ax.spines[side].set_linewidth(0.6)


def labelled(ax: "Axes", x: str | None = None, y: str | None = None) -> None:
    """Titles of the axes; None: that one has none."""
    for title, what in ((ax.set_xlabel, x), (ax.set_ylabel, y)):
        if what is not None:
            title(what, fontsize=7)


def legend_above(ax: "Axes", *, size: float = 6.5, up: float = 1.0, **more: Any) -> None:
    """A legend without a frame above the axes."""
    place = {"loc": "lower left", "bbox_to_anchor": (0, up), "borderaxespad": 0.1}
    ax.legend(fontsize=size, frameon=False, **{**place, **more})


def label(name: str) -> str:
    """A quantity's name without its unit, as words."""
    for unit in sorted(UNITS, key=len, reverse=True):
        if name.endswith(f"_{unit}"):
            return words(name.removesuffix(f"_{unit}"))
    return words(name)


def plot_over_time(found: Kinematics, quantities: Sequence[str], *, ax: "Axes | None" = None) -> "Axes":
    """Quantities of one unit over time with their 95 % intervals, and below them how wide these are.

    A bar at the bottom shows, in the colour of each quantity, where it rests on filled markers.

    Args:
        found: The quantities.
        quantities: Names of one to three of them.
        ax: To draw values on alone; None: new axes, with the widths of the intervals below.
    """
    below = None
    if ax is None:
        ax, below = stacked(1)[0]
    lines_over_time(ax, below, [found[name] for name in quantities], found.t_s)
    (below or ax).set_xlabel("time (s)", fontsize=7)
    return ax


def stacked(n: int) -> "list[tuple[Axes, Axes]]":
    """So many pairs of axes below each other: one for values, one for the widths of their intervals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(180 / 25.4, (10 + 52 * n) / 25.4), layout="constrained")
    axes = figure.subplots(2 * n, 1, sharex=True, height_ratios=[3, 1] * n)
    for ax in axes:
        styled(ax)
    return [(axes[2 * k], axes[2 * k + 1]) for k in range(n)]


def beside_each_other(n: int, *, rows: int) -> "list[Axes]":
    """Axes beside each other with one scale, and room above for so many rows of a legend."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(86 * n / 25.4, (48 + 3.6 * rows) / 25.4), layout="constrained")
    axes = figure.subplots(1, n, sharey=True, squeeze=False)[0]
    for ax in axes:
        styled(ax)
    return list(axes)


def lines_over_time(ax: "Axes", below: "Axes | None", several: Sequence[Quantity], t_s: Array) -> None:
    """Values with their 95 % intervals; on ``below`` half the width of these."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    keys, bottom = [], 0.0
    for q, colour in zip(several, COLOURS, strict=False):
        ax.fill_between(t_s, q.low, q.high, color=colour, alpha=0.25, linewidth=0)
        keys += ax.plot(t_s, q.value, color=colour, linewidth=0.9, label=label(q.name))
        filled = q.rests == Rests.FILLED
        if filled.any():
            look = {"step": "mid", "transform": ax.get_xaxis_transform(), "color": colour, "linewidth": 0}
            ax.fill_between(t_s, bottom, bottom + 0.022, where=filled.tolist(), **look)
            bottom += 0.03
        if below is not None:
            below.plot(t_s, 0.5 * (q.high - q.low), color=colour, linewidth=0.7)
    if any(np.isfinite(q.sd).any() for q in several):
        keys.append(Patch(color=COLOURS[0], alpha=0.25, label="95 % interval"))
    if bottom:
        keys.append(Patch(color="0.4", label="bars: filled markers"))
    ax.set_ylim(*_limits(several))
    left = [_leaves(ax, q, t_s, colour) for q, colour in zip(several, COLOURS, strict=False)]
    if any(left):
        keys.append(Line2D([], [], color="0.4", marker="^", markersize=3.5, linestyle="", label=LEAVES))
    there = np.flatnonzero(np.any([np.isfinite(q.value) for q in several], axis=0))
    if len(there):
        _over(ax, t_s[there])
    unit = UNITS[several[0].unit]
    ax.set_ylabel(f"{'angle' if several[0].unit == 'deg' else label(several[0].name)} ({unit})", fontsize=7)
    legend_above(ax, size=7, handles=keys, ncols=5)
    if below is not None:
        below.set_ylim(bottom=0)
        below.set_ylabel(f"± ({unit})", fontsize=7)


def _limits(several: Sequence[Quantity]) -> tuple[float, float]:
    """Of values, and of their intervals but those that say hardly anything; room below for the bars.

    An interval is drawn whole if it is no wider than all values together, or than half of the intervals are: the axis
    is then at most twice as high as the curve, or holds half of all intervals of one that stands still.
    """
    low, high = sensible([q.value for q in several])
    for q in several:
        width = q.high - q.low
        known = np.isfinite(width)
        if known.any():
            known &= width <= max(high - low, float(np.median(width[known])))
            low, high = min(low, float(q.low[known].min())), max(high, float(q.high[known].max()))
    high = high if high > low else low + 1  # one value all the time
    return low - 0.08 * (high - low), high + 0.02 * (high - low)


def _leaves(ax: "Axes", q: Quantity, t_s: Array, colour: str) -> bool:
    """A triangle at the edge of the axes, in the middle of each time in which an interval leaves them there."""
    low, high = ax.get_ylim()
    found = False
    for beyond, edge, marker in ((q.high > high, 1.0, "^"), (q.low < low, 0.0, "v")):
        runs = true_runs(np.asarray(beyond))
        look = {"transform": ax.get_xaxis_transform(), "clip_on": False, "color": colour, "markersize": 3.5}
        at = [0.5 * float(t_s[start] + t_s[stop - 1]) for start, stop in runs]
        for mark in ax.plot(at, [edge] * len(at), marker, zorder=4, **look):
            mark.set_in_layout(False)
        found = found or bool(at)
    return found


def _over(ax: "Axes", t_s: Array) -> None:
    """From the first to the last of times; one alone has no axis to be over."""
    if t_s[-1] > t_s[0]:
        ax.set_xlim(float(t_s[0]), float(t_s[-1]))


def half_frame(t_s: Array) -> float:
    """Half of the usual time between frames, s."""
    return 0.5 * float(np.median(np.diff(t_s))) if len(t_s) > 1 else 0.5


def shade(ax: "Axes", t_s: Array, where: NDArray[np.bool_]) -> None:
    """Grey where something holds."""
    half = half_frame(t_s)
    for start, stop in true_runs(where):
        ax.axvspan(t_s[start] - half, t_s[stop - 1] + half, color=GAP, linewidth=0, zorder=0)


def sensible(values: Sequence[Array]) -> tuple[float, float]:
    """Limits that hold all but the outermost half per cent at each end, with room; one outlier flattens no plot."""
    every = np.concatenate([v[np.isfinite(v)] for v in values])
    if not len(every):
        return 0.0, 1.0
    low, high = np.percentile(every, [0.5, 99.5])
    room = 0.08 * max(high - low, 1e-9)
    return float(low - room), float(high + room)


def plot_by_phase(
    curves: Sequence[Ensemble], *, unit: str, of: str, turning: float | None = None, ax: "Axes | None" = None
) -> "Axes":
    """Mean curves over the phase of a cycle, with the 95 % interval of the mean, and each cycle thin.

    Args:
        curves: Of quantities of one unit.
        unit: Theirs.
        of: What a cycle is, in words.
        turning: Phase of the lower turning point, where the cycle begins at the upper one; None: it does not.
        ax: To draw on; None: new ones.
    """
    ax = new_axes(rows=len(curves) + (turning is not None)) if ax is None else ax
    for one, colour in zip(curves, COLOURS, strict=False):
        for curve in one.curves:
            ax.plot(one.phase, curve, color=colour, linewidth=0.3, alpha=0.35)
        ax.fill_between(one.phase, one.low, one.high, color=colour, alpha=0.35, linewidth=0)
        ax.plot(one.phase, one.mean, color=colour, linewidth=1.2, label=f"{label(one.quantity)} (n = {one.n})")
    if turning is not None and np.isfinite(turning):
        ax.axvline(turning, color="0.5", linewidth=0.7, linestyle="--")
        for phase, text, side in ((0.0, "upper", "left"), (turning, "lower", "center"), (1.0, "upper", "right")):
            place = {"xycoords": ("data", "axes fraction"), "xytext": (0, 1), "textcoords": "offset points"}
            ax.annotate(text, (phase, 1), fontsize=6, ha=side, color="0.35", **place)
    ax.set_xlim(0, 1)
    labelled(ax, f"phase of the {of} (cycles)", f"{'angle' if unit == 'deg' else 'value'} ({UNITS[unit]})")
    legend_above(ax, up=1.0 if turning is None else 1.06)
    return ax


def plot_gait(steps: Footfalls, *, ax: "Axes | None" = None) -> "Axes":
    """Gait diagram: a bar where a foot stands, with its duty factor."""
    ax = new_axes(width_mm=180, height_mm=16 + 7 * len(steps.feet), left_mm=18) if ax is None else ax
    half = half_frame(steps.t_s)
    for row in range(len(steps.feet)):
        for start, stop in true_runs(steps.stance[:, row]):
            left = steps.t_s[start] - half
            ax.barh(row, steps.t_s[stop - 1] + half - left, left=left, height=0.6, color=COLOURS[row % len(COLOURS)])
    ax.set_yticks(range(len(steps.feet)), [words(foot) for foot in steps.feet])
    ax.invert_yaxis()
    _over(ax, steps.t_s)
    ax.set_xlabel("time (s)", fontsize=7)
    ax.set_title("gait diagram: bars are stance", fontsize=7, loc="left")
    return ax


def plot_cycle_values(rows: Sequence[Cycle], what: str, *, unit: str, ax: "Axes | None" = None) -> "Axes":
    """A value of each cycle over time, by limb, with its 95 % interval where that is known."""
    ax = new_axes(rows=len({row.of for row in rows})) if ax is None else ax
    stem, _, end = what.rpartition("_")
    for k, limb in enumerate(dict.fromkeys(row.of for row in rows)):
        some = [row for row in rows if row.of == limb]
        values = np.array([getattr(row, what) for row in some])
        left_out = np.flatnonzero(np.diff([row.number for row in some]) > 1) + 1  # no line leads across these
        line = np.insert(np.stack([[row.start_s for row in some], values]), left_out, np.nan, axis=1)
        ax.plot(*line, color=COLOURS[k % len(COLOURS)], linewidth=0.7)
        half = Z95 * np.array([getattr(row, f"{stem}_sd_{end}", np.nan) for row in some])
        text = f"{words(limb)}: {np.mean(values):.2f} ± {np.std(values):.2f} {unit} (mean ± SD, n = {len(some)})"
        ax.errorbar(
            [row.start_s for row in some], values, np.where(np.isfinite(half), half, 0.0), fmt="o", markersize=2.5,
            color=COLOURS[k % len(COLOURS)], elinewidth=0.7, capsize=1.2, label=text,
        )  # fmt: skip
    labelled(ax, "time (s)", f"{stem.replace('_', ' ')} ({unit})")
    legend_above(ax)
    return ax


def plot_stroke_path(found: Kinematics, name: str, rows: Sequence[Cycle] = (), *, ax: "Axes | None" = None) -> "Axes":
    """Path of a limb in and out of its stroke plane, with equal axes; the mean of its cycles, and which way it goes."""
    ax = new_axes(rows=1) if ax is None else ax
    stroke, aside = found[f"{name}_stroke_deg"], found[f"{name}_deviation_deg"]
    ax.axhline(0, color="0.8", linewidth=0.6)
    ax.plot(stroke.value, aside.value, color="0.65", linewidth=0.5, label="each cycle")
    filled = stroke.rests == Rests.FILLED
    if filled.any():
        ax.plot(stroke.value[filled], aside.value[filled], ".", color=COLOURS[1], markersize=1.5, label="filled")
    along, out = (ensemble(found, rows, q.name).mean for q in (stroke, aside))
    if np.isfinite(along).all():
        ax.plot(along, out, color=COLOURS[0], linewidth=1.6, label="mean")
        for k in (len(along) // 4, 3 * len(along) // 4):
            tip = {"arrowstyle": "->", "color": COLOURS[0], "linewidth": 1.6}
            ax.annotate("", (along[k + 2], out[k + 2]), (along[k], out[k]), arrowprops=tip)
    ax.set_aspect("equal", adjustable="datalim")
    labelled(ax, f"{words(name)}: stroke angle, up is positive (°)", "out of the stroke plane (°)")
    legend_above(ax, ncols=3)
    return ax


def plot_gaps(names: Sequence[str], t_s: Array, status: NDArray[np.int8], *, ax: "Axes | None" = None) -> "Axes":
    """Where each marker was filled, extrapolated, rejected or missing, in frames that show any: a row each, named."""
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    ax = new_axes(width_mm=180, height_mm=20 + 3.2 * len(names), left_mm=22) if ax is None else ax
    known = np.flatnonzero((status != Status.MISSING).any(axis=1))
    if len(known):  # frames before and after all sightings are left out
        part = slice(int(known[0]), int(known[-1]) + 1)
        t_s, status = t_s[part], status[part]
    kinds = (
        ("measured", "0.93", status == Status.MEASURED),
        ("filled", COLOURS[1], (status == Status.SMOOTHED) | (status == Status.INTERPOLATED)),
        ("extrapolated", COLOURS[4], status == Status.PREDICTED),
        ("rejected", COLOURS[3], status == Status.REJECTED),
        ("missing", "0.25", status == Status.MISSING),
    )
    picture = np.ones((*status.shape, 3))
    for _, colour, where in kinds:
        picture[where] = to_rgb(colour)
    half = half_frame(t_s)
    span = (t_s[0] - half, t_s[-1] + half, len(names) - 0.5, -0.5)
    ax.imshow(np.swapaxes(picture, 0, 1), aspect="auto", interpolation="nearest", extent=span)
    ax.hlines(np.arange(0.5, len(names) - 1), *span[:2], color="white", linewidth=0.5)  # markers apart
    ax.set_yticks(range(len(names)), [words(name) for name in names], fontsize=5.5)
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("time (s)", fontsize=7)
    shares = [(what, colour, 100 * float(where.mean())) for what, colour, where in kinds if where.any()]
    keys = [Patch(color=colour, label=f"{what} {share:.1f} %") for what, colour, share in shares]
    ax.legend(handles=keys, fontsize=6.5, frameon=False, ncols=5, loc="lower left", bbox_to_anchor=(0, 1.0))
    return ax


def plot_residuals(
    cameras: Sequence[str], residual_px: Array, used: NDArray[np.bool_], *, ax: "Axes | None" = None
) -> "Axes":
    """Distance of each camera's pixels from the tracked markers: median, and the middle half and 90 %.

    Args:
        cameras: The C cameras.
        residual_px: (C, T, M) distances; NaN where nothing was seen.
        used: (C, T, M) pixels that were believed.
        ax: To draw on; None: new ones.
    """
    ax = new_axes(height_mm=18 + 4.5 * len(cameras), left_mm=18, rows=0) if ax is None else ax
    for row in range(len(cameras)):
        values = residual_px[row][used[row] & np.isfinite(residual_px[row])]
        if len(values):
            five, low, mid, high, most = np.percentile(values, [5, 25, 50, 75, 95])
            ax.plot([five, most], [row, row], color=COLOURS[0], linewidth=0.8)
            ax.plot([low, high], [row, row], color=COLOURS[0], linewidth=3.5, solid_capstyle="butt")
            ax.plot([mid], [row], "o", color="white", markeredgecolor=COLOURS[0], markersize=3.5)
    ax.set_yticks(range(len(cameras)), cameras, fontsize=6)
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(len(cameras) - 0.4, -0.6)
    ax.set_xlim(left=0)
    ax.set_xlabel("px from the tracked markers: median, 50 and 90 %", fontsize=7)
    return ax


def plot_coordinates(
    t_s: Array,
    q_m: Array,
    sd_m: Array,
    filled: NDArray[np.bool_],
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
        color = COLOURS[k % 3]
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
