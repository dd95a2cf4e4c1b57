"""Identity switches: for a while two markers have each other's names, in all cameras or in the positions themselves.

Whether two markers are swapped in a frame is a state that changes rarely; the most likely sequence of states is found
by dynamic programming (Viterbi 1967). Evidence for a state is that both paths bend no more than they usually do, and
that rigid bones keep their lengths. A run is undone only where that is more likely by a clear margin, and is reported.
"""

from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, true_runs
from mocap.cleaning.click_noise import USUAL_DOF
from mocap.cleaning.positions import medians
from mocap.filters.independent import INDEPENDENT

Mask = NDArray[np.bool_]
Bones = NDArray[np.int64]
Pair = tuple[int, int]

REPAIRS = {
    "exchanged_ray": "identity switch in one camera: the names of two markers were swapped back",
    "exchanged_marker": "identity switch: the names of two markers were swapped back",
}
"""How a sample was repaired, by the key that reports use."""
DOUBTFUL = {"doubtful_name": "next to an identity switch, or isolated on another marker's path: identity ambiguous"}
"""Why a sample was rejected here, by the key that reports use."""
WAY_FRAMES = 3
"""Frames over which a marker that was not seen in between may be recognised by its path. Chosen, not measured."""
CHANGE = 12.0
"""Negative log probability that two given markers change names between two given frames (one in 160 000).
Chosen, not measured."""
BENDS = 5 * np.sqrt(3)
"""A path goes on straight within so many deviations of a coordinate: five of each of three. Chosen, not measured."""
MARGIN = 8.0
"""Log likelihood by which a run must win, after what its two changes cost, to be undone: odds of 3000.
Chosen, not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Swap:
    """An identity switch: two markers that had each other's names.

    Attributes:
        a: Index of one marker.
        b: Index of the other.
        frames: (K,) frames, increasing.
        camera: Index of the only camera in which they did; None: everywhere.
        gain: Log likelihood won by undoing it.
    """

    a: int
    b: int
    frames: NDArray[np.int64]
    camera: int | None
    gain: float


@dataclass(frozen=True)
class BoneLength:
    """Two markers, the median of their distance and its deviation in metres."""

    a: int
    b: int
    median_m: float
    sd_m: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Exchanged:
    """What was found, and the samples to which it happened.

    Attributes:
        swaps: Runs that were undone, one entry a run.
        unsure: (T, M) samples of ambiguous identity, beside a run or alone on another marker's path (``lone_runs``).
    """

    swaps: tuple[Swap, ...]
    unsure: Mask


def exchanged_samples(shape: tuple[int, int], swaps: Iterable[Swap]) -> dict[str, Mask]:
    """(T, M) samples that had another marker's name, by the keys of ``REPAIRS``; each under the last that fits."""
    out = {key: np.zeros(shape, dtype=bool) for key in REPAIRS}
    for swap in swaps:
        key = "exchanged_marker" if swap.camera is None else "exchanged_ray"
        out[key][np.ix_(swap.frames, np.array([swap.a, swap.b]))] = True
    out["exchanged_ray"] &= ~out["exchanged_marker"]
    return out


def exchange(values: Array, swaps: Sequence[Swap]) -> Array:
    """A copy of (T, M, ...) values with the swaps undone, or done."""
    out = values.copy()
    for swap in swaps:
        out[swap.frames, swap.a], out[swap.frames, swap.b] = out[swap.frames, swap.b], out[swap.frames, swap.a].copy()
    return out


def without_edited(swaps: Iterable[Swap], edited: Mask) -> tuple[list[Swap], list[Swap]]:
    """Swaps in frames in which no person edited (T, M) either marker, and in the others, where the person is right."""
    kept, undone = list[Swap](), list[Swap]()
    for swap in swaps:
        own = edited[np.ix_(swap.frames, np.array([swap.a, swap.b]))].any(axis=1)
        for part, where in ((kept, ~own), (undone, own)):
            part += [replace(swap, frames=swap.frames[where])] if where.any() else []
    return kept, undone


