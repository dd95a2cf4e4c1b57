"""Evidence of bone lengths for or against two markers having swapped names."""

from collections.abc import Sequence, Set
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array

Bones = NDArray[np.int64]
Pair = tuple[int, int]

DOF = 4.0
"""Degrees of freedom of the Student's t errors in every likelihood below: neither digitisers nor animals are normal."""
CHANGE = 12.0
"""Negative log probability that two given markers change names between two given frames (one in 160 000)."""
MARGIN = 8.0
"""Log likelihood by which a run must win, after what its two changes cost, to be undone."""
SAME_ERROR_FRAMES = 10.0
"""Errors of a bone's length persist: so many frames count as one."""


@dataclass(frozen=True)
class BoneLength:
    """Two markers, the median of their distance and its deviation in metres."""

    a: int
    b: int
    median_m: float
    sd_m: float


def student_log(squares: Array, size: int) -> Array:
    """Log density of Student's t in ``size`` dimensions at squared standardised distances, less that at its centre."""
    return -0.5 * (DOF + size) * np.log1p(squares / DOF)


def usual_length(length_m: Array) -> tuple[float, float] | None:
    """Median of (T,) lengths and its robust deviation, 5 % of it or more; None where fewer than ten are known."""
    known = length_m[np.isfinite(length_m)]
    if len(known) < 10:
        return None
    median = float(np.median(known))
    return median, max(1.4826 * float(np.median(np.abs(known - median))), 0.05 * median, 1e-9)


def bone_lengths(xyz_m: Array, bones: Bones) -> list[BoneLength]:
    """What each bone that is seen often enough measures."""
    out = []
    for a, b in bones:
        if (usual := usual_length(np.linalg.norm(xyz_m[:, a] - xyz_m[:, b], axis=-1))) is not None:
            out.append(BoneLength(int(a), int(b), *usual))
    return out


def _in_place(xyz_m: Array, bone: BoneLength, fixed: int, others: int | slice) -> Array:
    """Log likelihood of a bone's length with others at its free end; 0 where not seen."""
    length = np.linalg.norm(
        xyz_m[:, others] - (xyz_m[:, fixed] if isinstance(others, int) else xyz_m[:, [fixed]]), axis=-1
    )
    return np.nan_to_num(student_log(((length - bone.median_m) / bone.sd_m) ** 2, 1))


def steady_pairs(xyz_m: Array, bones: Bones) -> Bones:
    """(P, 2) markers without a bone, each with up to three others: their distance varies least, by under 20 %."""
    out = []
    boned = {int(m) for m in bones.ravel()}
    for marker in range(xyz_m.shape[1]):
        if marker in boned:
            continue
        distance = np.linalg.norm(xyz_m - xyz_m[:, marker, None], axis=-1)
        median = _medians(distance)
        varies = 1.4826 * _medians(np.abs(distance - median)) / np.maximum(median, 1e-12)
        varies[np.isfinite(distance).sum(axis=0) < 30] = np.inf
        varies[marker] = np.inf
        best = np.argsort(varies)[:3]
        out += [(marker, int(other)) for other in best if varies[other] < 0.2]
    return np.array(out, dtype=np.int64).reshape(-1, 2)


def _medians(values: Array) -> Array:
    """(M,) medians of the columns of (T, M) without NaN, as ``np.nanmedian`` gives them; NaN of none."""
    ordered = np.sort(values, axis=0)  # NaN last
    count = np.isfinite(values).sum(axis=0)
    column = np.arange(values.shape[1])
    low, high = (np.maximum(count - 1, 0) // 2), count // 2
    middle = 0.5 * (ordered[low, column] + ordered[np.minimum(high, len(values) - 1), column])
    return np.where(count > 0, middle, np.nan)


def pair_evidence(xyz_m: Array, lengths: Sequence[BoneLength], pair: Pair, suspects: Set[int]) -> Array:
    """(T,) evidence of bone lengths for the swap of a pair; bones to ``suspects`` are not used.

    Where one of the pair is seen, bones judge it in its own place and in that of the other.
    """
    total = np.zeros(len(xyz_m))
    for bone in lengths:
        for end, fixed in ((bone.a, bone.b), (bone.b, bone.a)):
            if end in pair and fixed not in pair and fixed not in suspects:
                other = pair[1] if end == pair[0] else pair[0]
                total += _in_place(xyz_m, bone, fixed, other) - _in_place(xyz_m, bone, fixed, end)
    return total / SAME_ERROR_FRAMES


def stretched_pairs(xyz_m: Array, lengths: Sequence[BoneLength]) -> set[Pair]:
    """Pairs for whose swap bone lengths alone are clear evidence over some run of frames."""
    n_frames, n_markers = xyz_m.shape[:2]
    place = np.zeros((n_markers, n_frames, n_markers), dtype=np.float32)  # of one marker, taken by another
    for bone in lengths:
        for end, fixed in ((bone.a, bone.b), (bone.b, bone.a)):
            value = _in_place(xyz_m, bone, fixed, slice(None))
            value -= value[:, [end]]
            value[:, fixed] = 0
            place[end] += value
    seen = np.isfinite(xyz_m[..., 0])
    out = set()
    for a in range(n_markers):
        total = (place[a] + place[:, :, a].T) * (seen[:, [a]] & seen)
        total = np.cumsum(np.concatenate([np.zeros((1, n_markers)), total]) / SAME_ERROR_FRAMES, axis=0)
        rise = np.max(total - np.minimum.accumulate(total, axis=0), axis=0)
        out |= {(a, int(b)) for b in np.flatnonzero(rise > CHANGE + MARGIN) if b > a}
    return out
