"""Our tracker and its controls, as methods of the gap benchmark.

All share one search on hidden gaps of the training trials, so that they differ in what they are named after alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.gaps.method import Filled, Filler, Method, Trial
from benchmarks.gaps.protocol import plan
from filters.fitting import Fitting, Kind
from filters.hide import gap_lengths
from filters.learn import Potential
from filters.mixture import Mixture, learn_mixture
from filters.observations import PositionObservations
from filters.poses import MarkerTrial
from filters.score import Residuals
from filters.tune import (
    Search,
    bare_pose,
    delay_kinds,
    free_pose,
    held_pose,
    marker_kind,
    of_two_ranks,
    own_search,
    search_on,
)
from mocap.arrays import Array

LEAST_SD_M = 5e-5
"""Recordings that were smoothed before show less noise than their markers have."""


def marker_trial(trial: Trial) -> MarkerTrial:
    """A trial as the tracker takes it."""
    sd = np.broadcast_to(np.maximum(trial.sd_m, LEAST_SD_M), trial.xyz_m.shape[:2])
    return MarkerTrial(name=trial.name, t_s=trial.t_s, xyz_m=trial.xyz_m, sd_m=sd)


@dataclass(frozen=True, eq=False)
class Said:
    """What one model says of a trial, and of gaps that were hidden in it besides (None: there is no room)."""

    xyz_m: Array
    cov_m2: Array
    own: Residuals | None


@dataclass(eq=False)
class Lesson:
    """What all our methods learned from one set of training trials, and what each model said of trials.

    A method that comes later finds there what it shares with those before; its time to fill lacks that.
    """

    search: Search
    kinds: dict[str, Kind] = field(default_factory=dict)
    _said: dict[tuple[bytes, str], Said] = field(default_factory=dict)
    _fitting: tuple[bytes, Fitting, Search | None] | None = None

    def kind(self, name: str) -> Kind:
        """One of ``KINDS``, searched for when it is first asked for, or another that was put among ``kinds``."""
        if name not in self.kinds:
            self.kinds[name] = KINDS[name](self.search)
        return self.kinds[name]

    def said(self, name: str, trial: MarkerTrial) -> Said:
        """By one model."""
        key = trial.xyz_m.tobytes()
        if (key, name) not in self._said:
            if self._fitting is None or self._fitting[0] != key:
                fitting = Fitting([*self.search.trials, trial], self.search.trunk)
                self._fitting = key, fitting, own_search(fitting)
            _, fitting, own = self._fitting
            kind = self.kind(name)
            found = fitting.fill(kind, PositionObservations(xyz_m=trial.xyz_m, sd_m=trial.sd_m))
            self._said[key, name] = Said(found.xyz_m, found.cov_m2, own.fill(kind) if own else None)
        return self._said[key, name]


GAUSSIAN: tuple[Potential, ...] = ("quadratic motion", "quadratic")
"""The control of ``held_pose``'s own two."""

KINDS: dict[str, Callable[[Search], Kind]] = {
    "marker": marker_kind,
    "delayed poses": lambda search: delay_kinds(search, free_pose(search))[0],
    "delayed poses, turned": lambda search: delay_kinds(search, free_pose(search))[1],
    "mechanics": lambda search: of_two_ranks(search, bare_pose(search, free_pose(search))),
    "mechanics + V_z": lambda search: of_two_ranks(search, held_pose(search, free_pose(search))),
    "mechanics + quadratic": lambda search: of_two_ranks(search, held_pose(search, free_pose(search), GAUSSIAN)),
}
"""Models by name; a search keeps what it tried, so that what they have in common is tried once."""

_lessons: dict[tuple[str, ...], Lesson] = {}


def lesson(training: Sequence[Trial]) -> Lesson:
    """The search on training trials, done once for all methods."""
    key = tuple(trial.name for trial in training)
    if key not in _lessons:
        _lessons.clear()
        trunk = [training[0].names.index(name) for name in training[0].trunk]
        much = plan.get()
        search = search_on(
            [marker_trial(trial) for trial in training],
            trunk,
            np.random.default_rng(0),
            validated=min(much.trials, 2),
            most_frames=max(much.frames, 500) if much.trials > 1 else much.frames,
            times=3 if much.trials > 1 else 1,
        )
        _lessons[key] = Lesson(search)
    return _lessons[key]


@dataclass(frozen=True)
class Ours:
    """A mixture of some of our models; of one alone, its widths are learned."""

    name: str
    members: tuple[str, ...]

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Search, then learn the mixture's weights and widths on the same hidden gaps."""
        learned = lesson(training)
        mixture = learn_mixture([learned.search.both(learned.kind(member)) for member in self.members])
        return _filler(learned, self.members, mixture)


def _filler(learned: Lesson, members: Sequence[str], mixture: Mixture) -> Callable[[Trial], Filled]:
    def fill(trial: Trial) -> Filled:
        own = marker_trial(trial)
        said = [learned.said(member, own) for member in members]
        hidden = [each.own for each in said if each.own is not None]
        fitted = mixture.calibrated(hidden) if hidden else mixture
        xyz, cov = fitted.combine([each.xyz_m for each in said], [each.cov_m2 for each in said], gap_lengths(own.seen))
        return Filled(xyz, cov + (own.sd_m**2)[..., None, None] * np.eye(3))

    return fill


BESIDE = ("marker", "delayed poses", "delayed poses, turned")
"""What is mixed with the mechanics."""


def ours() -> list[Method]:
    """The default, and the same with other potentials (controls)."""
    return [
        Ours("EAL", (*BESIDE, "mechanics + V_z")),
        Ours("EAL, no potential", (*BESIDE, "mechanics")),
        Ours("EAL, quadratic potential", (*BESIDE, "mechanics + quadratic")),
    ]


def alone() -> list[Method]:
    """The mechanics without what they are mixed with, held by each potential."""
    return [Ours(f"{part} alone", (part,)) for part in ("mechanics + V_z", "mechanics + quadratic", "mechanics")]
