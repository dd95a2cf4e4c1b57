"""Our tracker, as users run it: recordings with hidden samples are learned from and tracked by the product itself.

The controls differ in the motion models that ``learn_from`` is given; all else is the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from mocap.filters.hidden_gaps import EACH_MARKER, JOINTS, MODELS, POSE, WITH_JOINTS, Effort
from mocap.filters.interpolate import interpolated
from mocap.filters.models.base import TrajectoryModel
from mocap.filters.models.pose import Over, PoseSettings

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.prepared import LEAST_SD_M, recording
from benchmarks.gaps.protocol import plan
from eal.arrays import Array
from mocap.io.unstated_unit import length
from mocap.records import MarkerTracks
from mocap.report.job import run_job
from mocap.tracking.learning import learn_from
from mocap.tracking.result import Result


def effort() -> Effort:
    """What a user's ``learn`` does; less with ``--quick``, as all methods do."""
    much = plan.get()
    return Effort() if much.trials > 1 else Effort(validated=1, most_frames=much.frames)


@dataclass(frozen=True)
class Ours:
    """The product with a choice of motion models; the default are its own."""

    name: str
    models: tuple[TrajectoryModel, ...] = MODELS
    reads_rays: bool = True

    def learn(self, training: Sequence[Trial]) -> Filler:
        """``learn_from`` the training trials; what is filled later is tracked by ``run_job``."""
        learned = learn_from([recording(trial) for trial in training], effort=effort(), models=self.models)

        def fill(trial: Trial) -> Estimate:
            run, _ = run_job(recording(trial), learned=learned, validated=False)
            filled, noise = without_holes(run, trial), np.maximum(trial.sd_m, LEAST_SD_M) ** 2
            return Estimate(filled.xyz_m, filled.cov_m2 + noise[:, None, None] * np.eye(3))

        return fill


def without_holes(run: Result, trial: Trial) -> MarkerTracks:
    """What a run filled; samples that it leaves empty lie on lines, known to the length of the animal."""
    empty = run.data["unknown"].values[..., None]
    if not empty.any():
        return run.tracks
    lines, anywhere = interpolated(trial.xyz_m, trial.t_s, kind="linear"), length(trial.xyz_m) ** 2 * np.eye(3)
    xyz, cov = np.where(empty, lines, run.xyz_m), np.where(empty[..., None], anywhere, run.cov_m2)
    return replace(run.tracks, xyz_m=xyz, cov_m2=cov)


class Quadratic(PoseSettings):
    """The pose held by the quadratic potential of a Gaussian in place of V_z."""

    def pull(
        self,
        samples: Array,
        *,
        rate: float,
        over: Over = lambda kernel: kernel,  # noqa: ARG002
    ) -> Callable[[Array], Array]:
        """Gradient of rate (x - mean)^T C^-1 (x - mean) / d, whose mean value is the rate."""
        d = samples.shape[1]
        cov = np.cov(samples.T).reshape(d, d)
        information = np.linalg.inv(cov + 1e-6 * np.trace(cov) / d * np.eye(d))
        centre, stiffness = samples.mean(axis=0), 2 * rate / d
        return lambda x: (x - centre) @ information * stiffness


def ours() -> list[Method]:
    """The product, and the same with other potentials (controls)."""
    return [
        Ours("EAL"),
        Ours("EAL quadratic", (*MODELS[:-1], Quadratic(**vars(POSE)))),
        Ours("EAL none", (*MODELS[:-1], replace(POSE, potential="none"))),
    ]


def alone() -> list[Method]:
    """Parts of the product: the EAL model not mixed, with its regression and without; joint angles; mixtures of two."""
    alone = replace(JOINTS, pose=replace(JOINTS.pose, regression=0.0))
    return [
        Ours("EAL alone", (POSE,)),
        Ours("EAL alone, no regression", (replace(POSE, regression=0.0),)),
        Ours("articulated", (JOINTS,)),
        Ours("articulated, no regression", (alone,)),
        Ours("EAL, joints in place of poses", (EACH_MARKER, JOINTS)),
        Ours("EAL with joints", WITH_JOINTS),
    ]
