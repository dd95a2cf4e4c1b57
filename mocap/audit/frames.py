"""Single samples off the path of their coordinate, and frames that are in each other's place: slips of tables."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.findings import MOST, Finding, Kind, alarm
from mocap.io.rounding import rounding
from mocap.text import number_of

OFF = 25.0
"""A sample off its path by so many times what three quarters of all samples of its coordinate are off: a careless click
is off by 10 to 20 times that, a limb that turns by 5 to 10. Chosen; see benchmarks.silent."""
BACK = 4.0
"""It is that much further off than the samples beside it, and its neighbours are that much nearer to each other."""
LEAST = 0.005
"""Of the extent of all that is recorded (3 px of an image of 640, 1.5 mm of a mouse): so much trembles what lies still.
Chosen."""
FEWEST = 20
"""Samples with both neighbours from which a usual one is known."""
REPAIRED = 9.0
"""Two frames that change places make what they are part of so many times as smooth, in squares; it is an exchange where
each is off by more than a tenth of LEAST. Noise of what lies still reaches 12. Chosen."""

MOST_OFF = 7.0
"""A coordinate counts for at most so many times what three quarters of its samples are off. Chosen."""


def off_path(values: Array, axes: int) -> tuple[NDArray[np.bool_], Array]:
    """(T, K) samples of K coordinates that leave their path in one frame and are back in the next; by how much.

    A sample is off by its distance from the middle of its neighbours, which a path that bends is by a half of its
    acceleration.

    Args:
        values: (T, K) coordinates; NaN where not seen.
        axes: How many axes they are along, in turn.
    """
    off = np.full(values.shape, np.nan)
    off[1:-1] = values[1:-1] - (values[:-2] + values[2:]) / 2
    far, out = np.abs(off), np.zeros(values.shape, dtype=bool)
    known = np.isfinite(far).sum(axis=0) >= FEWEST
    if not known.any():
        return out, off
    usual = np.full(values.shape[1], np.inf)
    usual[known] = np.nanquantile(far[:, known], 0.75, axis=0)  # one that is off spoils three of twenty
    least = np.maximum(OFF * usual, np.maximum(8 * rounding(values), LEAST * _extent(values, axes)))
    with np.errstate(invalid="ignore"):
        out[1:-1] = (far[1:-1] > least) & (np.abs(values[2:] - values[:-2]) * BACK < far[1:-1])
    for t, k in np.argwhere(out):
        # those at a distance of two or more are not moved by this one
        beside = [far[i, k] for i in range(max(0, t - 4), min(len(far), t + 5)) if abs(i - t) >= 2]
        out[t, k] = max((one for one in beside if np.isfinite(one)), default=0.0) * BACK < far[t, k]
    return out, off


def _extent(values: Array, axes: int) -> float:
    """The largest range that (T, K) coordinates have along one of some axes, but for a hundredth at either end."""
    along = [values[:, k::axes][np.isfinite(values[:, k::axes])] for k in range(axes)]
    return max((float(np.ptp(np.quantile(own, [0.01, 0.99]))) for own in along if own.size), default=0.0)


def path_findings(values: Array, names: Sequence[str], *, camera: str | None = None, first: int = 0) -> list[Finding]:
    """Samples of (T, M, d) tracks that jump away and back in one frame, and frames that are exchanged.

    Args:
        values: Positions, or pixels.
        names: The M markers.
        camera: Whose pixels they are; None: positions.
        first: Frames of the recording before these.
    """
    count = values.shape[-1]
    out, off = off_path(values.reshape(len(values), -1), count)
    if not out.any():
        return []
    markers = np.logical_or.reduce(out.reshape(len(values), -1, count), axis=-1)
    at, whose = np.flatnonzero(markers.any(axis=1)), np.flatnonzero(markers.any(axis=0))
    where = "" if camera is None else f" in camera {camera!r}"
    named = ", ".join(repr(str(names[m])) for m in whose[:4]) + (", ..." if len(whose) > 4 else "")
    frames = tuple(int(t) + 1 + first for t in at[:MOST])
    listed = ", ".join(map(str, frames[:8])) + (", ..." if len(at) > 8 else "")
    told = number_of(int(out.sum()), "coordinate")
    does = "leaves its path for one frame and is" if out.sum() == 1 else "leave their path for one frame and are"
    return [
        Finding(
            kind=Kind.SINGLE_SAMPLES,
            text=f"{told} of {named}{where} {does} back in the next (frame {listed}): exchanged or mistyped "
            "cells, or a careless click",
            numbers={"coordinates": int(out.sum()), "largest_off": float(np.nanmax(np.abs(off[out])))},
            cameras=() if camera is None else (camera,),
            markers=tuple(str(names[m]) for m in whose[:MOST]),
            frames=frames,
        )
    ]


def exchanged_frames(values: Array, *, axes: int, first: int = 0) -> list[Finding]:
    """Pairs of frames of which each is where the other was to be, in all that is seen: lines that changed places.

    Args:
        values: (T, K) all coordinates of all markers and cameras; NaN where not seen.
        axes: How many axes they are along, in turn.
        first: Frames of the recording before these.
    """
    if len(values) < FEWEST:
        return []
    off = np.full(values.shape, np.nan)
    off[1:-1] = values[1:-1] - (values[:-2] + values[2:]) / 2
    spread = np.nanquantile(np.abs(off), 0.75, axis=0) if np.isfinite(off).any(axis=0).all() else None
    if spread is None:
        some = np.isfinite(off).sum(axis=0) >= FEWEST
        values, off = values[:, some], off[:, some]
        if not values.shape[1]:
            return []
        spread = np.nanquantile(np.abs(off), 0.75, axis=0)
    scale = np.maximum(spread, rounding(values) + 1e-12 * np.nanmax(np.abs(values)))
    scale = np.where(scale > 0, scale, 1.0)  # of what never moves: it is not rough
    scaled = values / scale
    rough, extent = _roughness(off / scale), _extent(values, axes)
    usual = float(np.nanquantile(rough, 0.75)) if np.isfinite(rough).any() else np.inf
    pairs = [(int(t), int(t) + 1) for t in np.flatnonzero((rough[:-1] > usual) & (rough[1:] > usual))]
    odd = np.argsort(-np.nan_to_num(rough))[:MOST]
    odd = sorted(int(t) for t in odd if rough[t] > 15 * usual)
    pairs += [(a, b) for i, a in enumerate(odd) for b in odd[i + 1 :] if b > a + 1]
    gain = {pair: _gain(scaled, *pair) for pair in pairs}
    taken: set[int] = set()
    found = []
    for pair in sorted(gain, key=lambda p: -gain[p]):
        far = np.sqrt(_roughness(off[list(pair)])).min()  # in the unit of the file
        if gain[pair] > REPAIRED and far > LEAST / 10 * extent and not taken & set(pair):
            taken |= set(pair)
            found.append(tuple(t + 1 + first for t in pair))
    if not found:
        return []
    listed = ", ".join(f"{a} and {b}" for a, b in found[:8]) + (", ..." if len(found) > 8 else "")
    return [
        alarm(
            kind=Kind.EXCHANGED_FRAMES,
            text=f"frames {listed} are in each other's place: all that is seen in one continues at the other: lines of "
            "the file were exchanged: put them back",
            numbers={"pairs": len(found)},
            frames=tuple(sorted(t for pair in found for t in pair))[:MOST],
        )
    ]


def _roughness(off: Array) -> Array:
    """(T,) mean squares of how far the coordinates of a frame are off; NaN where nothing is known."""
    known = np.isfinite(off)
    counts = known.sum(axis=1)
    sums = np.where(known, off, 0.0) ** 2
    return np.where(counts > 0, sums.sum(axis=1) / np.maximum(counts, 1), np.nan)


def _gain(scaled: Array, a: int, b: int) -> float:
    """How many times as smooth the frames about two are once these change places; 0 where it is not known."""
    rows = sorted({i for t in (a, b) for i in range(t - 2, t + 3) if 0 <= i < len(scaled)})
    order = np.arange(len(scaled))
    order[[a, b]] = b, a
    sums = []
    inside = [t for t in rows if t - 1 >= 0 and t + 1 < len(scaled) and any(abs(t - x) <= 1 for x in (a, b))]
    if not inside:
        return 0.0
    for index in (np.arange(len(scaled)), order):
        off = np.stack([scaled[index[t]] - (scaled[index[t - 1]] + scaled[index[t + 1]]) / 2 for t in inside])
        sums.append(off)
    known = np.isfinite(sums[0]) & np.isfinite(sums[1])
    # of networks that snap to a grid single coordinates go to and fro: none counts for more than it usually is off
    before, after = ((np.where(known, np.clip(off, -MOST_OFF, MOST_OFF), 0.0) ** 2).sum() for off in sums)
    # each of the two must fit better where the other was, most of its coordinates too
    better = np.mean(np.abs(sums[1])[known] < np.abs(sums[0])[known]) if known.any() else 0.0
    return float(before / max(after, 1e-12)) if better > 0.6 else 0.0
