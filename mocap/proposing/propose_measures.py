"""Strokes, feet and spans that a recording's cycles show: a first table ``[measures]`` of a skeleton."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from eal.arrays import Array
from mocap.filters.body_axes import body_frames
from mocap.filters.independent import FEWEST_FRAMES
from mocap.filters.poses import MarkerTrial
from mocap.filters.whittaker import fastest_hz
from mocap.measures import Line, Measures
from mocap.sides import LEFT, other_side, side_of
from mocap.skeleton import Skeleton


def proposed_measures(
    names: Sequence[str], trial: MarkerTrial, bones: Sequence[tuple[int, int]], trunk: Sequence[int]
) -> Measures:
    """Limbs that move in cycles relative to the trunk; none where it is not known, or nothing repeats.

    Args:
        names: The M markers.
        trial: Their positions.
        bones: Pairs of markers.
        trunk: Markers of the trunk.
    """
    if not trunk or len(trial.t_s) < FEWEST_FRAMES:
        return Measures()
    dt_s = float(np.diff(trial.t_s).mean())
    axes = body_frames(trial.xyz_m[:, list(trunk)], dt_s=dt_s, cutoff_hz=fastest_hz(dt_s)).rotation
    found = {limb: cycle_frames(_swing(trial.xyz_m, axes, *limb)) for limb in _limbs(bones, trunk)}
    limbs = [limb for limb, cycle in found.items() if cycle]
    feet = [tip for root, tip in limbs if stands(trial.xyz_m[:, tip], found[root, tip])]
    strokes = {names[tip]: (names[root], names[tip]) for root, tip in limbs if tip not in feet}
    tips = [tip for _, tip in limbs if tip not in feet]
    pairs = [(a, b) for i, a in enumerate(tips) for b in tips[i + 1 :]]
    apart = {(a, b): np.linalg.norm(trial.xyz_m[:, a] - trial.xyz_m[:, b], axis=-1) for a, b in pairs}
    spans = {pair: float(np.nanmax(length)) for pair, length in apart.items() if cycle_frames(length)}
    wide = max(spans, key=lambda pair: spans[pair], default=None)
    forward, left = ahead(names, trial.xyz_m, trunk), leftwards([names[m] for m in trunk])
    return Measures(
        forward=forward if strokes else None,
        left=left if strokes else None,
        strokes=strokes,
        feet=tuple(names[foot] for foot in feet),
        distances={} if wide is None else {"span": (names[wide[0]], names[wide[1]])},
    )


def with_measures(skeleton: Skeleton, t_s: Array, xyz_m: Array) -> Skeleton:
    """A skeleton with the measures that its limbs show beside those that it states.

    Args:
        skeleton: With bones and a trunk.
        t_s: (T,) times.
        xyz_m: (T, M, 3) positions of its markers, in their order.
    """
    names = skeleton.markers
    trial = MarkerTrial(name=skeleton.name, t_s=t_s, xyz_m=xyz_m, sd_m=np.zeros(xyz_m.shape[:2]))
    bones = [(names.index(bone.a), names.index(bone.b)) for bone in skeleton.bones]
    found = proposed_measures(names, trial, bones, [names.index(name) for name in skeleton.trunk])
    return replace(skeleton, measures=found.and_of(skeleton.measures))


def leftwards(names: Sequence[str]) -> tuple[str, str] | None:
    """The first markers that names call the two sides of one thing: from right to left; None: there are none."""
    pairs = [(other_side(name), name) for name in names if side_of(name) == LEFT]
    return next((pair for pair in pairs if pair[0] in names), None)


def ahead(names: Sequence[str], xyz_m: Array, trunk: Sequence[int]) -> Line | None:
    """Two markers of the trunk, from hind to front: along its way, if that is longer than it is twice over.

    Of pairs that point along the way in every fifth of it to 25 degrees in the mean, the longest; None: there is none.
    """
    own = xyz_m[:, list(trunk)]
    seen = np.flatnonzero(np.isfinite(own).all(axis=(1, 2)))
    if len(seen) < FEWEST_FRAMES or len(trunk) < 2:
        return None
    middle = own[seen].mean(axis=1)
    size = float(np.linalg.norm(np.ptp(own[seen] - middle[:, None], axis=1), axis=-1).mean())
    if np.linalg.norm(middle[-1] - middle[0]) < 2 * size:
        return None
    ends = np.linspace(0, len(seen) - 1, 6).astype(int)
    found: dict[tuple[int, int], float] = {}
    for a, b in ((a, b) for a in range(len(trunk)) for b in range(len(trunk)) if a != b):
        away = own[seen, b] - own[seen, a]
        cosines = []
        for start, stop in pairwise(ends):
            way, line = middle[stop] - middle[start], away[start : stop + 1].mean(axis=0)
            cosines.append(way @ line / max(float(np.linalg.norm(way) * np.linalg.norm(line)), 1e-12))
        if min(cosines) > np.cos(np.radians(25.0)):
            found[a, b] = float(np.linalg.norm(away, axis=-1).mean())
    if not found:
        return None
    a, b = max(found, key=lambda pair: found[pair])
    return names[trunk[a]], names[trunk[b]]


def _limbs(bones: Sequence[tuple[int, int]], trunk: Sequence[int]) -> list[tuple[int, int]]:
    """Root in the trunk and tip of each chain of bones that leaves it and ends."""
    beside: dict[int, list[int]] = {}
    for a, b in bones:
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    found, walked, queue = [], set(trunk), [(root, root) for root in trunk]
    while queue:
        root, at = queue.pop(0)
        after = [marker for marker in beside.get(at, []) if marker not in walked]
        walked |= set(after)
        queue += [(root, marker) for marker in after]
        if not after and at != root:
            found.append((root, at))
    return sorted(found)


def _swing(xyz_m: Array, axes: Array, root: int, tip: int) -> Array:
    """(T,) angle of a limb along its direction of largest swing in the trunk, degrees; NaN where the swing is small."""
    along = np.einsum("tij,ti->tj", axes, xyz_m[:, tip] - xyz_m[:, root])
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    seen = np.isfinite(along).all(axis=-1)
    if seen.sum() < FEWEST_FRAMES:
        return np.full(len(along), np.nan)
    centred = along - along[seen].mean(axis=0)
    main = np.linalg.svd(centred[seen], full_matrices=False)[2][0]
    swing = np.degrees(np.arcsin(np.clip(centred @ main, -1, 1)))
    low, high = np.nanpercentile(swing, [5, 95])
    # 5th to 95th percentile; noise of bones bends them by up to 10
    return swing if high - low >= 15.0 else np.full(len(swing), np.nan)


def cycle_frames(values: Array) -> int:
    """Frames after which a series repeats; 0 where it does not, or shows fewer than 2.5 of them.

    The first peak of the autocorrelation after its first crossing of zero, of what is left of the series without its
    trend, each lag with the pairs that are there.
    """
    seen = np.isfinite(values)
    if seen.sum() < FEWEST_FRAMES:
        return 0
    frames = np.arange(len(values))
    rest = values - np.polyval(np.polyfit(frames[seen], values[seen], 1), frames)
    y, there = np.where(seen, rest, 0.0), seen.astype(float)
    most = int(len(y) / 2.5)  # so that one is seen whole wherever it begins
    pairs = np.array([there[: len(y) - k] @ there[k:] for k in range(most + 1)])
    sums = np.array([y[: len(y) - k] @ y[k:] for k in range(most + 1)])
    scale = y @ y / seen.sum()
    if not scale > 0 or (pairs < 10).any():
        return 0
    like = sums / pairs / scale
    below = np.flatnonzero(like < 0)
    if not len(below):
        return 0
    after = like[below[0] :]
    high = after >= 0.8 * after.max()  # later peaks, of two and three cycles, are as high but for the noise
    first = int(np.argmax(high))
    last = first + int(np.argmin(high[first:])) or len(high)
    lag = int(below[0]) + first + int(np.argmax(after[first : max(last, first + 1)]))
    # white noise has 0, a sine 1: half of the variance repeats
    return lag if like[lag] >= 0.5 and 3 < lag < most else 0


def stands(xyz_m: Array, cycle: int) -> bool:
    """Whether a point of a moving animal stands still in part of each cycle, as a foot does and a wing does not."""
    step = max(1, cycle // 10)  # noise of each frame is not speed
    speed = np.linalg.norm(xyz_m[step:] - xyz_m[:-step], axis=-1)
    speed = speed[np.isfinite(speed)]
    # a foot: at a quarter of its mean speed or less for a quarter of the time
    return len(speed) > 0 and bool(np.mean(speed < 0.25 * speed.mean()) >= 0.25)
