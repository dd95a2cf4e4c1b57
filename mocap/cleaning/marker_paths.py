"""What tells that two markers swapped names: paths that bend, and bones that change their lengths."""

from collections.abc import Sequence, Set
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cleaning.click_noise import USUAL_DOF

Mask = NDArray[np.bool_]
Pair = tuple[int, int]

STEP = 3
"""Frames over which a marker that was not seen in between may be recognised by its straight path."""


def bend_scales(xyz_m: Array) -> Array:
    """(M,) standard deviation of a coordinate of the second differences of each path, in metres per frame squared.

    From its 90 % quantile over frames (2.5 deviations for three coordinates), which rare errors do not move; inf where
    unknown.
    """
    size = np.linalg.norm(np.diff(xyz_m, n=2, axis=0), axis=-1)
    out = np.full(xyz_m.shape[1], np.inf)
    for marker, column in enumerate(size.T):
        known = column[np.isfinite(column)]
        if len(known) >= 10:
            out[marker] = max(float(np.quantile(known, 0.9)) / 2.5, 1e-9)
    return out


def straight_on(xyz_m: Array, bend_m: Array) -> tuple[Array, Array, Array]:
    """Straight continuation of each marker's path from the two samples before, and how far it may bend from that.

    Returns:
        (T, M, 3) continuations, NaN without two samples before; (T, M) five deviations of their error; and (T, M, 3)
        the last sample before.
    """
    index = np.arange(len(xyz_m))[:, None]
    seen = np.isfinite(xyz_m[..., 0])
    last = _before(np.where(seen, index, -1))
    columns = np.arange(xyz_m.shape[1])
    earlier = np.where(last >= 0, last[np.maximum(last, 0), columns], -1)
    frames = np.maximum(last, 0)
    gap, step = index - last, np.maximum(last - earlier, 1)
    velocity = (xyz_m[frames, columns] - xyz_m[np.maximum(earlier, 0), columns]) / step[..., None]
    ahead = np.where((earlier >= 0)[..., None], xyz_m[frames, columns] + gap[..., None] * velocity, np.nan)
    before = np.where((last >= 0)[..., None], xyz_m[frames, columns], np.nan)
    return ahead, 5 * np.sqrt(3) * bend_m * gap * (gap + step) / 2, before


def crossing_pairs(xyz_m: Array, bend_m: Array) -> set[Pair]:
    """Pairs of markers each of which continues the path of the other one at least once.

    A pair is suspected where both are off their own straight continuation, and three times as near to the other's.
    """
    ahead, limit, _ = straight_on(xyz_m, bend_m)
    pairs: set[Pair] = set()
    own = np.linalg.norm(xyz_m - ahead, axis=-1)
    off = own > limit
    for frame in np.flatnonzero(np.count_nonzero(off, axis=1) >= 2):
        who = np.flatnonzero(off[frame])
        here, there, miss = xyz_m[frame, who], ahead[frame, who], own[frame, who]
        crossed = np.linalg.norm(here[:, None] - there, axis=-1) < miss[:, None] / 3
        near = crossed & crossed.T
        pairs |= {(int(who[i]), int(who[j])) for i, j in np.argwhere(np.triu(near, 1))}
    return pairs


def jumped(xyz_m: Array, frames: NDArray[np.int64], bend_m: Array) -> Mask:
    """(K,) whether one of two markers, seen alone between frames k - 1 and k, went over to where the other went or was.

    Args:
        xyz_m: (T, 2, 3) positions.
        frames: (K,) frames in which both are seen.
        bend_m: (2,) usual bend of each path.
    """
    ahead, limit, before = straight_on(xyz_m, bend_m)
    own = np.linalg.norm(xyz_m - ahead, axis=-1)
    other = np.fmin(*(np.linalg.norm(xyz_m - way[:, ::-1], axis=-1) for way in (ahead, before)))
    alone = np.isfinite(xyz_m[..., 0]).sum(axis=1) == 1
    apart = np.nanmedian(np.linalg.norm(xyz_m[:, 0] - xyz_m[:, 1], axis=-1))
    certain = np.minimum(limit, limit[:, ::-1]) < apart / 2  # one of the two ways is known well
    over = np.cumsum(alone & (certain & (own > limit.min(axis=1)[:, None]) & (other < own / 3)).any(axis=1))
    return np.concatenate([[False], over[frames[1:]] > over[frames[:-1]]])


