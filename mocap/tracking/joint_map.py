"""One picture of a joint's potential, which the viewer, the desk and ``JointPotential.plot`` show."""

from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from contourpy import contour_generator

from eal.arrays import Z95, Array, short_repr
from eal.plot import COLORS
from eal.potential import EmpiricalPotential
from eal.radius import value_deviation
from mocap.sides import words

EDGE = 0.5
"""The value of the potential at the edge of a joint's range."""
NEVER = 0.9
"""Where it is higher the joint was never near."""
GRID, OUTSIDE = 121, 0.999
"""Points along an edge of the map, and the potential from which on no other recording would make it an edge."""
RESAMPLES, RANK = 24, 200
"""What its interval is made of: a joint's standard deviation is known to a fifth then (40 and 300: to 16 %)."""
BIN_DEG = 5.0
"""Width of the bars that say how often the joint was at an angle."""
REACH, BARS = 1.6, (1.1, 1.38)
"""As far as the map shows its angles, and where the bars begin and the longest ends, in lengths of the segment."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JointMap:
    """A potential in the plane of its limb, and what a person looks for in it.

    Attributes:
        name: Of the joint, in words.
        length_mm: Of the segment after the joint: the median of the samples.
        x_mm: (G,) first coordinate of the grid, along the segment before the joint.
        y_mm: (G,) second coordinate; same spacing.
        value: (G, G) potential at (y, x), between 0 and 1.
        edge_mm: Lines (n, 2) on which it is ``EDGE``.
        interval_mm: Lines on which that edge could lie: ends of the 95 % interval of the potential.
        samples_mm: (N, 2) samples that it was learned from.
        degrees: (B,) middle of each bar, degrees of flexion: 0 where both segments are in line.
        share: (B,) part of the samples in it.
        never_deg: A direction in which the joint never was; NaN: none is free.
    """

    __repr__ = short_repr

    name: str
    length_mm: float
    x_mm: Array
    y_mm: Array
    value: Array
    edge_mm: list[Array]
    interval_mm: list[Array]
    samples_mm: Array
    degrees: Array
    share: Array
    never_deg: float

    @property
    def bounds_mm(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top."""
        x, y = self.x_mm, self.y_mm
        return float(x[0]), float(x[-1]), float(y[0]), float(y[-1])


def joint_map(joint: str, potential: EmpiricalPotential, samples_m: Array, scale_m: float) -> JointMap:
    """The map of a potential of two coordinates.

    Args:
        joint: Its name.
        potential: V_z on coordinates divided by ``scale_m``.
        samples_m: (N, 2) its samples in metres.
        scale_m: Metres a unit of the potential's coordinates.
    """
    samples = 1e3 * samples_m[np.isfinite(samples_m).all(axis=1)]
    radius = np.hypot(*samples.T)
    length = max(float(np.median(radius)), 1e-3)
    angle = np.degrees(np.arctan2(samples[:, 1], samples[:, 0]))
    bins = np.arange(-180.0, 180.0 + BIN_DEG, BIN_DEG)
    share = np.histogram(angle, bins)[0] / len(angle)
    middle = bins[:-1] + BIN_DEG / 2
    ticks = _ticks(middle[share > 0])
    around = np.array([_at(REACH * length, one) for one in ticks])
    ring = 1.15 * length * np.array([(-1.0, -1.0), (1.0, 1.0)])
    shown = np.concatenate([around, ring, 1.1 * samples])  # a soft segment reaches beyond its median
    low, high = shown.min(axis=0), shown.max(axis=0)
    corner = (low + high) / 2 - (high - low).max() / 2

    x, y = corner[:, None] + np.linspace(0.0, float((high - low).max()), GRID)
    q = np.stack(np.meshgrid(x, y), axis=-1) / (1e3 * scale_m)
    value = potential.value(q)
    near, sd = value < OUTSIDE, np.zeros_like(value)
    rng = np.random.default_rng(0)  # the same picture each time
    sd[near] = value_deviation(potential, q[near], rng=rng, resamples=RESAMPLES, max_rank=RANK)
    ends = [_lines(x, y, value + sign * Z95 * sd) for sign in (-1, 1)]
    return JointMap(
        name=words(joint),
        length_mm=length,
        x_mm=x,
        y_mm=y,
        value=value,
        edge_mm=_lines(x, y, value),
        interval_mm=[line for lines in ends for line in lines],
        samples_mm=samples,
        degrees=middle[share > 0],
        share=share[share > 0],
        never_deg=_never(potential, angle, length / (1e3 * scale_m)),
    )


def _lines(x: Array, y: Array, value: Array) -> list[Array]:
    return [np.asarray(line, dtype=np.float64) for line in contour_generator(x, y, value).lines(EDGE)]


def _ticks(degrees: Array) -> list[int]:
    """Angles that are written: straight, and each 30 degrees round those where the joint was."""
    low, high = 30 * int(np.floor(degrees.min() / 30)), 30 * int(np.ceil(degrees.max() / 30))
    ticks = sorted({0, *range(low, high + 1, 30)})
    return [one for one in ticks if one != -180 or 180 not in ticks]  # the same place


