"""What the pose tracker learns from trials: subspace, mechanics, noise and empirical potential."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from mocap.filters.anatomy import Anatomy
from mocap.filters.gaussian import Moments
from mocap.filters.groups import GROUP, MOST_MARKERS, groups_of, part_of, smooth_in_groups
from mocap.filters.models.base import FittedMotion, TrajectoryModel, TrialSet
from mocap.filters.models.delayed_poses import Delayed, fill_delayed
from mocap.filters.models.limbs import limb_potentials
from mocap.filters.motion.pose import PoseMotion, Regression, body_path
from mocap.filters.motion.potential import Bones, PosePotential, Pull
from mocap.filters.motion.shape import LinearShape, RecordedMotion, joined, linear_shape
from mocap.filters.observations import Observations, PositionObservations, some_markers
from mocap.filters.poses import MATERN_HALF, PoseTrial, Shapes, known_shapes, radian, residual_memory_s, shapes_of
from mocap.filters.records import Estimate
from mocap.filters.roughness import marker_rates, out_of_sample
from mocap.filters.track import filter_forward, smooth
from mocap.filters.velocities import RatePoints
from numpy.typing import NDArray

from eal.arrays import Array
from eal.efforts import Progress
from eal.kernels import Kernel
from eal.potential import EmpiricalPotential, fit_potential, usual_kernel

Over = Callable[[Kernel], Kernel]
"""Makes a kernel of another one."""
Potential = Literal["limb motion", "limbs", "none"]

CENTRES = 200
"""Most samples that V_z is learned from. Chosen; not measured."""
WEIGHT = 4.0
"""Potential that an unseen pose of the same motion is charged while the motion turns by a radian, in units of the log
density (``with_potential``). Of 1, 4 and 16 measured (docs/experiments/stiffness.md,
potential_of_limbs.md)."""


@dataclass(frozen=True, eq=False)
class FittedGroups(FittedMotion):
    """A pose model of many markers, which are filtered in groups (``filters.groups``)."""

    motion: PoseMotion

    def smoothed(
        self, observations: Observations, *, rate_points: RatePoints | None, progress: Progress | None
    ) -> Estimate:
        """Each group by itself."""
        groups = groups_of(self.motion)
        return smooth_in_groups(
            self.motion,
            observations,
            self.t_s,
            groups=groups,
            smooth=smooth,
            rate_points=rate_points,
            progress=progress,
        )


@dataclass(frozen=True, kw_only=True)
class PoseSettings(TrajectoryModel):
    """Choices of the pose model; the numbers that settled the defaults are in docs/experiments/.

    Attributes:
        ranks: Ranks of the pose subspace to choose from, on hidden samples.
        process_noise: Factor on the force that those leave unexplained; 0: the likeliest (``likely_noise``).
        potential: What holds the pose: V_z of the relative joint coordinates q of each limb, with their velocities
            (``limb motion``) or without (``limbs``); or nothing. Where no limbs are known the shape of the whole pose
            takes their place.
        bones: Of rigid bones: how often V_b (``motion.potential``) is charged while the motion turns by a
            radian. Bones are not counted anew in each frame, as what they say of neighbouring ones is the same.
        regression: What a regression on the other markers predicts (``delayed_poses``) is one more observation of a
            marker that is not seen. It errs alike for so many of the times in which the motion turns by a radian, and
            counts once in each; 0: there is none.
        covariance: Of the regression (``fill_delayed``).
    """

    ranks: tuple[int, ...] = (1, 2, 3, 4, 6, 8, 11, 15, 20, 26, 34)
    process_noise: float = 0.0
    potential: Potential = "limb motion"
    bones: float = 1.0
    regression: float = 1.0
    covariance: tuple[float, ...] = ()

    @property
    def description(self) -> str:
        """Its name."""
        return "pose model"

    def tuned_s(self, markers: int, frames: int) -> float:
        """1.5 s of 15 markers in 297 frames, 6.0 of 50 in 93, 7.6 of 34 in 540: also some passes of the filter."""
        return 0.2 + 2.1e-4 * markers * frames + self.fill_s(markers, min(frames, JUDGED_FRAMES))

    def fit_s(self, markers: int, frames: int) -> float:
        """With a known process noise 1.6 s of 15 markers in 297 frames, 1.2 to 1.5 of 50 in 93, 6 of 34 in 300."""
        judged_s = 0.0 if self.process_noise else self.fill_s(markers, min(frames, JUDGED_FRAMES))
        return 0.5 + 3.8e-4 * markers * frames + judged_s

    def fill_s(self, markers: int, frames: int) -> float:
        """Of each group of markers by itself."""
        groups = -(-markers // GROUP) if markers > MOST_MARKERS else 1
        return groups * filter_s(markers / groups, self.ranks[0], frames)

    def pull(self, samples: Array, *, rate: float, over: Over = lambda kernel: kernel) -> Callable[[Array], Array]:
        """Gradient of the potential of samples (N, d), here of V_z.

        Args:
            samples: Of unit size.
            rate: What an unseen pose of the same motion is charged, a second.
            over: Makes the kernel of V_z from a Gaussian one, as where samples are angles (``eal.RotationKernel``).
        """
        potential = learn_potential(samples, over=over)
        stiffness = rate / max(float(np.mean(unseen_potential(samples, over=over))), 1e-9)
        return Pull(potential=potential, stiffness=stiffness)

    def tuned(self, trials: TrialSet) -> "PoseSettings":
        """With one rank, the covariance of its regression, and the likeliest process noise.

        Of ranks that predict hidden samples alike that one under which the last trial's positions are likeliest: too
        few shapes leave motion to residuals, which are rougher than it, and state velocities 1.6 times too uncertain
        (docs/experiments/roughness_of_recordings.md).
        """
        each = [replace(self, ranks=(rank,)) for rank in trials.shapes(self.ranks)[1].ranks]
        judged: list[Judged] = []
        for one in each:
            judged.append(likely_noise(one._learned(trials), trials, near=judged[-1].factor if judged else 1.0))
        best = max(range(len(each)), key=lambda i: judged[i].log_likelihood)
        settings = each[best]
        law = Delayed(*trials.shapes(settings.ranks)).covariance().logarithms if self.regression else np.zeros(0)
        return replace(settings, covariance=tuple(law.tolist()), process_noise=judged[best].factor)

    def fit(self, trials: TrialSet) -> FittedMotion:
        """Learn subspace, mechanics and potential from all trials, for the last one."""
        model = self._learned(trials)
        model = with_noise(model, self.process_noise or likely_noise(model, trials).factor)
        many = len(model.subspace.mean) > 3 * MOST_MARKERS
        whole, t_s = replace(model, regression=self.regressed(trials)), trials.trials[-1].t_s
        return FittedGroups(whole, t_s, trials.rigid) if many else FittedMotion(whole, t_s, trials.rigid)

    def _learned(self, trials: TrialSet) -> PoseMotion:
        """Without regression, and with the process noise of the mechanics; once for all that ask."""
        own, (poses, shapes) = replace(self, covariance=(), process_noise=0.0), trials.shapes(self.ranks)
        if own not in trials.learned:
            trials.learned[own] = learn_pose(poses, self, shapes=shapes, bones=trials.bones, anatomy=trials.anatomy)
        return trials.learned[own]

    def regressed(self, trials: TrialSet) -> Regression | None:
        """What a regression on the other markers has where markers of the last trial are not seen."""
        if not self.regression:
            return None
        (poses, shapes), key = trials.shapes(self.ranks), (self.ranks, self.covariance)
        if key not in trials.regressed:
            trials.regressed[key] = fill_delayed(trials.trials[-1].seen, poses, shapes, self.covariance)
        found = trials.regressed[key]
        lasts = max(1.0, self.regression * radian(shapes) / trials.trials[-1].dt_s)
        # no regression is surer than a micrometre, not even of what points of one plane share
        return Regression(found.xyz_m, lasts * (found.cov_m2 + 1e-6**2 * np.eye(3)))

    def learned_arrays(self, trials: TrialSet) -> dict[str, NDArray[Any]]:
        """Mean pose, basis, shapes, noise; stiffness and damping of its mechanics; bones."""
        shapes, model = trials.shapes(self.ranks)[1], self._learned(trials)
        return {
            "pose_mean_m": shapes.subspace.mean.reshape(-1, 3),
            "pose_basis": shapes.subspace.basis.reshape(-1, 3, model.rank),
            "pose_residual_sd_m": shapes.subspace.residual_sd.reshape(-1, 3),
            "pose_shapes_m": np.concatenate(shapes.z),
            "pose_acceleration_density": model.mechanics.density @ model.mechanics.density.T,
            "bone_ends": trials.bones.ends,
            "bone_length_m": trials.bones.length_m,
            "bone_sd_m": trials.bones.sd_m,
            "pose_stiffness": model.mechanics.stiffness,
            "pose_damping": model.mechanics.damping,
        }


def filter_s(markers: float, rank: int, frames: int) -> float:
    """Processor seconds of one filter: 5.5 ms a frame of 15 markers, 11 with rank 8, 17 to 20 of 31, 37 to 39 of 34."""
    return (0.003 + 0.0025 * ((markers + rank) / 15) ** 2.5) * frames


def recorded_motion(trials: Sequence[PoseTrial], shapes: Shapes) -> RecordedMotion:
    """The motion of the shape where it is well known."""
    parts = []
    for z, rate, acceleration, keep in zip(
        shapes.z, shapes.rate, shapes.acceleration, known_shapes(shapes), strict=True
    ):
        edges = np.flatnonzero(np.diff(keep.astype(int))) + 1
        for stretch in np.split(np.arange(len(z)), edges):
            if keep[stretch[0]]:
                parts.append((z[stretch], rate[stretch], acceleration[stretch]))
    return joined(parts, trials[0].dt_s)


def learn_pose(
    trials: Sequence[PoseTrial],
    settings: PoseSettings,
    *,
    shapes: Shapes | None = None,
    bones: Bones | None = None,
    anatomy: Anatomy | None = None,
) -> PoseMotion:
    """Learn a pose model from trials, for tracking the last one.

    Args:
        trials: Trials of the same markers and rate; what is to be filled is NaN.
        settings: Choices.
        shapes: Shapes of these trials where they are at hand (``shapes_of``).
        bones: Its bones.
        anatomy: What is known of the animal; None: nothing.
    """
    shapes = shapes_of(trials, ranks=settings.ranks) if shapes is None else shapes
    motion = recorded_motion(trials, shapes)
    trial, subspace = trials[-1], shapes.subspace
    left_sd = np.hypot(subspace.residual_sd, _across_markers(shapes.offset_sd[-1]))
    memory_s = residual_memory_s(shapes.residual, trial.dt_s, radian(shapes), hidden_sd=subspace.residual_sd)
    usual_hz = 0.5 * MATERN_HALF / memory_s
    rates = np.full(len(left_sd), usual_hz)
    if trial.sd_m.any():  # without the noise's size nothing tells it from rough motion
        left, noise = out_of_sample(shapes.residual[-1], trial.sd_m, subspace.basis)
        rates = marker_rates(left, noise, trial.dt_s, left_sd, usual_hz)
    own = replace(subspace, mean=subspace.mean + shapes.offset[-1], residual_sd=left_sd)
    spread = np.concatenate([motion.z.std(axis=0), motion.rate.std(axis=0)])
    extent = float(np.sqrt(np.nanmean((trial.y - np.nan_to_num(own.mean)) ** 2)))
    model = PoseMotion(
        path=body_path(trial.frames, trial.t_s),
        subspace=own,
        mechanics=linear_shape(motion, ridge=1e-3),
        body=body_mechanics(trials),
        shape_sd=2 * np.maximum(spread, 1e-4 * spread.max()),
        body_sd=np.concatenate([np.full(3, extent), np.full(3, 0.3), np.full(3, extent), np.full(3, 1.0)]),
        residual_rate_hz=rates,
        usual=usual_motion(motion),
        bones=bones if bones is not None and len(bones.ends) and settings.bones else None,
        bone_stiffness=settings.bones / motion.tau_s,
        name="pose_constant_velocity",
    )
    return with_potentials(model, shapes, motion, settings, anatomy)


JUDGED_FRAMES = 100
"""So many frames judge the process noise: in bats and lizards they tell factors of 4 apart by 20 to 650 in log
likelihood."""


def with_noise(model: PoseMotion, factor: float) -> PoseMotion:
    """The model with the density of its shape's unexplained force times a factor."""
    mechanics = model.mechanics
    return replace(model, mechanics=replace(mechanics, density=np.sqrt(factor) * mechanics.density))


