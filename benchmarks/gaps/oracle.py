"""How much there is to win: the product, with V_z of the very trial that it fills.

All else is learned as always: subspace, mechanics, bones, the regression, and how models are mixed. V_z alone is
learned from the trial before anything was hidden, in the coordinates of the subspace. Nobody can have it: what it is
better by than the product is the most that any other way of learning V_z could add.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mocap.filters.hidden_gaps import MODELS
from mocap.filters.models.base import FittedMotion, TrialSet
from mocap.filters.models.pose import PoseSettings, recorded_motion, with_potentials
from mocap.filters.motion.pose import PoseMotion
from mocap.filters.poses import MarkerTrial, PoseTrial, Shapes, poses_of
from mocap.filters.subspace import PoseSubspace
from mocap.filters.whittaker import smooth_series

from benchmarks.gaps.method import Filler, Trial
from benchmarks.gaps.ours import Ours
from benchmarks.gaps.prepared import recording
from eal.arrays import Array
from mocap.tracking.tracking import marker_trial, seen_frames


@dataclass(frozen=True, kw_only=True)
class Informed(PoseSettings):
    """The pose model with V_z of the trial that is filled.

    Attributes:
        whole: Trials before anything was hidden; that of the last trial's name is taken.
    """

    whole: tuple[MarkerTrial, ...] = ()

    def fit(self, trials: TrialSet) -> FittedMotion:
        """As ``PoseSettings``, but for V_z; that too where the trial lacks a marker that it has as a whole."""
        fitted = super().fit(trials)
        last = trials.trials[-1].name.partition("@")[0]
        own = next(trial for trial in self.whole if trial.name.partition("@")[0] == last)
        if own.xyz_m.shape[1] != trials.trials[-1].xyz_m.shape[1]:  # it was cut to a part that lacks a marker
            return fitted
        motion = fitted.motion
        if not isinstance(motion, PoseMotion):
            raise TypeError(f"a pose model was expected, but {type(motion).__name__} was fitted")
        _, shapes = trials.shapes(self.ranks)
        *_, poses = poses_of([*trials.trials[:-1], own], trials.anatomy.trunk)
        known = truth_in(shapes, poses)
        recorded = recorded_motion([poses], known)
        return replace(fitted, motion=with_potentials(motion, known, recorded, self, trials.anatomy))


def truth_in(shapes: Shapes, poses: PoseTrial) -> Shapes:
    """The shapes of one trial, the last of those that a subspace was learned from, before anything was hidden.

    Args:
        shapes: Of all trials as they were learned from.
        poses: Of that one, whole.
    """
    own = replace(shapes.subspace, mean=shapes.subspace.mean + shapes.offset[-1])
    found = shapes_in(own, poses.y)
    share = np.isfinite(poses.y).mean(axis=1)
    smooth = smooth_series(found, share, dt_s=poses.dt_s, cutoff_hz=min(30.0, 0.2 / poses.dt_s))
    rate = np.gradient(smooth, poses.dt_s, axis=0)
    return replace(
        shapes,
        z=[found],
        rate=[rate],
        acceleration=[np.gradient(rate, poses.dt_s, axis=0)],
        certainty=[share],
        offset=shapes.offset[-1:],
        offset_sd=shapes.offset_sd[-1:],
        residual=[poses.y - own.mean - found @ own.basis.T],
    )


def shapes_in(subspace: PoseSubspace, y: Array) -> Array:
    """(T, r) shapes of poses (T, 3M) by weighted least squares over what each frame shows."""
    seen = np.isfinite(y)
    weight = np.where(seen, 1 / np.maximum(subspace.residual_sd, 1e-6) ** 2, 0.0)
    left = np.where(seen, y - subspace.mean, 0.0)
    normal = np.einsum("td,di,dj->tij", weight, subspace.basis, subspace.basis)
    small = 1e-6 * np.trace(normal, axis1=1, axis2=2).max() * np.eye(subspace.basis.shape[1])
    right = np.einsum("td,di->ti", weight * left, subspace.basis)
    return np.linalg.solve(normal + small, right[..., None])[..., 0]


def whole(trial: Trial) -> MarkerTrial:
    """A trial as the product learns from it."""
    prepared = recording(trial)
    return marker_trial(prepared.at(seen_frames(prepared)))


@dataclass(frozen=True)
class EalOracle:
    """The product with V_z of the trial that is filled; each training trial has its own, too, where gaps are hidden."""

    name: str = "EAL oracle"
    reads_rays: bool = True

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Not without the answer.

        Raises:
            TypeError: always.
        """
        raise TypeError(f"{self.name} learns from {len(training)} trials and the answer: call learn_with_truth")

    def learn_with_truth(self, training: Sequence[Trial], truth: Trial) -> Filler:
        """Learn as the product does, V_z apart."""
        *others, eal = MODELS
        known = tuple(whole(trial) for trial in (*training, truth))
        if not isinstance(eal, PoseSettings):
            raise TypeError(f"the product's last model was a pose model, but is {type(eal).__name__}")
        own = Informed(**{**vars(eal), "whole": known})
        return Ours(self.name, (*others, own)).learn(training)
