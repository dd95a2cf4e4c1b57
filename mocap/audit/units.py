"""Lengths in two units: a marker, or a stretch of time, that is so many times as large as the rest."""

from collections.abc import Sequence

import numpy as np

from eal.arrays import Array
from mocap.findings import Finding, alarm
from mocap.io.lines import UNIT_M

RATIOS = np.unique([a / b for a in UNIT_M.values() for b in UNIT_M.values() if a / b > 9])
"""Of two units in use, from mm among cm (10) on: less than that a limb does to its distance from the others."""
FAR = 25.0
"""A marker in another unit is so many sizes of the others away: a wing tip or tail beside three markers of a head is 15
to 20. Chosen; units that differ by less are not told from limbs."""
ALIKE = 5.0
"""In the right unit a marker moves as far as others within that factor, and is as near to them in their own size: limbs
move five times as far as a trunk. Chosen."""


def unit_findings(xyz_m: Array, names: Sequence[str], *, first: int = 0) -> list[Finding]:
    """Markers, and stretches of time, whose lengths are in another unit than the rest.

    A factor f of two units is told from a real distance by motion: what is f times as far from the origin moves f times
    as far, and divided by f it is amid the others, and moves as they do. Nothing depends on the unit of the whole.

    Args:
        xyz_m: (T, M, 3) positions; NaN where not seen.
        names: The M markers.
        first: Frames of the recording before these.
    """
    return [*_markers(xyz_m, names), *_stretches(xyz_m, first)]


def _markers(xyz_m: Array, names: Sequence[str]) -> list[Finding]:
    """Single markers, of three or more, in another unit than the others."""
    if len(names) < 3 or len(xyz_m) < 3:
        return []
    some = xyz_m[:: max(1, len(xyz_m) // 2000)]  # medians need no more
    moves = _medians(np.linalg.norm(np.diff(xyz_m, axis=0), axis=-1).T)
    usual = float(_medians(moves))
    if not usual > 0:
        return []
    found = []
    # few markers can be of another unit than most, and these move by as much more
    for m in np.flatnonzero((moves > RATIOS[0] / ALIKE * usual) | (moves * RATIOS[0] / ALIKE < usual)):
        others = np.delete(some, m, axis=1)
        both = np.isfinite(others[..., 0]).any(axis=1) & np.isfinite(some[:, m, 0])
        if both.sum() < 3:
            continue
        own, others = some[both, m], others[both]
        centre = np.nanmedian(others, axis=1)
        size = float(np.nanmedian(np.linalg.norm(others - centre[:, None], axis=-1)))
        far = float(np.median(np.linalg.norm(own - centre, axis=-1)))
        path = _excursion(centre)
        for factor in (*RATIOS, *(1 / RATIOS)):
            near = float(np.median(np.linalg.norm(own / factor - centre, axis=-1)))
            like = moves[m] / (factor * usual)
            # what is too small lies near the origin, as a marker there that does not move: it must follow the others
            small = factor < 0.9 / FAR and far > ALIKE * size and _excursion(own / factor - centre) < path / 2
            if (far > FAR * size or small) and near < ALIKE * size and 1 / ALIKE < like < ALIKE:
                found.append((int(m), float(factor), near))
    best = {m: min((near, f) for n, f, near in found if n == m)[1] for m in {m for m, _, _ in found}}
    return [
        alarm(
            kind="units",
            text=f"{names[m]!r} is {_times(factor)} as far from the origin as the other markers, and moves "
            f"{_times(float(moves[m] / usual))} as far: its lengths are in another unit: correct its columns",
            numbers={"factor": float(factor)},
            markers=(str(names[m]),),
        )
        for m, factor in sorted(best.items())
    ]


def _stretches(xyz_m: Array, first: int) -> list[Finding]:
    """Frames between which all that is seen grows by one factor, about the origin, and goes on so."""
    seen = np.isfinite(xyz_m[..., 0])
    frames = np.flatnonzero(seen.any(axis=1))
    if len(frames) < 6:
        return []
    xyz, there = xyz_m[frames], seen[frames]
    size = np.linalg.norm(xyz, axis=-1)
    both = there[1:] & there[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(both, size[1:] / size[:-1], np.nan)
    middle = _medians(ratio)
    with np.errstate(divide="ignore", invalid="ignore"):
        places = np.flatnonzero(np.abs(np.log(middle)) > np.log(RATIOS[0] / 2))  # NaN is not larger
    step = _medians(np.linalg.norm(np.diff(xyz, axis=0), axis=-1))
    changes: list[tuple[int, float]] = []
    for t in places:
        before, after = xyz[t, both[t]], xyz[t + 1, both[t]]
        fits = {}
        for factor in (*RATIOS, *(1 / RATIOS)):
            off = np.linalg.norm(after - factor * before, axis=-1) / np.linalg.norm(factor * before, axis=-1)
            fits[factor] = float(np.max(off))
        factor = min(fits, key=lambda f: fits[f])
        earlier, later = (x[np.isfinite(x)] for x in (step[max(0, t - 50) : t], step[t + 1 : t + 51]))
        if fits[factor] > 0.5 or len(earlier) < 2 or len(later) < 2 or not np.median(earlier) > 0:
            continue
        like = np.median(later) / np.median(earlier) / factor
        if 1 / ALIKE < like < ALIKE:
            changes.append((int(t), float(factor)))
    if not changes:
        return []
    t, factor = changes[0]
    at = int(frames[t + 1]) + first + 1
    until = f" to {int(frames[changes[1][0]]) + first + 1}" if len(changes) > 1 else " on"
    return [
        alarm(
            kind="units",
            text=f"from frame {at}{until} all positions are {_times(factor)} as far from the origin as before, and "
            "their steps as long: their lengths are in another unit: correct them",
            numbers={"factor": factor, "changes": len(changes)},
            frames=tuple(int(frames[k + 1]) + first + 1 for k, _ in changes[:20]),
        )
    ]


def _excursion(path: Array) -> float:
    """Median distance of a path (n, 3) from its middle."""
    return float(np.median(np.linalg.norm(path - np.median(path, axis=0), axis=-1)))


def _medians(values: Array) -> Array:
    """(...) medians of the numbers along the last axis of (..., n); NaN where there are none."""
    out = np.full(values.shape[:-1], np.nan)
    known = np.isfinite(values).any(axis=-1)
    out[known] = np.nanmedian(np.where(np.isfinite(values[known]), values[known], np.nan), axis=-1)
    return out


def _times(factor: float) -> str:
    return f"{factor:.4g} times" if factor > 1 else f"a {1 / factor:.4g}th"
