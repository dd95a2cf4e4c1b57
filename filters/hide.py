"""Gaps made on purpose in measured trials: one rule of where they may lie, for learning, validation and benchmarks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Generic, Protocol, TypeVar

import numpy as np
from mocap.filters.poses import MarkerTrial
from numpy.typing import NDArray

from eal.arrays import Array

Mask = NDArray[np.bool_]
GAP_FRAMES = (10, 25, 50, 100)
"""Lengths of the gaps that a model is prepared for, as far as trials have room for them."""


def unseen_runs(seen: Mask) -> Iterator[tuple[int, int, int]]:
    """Marker, first frame and frame after the last of every run of (T, M) sightings in which a marker is not seen."""
    edges = np.diff(np.pad((~seen).astype(np.int8), ((1, 1), (0, 0))), axis=0).T
    marker, start = np.nonzero(edges == 1)
    _, stop = np.nonzero(edges == -1)
    yield from zip(marker.tolist(), start.tolist(), stop.tolist(), strict=True)


def gap_lengths(seen: Mask) -> NDArray[np.int64]:
    """(T, M) length in frames of the run of unseen frames that each sample lies in; 0 where seen."""
    out = np.zeros(seen.shape, dtype=np.int64)
    for marker, start, stop in unseen_runs(seen):
        out[start:stop, marker] = stop - start
    return out


def length_bins(frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """The first of ``GAP_FRAMES`` that a gap does not exceed, by its index; of a longer one their number."""
    return np.searchsorted(np.array(GAP_FRAMES), frames, side="left")


def interior_gaps(seen: Mask) -> Mask:
    """(T, M) True where a marker is not seen between its first and its last sighting."""
    before = np.logical_or.accumulate(seen, axis=0)
    after = np.logical_or.accumulate(seen[::-1], axis=0)[::-1]
    return ~seen & before & after


def excerpt(seen: Mask, frames: int, rng: np.random.Generator | None = None) -> slice:
    """At most so many frames of (T, M) sightings: where most is seen; with ``rng`` the best of four random places."""
    if len(seen) <= frames:
        return slice(0, len(seen))
    total = np.concatenate([[0], np.cumsum(seen.sum(axis=1))])
    starts = np.arange(len(seen) - frames + 1) if rng is None else rng.integers(0, len(seen) - frames + 1, size=4)
    start = int(starts[np.argmax(total[starts + frames] - total[starts])])
    return slice(start, start + frames)


MARGIN, MEASURED = 3, 0.5
"""Frames on either side of a gap in which its markers were measured, and the share of it in which they were."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Gap:
    """One gap.

    Attributes:
        kind: What it hides, by name.
        length: In frames.
        start: Its first frame.
        hidden: (M,) markers that are hidden.
        scored: (M,) of them, those that are compared: they were measured (``place``).
    """

    kind: str
    length: int
    start: int
    hidden: Mask
    scored: Mask

    @property
    def frames(self) -> slice:
        """Its frames."""
        return slice(self.start, self.start + self.length)


def place(
    seen: Mask,
    others: Sequence[Gap],
    sets: Mask,
    least: NDArray[np.int64] | int,
    length: int,
    rng: np.random.Generator,
    *,
    margin: int = MARGIN,
    measured: float = MEASURED,
    apart: int | None = None,
) -> tuple[int, int, Mask] | None:
    """Where a gap may lie in (T, M) sightings, drawn evenly from all places and sets of markers; None: there is none.

    Args:
        seen: Sightings.
        others: Gaps that are there.
        sets: (G, M) True for the markers of each set.
        least: (G,) markers of a set that must be measured there.
        length: In frames.
        rng: Where to.
        margin: See ``MARGIN``.
        measured: See there.
        apart: Frames between two gaps in which nothing is hidden; None: a quarter of its length.

    Returns:
        Its first frame, the set, and (M,) the markers of the set that were measured there.
    """
    window = length + 2 * margin
    starts = len(seen) - window + 1
    if starts < 1:
        return None
    count = np.cumsum(np.vstack([np.zeros((1, seen.shape[1]), dtype=int), seen]), axis=0)
    before, after = count[margin : margin + starts], count[margin + length : margin + length + starts]
    sides = before - count[:starts] + count[window:] - after
    whole = (sides == 2 * margin) & (after - before >= measured * length)  # by the first frame of the window
    apart = length // 4 if apart is None else apart
    for other in others:
        first, last = other.start - length - apart - margin + 1, other.start + other.length + apart - margin
        whole[max(0, first) : max(0, last)] = False
    which, start = np.nonzero((whole.astype(int) @ sets.T.astype(int) >= least).T)
    if not len(start):
        return None
    i = int(rng.integers(len(start)))
    return int(start[i]) + margin, int(which[i]), whole[start[i]] & sets[which[i]]


class _Recorded(Protocol):
    @property
    def xyz_m(self) -> Array: ...


Recorded = TypeVar("Recorded", bound=_Recorded)


