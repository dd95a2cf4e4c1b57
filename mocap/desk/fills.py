"""How a person would fill a marker by hand, for a look: by a spline, or by the way of its neighbours."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from eal.arrays import Array, true_runs
from mocap.digitising.pose import rigid
from mocap.skeleton import Skeleton
from mocap.text import number_of

FEWEST_OF_BODY = 3
"""Neighbours that a marker is turned with; of fewer it keeps its distance to their middle in the axes of the world."""
TRIED = 12
"""Places in the frames about a gap, at most, that the same fill is tried at."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Fills:
    """Two fills of the frames that a marker was not measured in, about one of them.

    Attributes:
        spline_m: (R, 3) by a cubic spline through what was measured on both sides; NaN elsewhere, or all of it.
        neighbours_m: (R, 3) by the neighbours that were seen all the time.
        said: Which neighbours, and how far both fills were off where the marker was measured; or why there is no line.
    """

    spline_m: Array
    neighbours_m: Array
    said: str


def fills(
    t_s: Array,
    xyz_m: Array,
    measured: NDArray[np.bool_],
    at: int,
    marker: int,
    names: Sequence[str],
    skeleton: Skeleton,
) -> Fills:
    """Fill the run of frames about a frame that were not measured, as Vicon Nexus' pattern and rigid body fills do.

    Each side of the run gives a place among the neighbours: what both give is blended over the run; an end, which has
    one side, has that alone. Of the sets of neighbours (``neighbours_of``), and of moving or turning with them, that is
    taken which misses the marker least in frames beside the run that are hidden in the same way. It must miss it by
    less than a straight line: else the neighbours do not move as it does.

    Args:
        t_s: (R,) times.
        xyz_m: (R, M, 3) positions.
        measured: (R, M) whether they were measured.
        at: The frame; if the marker was measured there, that frame is filled alone.
        marker: Its number.
        names: Of the markers.
        skeleton: Bones and bodies.
    """
    own = measured[:, marker].copy()
    own[at] = False
    run = next((first, stop) for first, stop in true_runs(~own) if first <= at < stop)
    spline, none = _splined(t_s, xyz_m[:, marker], own, run), np.full((len(t_s), 3), np.nan)
    sets, within = neighbours_of(names[marker], names, skeleton), slice(max(run[0] - 1, 0), run[1] + 1)
    there = list(dict.fromkeys(kept for one in sets if (kept := tuple(n for n in one if measured[within, n].all()))))
    tried = list(_beside(own, measured, sorted({n for one in there for n in one}), run)) if there else []
    if not tried:
        said = (
            f"the skeleton has no bone or body of {names[marker]}"
            if not sets
            else f"none is seen all the time ({', '.join(names[n] for n in sets[-1])})"
            if not there
            else "no frames beside these show it with them: how they move together is not known"
        )
        return Fills(spline_m=spline, neighbours_m=none, said=said)
    ways = [(one, turns) for one in there for turns in (False, True) if not turns or len(one) >= FEWEST_OF_BODY]
    off_mm = {way: _missed(partial(_carried, xyz_m, marker, *way), xyz_m[:, marker], own, run, tried) for way in ways}
    best = min(off_mm, key=off_mm.__getitem__)
    splined, straight = (
        _missed(partial(way, t_s, xyz_m[:, marker]), xyz_m[:, marker], own, run, tried) for way in (_splined, _straight)
    )
    which, places = ", ".join(names[n] for n in best[0]), f"hidden so at {number_of(len(tried), 'place')} beside"
    if off_mm[best] >= straight:
        said = f"{which}: not moving as it does: {places}, missed by {off_mm[best]:.2g} mm, straight {straight:.2g}"
        return Fills(spline_m=spline, neighbours_m=none, said=said)
    beside = f", by the spline {splined:.2g}" if np.isfinite(splined) else ""
    said = f"{which}: {places}, missed by {off_mm[best]:.2g} mm{beside}"
    return Fills(spline_m=spline, neighbours_m=_carried(xyz_m, marker, *best, own, run), said=said)


