"""Filling gaps as people do today: curves through each marker by itself, and poses from the markers that are seen."""

from collections.abc import Sequence

import numpy as np
from mocap.filters.conditional import expected
from mocap.filters.poses import MarkerTrial, poses_of
from mocap.filters.subspace import principal_components

from eal.arrays import Array
from eal.threads import one_blas_thread


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
            from scipy.interpolate import CubicSpline

            out[inside, marker] = CubicSpline(t, x)(t_s[inside])
        else:
            out[inside, marker] = np.stack([np.interp(t_s[inside], t, of) for of in x.T], axis=-1)
    return out


def blended(y: Array, model: Array) -> Array:
    """(T, D) series whose gaps a model (T, D) fills; its misfit beside a gap is interpolated over it.

    So the filled track joins the measured one. Columns that show nothing are the model's.
    """
    index, misfit, filled = np.arange(len(y)), y - model, y.copy()
    for column in range(y.shape[1]):
        known, gap = np.isfinite(misfit[:, column]), np.isnan(y[:, column])
        shift = np.interp(index[gap], index[known], misfit[known, column]) if known.any() else 0.0
        filled[gap, column] = model[gap, column] + shift
    return filled


def by_chains(xyz_m: Array, t_s: Array, bones: Sequence[tuple[int, int]], trunk: Sequence[int]) -> Array:
    """Gaps of (T, M, 3) markers filled outward from the trunk, along bones that keep their lengths.

    The direction of each bone is a spline through the frames that show both its ends, its length is their median; the
    trunk, and what no bone ties to it, are splines.

    Args:
        xyz_m: Markers; NaN where not seen.
        t_s: (T,) times.
        bones: Pairs of markers.
        trunk: Markers from which the chains start; none: the first marker of the first bone.
    """
    out, placed = interpolated(xyz_m, t_s, kind="cubic"), set(trunk or [a for a, _ in bones[:1]])
    while step := next(((a, b) for p in bones for a, b in (p, p[::-1]) if a in placed and b not in placed), None):
        parent, marker = step
        placed.add(marker)
        bone = xyz_m[:, [marker]] - xyz_m[:, [parent]]
        direction = interpolated(bone, t_s, kind="cubic")[:, 0]
        length = np.linalg.norm(direction, axis=-1, keepdims=True)
        at = out[:, parent] + direction / length * np.nanmedian(np.linalg.norm(bone, axis=-1))
        gap = np.isnan(xyz_m[:, marker, 0]) & np.isfinite(at[:, 0])
        out[gap, marker] = at[gap]
    return out


def by_poses(xyz_m: Array, t_s: Array, trunk: Sequence[int], *, kind: str, rank: int = 12) -> Array:
    """Gaps of (T, M, 3) markers filled from the other markers of the same frame, in the axes of the body.

    Args:
        xyz_m: Markers in the world; NaN where not seen.
        t_s: (T,) times, evenly spaced.
        trunk: Indices of the markers that the body's axes follow.
        kind: ``conditional_gaussian`` (``mocap.filters.conditional``) or ``principal_components`` of ``rank``.
        rank: Number of components, as in ``benchmarks.gaps``.
    """
    trial = MarkerTrial(name="", t_s=t_s, xyz_m=xyz_m, sd_m=np.zeros(xyz_m.shape[:2]))
    (pose,) = poses_of([trial], trunk, body_hz=0.4 / trial.dt_s)  # below half the frame rate: all that is recorded
    components = principal_components(pose.y, max(1, min(rank, pose.y.shape[1] // 2, len(pose.y) // 4)), iterations=12)
    filled = blended(pose.y, components.poses)
    if kind == "conditional_gaussian":
        with one_blas_thread():  # at these sizes two only wait for each other: 54 s instead of 2.4
            filled = blended(pose.y, _conditional(pose.y, filled))
    turned = filled.reshape(xyz_m.shape) @ np.swapaxes(pose.frames.rotation, 1, 2)
    return turned + pose.frames.position_m[:, None]


def _conditional(y: Array, guess: Array) -> Array:
    """(T, D) poses by regression: in gaps and in the frames beside them, each time without the marker itself."""
    ridge = (1e-4 * np.trace(np.cov(guess.T)) / y.shape[1] + 1e-14) * np.eye(y.shape[1])  # as in benchmarks.gaps
    mean, cov = guess.mean(axis=0), np.cov(guess.T, bias=True)
    for _ in range(3):
        found, extra = expected(y, mean, cov + ridge)
        mean, cov = found.mean(axis=0), np.cov(found.T, bias=True) + extra / len(found)
    gap = np.isnan(y)
    beside = gap.copy()
    beside[1:] |= gap[:-1]
    beside[:-1] |= gap[1:]
    found, _ = expected(np.where(beside, np.nan, y), mean, cov + ridge)
    return np.where(beside, found, np.nan)
