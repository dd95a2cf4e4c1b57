"""The tracker: filter forward, smooth backward, return markers with covariance."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mocap.filters.apart import smooth_apart
from mocap.filters.ensemble import Gaussian, Prediction, gram, marker_covariances
from mocap.filters.groups import MOST, groups_of, smooth_in_groups
from mocap.filters.limb_potential import HeldKeeper
from mocap.filters.motion.base import MotionModel, Step
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.motion.pose import PoseMotion
from mocap.filters.motion.singer import LastingAcceleration
from mocap.filters.moving import RateKeeper
from mocap.filters.observations import Observations, seen_from
from mocap.filters.observe import Observed, observe, unused
from mocap.filters.records import Estimate
from mocap.filters.smoother import smooth_step
from mocap.filters.velocities import Asked
from threadpoolctl import threadpool_limits

from eal.arrays import Array

Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Filtered:
    """Frames that were filtered one after the other.

    Attributes:
        states: Filtered state of each frame; empty where they were not kept.
        predictions: What led to each frame; None to the first of the recording.
        observed: What was seen in each frame.
        last: Filtered state of the last frame.
    """

    states: list[Gaussian]
    predictions: list[Prediction | None]
    observed: list[Observed]
    last: Gaussian


@dataclass(frozen=True, eq=False)
class Reference:
    """A smoothed frame, about which the next pass linearises.

    Attributes:
        mean: (M, 3) markers.
        cov: (M, 3, 3) their covariance.
        model: What the motion model needs (``MotionModel.reference``).
    """

    mean: Array
    cov: Array
    model: Any


def filter_frame(
    model: MotionModel,
    observations: Observations,
    frame: int,
    before: Gaussian,
    step: Step | None,
    gate_sd: float,
    *,
    about: Reference | None = None,
) -> tuple[Prediction | None, Gaussian, Observed]:
    """Predict one frame and condition on what it shows; without a ``step`` (at the first frame) only the latter.

    Rays and potentials are linearised about the prediction, or ``about`` what an earlier pass made of the frame.
    """
    prediction, state = None, before
    if step is not None:
        prediction = model.predict(before, step)
        state = model.constrain(prediction.state, step, None if about is None else about.model)
    mean, deviations = model.deviations(state, frame)
    sights = observations.sights(frame, mean, marker_covariances(deviations))
    if not len(sights.size):  # a potential would hold a shape whose phase nobody knows, and be sure of it
        return prediction, state if prediction is None else prediction.state, unused(sights)
    if about is not None:
        sights = seen_from(observations.sights(frame, about.mean, about.cov), about.mean - mean)

    def update(mean: Array, deviations: Array, shift: Array | None) -> tuple[Gaussian, Observed]:
        here = sights
        if shift is not None:
            here = seen_from(observations.sights(frame, mean, marker_covariances(deviations)), -shift)
        return observe(state, here, deviations, reads=model.reads, gate_sd=gate_sd)

    return prediction, *model.conditioned(state, frame, update, first=(mean, deviations))


def filter_forward(
    model: MotionModel,
    observations: Observations,
    t_s: Array,
    *,
    frames: range | None = None,
    before: Gaussian | None = None,
    gate_sd: float = 6.0,
    keep: bool = True,
    about: Sequence[Reference] | None = None,
    progress: Progress | None = None,
) -> Filtered:
    """Filter frames.

    Args:
        model: Motion model.
        observations: What each frame shows.
        t_s: (T,) times.
        frames: Consecutive frames; None: all.
        before: Filtered state of the frame before them; None: the model's initial state.
        gate_sd: Groups further off are not believed (``gate_groups``).
        keep: Whether to keep states and predictions for smoothing.
        about: What an earlier pass made of all frames of the recording (``filter_frame``).
        progress: Called with the share of all frames done.
    """
    frames = range(observations.n_frames) if frames is None else frames
    states: list[Gaussian] = []
    predictions: list[Prediction | None] = []
    observed: list[Observed] = []
    state = model.initial() if before is None else before
    noise_of: dict[float, tuple[Array, Array]] = {}
    for frame in frames:
        step = None
        if frame:
            dt = round(float(t_s[frame] - t_s[frame - 1]), 12)
            if dt not in noise_of:
                noise = model.noise(dt)
                noise_of[dt] = noise, gram(noise)
            step = Step(frame, dt, *noise_of[dt])
        here = None if about is None else about[frame]
        prediction, state, seen = filter_frame(model, observations, frame, state, step, gate_sd, about=here)
        if keep:
            states.append(state)
            predictions.append(prediction)
        observed.append(seen)
        if progress is not None:
            progress((frame + 1) / observations.n_frames)
    return Filtered(states, predictions, observed, state)


def smooth(
    model: MotionModel,
    observations: Observations,
    t_s: Array,
    *,
    gate_sd: float = 6.0,
    most_bytes: float = 1e9,
    passes: int = 1,
    settled: float = 0.05,
    asked: Asked | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Filter and smooth; one BLAS thread, which is up to 100 times faster than two at these sizes.

    What is not linear (rays, potentials, bones) is linearised about the prediction. In a further pass it is linearised
    about the states that were smoothed before, under their uncertainty: iterated posterior linearisation
    (Garcia-Fernandez, Svensson, Morelande & Sarkka 2015; of smoothers: Garcia-Fernandez, Svensson & Sarkka 2017).

    A recording whose states would take more than ``most_bytes`` is filtered in blocks of which only the state before
    each is kept; going back, each block but the last is filtered again. The memory for states is then flat in the
    number of frames, for a third more time.

    Args:
        model: Motion model.
        observations: What each frame shows.
        t_s: (T,) times.
        gate_sd: Groups further off are not believed (``gate_groups``).
        most_bytes: See above.
        passes: At most so many; one where the model has nothing to linearise.
        settled: Passes end when no marker moves by more than so many of its standard deviations.
        asked: Points and pairs whose velocities and joint covariances are kept; None: of none.
        progress: Called with the share done.
    """
    if isinstance(model, ConstantVelocity | LastingAcceleration) and passes == 1:
        plain: dict[str, Any] = {"gate_sd": gate_sd, "most_bytes": most_bytes, "asked": asked, "progress": progress}
        with threadpool_limits(1):
            return smooth_apart(model, observations, t_s, **plain)
    options: dict[str, Any] = {
        "gate_sd": gate_sd,
        "most_bytes": most_bytes,
        "passes": passes,
        "settled": settled,
        "asked": asked,
        "progress": progress,
    }
    if isinstance(model, PoseMotion) and len(model.subspace.mean) > 3 * MOST:
        return smooth_in_groups(model, observations, t_s, groups_of(model), smooth_together, **options)
    return smooth_together(model, observations, t_s, **options)