def _before(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """(T, M) largest entry of the rows before each row; -1 where there is none."""
    last = np.maximum.accumulate(index, axis=0)
    return np.concatenate([np.full((1, index.shape[1]), -1), last[:-1]])


def unbroken(xyz_m: Array, frames: NDArray[np.int64], bend_m: Array) -> Mask:
    """(K,) whether one of two markers was seen alone between frames k - 1 and k, and went on straight all the way.

    Where it did its name has not changed, whatever the other one does when it is seen again.

    Args:
        xyz_m: (T, 2, 3) positions.
        frames: (K,) frames in which both are seen.
        bend_m: (2,) usual bend of each path.
    """
    out = np.zeros(len(frames), dtype=bool)
    apart = np.linalg.norm(xyz_m[frames, 0] - xyz_m[frames, 1], axis=-1)
    for j in (0, 1):
        seen = np.flatnonzero(np.isfinite(xyz_m[:, j, 0]))
        x, (g, h) = xyz_m[seen, j], (np.diff(seen)[:-1], np.diff(seen)[1:])
        off = np.linalg.norm(x[2:] - x[1:-1] - (x[1:-1] - x[:-2]) * (h / g)[:, None], axis=-1)
        limit = 5 * np.sqrt(3) * bend_m[j] * h * (g + h) / 2
        goes_on = np.concatenate([[False, False], (off <= limit) & (h <= STEP)])
        breaks = np.concatenate([[0], np.cumsum(~goes_on)])
        at = np.searchsorted(seen, frames)
        near = np.concatenate([[np.inf, np.inf], limit])[at] < 0.5 * apart
        out[1:] |= (np.diff(at) > 1) & (breaks[at[1:] + 1] == breaks[at[:-1] + 1]) & near[1:]
    return out


def belonging(xyz_m: Array, ends: NDArray[np.int64], state: NDArray[np.int64], bend_m: Array) -> NDArray[np.int64]:
    """Samples between two frames of different states, where one of two markers is seen at a time.

    From both ends each way is continued straight, sample by sample, as long as these lie where its bend may bring it
    within ``STEP`` frames, and nearer than half of the distance that the two usually have.

    Args:
        xyz_m: (T, 2, 3) positions, right outside and at both ends.
        ends: The frame before and the frame after.
        state: The states there: whether names are exchanged.
        bend_m: (2,) usual bend of each path.

    Returns:
        (2, T) by name: 1 where exchanged, 0 where not or not between, -1 where both ends claim it, or none.
    """
    reached = np.zeros((2, 2, len(xyz_m)), dtype=bool)  # end, name, frame
    half = 0.5 * float(np.nanmedian(np.linalg.norm(xyz_m[:, 0] - xyz_m[:, 1], axis=-1)))
    between = np.arange(ends[0] + 1, ends[1])
    seen = np.isfinite(xyz_m[..., 0]).T
    for end, order in enumerate((between, between[::-1])):
        outside = np.arange(ends[0] + 1) if end == 0 else np.arange(len(xyz_m) - 1, ends[1] - 1, -1)
        for name in (0, 1):
            way = name ^ int(state[end])
            known = [int(t) for t in outside[seen[way, outside]][-2:]]
            at = [xyz_m[t, way] for t in known]
            for t in order[seen[name, order]]:
                if len(known) < 2:
                    break
                g, h = abs(known[-1] - known[-2]), abs(int(t) - known[-1])
                off = xyz_m[t, name] - at[-1] - (at[-1] - at[-2]) * h / g
                limit = min(5 * np.sqrt(3) * bend_m[way] * h * (g + h) / 2, half)
                if h > STEP or np.linalg.norm(off) > limit:
                    break
                reached[end, name, t] = True
                known, at = [known[-1], int(t)], [at[-1], xyz_m[t, name]]
    out = np.zeros((2, len(xyz_m)), dtype=np.int64)
    out[:, between] = np.where(
        seen[:, between], np.where(reached[1] == reached[0], -1, reached[state[1]])[:, between], 0
    )
    return out


Bones = NDArray[np.int64]

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
    # neither digitisers nor animals are normal
    return -0.5 * (USUAL_DOF + size) * np.log1p(squares / USUAL_DOF)


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