def exchanged_markers(xyz_m: Array, bones: Bones) -> Exchanged:
    """Find identity switches, the clearest first; each search starts from the data with the earlier ones undone.

    Args:
        xyz_m: (T, M, 3) positions; NaN where not seen.
        bones: (B, 2) markers at constant distance.
    """
    if len(xyz_m) < 3:
        return Exchanged(swaps=(), unsure=np.zeros(xyz_m.shape[:2], dtype=bool))
    xyz = xyz_m.copy()
    lengths = bone_lengths(xyz, np.concatenate([bones, steady_pairs(xyz, bones)]))
    unsure = np.zeros(xyz.shape[:2], dtype=bool)
    swaps: list[Swap] = []
    done: set[Pair] = set()
    bend = bend_scales(xyz)
    for _ in range(60):  # pairs at most
        crossing = crossing_pairs(xyz, bend)
        found: dict[Pair, tuple[list[Swap], Mask]] = {}
        for by_bones in (False, True):
            for pair in sorted((stretched_pairs(xyz, lengths) if by_bones else crossing) - done):
                suspects = {marker for other in crossing if not set(other) & set(pair) for marker in other}
                runs = runs_of(xyz, bend, pair, pair_evidence(xyz, lengths, pair, suspects))
                if runs[0]:
                    found[pair] = runs
            if found:
                break
        if not found:
            break
        best = max(found, key=lambda pair: sum(run.gain for run in found[pair][0]))
        runs, doubtful = found[best]
        xyz = exchange(xyz, runs)
        xyz[doubtful] = np.nan
        unsure |= doubtful
        swaps += runs
        done.add(best)
    lone, doubtful = lone_runs(xyz, bend, bone_lengths(xyz, bones))
    return Exchanged(swaps=(*swaps, *lone), unsure=unsure | doubtful)


def lone_runs(xyz_m: Array, bend_m: Array, lengths: Sequence[BoneLength]) -> tuple[list[Swap], Mask]:
    """Runs in which a marker had the name of another one that was hidden meanwhile, and (T, M) ambiguous samples.

    A stretch of one name, unbroken and straight, is given to another marker where its ends lie on the path of that one
    rather than on its own: log densities of both ends about both straight continuations, whose deviations grow with the
    frames that they bridge, and what bones say, less two changes. Rigid bones must speak for it clearly by themselves:
    markers that hide each other for a few frames come and go near to each other. Where bones say neither, a stretch
    that stands alone under its name is doubtful if it fills a hole in the way of a marker that is always ten times as
    far off as it is from that way.

    Args:
        xyz_m: (T, M, 3) positions.
        bend_m: (M,) usual bend of each way.
        lengths: Rigid bones.
    """
    seen = np.isfinite(xyz_m[..., 0])
    ways = [straight_on(xyz_m, bend_m)[:2], tuple(v[::-1] for v in straight_on(xyz_m[::-1], bend_m)[:2])]
    found = []
    doubtful = np.zeros_like(seen)
    for j in np.flatnonzero(seen.any(axis=0) & np.isfinite(bend_m)):
        frames = np.flatnonzero(seen[:, j])
        off = np.linalg.norm(xyz_m[frames, j] - ways[0][0][frames, j], axis=-1) > ways[0][1][frames, j]
        for part in np.split(frames, np.flatnonzero((np.diff(frames) > WAY_FRAMES) | off[1:]) + 1):
            ends = (part[0], part[-1])
            hidden = ~seen[ends[0] : ends[1] + 1].any(axis=0) & np.isfinite(bend_m)
            at_ends = list(zip(ways, ends, strict=True))
            off_way = np.stack([np.linalg.norm(xyz_m[end, j] - ahead[end], axis=-1) for (ahead, _), end in at_ends])
            near = off_way <= np.stack([limit[end] for (_, limit), end in at_ends])
            beside = np.stack(
                [seen[max(0, ends[0] - WAY_FRAMES) : ends[0]].any(axis=0), seen[ends[1] + 1 :][:WAY_FRAMES].any(axis=0)]
            )
            fills = np.all(near & beside, axis=0) if not beside[:, j].any() else np.zeros_like(hidden)
            for i in np.flatnonzero(hidden & near.any(axis=0)):
                pair = (int(min(i, j)), int(max(i, j)))
                inside = slice(ends[0], ends[1] + 1)
                by_bones = float(pair_evidence(xyz_m[inside], lengths, pair, set()).sum())
                if by_bones < MARGIN and not (fills[i] and by_bones > -MARGIN):
                    continue
                apart = np.linalg.norm(xyz_m[:, i] - xyz_m[:, j], axis=-1)
                if not np.isfinite(apart).any():
                    continue
                doubtful[part, j] |= fills[i] and 10 * off_way[:, i].max() < np.nanquantile(apart, 0.05)
                if by_bones < MARGIN:
                    continue
                widest, score = float(np.nanmedian(apart)), by_bones - 2 * CHANGE
                for (ahead, limit), end in at_ends:
                    for marker, sign in ((i, 1), (j, -1)):
                        sd = float(np.clip(np.nan_to_num(limit[end, marker] / BENDS, nan=widest), 1e-9, widest))
                        miss = np.linalg.norm(xyz_m[end, j] - ahead[end, marker]) if sd < widest else widest
                        score += sign * (float(student_log(np.array((miss / sd) ** 2), 3)) - 3 * np.log(sd))
                if score > MARGIN:
                    found.append(Swap(a=pair[0], b=pair[1], frames=part, camera=None, gain=score))
    chosen, taken = clearest(found, seen.shape)
    return chosen, doubtful & ~taken


