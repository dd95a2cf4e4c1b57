"""What every motion model answers: it is settings that are fitted to trials, and then fill the last of these.

A new model is a file with such a class, and a line in ``mocap.filters.models.registry``.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

from mocap.filters.anatomy import Anatomy
from mocap.filters.bones import rigid_bones, sized_like
from mocap.filters.motion.base import MotionModel
from mocap.filters.motion.potential import Bones
from mocap.filters.observations import Observations, PositionObservations, WithBodies
from mocap.filters.poses import MarkerTrial, PoseTrial, Shapes, poses_of, shapes_of
from mocap.filters.records import Estimate
from mocap.filters.rigid import Completed, completed, find_bodies
from mocap.filters.track import smooth
from mocap.filters.velocities import RatePoints
from numpy.typing import NDArray

from eal.arrays import Array
from eal.efforts import Progress, shares
from eal.threads import one_blas_thread

OF_PIXELS = 1.7
"""Times that filling pixels takes, with rates, in place of positions with hidden gaps: 1.5 to 1.8. Positions with rates
take 1.1 to 1.4."""
LEARNED = 0.25
"""Share of a fit that is left where settings were learned from the same trials before: a regression, 0.1 to 0.4."""


@dataclass(eq=False)
class TrialSet:
    """Trials that models are fitted to; poses and shapes that several models need are computed once.

    Attributes:
        trials: Trials of the same markers and rate; the last is the one to fill, NaN where it is to be filled. A marker
            that its rigid body shows is in it as if it was measured.
        anatomy: What is known of the animal, with the rigid bodies of the last trial.
        rigid: What these say of markers of the last trial that are not seen.
        regressed: What regressions made of the last trial, by ranks and covariance.
        learned: What pose models learned from the trials, by theirs.
    """

    trials: Sequence[MarkerTrial]
    anatomy: Anatomy
    _shapes: dict[tuple[int, ...], Shapes] = field(default_factory=dict)
    regressed: dict[tuple, Estimate] = field(default_factory=dict)
    learned: dict["TrajectoryModel", Any] = field(default_factory=dict)
    rigid: Completed = field(init=False)

    def __post_init__(self) -> None:
        """Other animals are scaled to the size of the last trial's, and this is completed by its bodies."""
        last = self.trials[-1]
        if self.anatomy.bodies is None:
            self.anatomy = replace(self.anatomy, bodies=tuple(map(tuple, find_bodies(last))))
        others = sized_like(self.trials[:-1], last)
        with one_blas_thread():
            self.rigid = completed(last, self.anatomy.bodies or (), others)
        self.trials = [*others, self.rigid.whole(last)]

    @cached_property
    def poses(self) -> list[PoseTrial]:
        """Those of all trials."""
        return poses_of(self.trials, self.anatomy.trunk)

    def __getstate__(self) -> dict[str, Any]:
        """For another process, which learns itself: a person's own potential may be no function that is sent."""
        return self.__dict__ | {"learned": {}}

    def shapes(self, ranks: tuple[int, ...]) -> tuple[list[PoseTrial], Shapes]:
        """Poses, and their shapes in a subspace of one of the ranks."""
        if ranks not in self._shapes:
            self._shapes[ranks] = found = shapes_of(self.poses, ranks=ranks)
            self._shapes[found.ranks[:1]] = replace(found, ranks=found.ranks[:1])
        return self.poses, self._shapes[ranks]

    @cached_property
    def bones(self) -> Bones:
        """Those of the last trial."""
        return rigid_bones(self.trials, self.anatomy.bones)


