"""Our tracker, as users run it: recordings with hidden samples are learned from and tracked by the product itself.

The controls differ in what ``learn_from`` is asked to choose and mix; all else is the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.protocol import plan
from filters.models.base import TrajectoryModel
from filters.models.pose import Potential
from filters.tune import (
    Effort,
    Search,
    Tuned,
    bare_pose,
    delay_models,
    free_pose,
    held_pose,
    marker_model,
    mixed,
    of_two_ranks,
    tuned,
)
from mocap.pipeline.job import run_job
from mocap.pipeline.learning import learn_from
from mocap.pipeline.prepare import Prepared, prepare_tracks
from mocap.records import MarkerTracks, Status
from mocap.skeleton import Skeleton

LEAST_SD_M = 5e-5
"""Recordings that were smoothed before show less noise than their markers have."""
GAUSSIAN: tuple[Potential, ...] = ("quadratic motion", "quadratic")
"""The control of ``held_pose``'s own two."""

Choose = Callable[[Search], Tuned]


def tracks_of(trial: Trial) -> MarkerTracks:
    """A trial as a file of positions would hold it, each with the noise that the set's markers have."""
    sd = np.maximum(trial.sd_m, LEAST_SD_M)
    seen = np.isfinite(trial.xyz_m[..., 0])
    cov = np.where(seen[..., None, None], (sd**2)[:, None, None] * np.eye(3), np.nan)
    origin = np.where(seen, Status.MEASURED, Status.MISSING)
    return MarkerTracks(names=trial.names, t_s=trial.t_s, xyz_m=trial.xyz_m, cov_m2=cov, status=origin)


def recording(trial: Trial) -> Prepared:
    """A trial as the product prepares it: cleaned, with a skeleton of markers and trunk."""
    skeleton = Skeleton(name="markers and trunk", markers=trial.names, trunk=trial.trunk)
    return prepare_tracks(tracks_of(trial), skeleton, name=trial.name)


def effort() -> Effort:
    """What a user's search does; less with ``--quick``, as all methods do."""
    much = plan.get()
    return Effort() if much.trials > 1 else Effort(validated=1, most_frames=much.frames, times=1)


@dataclass(frozen=True)
class Ours:
    """The product with a choice of what is mixed; the default is its own."""

    name: str
    choose: Choose = tuned

    def learn(self, training: Sequence[Trial]) -> Filler:
        """``learn_from`` the training trials; what is filled later is tracked by ``run_job``."""
        learned = learn_from(
            [recording(trial) for trial in training], effort=effort(), choose=remembering(self.choose, training)
        )

        def fill(trial: Trial) -> Estimate:
            run, _ = run_job(recording(trial), learned=learned, validated=False)
            markers, noise = run.tracked.markers, np.maximum(trial.sd_m, LEAST_SD_M) ** 2
            return Estimate(markers.xyz_m, markers.cov_m2 + noise[:, None, None] * np.eye(3))

        return fill


_tried: dict[tuple, list] = {}


def remembering(choose: Choose, training: Sequence[Trial]) -> Choose:
    """The same choice, which finds what others tried on the same hidden gaps of the same trials."""

    def chosen(search: Search) -> Tuned:
        key = (plan.get(), *(trial.xyz_m.tobytes() for trial in training))
        if key not in _tried:
            _tried.clear()
        search.tried = _tried.setdefault(key, search.tried)
        return choose(search)

    return chosen


def _beside(search: Search, pose: Callable[[Search], TrajectoryModel]) -> Tuned:
    """The default mixture with another model of poses."""
    return mixed(search, (marker_model(search), *delay_models(search, free_pose(search)), pose(search)))


def _held(search: Search) -> TrajectoryModel:
    return of_two_ranks(search, held_pose(search, free_pose(search)))


def _quadratic(search: Search) -> TrajectoryModel:
    return of_two_ranks(search, held_pose(search, free_pose(search), GAUSSIAN))


def _bare(search: Search) -> TrajectoryModel:
    return of_two_ranks(search, bare_pose(search, free_pose(search)))


def ours() -> list[Method]:
    """The product, and the same with other potentials (controls)."""
    return [
        Ours("EAL"),
        Ours("EAL, no potential", lambda search: _beside(search, _bare)),
        Ours("EAL, quadratic potential", lambda search: _beside(search, _quadratic)),
    ]


def alone() -> list[Method]:
    """The mechanics without what they are mixed with, held by each potential."""
    return [
        Ours("mechanics + V_z alone", lambda search: mixed(search, (_held(search),))),
        Ours("mechanics + quadratic alone", lambda search: mixed(search, (_quadratic(search),))),
        Ours("mechanics alone", lambda search: mixed(search, (_bare(search),))),
    ]
