"""Cleaning: implausible samples are rejected, marked and counted, never changed without a report."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, varying
from mocap.filters.anatomy import ends_among
from mocap.skeleton import Skeleton

Mask = NDArray[np.bool_]

REASONS = {
    "rays_miss": "the rays of the cameras do not intersect",
    "likelihood": "fewer than two cameras have a likelihood that is high enough",
    "jump": "moves faster than is plausible for this marker",
    "duplicate": "coincides with another marker",
    "bone_length": "contradicts the length of a rigid bone",
    "contradicted": "two-camera points inconsistent with the motion and the other markers",
}
"""Why a sample was rejected, by the key that reports use."""
POSE_MARKERS, POSE_SHARE = 4, 0.6
"""A pose is of so many markers (three tell where a body is, a fourth of its shape), and a frame shows it that shows
this share of them. The share is chosen, not measured."""


def shows_a_pose(seen: Mask) -> Mask:
    """(T,) frames that show enough of the (T, M) markers for a pose."""
    return seen.mean(axis=1) >= POSE_SHARE


@dataclass(frozen=True, eq=False, kw_only=True)
class Cleaning:
    """What cleaning rejected.

    Attributes:
        rejected: (T, M) masks by reason (``REASONS``); a sample has at most one reason.
        max_speed_m_s: (M,) speed limit of each marker, given or derived.
    """

    rejected: dict[str, Mask]
    max_speed_m_s: Array

    @property
    def any(self) -> Mask:
        """(T, M) True where a sample was rejected, for any reason."""
        return np.any(list(self.rejected.values()), axis=0)


def clean(
    xyz_m: Array,
    sd_m: Array,
    t_s: Array,
    skeleton: Skeleton,
    names: tuple[str, ...],
    *,
    certain: Mask | bool = False,
) -> Cleaning:
    """Find jumps, duplicated markers and stretched bones, in this order.

    Args:
        xyz_m: (T, M, 3) positions; NaN where not seen.
        sd_m: (T, M) standard deviation of a coordinate.
        t_s: (T,) times.
        skeleton: Rigid bones, and the speed limit if it is known.
        names: The M marker names.
        certain: (T, M) samples that are never rejected; False: none.
    """
    limit = speed_limits(xyz_m, t_s)
    if skeleton.max_speed_m_s is not None:
        limit = np.fmin(limit, skeleton.max_speed_m_s)
    xyz = xyz_m.copy()
    rejected: dict[str, Mask] = {}

    def reject(reason: str, mask: Mask) -> None:
        rejected[reason] = mask & np.logical_not(certain)
        xyz[rejected[reason]] = np.nan

    slack = 4 * np.nan_to_num(medians(sd_m))
    reject("jump", jumps(xyz, t_s, max_speed_m_s=limit, slack_m=slack))
    if varying(xyz).all():  # in an image markers pass in front of each other
        reject("duplicate", duplicates(xyz, sd_m))
    else:
        rejected["duplicate"] = np.zeros(xyz.shape[:2], dtype=bool)
    reject("bone_length", stretched(xyz, np.array(ends_among(names, skeleton.rigid), dtype=int).reshape(-1, 2)))
    return Cleaning(rejected=rejected, max_speed_m_s=limit)


def speed_limits(xyz_m: Array, t_s: Array) -> Array:
    """(M,) six times the 90 % quantile of each marker's speed between neighbouring frames; NaN if unknown.

    Digitising errors are rare (a few per cent), so that the quantile is the animal's.
    """
    speed = np.linalg.norm(np.diff(xyz_m, axis=0), axis=-1) / np.diff(t_s)[:, None]
    limits = np.full(xyz_m.shape[1], np.nan)
    for marker, column in enumerate(speed.T):
        finite = column[np.isfinite(column)]
        if len(finite) >= 10:
            limits[marker] = 6.0 * np.quantile(finite, 0.9)
    return limits


def jumps(xyz_m: Array, t_s: Array, *, max_speed_m_s: Array, slack_m: Array) -> Mask:
    """The fewest samples whose removal leaves each marker slower than its limit.

    The longest chain of samples of which each is reached from the one before at no more than the limit, found by
    dynamic programming; what is not on it is a jump.

    Args:
        xyz_m: (T, M, 3) positions.
        t_s: (T,) times.
        max_speed_m_s: (M,) limits.
        slack_m: (M,) distance that measurement noise may add.

    Returns:
        (T, M) True for samples that are not on the chain.
    """
    out = np.zeros(xyz_m.shape[:2], dtype=bool)
    for marker in range(xyz_m.shape[1]):
        frames = np.flatnonzero(np.isfinite(xyz_m[:, marker, 0]))
        if len(frames) < 3 or not np.isfinite(max_speed_m_s[marker]):
            continue
        x, t = xyz_m[frames, marker], t_s[frames]
        near = np.linalg.norm(np.diff(x, axis=0), axis=1) <= max_speed_m_s[marker] * np.diff(t) + slack_m[marker]
        if near.all():
            continue
        length = np.ones(len(frames), dtype=int)
        before = np.full(len(frames), -1)
        for i in range(1, len(frames)):
            j = np.arange(max(0, i - 40), i)  # so many wrong samples on end, at most
            reach = max_speed_m_s[marker] * (t[i] - t[j]) + slack_m[marker]
            ok = j[np.linalg.norm(x[i] - x[j], axis=1) <= reach]
            if len(ok):
                best = ok[::-1][np.argmax(length[ok[::-1]])]
                length[i], before[i] = length[best] + 1, best
        i = int(np.argmax(length))
        chain = []
        while i >= 0:
            chain.append(i)
            i = before[i]
        off = np.ones(len(frames), dtype=bool)
        off[chain] = False
        out[frames[off], marker] = True
    return out


def duplicates(xyz_m: Array, sd_m: Array) -> Mask:
    """Of two markers that are usually apart and coincide in a frame, the one farther from its own path.

    Args:
        xyz_m: (T, M, 3) positions.
        sd_m: (T, M) standard deviation of a coordinate. Coincident means nearer than that of their distance, and than a
            twentieth of the distance that the two usually have.
    """
    out = np.zeros(xyz_m.shape[:2], dtype=bool)
    away = off_course(xyz_m)
    sd = np.nan_to_num(sd_m)
    for a in range(xyz_m.shape[1] - 1):
        distance = np.linalg.norm(xyz_m[:, a + 1 :] - xyz_m[:, a, None], axis=-1)
        near = distance <= np.hypot(sd[:, a + 1 :], sd[:, a, None])
        for other in np.flatnonzero(near.any(axis=0)):
            apart, b = distance[:, other], a + 1 + other
            same = near[:, other] & (apart <= 0.05 * np.median(apart[np.isfinite(apart)]))
            worse_a = away[:, a] >= away[:, b]
            out[:, a] |= same & worse_a
            out[:, b] |= same & ~worse_a
    return out


def stretched(xyz_m: Array, bones: NDArray[np.int64]) -> Mask:
    """Ends of rigid bones whose length deviates from its usual value.

    A bone violates where its length differs from its median by more than a quarter of it, which skin and digitising may
    add, and by more than eight robust standard deviations. The end with more violating bones is rejected, of equals the
    one that is further off its own course; then again, until no bone violates.

    Args:
        xyz_m: (T, M, 3) positions.
        bones: (B, 2) marker indices.
    """
    xyz = xyz_m.copy()
    out = np.zeros(xyz.shape[:2], dtype=bool)
    if not len(bones):
        return out
    length = np.linalg.norm(xyz[:, bones[:, 0]] - xyz[:, bones[:, 1]], axis=-1)
    finite = np.isfinite(length).sum(axis=0) >= 10
    bones, length = bones[finite], length[:, finite]
    if not len(bones):
        return out
    median = np.nanmedian(length, axis=0)
    robust_sd = 1.4826 * np.nanmedian(np.abs(length - median), axis=0)
    limit = np.maximum(0.25 * median, 8.0 * robust_sd)
    away = off_course(xyz)
    away = away / (1 + away)  # below 1: breaks ties only
    for _ in range(xyz.shape[1]):
        length = np.linalg.norm(xyz[:, bones[:, 0]] - xyz[:, bones[:, 1]], axis=-1)
        violated = np.abs(length - median) > limit  # NaN compares False
        if not violated.any():
            break
        votes = np.zeros(out.shape)
        for i, (a, b) in enumerate(bones):
            votes[:, a] += violated[:, i]
            votes[:, b] += violated[:, i]
        frames = np.flatnonzero(votes.any(axis=1))
        worst = np.argmax(np.where(votes[frames] > 0, votes[frames] + away[frames], -1), axis=1)
        out[frames, worst] = True
        xyz[frames, worst] = np.nan
    return out


def off_course(xyz_m: Array) -> Array:
    """(T, M) distance of a sample from the median of its four neighbours in time, in metres; 0 where unknown."""
    padded = np.pad(xyz_m, ((2, 2), (0, 0), (0, 0)), constant_values=np.nan)
    n = len(xyz_m)
    neighbours = np.stack([padded[i : i + n] for i in (0, 1, 3, 4)])
    middle = medians(neighbours.reshape(4, -1)).reshape(xyz_m.shape)
    return np.nan_to_num(np.linalg.norm(xyz_m - middle, axis=-1))


def medians(values: Array) -> Array:
    """(M,) medians of the columns of (T, M) without NaN, as ``np.nanmedian`` gives them; NaN of none."""
    ordered = np.sort(values, axis=0)  # NaN last
    count = np.isfinite(values).sum(axis=0)
    column = np.arange(values.shape[1])
    low, high = (np.maximum(count - 1, 0) // 2), count // 2
    middle = 0.5 * (ordered[low, column] + ordered[np.minimum(high, len(values) - 1), column])
    return np.where(count > 0, middle, np.nan)


def position_sd(xyz_m: Array) -> Array:
    """(T, M) standard deviation of a coordinate of (T, M, 3) positions, from fourth differences.

    Smooth motion has hardly any. White noise of variance s^2 gives fourth differences of variance 70 s^2. Digitising
    errors have heavy tails: the result is the root mean square of a marker's differences within five robust standard
    deviations (their median is 0.6745 of one). Markers with too few samples take the median of the others, and all at
    least 1e-6 m.
    Points in a plane have two coordinates.
    """
    size = np.abs(np.asarray(np.diff(xyz_m[..., varying(xyz_m)], n=4, axis=0))) / np.sqrt(70)
    sd: Array = np.full(xyz_m.shape[1], np.nan)
    for marker in range(len(sd)):
        finite = size[:, marker][np.isfinite(size[:, marker])]
        if len(finite) >= 15:
            near = finite[finite <= 5 * np.median(finite) / 0.6745]
            sd[marker] = np.sqrt(np.mean(near**2))
    fallback = np.nanmedian(sd) if np.isfinite(sd).any() else 1e-3
    return np.broadcast_to(np.maximum(np.where(np.isfinite(sd), sd, fallback), 1e-6), xyz_m.shape[:2])
