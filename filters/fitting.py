"""Kinds of models fitted to trials, and what they say of one of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import overload

import numpy as np
from threadpoolctl import threadpool_limits

from filters.bones import rigid_bones
from filters.delayed import DelaySettings, Filled, fill_delayed
from filters.learn import PoseSettings, learn_pose
from filters.learn_markers import MarkerSettings, learn_constant_velocity
from filters.motion.base import MotionModel
from filters.motion.bones import Bones
from filters.motion.pose import PoseMotion
from filters.observations import Observations
from filters.poses import MarkerTrial, PoseTrial, Shapes, poses_of, shapes_of
from filters.several import Several, averaged
from filters.track import Progress, Smoothed, smooth

Kind = PoseSettings | Several | DelaySettings | MarkerSettings
"""Pose models, a regression on delayed poses, or constant velocity of each marker for itself, with their settings."""


@dataclass(eq=False)
class Fitting:
    """Models of several kinds, fitted to the same trials; poses and shapes that they have in common are made once.

    Attributes:
        trials: Trials of the same markers and rate; the last is the one to fill, NaN where it is to be filled.
        trunk: Indices of the trunk's markers.
        named: Indices of the markers of the skeleton's rigid bones.
    """

    trials: Sequence[MarkerTrial]
    trunk: Sequence[int]
    named: Sequence[tuple[int, int]] = ()
    _poses: dict[tuple, list[PoseTrial]] = field(default_factory=dict)
    _shapes: dict[tuple, Shapes] = field(default_factory=dict)

    def shapes(self, kind: PoseSettings | DelaySettings) -> tuple[list[PoseTrial], Shapes]:
        """Poses and shapes of the trials as a kind takes them."""
        body = (kind.body_hz, kind.turns)
        if body not in self._poses:
            self._poses[body] = poses_of(self.trials, self.trunk, body_hz=kind.body_hz, turns=kind.turns)
        if (body, kind.ranks) not in self._shapes:
            self._shapes[body, kind.ranks] = shapes_of(self._poses[body], ranks=kind.ranks)
        return self._poses[body], self._shapes[body, kind.ranks]

    @cached_property
    def bones(self) -> Bones:
        """Those of the last trial."""
        return rigid_bones(self.trials, self.named)

    def motion(self, kind: PoseSettings | MarkerSettings) -> MotionModel:
        """A motion model for the last trial."""
        if isinstance(kind, MarkerSettings):
            *others, xyz_m = (trial.xyz_m for trial in self.trials)
            return learn_constant_velocity(xyz_m, dt_s=self.trials[-1].dt_s, others=others, settings=kind)
        return self.pose(kind)

    def pose(self, kind: PoseSettings) -> PoseMotion:
        """A pose model for the last trial."""
        poses, shapes = self.shapes(kind)
        return learn_pose(poses, kind, shapes=shapes, bones=self.bones)

    @overload
    def fill(
        self,
        kind: PoseSettings | Several | MarkerSettings,
        observations: Observations,
        *,
        progress: Progress | None = None,
    ) -> Smoothed: ...
    @overload
    def fill(
        self, kind: Kind, observations: Observations, *, progress: Progress | None = None
    ) -> Smoothed | Filled: ...
    def fill(self, kind: Kind, observations: Observations, *, progress: Progress | None = None) -> Smoothed | Filled:
        """What one kind says of the last trial.

        Args:
            kind: Which.
            observations: What each frame shows; a regression takes the trial's own positions instead.
            progress: Called with the share done.
        """
        if isinstance(kind, Several):
            tells = shares(progress, len(kind.members))
            found = [self.fill(one, observations, progress=tell) for one, tell in zip(kind.members, tells, strict=True)]
            xyz, cov = averaged(np.array([f.xyz_m for f in found]), np.array([f.cov_m2 for f in found]))
            return replace(found[0], xyz_m=xyz, cov_m2=cov)
        with threadpool_limits(1):
            if isinstance(kind, DelaySettings):
                return fill_delayed(self.trials[-1], *self.shapes(kind), kind)
            return smooth(self.motion(kind), observations, self.trials[-1].t_s, progress=progress)


def shares(progress: Progress | None, count: int) -> list[Progress | None]:
    """What each of so many parts calls with its own share done."""

    def tell(part: int, share: float) -> None:
        if progress is not None:
            progress((part + share) / count)

    return [None if progress is None else partial(tell, part) for part in range(count)]