class Judged(NamedTuple):
    """A factor on the process noise of the shape.

    Attributes:
        factor: The likeliest.
        log_likelihood: Of positions in the frames that judge it, under the likeliest power of 4.
    """

    factor: float
    log_likelihood: float


def likely_noise(model: PoseMotion, trials: TrialSet, *, near: float = 1.0) -> Judged:
    """The factor on the process noise of the shape under which the last trial's positions are likeliest.

    What mechanics leave of smoothed accelerations is too small by what the smoothing took: bats want 4 to 16 times of
    it, lizards what it is. Factors of 4 up or down as long as the likelihood rises, then the vertex of a parabola
    through the best three; by shape, body and residuals alone, in the ``JUDGED_FRAMES`` frames that show most.

    Args:
        model: Learned from the trials.
        trials: The trials; the last judges.
        near: A factor near which the search begins, as that of another rank.
    """
    trial = trials.trials[-1]
    plain = replace(model, potentials=(), bones=None, regression=None)
    length = min(len(trial.t_s), JUDGED_FRAMES)
    seen = np.concatenate([[0], np.cumsum(trial.seen.sum(axis=1))])
    start = int(np.argmax(seen[length:] - seen[: len(seen) - length]))
    observations = PositionObservations(xyz_m=trial.xyz_m, sd_m=trial.sd_m)
    parts: list[tuple[PoseMotion, Observations]] = [(plain, observations)]
    if trial.xyz_m.shape[1] > MOST_MARKERS:  # as they are tracked
        parts = [(part_of(plain, group), some_markers(observations, group)) for group in groups_of(plain)]

    def likelihood(power: int) -> float:
        return sum(
            frame.observed.log_likelihood
            for part, seen_of in parts
            for frame in filter_forward(
                with_noise(part, 4.0**power), seen_of, trial.t_s, frames=range(start, start + length)
            )
        )

    first = min(round(float(np.log(near) / np.log(4))), 3)
    found = {power: likelihood(power) for power in (first, first + 1)}
    step = 1 if found[first + 1] > found[first] else -1
    best = first + max(step, 0)
    while abs(best + step) <= 4:  # factors of 4 to this power at most
        found[best + step] = likelihood(best + step)
        if found[best + step] <= found[best]:
            break
        best += step
    if best - 1 not in found or best + 1 not in found:
        return Judged(4.0**best, found[best])
    low, middle, high = (found[best + i] for i in (-1, 0, 1))
    bend = low - 2 * middle + high
    return Judged(float(4.0 ** (best + (0.5 * (low - high) / bend if bend < 0 else 0.0))), middle)