def clearest(found: Iterable[Swap], shape: tuple[int, int]) -> tuple[list[Swap], Mask]:
    """Runs by their gain, no two of one marker in one frame, and (T, M) the samples of these."""
    taken, chosen = np.zeros(shape, dtype=bool), []
    for run in sorted(found, key=lambda run: -run.gain):
        where = np.ix_(run.frames, np.array([run.a, run.b]))
        if not taken[where].any():
            taken[where] = True
            chosen.append(run)
    return chosen, taken


def runs_of(xyz_m: Array, bend_m: Array, pair: Pair, for_exchange: Array) -> tuple[list[Swap], Mask]:
    """Runs of frames in which the names of a pair were swapped, and (T, M) samples beside them of ambiguous identity.

    The state of a frame in which both are seen is s = 1 for exchanged. The log likelihood of a sequence is that of the
    bends of both ways over every three frames, plus what bones say, less ``CHANGE`` for each change of state.

    Args:
        xyz_m: (T, M, 3) positions.
        bend_m: (M,) usual bend of each path (``bend_scales``).
        pair: The two markers.
        for_exchange: (T,) log likelihood of s = 1 less that of s = 0 from all else; where one of the two is seen alone
            it counts for the nearest frame in which both are.
    """
    a, b = pair
    unsure = np.zeros(xyz_m.shape[:2], dtype=bool)
    frames = np.flatnonzero(np.isfinite(xyz_m[:, [a, b], 0]).all(axis=1))
    if len(frames) < 3 or not np.isfinite(bend_m[[a, b]]).all():
        return [], unsure
    bends = _bends(xyz_m[frames][:, [a, b]], frames, float(max(bend_m[a], bend_m[b])))
    nearest = np.searchsorted((frames[1:] + frames[:-1]) / 2, np.arange(len(xyz_m)))
    # of two states that nothing tells apart the longer is right
    own = np.bincount(nearest, for_exchange, len(frames)) - 0.02
    two, bend = xyz_m[:, [a, b]], bend_m[[a, b]]
    # a change is next to impossible while one goes on straight in full view, and likely where one, alone in view,
    # jumps to the other's way
    change = CHANGE + 30.0 * unbroken(two, frames, bend) - 11.0 * jumped(two, frames, bend)
    state = _most_likely(bends, own, change)
    score = _score(bends, own, change, state)
    runs, kept = [], np.zeros_like(state)
    for start, stop in true_runs(state):
        without = state.copy()
        without[start:stop] = 0
        gain = score - _score(bends, own, change, without)
        if gain > MARGIN:
            kept[start:stop] = 1
            runs.append((start, stop, gain))
    swaps = []
    for start, stop, gain in runs:
        first = int(frames[start]) if start else 0
        last = int(frames[stop - 1]) if stop < len(frames) else len(xyz_m) - 1
        inside = np.arange(first, last + 1)
        inside = inside[np.isfinite(xyz_m[inside][:, [a, b], 0]).any(axis=1)]
        swaps.append(Swap(a=a, b=b, frames=inside, camera=None, gain=float(gain)))
    changes = [k for run in runs for k in run[:2] if 0 < k < len(frames)]
    right = exchange(xyz_m, swaps)[:, [a, b]]
    for k in changes:
        belongs = belonging(right, frames[k - 1 : k + 1], kept[k - 1 : k + 1], bend_m[[a, b]])
        for j, marker in enumerate(pair):
            unsure[belongs[j] < 0, marker] = True
        more = np.flatnonzero((belongs == 1).any(axis=0))
        more = more[(belongs[:, more] >= 0).all(axis=0) | ~np.isfinite(xyz_m[more][:, [a, b], 0]).all(axis=1)]
        if len(more):
            run = next(i for i, (start, stop, _) in enumerate(runs) if k in (start, stop))
            frames_of = np.union1d(swaps[run].frames, more)
            swaps[run] = replace(swaps[run], frames=frames_of)
    return swaps, unsure


