"""Identity switches: for a while two markers have each other's names, in all cameras or in the positions themselves.

Whether two markers are swapped in a frame is a state that changes rarely; the most likely sequence of states is found
by dynamic programming (Viterbi 1967). Evidence for a state is that both paths bend no more than they usually do, and
that rigid bones keep their lengths. A run is undone only where that is more likely by a clear margin, and is reported.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, true_runs
from mocap.cleaning.marker_paths import (
    CHANGE,
    MARGIN,
    STEP,
    BoneLength,
    belonging,
    bend_scales,
    bone_lengths,
    crossing_pairs,
    jumped,
    pair_evidence,
    steady_pairs,
    straight_on,
    stretched_pairs,
    student_log,
    unbroken,
)

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
        for part in np.split(frames, np.flatnonzero((np.diff(frames) > STEP) | off[1:]) + 1):
            ends = (part[0], part[-1])
            hidden = ~seen[ends[0] : ends[1] + 1].any(axis=0) & np.isfinite(bend_m)
            at_ends = list(zip(ways, ends, strict=True))
            off_way = np.stack([np.linalg.norm(xyz_m[end, j] - ahead[end], axis=-1) for (ahead, _), end in at_ends])
            near = off_way <= np.stack([limit[end] for (_, limit), end in at_ends])
            beside = np.stack(
                [seen[max(0, ends[0] - STEP) : ends[0]].any(axis=0), seen[ends[1] + 1 :][:STEP].any(axis=0)]
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
                        sd = float(
                            np.clip(np.nan_to_num(limit[end, marker] / (5 * np.sqrt(3)), nan=widest), 1e-9, widest)
                        )
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
