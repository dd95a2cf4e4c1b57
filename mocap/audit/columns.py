"""Columns of pixels that no camera has: negative ones, and one that is so many times as large as the others."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.findings import Finding, Kind, alarm

FACTORS = np.array([1000.0, 100.0, 25.4, 10.0, 2.54])
"""By which columns are wrong: mm for m, per cent, inches, cm, a slip of the point."""
OUTSIDE = 0.05
"""Predictions and clicks beside the image lie beyond its edge by less than that share of the largest pixel. Chosen."""
WHOLE = 20
"""A column all below 0 has at least so many samples: a short track may lie outside the image. Chosen."""
BEYOND = 2.5
"""An image is at most so many times as wide as it is high; a column beyond that times all others is in no image."""


def column_findings(uv: Array, names: Sequence[str], *, camera: str) -> list[Finding]:
    """Of the (T, M, 2) pixels of one camera: those below 0, and columns in another unit."""
    return [*_negative(uv, names, camera), *_scaled(uv, names, camera)]


def _negative(uv: Array, names: Sequence[str], camera: str) -> list[Finding]:
    known = uv[np.isfinite(uv)]
    if not known.size or known.max() <= 0:
        return []
    below = uv < -OUTSIDE * known.max()
    share = np.count_nonzero(known < 0) / known.size
    if not below.any() or share > 0.25:  # then pixels are counted from the middle
        return []
    for m, k in np.argwhere(below.any(axis=0)).tolist():
        below[:, m, k] &= _flipped(uv[:, m, k], uv[:, m, 1 - k], below[:, m, k])
    if not below.any():
        return []
    whose = np.flatnonzero(below.any(axis=(0, 2)))
    rows = np.flatnonzero(below.any(axis=(1, 2))) + 1
    named = ", ".join(repr(str(names[m])) for m in whose[:4].tolist()) + (", ..." if len(whose) > 4 else "")
    return [
        alarm(
            kind=Kind.NEGATIVE_PIXELS,
            text=f"{below.sum()} pixels of {named} in camera {camera!r} are far below 0, down to {known.min():.6g} "
            f"(from row {rows[0]} on), as no image has: check their sign",
            numbers={"pixels": int(below.sum()), "lowest_px": float(known.min())},
            cameras=(camera,),
            markers=tuple(str(names[m]) for m in whose.tolist()),
            frames=tuple(int(r) for r in rows[:20]),
        )
    ]


def _flipped(column: Array, across: Array, below: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(T,) samples below 0 that continue the others with the other sign, or of a column that is all below 0.

    What leaves the image goes on where it was; what has lost its sign comes from as far on the other side,
    and its other coordinate, ``across``, goes on.
    """
    seen = np.flatnonzero(np.isfinite(column))
    out = below.copy()
    values, mine = column[seen], below[seen]
    if np.count_nonzero(values < 0) > 0.9 * len(values):  # single predictions beside the image had a minus sign before
        out[seen] = mine & (len(values) >= WHOLE)
        return out
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mine, [False]]).astype(int))).reshape(-1, 2)
    for start, stop in edges:
        inside = start > 1 and stop < len(values) - 1  # at an end of its track it may have left the image for good
        sides = [(start, values[start - 2 : start][::-1]), (stop - 1, values[stop : stop + 2])] if inside else []
        ahead = [(values[i], _onward(two)) for i, two in sides]
        on = across[seen[[start, stop - 1]]] - (across[seen[start - 1]] + across[seen[stop % len(seen)]]) / 2
        steady = bool((np.abs(on) < np.abs(values[[start, stop - 1]]) / 2).all())
        lost = all(abs(own - other) > 3 * abs(own + other) for own, other in ahead)
        out[seen[start:stop]] = inside and steady and lost
    return out


def _onward(two: Array) -> float:
    """Where two samples, the nearer one first, lead to: what leaves the image may do so fast."""
    return float(2 * two[0] - two[1])


def _scaled(uv: Array, names: Sequence[str], camera: str) -> list[Finding]:
    """Columns that are ten times or more as large or small as all others, or move so, and fit once divided."""
    columns = np.abs(uv.reshape(len(uv), -1))
    seen = np.isfinite(columns).sum(axis=0) >= 5
    if seen.sum() < 4:
        return []
    middle, large, spread = (np.full(columns.shape[1], np.nan) for _ in range(3))
    low, middle[seen], large[seen] = np.nanquantile(columns[:, seen], [0.05, 0.5, 0.95], axis=0)
    spread[seen] = large[seen] - low
    steps = np.full(columns.shape[1], np.nan)
    with np.errstate(all="ignore"):
        length = np.abs(np.diff(columns, axis=0))
    moving = np.isfinite(length).any(axis=0)
    steps[moving] = np.nanmean(length[:, moving], axis=0)
    found = []
    for k in np.flatnonzero(seen).tolist():
        same = np.arange(k % 2, columns.shape[1], 2)  # the same axis of the other markers
        same = same[(same != k) & seen[same]]
        others = np.flatnonzero(seen & (np.arange(len(seen)) != k))
        if len(same) < 1:
            continue
        top = float(np.max(large[others]))
        bottom = float(np.min(middle[others]))
        factor = _factor(k, same, others, middle, spread, steps, top, bottom)
        if factor is not None:
            found.append((k, factor))
    return [
        alarm(
            kind=Kind.UNITS,
            text=f"the column {'xy'[k % 2]} of {str(names[k // 2])!r} in camera {camera!r} is about "
            f"{f'{factor:g} times' if factor > 1 else f'a {1 / factor:.3g}th of'} what the other columns are, and "
            "moves so: it is in another unit: correct it",
            numbers={"factor": factor},
            cameras=(camera,),
            markers=(str(names[k // 2]),),
        )
        for k, factor in found
    ]


def _factor(
    k: int,
    same: NDArray[np.int64],
    others: NDArray[np.int64],
    middle: Array,
    spread: Array,
    steps: Array,
    top: float,
    bottom: float,
) -> float | None:
    """By what a column differs from the others; None: it does not."""
    usual, moves, size = (float(np.median(v[same])) for v in (middle, steps, spread))
    if not (moves > 0 and steps[k] > 0):
        return None
    for factor in (*FACTORS, *(1 / FACTORS)):
        large = factor > 1
        # it lies where no other column does, or moves as no other does
        if large and not (middle[k] > BEYOND * top):
            continue
        if not large and not (middle[k] < bottom / 3 and steps[k] < np.min(steps[others]) / 3):
            continue
        amid = abs(middle[k] / factor - usual) < max(2.0 * size, 0.7 * usual)
        like = steps[k] / factor / moves
        if amid and 1 / 4 < like < 4:
            return float(factor)
    return None
