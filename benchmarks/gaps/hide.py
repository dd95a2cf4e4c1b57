"""Where the gaps of the benchmark lie: kinds of gaps of ``mocap.filters.hide``, and excerpts of trials."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from mocap.filters import hide as hiding
from mocap.filters.hide import Gap, Mask
from numpy.typing import NDArray

from benchmarks.gaps.method import Trial
from benchmarks.gaps.rays import Shown

SCENARIOS = ("single", "pair", "limb", "all")
"""One marker of a limb, two of the same limb, a whole limb, all limbs at once."""
GAPS = (10, 25, 50, 100)
"""Lengths in frames."""
MARGIN = 5
"""Frames on either side of a gap in which its markers were measured and stay shown."""
SPACING = 20
"""Frames between two gaps of a trial in which nothing is hidden."""

Cell = tuple[str, int]
"""A scenario and a length."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Group:
    """Sets of markers of which one is hidden in a gap.

    Attributes:
        name: Of the kind of gap.
        sets: (G, M) True for the markers of each set.
        least: (G,) markers of a set that must be measured there for it to be chosen.
        hides: Of the chosen set: every marker (``all``), or so many of those that were measured, at random.
    """

    name: str
    sets: Mask
    least: NDArray[np.int64]
    hides: Literal["all"] | int


def cells(*, scenarios: Sequence[str] = SCENARIOS, lengths: Sequence[int] = GAPS) -> list[Cell]:
    """All pairs of a scenario and a length; short ones (10, 25) three times and twice, for they hold few samples."""
    times = {10: 3, 25: 2}
    return [(scenario, length) for scenario in scenarios for length in lengths for _ in range(times.get(length, 1))]


def groups(trial: Trial) -> dict[str, Group]:
    """What each scenario hides of a trial: of the limbs, if half of their markers (two at least) were measured."""
    limbs = np.array([[name in limb for name in trial.names] for limb in trial.limbs], dtype=bool)
    every = np.atleast_2d(limbs.any(axis=0)) if len(limbs) > 1 else limbs[:0]
    one, two = np.ones(len(limbs), dtype=np.int64), np.full(len(limbs), 2)
    return {
        "single": Group(name="single", sets=limbs, least=one, hides=1),
        "pair": Group(name="pair", sets=limbs, least=two, hides=2),
        "limb": Group(name="limb", sets=limbs, least=np.maximum(2, (limbs.sum(axis=1) + 1) // 2), hides="all"),
        "all": Group(name="all", sets=every, least=np.maximum(2, (every.sum(axis=1) + 1) // 2), hides="all"),
    }


def hide(trial: Trial, wanted: Sequence[Cell], rng: np.random.Generator) -> list[Shown]:
    """A gap of every wanted kind that the trial has room for, in as few copies of the trial as random placing allows.

    No ray is left in gaps. When each kind has its gap, each is placed once more where a copy still has room.

    Args:
        trial: As measured.
        wanted: Kinds of gaps; a list may name one several times.
        rng: Where and which.
    """
    known, seen = groups(trial), np.isfinite(trial.xyz_m[..., 0])
    order = [wanted[i] for i in rng.permutation(len(wanted))]
    copies: list[list[Gap]] = []
    for scenario, length in sorted(order, key=lambda one: -one[1]):  # long ones need most room
        for gaps in [*copies, list[Gap]()]:
            gap = _placed(seen, gaps, known[scenario], length, rng)
            if gap is not None:
                copies += [] if gaps else [gaps]
                gaps.append(gap)
                break
    for scenario, length in order:
        for gaps in copies:
            gap = _placed(seen, gaps, known[scenario], length, rng)
            if gap is not None:
                gaps.append(gap)
                break
    return [Shown(trial=trial, gaps=tuple(sorted(copy, key=lambda gap: gap.start))) for copy in copies]


def _placed(seen: Mask, others: Sequence[Gap], group: Group, length: int, rng: np.random.Generator) -> Gap | None:
    """Only samples are compared whose marker was measured through the whole gap."""
    found = hiding.place(seen, others, group.sets, group.least, length, rng, margin=MARGIN, measured=1.0, apart=SPACING)
    if found is None:
        return None
    start, which, measured = found
    hidden = group.sets[which]
    if isinstance(group.hides, int):
        hidden = np.isin(np.arange(seen.shape[1]), rng.choice(np.flatnonzero(measured), group.hides, False))
    return Gap(kind=group.name, length=length, start=start, hidden=hidden, scored=hidden & measured)


def excerpt(trial: Trial, frames: int, rng: np.random.Generator) -> Trial:
    """At most so many frames of a trial: the best seen of four random places."""
    cut = hiding.excerpt(np.isfinite(trial.xyz_m[..., 0]), frames, rng)
    if len(trial.t_s) <= frames:
        return trial
    return replace(
        trial,
        name=f"{trial.name}@{cut.start}",
        t_s=trial.t_s[cut],
        xyz_m=trial.xyz_m[cut],
        film=None if trial.film is None else trial.film.cut(cut),
    )


__all__ = [
    "GAPS",
    "MARGIN",
    "SCENARIOS",
    "SPACING",
    "Cell",
    "Gap",
    "cells",
    "excerpt",
    "groups",
    "hide",
]
