"""Where the gaps of the benchmark lie: kinds of gaps of ``mocap.filters.hide``, and excerpts of trials."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from mocap.filters import hide as gaps
from mocap.filters.hide import Gap, Group, Rules

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
RULES = Rules(
    margin=MARGIN, measured=1.0, apart_frames=SPACING, apart_share=0.0, longest_first=True, copies=None, twice=True
)
"""Only samples are compared whose marker was measured through the whole gap; copies hold a gap of every kind."""

Cell = tuple[str, int]
"""A scenario and a length."""


def cells(*, scenarios: Sequence[str] = SCENARIOS, lengths: Sequence[int] = GAPS) -> list[Cell]:
    """All pairs of a scenario and a length; short ones (10, 25) three times and twice, for they hold few samples."""
    times = {10: 3, 25: 2}
    return [(scenario, length) for scenario in scenarios for length in lengths for _ in range(times.get(length, 1))]


def groups(trial: Trial) -> dict[str, Group]:
    """What each scenario hides of a trial: of the limbs, if half of their markers (two at least) were measured."""
    limbs = np.array([[name in limb for name in trial.names] for limb in trial.limbs], dtype=bool)
    every = limbs.any(axis=0, keepdims=True) if len(limbs) > 1 else limbs[:0]
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
    known = groups(trial)
    kinds = [(known[scenario], length) for scenario, length in wanted]
    return [Shown(trial=trial, gaps=copy) for copy in gaps.hide(np.isfinite(trial.xyz_m[..., 0]), kinds, rng, RULES)]


def excerpt(trial: Trial, frames: int, rng: np.random.Generator) -> Trial:
    """At most so many frames of a trial: the best seen of four random places."""
    cut = gaps.excerpt(np.isfinite(trial.xyz_m[..., 0]), frames, rng)
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
    "RULES",
    "SCENARIOS",
    "SPACING",
    "Cell",
    "Gap",
    "cells",
    "excerpt",
    "groups",
    "hide",
]