def _bends(xyz_m: Array, frames: NDArray[np.int64], bend_m: float) -> Array:
    """(K, 2, 2, 2) log likelihood of both ways' bends at frame k for the states of frames k - 2, k - 1 and k.

    A bend is what the last sample is off the straight line through the two before; with steps g and h in frames a
    curvature of one a frame squared makes h (g + h) / 2 of it.
    """
    out = np.zeros((len(frames), 2, 2, 2))
    g, h = np.diff(frames)[:-1], np.diff(frames)[1:]
    scale = bend_m * h * (g + h) / 2
    for states in product((0, 1), repeat=3):
        for flip in (0, 1):
            first, middle, last = (xyz_m[k : k + len(g), s ^ flip] for k, s in enumerate(states))
            off = last - middle - (middle - first) * (h / g)[:, None]
            out[(slice(2, None), *states)] += student_log(np.sum(off**2, axis=-1) / scale**2, 3)
    return out


def _most_likely(bends: Array, own: Array, change: Array) -> NDArray[np.int64]:
    """(K,) most likely states (Viterbi), each with the one before as one of four states of the chain."""
    n = len(own)
    differ = 1 - np.eye(2)
    value = own[0] * np.array([[0.0], [1.0]]) + own[1] * np.array([[0.0, 1.0]]) - change[1] * differ
    choice = np.zeros((n, 2, 2), dtype=np.int64)
    for k in range(2, n):
        options = value[:, :, None] + bends[k]  # (state k - 2, k - 1, k)
        choice[k] = np.argmax(options, axis=0)
        value = np.max(options, axis=0) - change[k] * differ + own[k] * np.array([[0.0, 1.0]])
    state = np.zeros(n, dtype=np.int64)
    state[n - 2], state[n - 1] = np.unravel_index(np.argmax(value), (2, 2))
    for k in range(n - 1, 1, -1):
        state[k - 2] = choice[k, state[k - 1], state[k]]
    return state


def _score(bends: Array, own: Array, change: Array, state: NDArray[np.int64]) -> float:
    """Log likelihood of a sequence of states."""
    k = np.arange(2, len(state))
    changes = change[1:] @ np.abs(np.diff(state))
    return float(bends[k, state[:-2], state[1:-1], state[2:]].sum() + own @ state - changes)