def smooth_together(
    model: MotionModel,
    observations: Observations,
    t_s: Array,
    *,
    gate_sd: float = 6.0,
    most_bytes: float = 1e9,
    passes: int = 1,
    settled: float = 0.05,
    asked: Asked | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """``smooth`` for a state whose components depend on each other, with one covariance matrix of all."""
    about: list[Reference] | None = None
    for number in range(passes):
        tell = None if progress is None else (lambda share, n=number: progress((n + share) / passes))
        estimate, found = _pass(
            model,
            observations,
            t_s,
            about,
            gate_sd=gate_sd,
            most_bytes=most_bytes,
            last=number == passes - 1,
            asked=asked,
            progress=tell,
        )
        if number and about is not None:
            moved = estimate.xyz_m - np.array([a.mean for a in about])
            sd = np.sqrt(np.trace(estimate.cov_m2, axis1=-2, axis2=-1) / 3)
            if (np.abs(moved).max(axis=-1) <= settled * sd).all():
                break
        about = found
    return estimate


def _pass(
    model: MotionModel,
    observations: Observations,
    t_s: Array,
    about: Sequence[Reference] | None,
    *,
    gate_sd: float,
    most_bytes: float,
    last: bool,
    asked: Asked | None,
    progress: Progress | None,
) -> tuple[Estimate, list[Reference]]:
    """One pass forward and back, about what the one before it found."""
    n_frames, size = observations.n_frames, model.points.n
    options: dict[str, Any] = {"gate_sd": gate_sd, "about": about}
    length = max(2, int(most_bytes / (3 * 8 * size**2)))
    blocks = [range(max(0, stop - length), stop) for stop in range(n_frames, 0, -length)][::-1]
    with threadpool_limits(1):
        half = None if progress is None else (lambda share: progress(0.5 * share))
        before: list[Gaussian | None] = [None]
        observed: list[Observed] = []
        filtered = None
        for block in blocks:
            keep = block is blocks[-1]
            filtered = filter_forward(
                model, observations, t_s, frames=block, before=before[-1], keep=keep, progress=half, **options
            )
            before.append(filtered.last)
            observed.extend(filtered.observed)
        xyz, cov, references, angles, energies = [], [], [], [], []
        state, ahead = before[-1], None
        keeper = None if asked is None else RateKeeper(model, asked)
        holder = None if asked is None else HeldKeeper.of(model)
        for i in range(len(blocks) - 1, -1, -1):
            if filtered is None or i < len(blocks) - 1:
                filtered = filter_forward(model, observations, t_s, frames=blocks[i], before=before[i], **options)
            for frame in reversed(blocks[i]):
                here, after = filtered.states.pop(), ahead
                state = here if ahead is None or state is None else smooth_step(here, ahead, state)
                ahead = filtered.predictions.pop()
                dark = not len(observed[frame].where)
                shown = model.informed(state) if dark else state
                mean, covariance = marker_moments(model, shown, frame)
                if keeper is not None:
                    keeper.take(frame, here, after, shown)
                if holder is not None:
                    holder.take(frame, shown)
                angles.append(model.angles_of(shown))
                energies.append(model.energy_of(shown, frame))
                xyz.append(mean)
                cov.append(covariance)
                if not last:
                    references.append(Reference(mean, covariance, model.reference(state)))
                if progress is not None:
                    progress(1 - 0.5 * frame / n_frames)
        rates = None if keeper is None else keeper.rates(n_frames)
    found = Estimate(
        xyz_m=np.array(xyz[::-1]),
        cov_m2=np.array(cov[::-1]),
        observed=observed,
        rates=rates,
        angles=None if angles[0] is None else np.moveaxis(np.array(angles[::-1]), 1, 0),
        energies=None if energies[0] is None else np.array(energies[::-1]),
        held=() if holder is None or asked is None else holder.held(asked.names),
    )
    return found, references[::-1]


def marker_moments(model: MotionModel, state: Gaussian, frame: int) -> tuple[Array, Array]:
    """Mean (M, 3) and covariance (M, 3, 3) of the markers of a state."""
    mean, deviations = model.deviations(state, frame)
    return mean, marker_covariances(deviations)
