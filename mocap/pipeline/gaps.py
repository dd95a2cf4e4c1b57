"""Gaps: hiding samples as recordings lose them, filling them as people do today, and scoring what fills them."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from filters.hidden import unseen_runs
from mocap.arrays import Array
from mocap.skeleton import Skeleton

Mask = NDArray[np.bool_]


def interior_gaps(seen: Mask) -> Mask:
    """(T, M) True where a marker is not seen between its first and its last sighting."""
    before = np.logical_or.accumulate(seen, axis=0)
    after = np.logical_or.accumulate(seen[::-1], axis=0)[::-1]
    return ~seen & before & after


def gap_lengths(seen: Mask) -> NDArray[np.int64]:
    """Lengths in frames of all interior gaps."""
    return np.array([stop - start for _, start, stop in unseen_runs(~interior_gaps(seen))], dtype=np.int64)


def hide_gaps(
    seen: Mask,
    skeleton: Skeleton,
    names: tuple[str, ...],
    dt_s: float,
    rng: np.random.Generator,
    *,
    share: float = 0.04,
) -> Mask:
    """Hide measured samples in gaps like the recording's own.

    Lengths are drawn from its interior gaps of 3 to 60 frames (if it has fewer than five: 10 to 70 ms); half of the
    gaps hide one marker, half also the markers that bones join to it. A hidden gap is measured for three frames on both
    of its sides.

    Args:
        seen: (T, M) samples that were measured.
        skeleton: Its bones.
        names: The M marker names.
        dt_s: Time step.
        rng: Where to hide.
        share: About this share of the measured samples is hidden.

    Returns:
        (T, M) hidden samples, all of them measured.
    """
    lengths = gap_lengths(seen)
    lengths = lengths[(lengths >= 3) & (lengths <= 60)]
    if len(lengths) < 5:
        lengths = np.unique(np.linspace(max(3, 0.01 / dt_s), max(4, 0.07 / dt_s), 7).astype(int))
    neighbours = {name: {name} for name in names}
    for bone in skeleton.bones:
        neighbours[bone.a].add(bone.b)
        neighbours[bone.b].add(bone.a)
    hidden = np.zeros_like(seen)
    wanted, n_frames = share * seen.sum(), len(seen)
    for _ in range(4000):
        if hidden.sum() >= wanted:
            break
        length, name = int(rng.choice(lengths)), names[rng.integers(len(names))]
        if n_frames <= length + 6:
            continue
        start = int(rng.integers(3, n_frames - length - 3))
        group = sorted(neighbours[name]) if rng.random() < 0.5 else [name]
        near = slice(max(start - length, 0), start + 2 * length)
        for marker in (names.index(m) for m in group):
            sides = np.r_[seen[start - 3 : start, marker], seen[start + length : start + length + 3, marker]]
            if sides.all() and not hidden[near, marker].any():
                hidden[start : start + length, marker] = True
    return hidden & seen


def interpolated(xyz_m: Array, t_s: Array, *, kind: str) -> Array:
    """Every marker interpolated through its gaps, ``linear`` or ``cubic`` (a spline); NaN outside its sightings."""
    out = np.full_like(xyz_m, np.nan)
    for marker in range(xyz_m.shape[1]):
        frames = np.flatnonzero(np.isfinite(xyz_m[:, marker, 0]))
        if len(frames) < 2:
            continue
        inside = slice(frames[0], frames[-1] + 1)
        t, x = t_s[frames], xyz_m[frames, marker]
        if kind == "cubic" and len(frames) >= 4:
            out[inside, marker] = CubicSpline(t, x)(t_s[inside])
        else:
            out[inside, marker] = np.stack([np.interp(t_s[inside], t, x[:, k]) for k in range(3)], axis=-1)
    return out


def score(xyz_m: Array, cov_m2: Array | None, truth_m: Array, where: Mask) -> dict[str, float | None]:
    """Root mean square distance from the truth in mm, and the share of coordinates inside their 95 % intervals.

    Args:
        xyz_m: (T, M, 3) estimates.
        cov_m2: (T, M, 3, 3) their covariance; None: the method has none.
        truth_m: (T, M, 3) truth.
        where: (T, M) samples to compare; those without estimate or truth do not count.

    Returns:
        ``rmse_mm`` and ``coverage95`` (per cent); None where not defined.
    """
    ok = where & np.isfinite(xyz_m[..., 0]) & np.isfinite(truth_m[..., 0])
    if not ok.any():
        return {"rmse_mm": None, "coverage95": None}
    error = (xyz_m - truth_m)[ok]
    coverage = None
    if cov_m2 is not None:
        sd = np.sqrt(np.diagonal(cov_m2[ok], axis1=-2, axis2=-1))
        coverage = float(100 * np.mean(np.abs(error) <= 1.959964 * sd))
    return {"rmse_mm": float(1e3 * np.sqrt(np.mean(np.sum(error**2, axis=-1)))), "coverage95": coverage}