def with_potentials(
    model: PoseMotion, shapes: Shapes, motion: RecordedMotion, settings: PoseSettings, anatomy: Anatomy | None
) -> PoseMotion:
    """The model with its pose held by what the settings name: potentials of limbs, or of the whole pose.

    Args:
        model: Its subspace, of the trial that is to be tracked.
        shapes: What limbs are learned from.
        motion: What the whole pose is learned from, and how fast it is.
        settings: Choices.
        anatomy: Limbs; None: none are known.
    """
    if "limb" not in settings.potential or anatomy is None or not anatomy.limbs:
        return with_potential(model, motion, settings)
    limbs = limb_potentials(
        shapes,
        model.subspace,
        anatomy,
        velocities="motion" in settings.potential,
        tau_s=motion.tau_s,
        learn=partial(settings.pull, rate=WEIGHT / motion.tau_s),
    )
    return replace(model, potentials=limbs, name="eal")


def usual_motion(motion: RecordedMotion) -> Moments:
    """Mean and covariance of the recorded [z, zdot]."""
    states = np.column_stack([motion.z, motion.rate])
    cov = np.cov(states.T)
    return Moments(states.mean(axis=0), cov + 1e-6 * np.diag(np.diag(cov)) + 1e-18 * np.eye(len(cov)))