def bend_scales(xyz_m: Array) -> Array:
    """(M,) standard deviation of a coordinate of the second differences of each path, in metres per frame squared.

    From its 90 % quantile over frames (2.5 deviations for three coordinates), which rare errors do not move; inf where
    unknown.
    """
    size = np.linalg.norm(np.diff(xyz_m, n=2, axis=0), axis=-1)
    out = np.full(xyz_m.shape[1], np.inf)
    for marker, column in enumerate(size.T):
        finite = column[np.isfinite(column)]
        if len(finite) >= 10:
            out[marker] = max(float(np.quantile(finite, 0.9)) / 2.5, 1e-9)
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
    return ahead, BENDS * bend_m * gap * (gap + step) / 2, before


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
        limit = BENDS * bend_m[j] * h * (g + h) / 2
        goes_on = np.concatenate([[False, False], (off <= limit) & (h <= WAY_FRAMES)])
        breaks = np.concatenate([[0], np.cumsum(~goes_on)])
        at = np.searchsorted(seen, frames)
        near = np.concatenate([[np.inf, np.inf], limit])[at] < 0.5 * apart
        out[1:] |= (np.diff(at) > 1) & (breaks[at[1:] + 1] == breaks[at[:-1] + 1]) & near[1:]
    return out


def belonging(xyz_m: Array, ends: NDArray[np.int64], state: NDArray[np.int64], bend_m: Array) -> NDArray[np.int64]:
    """Samples between two frames of different states, where one of two markers is seen at a time.

    From both ends each way is continued straight, sample by sample, as long as these lie where its bend may bring it
    within ``WAY_FRAMES`` frames, and nearer than half of the distance that the two usually have.

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
            frames = [int(t) for t in outside[seen[way, outside]][-2:]]
            at = [xyz_m[t, way] for t in frames]
            for t in order[seen[name, order]]:
                if len(frames) < 2:
                    break
                g, h = abs(frames[-1] - frames[-2]), abs(int(t) - frames[-1])
                off = xyz_m[t, name] - at[-1] - (at[-1] - at[-2]) * h / g
                limit = min(BENDS * bend_m[way] * h * (g + h) / 2, half)
                if h > WAY_FRAMES or np.linalg.norm(off) > limit:
                    break
                reached[end, name, t] = True
                frames, at = [frames[-1], int(t)], [at[-1], xyz_m[t, name]]
    out = np.zeros((2, len(xyz_m)), dtype=np.int64)
    out[:, between] = np.where(
        seen[:, between], np.where(reached[1] == reached[0], -1, reached[state[1]])[:, between], 0
    )
    return out


def student_log(squares: Array, size: int) -> Array:
    """Log density of Student's t in ``size`` dimensions at squared standardised distances, less that at its centre."""
    # neither digitisers nor animals are normal
    return -0.5 * (USUAL_DOF + size) * np.log1p(squares / USUAL_DOF)


def usual_length(length_m: Array) -> tuple[float, float] | None:
    """Median of (T,) lengths and its robust deviation, 5 % of it or more; None where fewer than ten are known."""
    finite = length_m[np.isfinite(length_m)]
    if len(finite) < 10:
        return None
    median = float(np.median(finite))
    return median, max(1.4826 * float(np.median(np.abs(finite - median))), 0.05 * median, 1e-9)


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
        median = medians(distance)
        varies = 1.4826 * medians(np.abs(distance - median)) / np.maximum(median, 1e-12)
        varies[np.isfinite(distance).sum(axis=0) < 30] = np.inf
        varies[marker] = np.inf
        best = np.argsort(varies)[:3]
        out += [(marker, int(other)) for other in best if varies[other] < 0.2]
    return np.array(out, dtype=np.int64).reshape(-1, 2)


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
    return INDEPENDENT * total


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
        total = INDEPENDENT * np.cumsum(np.concatenate([np.zeros((1, n_markers)), total]), axis=0)
        rise = np.max(total - np.minimum.accumulate(total, axis=0), axis=0)
        out |= {(a, int(b)) for b in np.flatnonzero(rise > CHANGE + MARGIN) if b > a}
    return out