@dataclass(frozen=True, eq=False)
class FittedMotion:
    """A motion model in state space that was fitted to trials.

    Attributes:
        motion: The model.
        t_s: (T,) times of the last trial.
        rigid: What its rigid bodies say of markers that are not seen; None: there are none.
    """

    motion: MotionModel
    t_s: Array
    rigid: Completed | None = None

    def fill(
        self, observations: Observations, *, rate_points: RatePoints | None = None, progress: Progress | None = None
    ) -> Estimate:
        """Estimate the markers of the last trial: filter forward, smooth backward.

        Args:
            observations: What each of its frames shows.
            rate_points: Points whose velocities and joint covariances are kept; None: of none.
            progress: Called with the share done.
        """
        if self.rigid is None or not self.rigid.filled.any():
            return self.smoothed(observations, rate_points=rate_points, progress=progress)
        both = WithBodies(seen=observations, xyz_m=self.rigid.xyz_m, cov_m2=self.rigid.cov_m2)
        found = self.smoothed(both, rate_points=rate_points, progress=progress)
        return replace(found, cov_m2=self.rigid.with_lasting(found.xyz_m, found.cov_m2, observations))

    def smoothed(
        self, observations: Observations, *, rate_points: RatePoints | None, progress: Progress | None
    ) -> Estimate:
        """The same by what is observed alone, without rigid bodies."""
        return smooth(self.motion, observations, self.t_s, rate_points=rate_points, progress=progress)


class Fitted(Protocol):
    """What was fitted to trials and fills the last of them; the one face of all models, a filter or none."""

    def fill(
        self, observations: Any, *, rate_points: RatePoints | None = None, progress: Progress | None = None
    ) -> Estimate:
        """Where the markers of the last trial are; arguments as of ``FittedMotion.fill``."""
        ...


@dataclass(frozen=True)
class TrajectoryModel(ABC):
    """Settings of a motion model: a frozen dataclass of numbers, strings, tuples of these, and other such models."""

    @property
    @abstractmethod
    def description(self) -> str:
        """The model in a few words."""

    @abstractmethod
    def fit(self, trials: TrialSet) -> Fitted:
        """Learn from trials, among them the one to fill."""

    def tuned_s(self, markers: int, frames: int) -> float:  # noqa: ARG002
        """About the processor seconds of ``tuned`` with trials of so many frames, beside ``fill_s``; here none."""
        return 0.0

    def fit_s(self, markers: int, frames: int) -> float:  # noqa: ARG002
        """The same of a fit; here none."""
        return 0.0

    def fill_s(self, markers: int, frames: int) -> float:
        """The same of filling so many frames, by which the time left is told; here of each marker by itself.

        1.2 to 1.5 ms a frame of 15 markers, 2.7 of 34.
        """
        return 8e-5 * markers * frames

    def applies(self, anatomy: Anatomy) -> bool:  # noqa: ARG002
        """Whether such an animal can be modelled so; here any."""
        return True

    def tuned(self, trials: TrialSet) -> "TrajectoryModel":  # noqa: ARG002
        """The model with settings that are learned once, from all trials; here itself."""
        return self

    def learned_arrays(self, trials: TrialSet) -> dict[str, NDArray[Any]]:  # noqa: ARG002
        """What it learns from trials, by the names that model files have for it; here nothing."""
        return {}


def estimate(
    model: TrajectoryModel,
    trials: TrialSet,
    observations: Observations,
    *,
    rate_points: RatePoints | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Fit a model to trials and fill the last one; on one BLAS thread, which is faster than two at these sizes."""
    with one_blas_thread():
        learn, fill = shares(progress, seconds_of(model, trials, observations, learned=bool(trials.learned)))
        fitted = model.fit(trials)
        if learn is not None:
            learn(1.0)
        return fitted.fill(observations, rate_points=rate_points, progress=fill)


def seconds_of(
    model: TrajectoryModel, trials: TrialSet, observations: Observations, *, learned: bool
) -> tuple[float, float]:
    """About the seconds in which a model is fitted to trials, and fills the last: these count beside each other.

    Args:
        model: Its settings.
        trials: The trials.
        observations: What each frame of the last shows.
        learned: Whether settings were learned from these trials before.
    """
    lengths, markers = [len(trial.t_s) for trial in trials.trials], trials.trials[-1].xyz_m.shape[1]
    fit_s, fill_s = model.fit_s(markers, sum(lengths)), model.fill_s(markers, lengths[-1])
    pixels = not isinstance(observations, PositionObservations)
    return (LEARNED if learned else 1.0) * fit_s, (OF_PIXELS if pixels else 1.0) * fill_s