def body_density(trial: PoseTrial) -> Array:
    """(6,) spectral density of the accelerations of a trial's body, of the frequencies that its frames follow."""
    path = body_path(trial.frames, trial.t_s)
    out = []
    for velocity in (path.velocity_m_s, path.rate_rad_s):
        acceleration = np.gradient(velocity, trial.dt_s, axis=0) if len(velocity) > 1 else np.zeros_like(velocity)
        out.append(np.full(3, 2 * velocity.std() * acceleration.std()))
    return np.maximum(np.concatenate(out), np.repeat([1e-6, 1e-4], 3))


def body_mechanics(trials: Sequence[PoseTrial]) -> LinearShape:
    """A free body whose accelerations last: of the size and for the time that those of the trials' paths have.

    White accelerations that follow a turn make velocities look 2 to 8 times too uncertain (docs/experiments/body.md).
    """
    sizes, memories = [], []
    for trial in trials:
        path = body_path(trial.frames, trial.t_s)
        for velocity in (path.velocity_m_s, path.rate_rad_s):
            acceleration = np.gradient(velocity, trial.dt_s, axis=0) if len(velocity) > 1 else np.zeros_like(velocity)
            change = np.gradient(acceleration, axis=0) if len(velocity) > 1 else acceleration
            sizes.append(float(np.sqrt(np.mean(acceleration**2))))
            lasts = sizes[-1] / max(float(np.sqrt(np.mean(change**2))), 1e-30)
            memories.append(trial.dt_s * np.clip(lasts, 1, len(velocity)))
    size, memory = (np.repeat(np.median(np.reshape(x, (-1, 2)), axis=0), 3) for x in (sizes, memories))
    density, none = np.maximum(2 * memory * size**2, np.repeat([1e-6, 1e-4], 3)), np.zeros((6, 6))
    return LinearShape(none, none, np.zeros(6), np.diag(np.sqrt(density)), memory)