def _never(potential: EmpiricalPotential, angle: Array, length: float) -> float:
    """The direction farthest from all samples and from both directions of the segment before; NaN: none is free."""
    tried = np.arange(-175.0, 180.0, 5.0)
    taken = np.concatenate([angle, [0.0, 180.0]])
    away = np.abs((tried[:, None] - taken + 180) % 360 - 180).min(axis=1)
    q = length * np.stack([np.cos(np.radians(tried)), np.sin(np.radians(tried))], axis=-1)
    free = (potential.value(0.7 * q) > NEVER) & (potential.value(q) > NEVER) & (away > 20)
    return float(tried[np.argmax(np.where(free, away, -1))]) if free.any() else float("nan")


def draw_map(found: JointMap, ax: Any, *, bare: bool = False) -> Any:
    """Draw it: yellow where the joint is often, violet where it never is; both segments, angles, how often, the edge.

    Args:
        found: The map.
        ax: Matplotlib axes.
        bare: Without title and key, for a picture that others frame.

    Returns:
        The axes.
    """
    left, right, bottom, top = found.bounds_mm
    ax.imshow(
        found.value, origin="lower", extent=(left, right, bottom, top), cmap=COLORS, vmin=0, vmax=1, zorder=0,
        interpolation="bilinear",
    )  # fmt: skip
    ax.plot(*found.samples_mm.T, ".", color="black", markersize=1.5, alpha=0.4, zorder=1)
    for line in found.edge_mm:
        ax.plot(*line.T, color="white", linewidth=1.6, zorder=3)
    for line in found.interval_mm:
        ax.plot(*line.T, ":", color="white", linewidth=0.9, zorder=3)
    _draw_segments(found, ax)
    _draw_angles(found, ax)
    if np.isfinite(found.never_deg):
        ax.text(*_at(0.75 * found.length_mm, found.never_deg), "never there", **_TEXT, style="italic")
    ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xticks=[], yticks=[])
    if not bare:
        ax.set_title(f"{found.name}: yellow where it was held, violet where it never was", fontsize=9)
        key = "white line: edge of its range (dotted: 95 % interval) · bars: how often · dots: frames"
        ax.set_xlabel(key, fontsize=7)
    return ax


_TEXT = {"fontsize": 9, "ha": "center", "va": "center", "color": "white", "zorder": 6}


def _at(radius: float, degrees: float) -> tuple[float, float]:
    return radius * float(np.cos(np.radians(degrees))), radius * float(np.sin(np.radians(degrees)))


def _draw_segments(found: JointMap, ax: Any) -> None:
    """The segment before the joint, the mean of the next one, and where that is in line with the first."""
    length, mean = found.length_mm, found.samples_mm.mean(axis=0)
    ax.plot([-length, 0], [0, 0], "o-", color="white", linewidth=3, markersize=5, zorder=5)
    ax.plot([0, mean[0]], [0, mean[1]], "o-", color="white", linewidth=2, markersize=4, zorder=5, alpha=0.75)
    ax.plot([0, 1.08 * length], [0, 0], "--", color="white", linewidth=1, zorder=4)
    ax.text(-0.12 * length, -0.12 * length, found.name, **_TEXT)
    ax.text(0.72 * length, -0.07 * length, "straight", **_TEXT)


def _draw_angles(found: JointMap, ax: Any) -> None:
    """A ring of angles, with a bar as long as the joint was often there."""
    from matplotlib.collections import LineCollection, PolyCollection

    length, (near, far) = found.length_mm, BARS
    ring = np.array([_at(near * length, degrees) for degrees in np.linspace(-180, 180, 181)])
    ax.plot(*ring.T, color="white", linewidth=0.6, alpha=0.6, zorder=4)
    bars, ticks = [], _ticks(found.degrees)
    for degrees, share in zip(found.degrees, found.share, strict=True):
        end = near + (far - near) * share / found.share.max()
        corners = (near, -1), (end, -1), (end, 1), (near, 1)
        bars.append([_at(r * length, degrees + s * 0.42 * BIN_DEG) for r, s in corners])
    ax.add_collection(PolyCollection(bars, color="white", alpha=0.85, linewidth=0, zorder=4))
    marks = [[_at(r * length, degrees) for r in (near - 0.05, near)] for degrees in ticks]
    ax.add_collection(LineCollection(marks, color="white", linewidth=1, capstyle="projecting", zorder=2))
    for degrees in ticks:
        ax.text(*_at(1.49 * length, degrees), f"{degrees}°", **_TEXT)


def map_picture(found: JointMap, *, pixels: int = 720) -> bytes:
    """The map alone, as a square PNG from edge to edge."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5, 4.5), dpi=pixels / 4.5)
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0, 0, 1, 1))
    draw_map(found, ax, bare=True)
    ax.set_axis_off()
    picture = BytesIO()
    figure.savefig(picture, format="png", pil_kwargs={"compress_level": 1})
    return picture.getvalue()