def _missed(
    fill: Callable[..., Array],
    xyz_m: Array,
    own: NDArray[np.bool_],
    run: tuple[int, int],
    tried: Sequence[tuple[int, int]],
) -> float:
    """RMS distance in millimetres of a fill from what was measured in other runs, hidden as this one is."""
    squares = []
    for first, stop in tried:
        left = own.copy()
        left[first if run[0] else 0 : stop if run[1] < len(own) else len(own)] = False
        squares += [np.sum((fill(left, (first, stop)) - xyz_m)[first:stop] ** 2, axis=-1)]
    return 1e3 * float(np.sqrt(np.mean(squares)))


def neighbours_of(marker: str, names: Sequence[str], skeleton: Skeleton) -> list[tuple[int, ...]]:
    """Sets of markers that may move with one, by their numbers: of its body or trunk, one bone away, and two."""
    number = {name: i for i, name in enumerate(names)}
    sets = [members for members in (*skeleton.bodies.values(), skeleton.trunk) if marker in members]
    one = {end for bone in skeleton.bones if marker in (bone.a, bone.b) for end in (bone.a, bone.b)}
    two = {end for bone in skeleton.bones if one & {bone.a, bone.b} for end in (bone.a, bone.b)}
    found = [tuple(sorted({number[n] for n in some if n in number and n != marker})) for some in (*sets, one, two)]
    return list(dict.fromkeys(some for some in found if some))


def _beside(
    own: NDArray[np.bool_], measured: NDArray[np.bool_], neighbours: Sequence[int], run: tuple[int, int]
) -> Iterator[tuple[int, int]]:
    """Runs as long, or as long as there are, that show the marker and its neighbours, with a frame on each side."""
    seen = own & measured[:, neighbours].all(axis=1)
    there = [(first, stop) for first, stop in true_runs(seen) if stop - first >= 3]
    long = min(run[1] - run[0], max((stop - first - 2 for first, stop in there), default=0))
    starts = [k for first, stop in there for k in range(first + 1, stop - long, max(1, long // 2))] if long else []
    some = np.unique(np.linspace(0, len(starts) - 1, min(TRIED, len(starts))).astype(int)) if starts else []
    yield from ((starts[k], starts[k] + long) for k in some)


def _carried(
    xyz_m: Array, marker: int, neighbours: tuple[int, ...], turns: bool, own: NDArray[np.bool_], run: tuple[int, int]
) -> Array:
    """(R, 3) the marker carried over a run by its neighbours from each side that there is."""
    out, first, stop = np.full((len(xyz_m), 3), np.nan), *run
    sides = [side for side in (first - 1, stop) if 0 <= side < len(xyz_m) and own[side]]
    frames = np.arange(min([first, *sides]), max([stop - 1, *sides]) + 1)
    points = xyz_m[:, neighbours]
    ways = []
    for side in sides:
        if turns:
            moves = [rigid(points[side], points[frame]) for frame in frames]
            ways.append(np.array([rotation @ xyz_m[side, marker] + shift for rotation, shift in moves]))
        else:
            ways.append(xyz_m[side, marker] + (points[frames] - points[side]).mean(axis=1))
    if len(ways) == 2:
        later = ((frames - frames[0]) / (frames[-1] - frames[0]))[:, None]
        out[frames] = (1 - later) * ways[0] + later * ways[1]
    elif ways:
        out[frames] = ways[0]
    return out


def _straight(t_s: Array, xyz_m: Array, own: NDArray[np.bool_], _run: tuple[int, int]) -> Array:
    """(R, 3) straight lines between what was measured; beyond its ends what was measured last."""
    if not own.any():
        return np.full((len(t_s), 3), np.nan)
    return np.stack([np.interp(t_s, t_s[own], xyz_m[own, k]) for k in range(3)], axis=-1)


def _splined(t_s: Array, xyz_m: Array, own: NDArray[np.bool_], run: tuple[int, int]) -> Array:
    """(R, 3) a cubic spline over a run, from its last frame before to its first after; NaN where two sides lack."""
    out, (first, stop) = np.full((len(t_s), 3), np.nan), run
    if min(own[:first].sum(), own[stop:].sum()) >= 2:
        inside = slice(first - 1, stop + 1)
        out[inside] = CubicSpline(t_s[own], xyz_m[own])(t_s[inside])
    return out