def _across_markers(sd: Array) -> Array:
    """(3M,) root mean square over the three coordinates of each marker."""
    return np.repeat(np.sqrt(np.mean(sd.reshape(-1, 3) ** 2, axis=1)), 3)


def with_potential(model: PoseMotion, motion: RecordedMotion, settings: PoseSettings) -> PoseMotion:
    """The model with its shape held by a potential.

    The stiffness 1/eps^2 of V_z follows from what the potential says of poses that it has not seen: learned without a
    fifth of the motion it has the mean value v there, and 1/eps^2 = weight w / v a second, w the rate sd(zdot) / sd(z)
    of the motion. Where the samples cover the motion v is small and the potential stiff; where a recording holds few
    cycles it is soft. The numbers are in docs/experiments/stiffness.md.
    """
    if settings.potential == "none":
        return model
    size = model.rank * (2 if "motion" in settings.potential else 1)
    scale = np.repeat([1 / motion.unit, motion.tau_s / motion.unit], model.rank)[:size]
    samples = np.column_stack([motion.z, motion.rate])[:, :size] * scale
    potential = PosePotential(
        mean=np.zeros(size),
        on_shape=np.diag(scale) @ np.eye(size, 2 * model.rank),
        on_residual=np.zeros((size, len(model.subspace.residual_sd))),
        samples=samples,
        gradient=settings.pull(samples, rate=WEIGHT / motion.tau_s),
    )
    return replace(model, potentials=(potential,), name="eal")


def learn_potential(samples: Array, *, over: Over = lambda kernel: kernel) -> EmpiricalPotential:
    """V_z of samples (N, k) of unit size, as ``eal`` has it by default; samples are thinned to ``CENTRES``.

    The likeliest kernel and lambda, which a map of V_z gets, are worse in a filter (docs/experiments/one_potential.md).
    """
    chosen = samples[np.linspace(0, len(samples) - 1, min(len(samples), CENTRES)).astype(int)]
    # exact: the search for fewer centres mostly ends there too, after three times as long
    return fit_potential(chosen, kernel=over(usual_kernel(chosen)), method="exact")


def unseen_potential(samples: Array, *, over: Over = lambda kernel: kernel) -> Array:
    """(N,) -log(1 - V) of each sample under a potential that was learned without its fifth of the motion."""
    fold = np.arange(len(samples)) * 5 // len(samples)
    learned = [learn_potential(samples[fold != i], over=over) for i in range(5)]
    return np.concatenate([one.barrier_value(samples[fold == i]) for i, one in enumerate(learned)])