@dataclass(frozen=True, eq=False, kw_only=True)
class Hidden(Generic[Recorded]):
    """A trial with gaps.

    Attributes:
        trial: The trial as measured: any record of positions ``xyz_m`` (T, M, 3).
        gaps: What is hidden of it.
    """

    trial: Recorded
    gaps: tuple[Gap, ...]

    @cached_property
    def shown(self) -> Recorded:
        """The trial without what is hidden."""
        xyz = np.array(self.trial.xyz_m)
        for gap in self.gaps:
            xyz[gap.frames, gap.hidden] = np.nan
        return replace(self.trial, xyz_m=xyz)  # type: ignore[type-var]  # all such records are dataclasses

    @cached_property
    def gap(self) -> NDArray[np.int64]:
        """(T, M) number of the gap in which a measured sample is to be compared; -1 else."""
        out = np.full(self.trial.xyz_m.shape[:2], -1)
        for number, gap in enumerate(self.gaps):
            out[gap.frames, gap.scored] = number
        return np.where(np.isfinite(self.trial.xyz_m[..., 0]), out, -1)

    @property
    def mask(self) -> Mask:
        """(T, M) samples to compare; all of them were measured."""
        return self.gap >= 0

    @property
    def length(self) -> NDArray[np.int64]:
        """(T, M) length in frames of the gap that such a sample lies in; 0 else."""
        return np.array([*(gap.length for gap in self.gaps), 0])[self.gap]

    def count(self, frames: int) -> int:
        """Number of gaps of that length."""
        return sum(gap.length == frames for gap in self.gaps)


def hide_own(trial: MarkerTrial, rng: np.random.Generator) -> Hidden[MarkerTrial]:
    """Hide gaps like the trial's own: all of its gaps, moved together in time to where their markers are seen.

    What is missing together stays together, for as many frames. Markers that go missing alike are one gap. Moves are
    drawn until a tenth of the samples is hidden, or no place is left; a gap that falls where its markers are missing
    for half of its frames, or in three frames beside it, is left out of that move.

    Args:
        trial: The trial.
        rng: Where to.
    """
    seen = trial.seen
    n_frames, n_markers = seen.shape
    own: dict[tuple[int, int], list[int]] = {}
    for marker, start, stop in unseen_runs(~interior_gaps(seen)):
        own.setdefault((start, stop), []).append(marker)
    left, gaps = np.array(seen), []
    for move in rng.permutation(np.arange(1, n_frames)) if own else ():
        if (seen & ~left).sum() >= 0.1 * seen.sum():
            break
        for (start, stop), markers in own.items():
            first, length = (start + int(move)) % n_frames, stop - start
            beside = (slice(first - MARGIN, first), slice(first + length, first + length + MARGIN))
            if first < MARGIN or beside[1].stop > n_frames or not all(left[b][:, markers].all() for b in beside):
                continue
            shown = left[first : first + length, markers].mean(axis=0) >= MEASURED
            if shown.any():
                hidden = np.isin(np.arange(n_markers), np.array(markers)[shown])
                gaps.append(Gap(kind="own", length=length, start=first, hidden=hidden, scored=hidden))
                left[first : first + length, hidden] = False
    return Hidden(trial=trial, gaps=tuple(gaps))


def nearest_length(frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of lengths in frames the power of 2 that is nearest: what gaps of any length show is put together by these."""
    return 2 ** np.rint(np.log2(np.maximum(frames, 1))).astype(np.int64)


def lengths_for(n_frames: int) -> list[int]:
    """Lengths of gaps that a trial has room for."""
    lengths = [n for n in GAP_FRAMES if max(1.5 * n, n + 6) <= n_frames] or [max(1, n_frames // 4)]
    return [n for n in lengths if n + 6 <= n_frames]


def hide_neighbours(trial: MarkerTrial, rng: np.random.Generator, *, turn: int | None = None) -> Hidden[MarkerTrial]:
    """Hide markers as recordings lose them: one, it with its neighbours, half, three quarters; for 10 to 100 frames.

    At most one gap of each length for each size of group, in one copy of the trial. Lengths are placed
    from one of them on downwards: a trial that has no room for all holds others each time.

    Args:
        trial: The trial.
        rng: Where to hide.
        turn: Length to begin with, counted down from the longest; None: any.
    """
    seen = trial.seen
    n_frames, n_markers = seen.shape
    xyz = np.where(np.asarray(seen.any(axis=1))[:, None, None], trial.xyz_m, 0.0)
    centred = trial.xyz_m - np.nanmean(xyz, axis=1, keepdims=True)
    middle = np.nansum(centred, axis=0) / np.maximum(seen.sum(axis=0), 1)[:, None]
    near = np.argsort(np.linalg.norm(middle[:, None] - middle[None], axis=-1), axis=1)
    groups = {}
    for size in (1, max(2, n_markers // 4), max(3, n_markers // 2), max(4, 3 * n_markers // 4)):
        groups[size] = np.zeros((n_markers, n_markers), dtype=bool)
        np.put_along_axis(groups[size], near[:, :size], True, axis=1)
    lengths = lengths_for(n_frames)
    first = (int(rng.integers(max(len(lengths), 1))) if turn is None else turn) % max(len(lengths), 1)
    order = [*lengths[::-1][first:], *lengths[::-1][:first]]
    gaps: list[Gap] = []
    for size, length in product(rng.permutation(list(groups)), order):
        found = place(seen, gaps, groups[int(size)], 1, length, rng)
        if found is not None:
            start, _, hidden = found
            gaps.append(Gap(kind=f"{size} neighbours", length=length, start=start, hidden=hidden, scored=hidden))
    return Hidden(trial=trial, gaps=tuple(sorted(gaps, key=lambda gap: gap.start)))
