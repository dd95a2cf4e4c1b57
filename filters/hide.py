"""Gaps made on purpose in measured trials: one rule of where they may lie, for learning, validation and benchmarks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Generic, Literal, Protocol, TypeVar

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


@dataclass(frozen=True, eq=False, kw_only=True)
class Group:
    """Sets of markers of which one is hidden in a gap.

    Attributes:
        name: Of the kind of gap.
        sets: (G, M) True for the markers of each set.
        least: (G,) markers of a set that must be measured there (``Rules``) for it to be chosen.
        hides: Of the chosen set: every marker (``all``), those that were measured, or so many of these at random.
    """

    name: str
    sets: Mask
    least: NDArray[np.int64]
    hides: Literal["all", "measured"] | int = "measured"


@dataclass(frozen=True, kw_only=True)
class Rules:
    """Where gaps may lie.

    Attributes:
        margin: Frames on either side of a gap in which its markers were measured.
        measured: Share of the gap in which a marker was measured if it is to be compared.
        apart_frames: Frames between two gaps in which nothing is hidden,
        apart_share: and so many more as a share of the gap's length.
        alone: Whether that holds for all markers; else only for each marker by itself, and gaps overlap in time.
        longest_first: Whether gaps are placed in order of length, for long ones need most room; else as they come.
        copies: Copies of a trial that gaps are spread over, at most; None: as many as hold one of each.
        twice: Whether each gap is placed once more where there is room when each has its place.
    """

    margin: int = 3
    measured: float = 0.5
    apart_frames: int = 0
    apart_share: float = 0.25
    alone: bool = True
    longest_first: bool = False
    copies: int | None = 1
    twice: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Gap:
    """One gap.

    Attributes:
        kind: Name of its group.
        length: In frames.
        start: Its first frame.
        hidden: (M,) markers that are hidden.
        scored: (M,) of them, those that are compared: measured as the rules have it.
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


def hide(
    seen: Mask, wanted: Sequence[tuple[Group, int]], rng: np.random.Generator, rules: Rules
) -> list[tuple[Gap, ...]]:
    """A gap of every wanted group and length that (T, M) sightings have room for, for each copy of the trial.

    Each gap is drawn evenly from all places and sets that the rules allow. What has no room is left out.
    """
    copies: list[list[Gap]] = []
    order = [wanted[i] for i in rng.permutation(len(wanted))] if rules.longest_first else list(wanted)
    for group, length in sorted(order, key=lambda one: -one[1]) if rules.longest_first else order:
        fresh = [None] if rules.copies is None or len(copies) < rules.copies else []
        for gaps in [*copies, *fresh]:
            gap = _place(seen, gaps or [], group, length, rng, rules)
            if gap is not None:
                if gaps is None:
                    copies.append([gap])
                else:
                    gaps.append(gap)
                break
    for group, length in order if rules.twice else []:
        for gaps in copies:
            gap = _place(seen, gaps, group, length, rng, rules)
            if gap is not None:
                gaps.append(gap)
                break
    return [tuple(sorted(gaps, key=lambda gap: gap.start)) for gaps in copies]


def _place(
    seen: Mask, others: Sequence[Gap], group: Group, length: int, rng: np.random.Generator, rules: Rules
) -> Gap | None:
    """A gap apart from the others; None where there is no room."""
    margin, window = rules.margin, length + 2 * rules.margin
    starts = len(seen) - window + 1
    if starts < 1:
        return None
    count = np.cumsum(np.vstack([np.zeros((1, seen.shape[1]), dtype=int), seen]), axis=0)
    before, after = count[margin : margin + starts], count[margin + length : margin + length + starts]
    sides = before - count[:starts] + count[window:] - after
    whole = (sides == 2 * margin) & (after - before >= rules.measured * length)  # by the first frame of the window
    apart = rules.apart_frames + int(rules.apart_share * length)
    for other in others:
        near = slice(
            max(0, other.start - length - apart - margin + 1), max(0, other.start + other.length + apart - margin)
        )
        whole[near, :] &= False if rules.alone else ~other.hidden
    which, start = np.nonzero((whole.astype(int) @ group.sets.T.astype(int) >= group.least).T)
    if not len(start):
        return None
    i = int(rng.integers(len(start)))
    measured = whole[start[i]] & group.sets[which[i]]
    hidden = group.sets[which[i]] if group.hides == "all" else measured
    if isinstance(group.hides, int):
        hidden = np.isin(np.arange(seen.shape[1]), rng.choice(np.flatnonzero(measured), group.hides, False))
    return Gap(kind=group.name, length=length, start=int(start[i]) + margin, hidden=hidden, scored=hidden & measured)


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


def hide_own(trial: MarkerTrial, rng: np.random.Generator, *, share: float = 0.1) -> Hidden[MarkerTrial]:
    """Hide gaps like the trial's own: all of its gaps, moved together in time to where their markers are seen.

    What is missing together stays together, for as many frames. Markers that go missing alike are one gap. Moves are
    drawn until a share of the samples is hidden, or no place is left; a gap that falls where its markers are missing
    for half of its frames, or in three frames beside it, is left out of that move.

    Args:
        trial: The trial.
        rng: Where to.
        share: See above.
    """
    seen = trial.seen
    n_frames, n_markers = seen.shape
    own: dict[tuple[int, int], list[int]] = {}
    for marker, start, stop in unseen_runs(~interior_gaps(seen)):
        own.setdefault((start, stop), []).append(marker)
    left, gaps, margin = np.array(seen), [], Rules().margin
    for move in rng.permutation(np.arange(1, n_frames)) if own else ():
        if (seen & ~left).sum() >= share * seen.sum():
            break
        for (start, stop), markers in own.items():
            first, length = (start + int(move)) % n_frames, stop - start
            beside = (slice(first - margin, first), slice(first + length, first + length + margin))
            if first < margin or beside[1].stop > n_frames or not all(left[b][:, markers].all() for b in beside):
                continue
            shown = left[first : first + length, markers].mean(axis=0) >= Rules().measured
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
    place = np.nansum(centred, axis=0) / np.maximum(seen.sum(axis=0), 1)[:, None]
    near = np.argsort(np.linalg.norm(place[:, None] - place[None], axis=-1), axis=1)
    groups, one = {}, np.ones(n_markers, dtype=np.int64)
    for size in (1, max(2, n_markers // 4), max(3, n_markers // 2), max(4, 3 * n_markers // 4)):
        sets = np.zeros((n_markers, n_markers), dtype=bool)
        np.put_along_axis(sets, near[:, :size], True, axis=1)
        groups[size] = Group(name=f"{size} neighbours", sets=sets, least=one)
    lengths = lengths_for(n_frames)
    first = (int(rng.integers(max(len(lengths), 1))) if turn is None else turn) % max(len(lengths), 1)
    order = [*lengths[::-1][first:], *lengths[::-1][:first]]
    wanted = [(groups[int(size)], length) for size, length in product(rng.permutation(list(groups)), order)]
    return Hidden(trial=trial, gaps=next(iter(hide(seen, wanted, rng, Rules())), ()))
