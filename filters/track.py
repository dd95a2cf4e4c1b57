"""The tracker: filter forward, smooth backward, return markers with covariance.

It is an unscented Kalman filter that propagates exactly what is linear in the state, and takes sigma points where
something is not, over the coordinates that are not: rays over the three of their marker, potentials over theirs; joint
angles and the Lagrangian are linearised by their derivatives.
"""

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from mocap.filters.gaussian import Adjoint, Markers, Moments, Smoothed, Update
from mocap.filters.hide import GAP_FRAMES
from mocap.filters.motion.base import Folded, Frame, MotionModel, Step
from mocap.filters.moving import RateKeeper
from mocap.filters.observations import Observations, seen_from
from mocap.filters.observe import GATE_SD, Observed, observe, unused
from mocap.filters.records import Estimate
from mocap.filters.velocities import RatePoints
from numpy.typing import NDArray

from eal.arrays import Array, true_runs
from eal.threads import one_blas_thread

Progress = Callable[[float], None]
REMEMBERED = max(GAP_FRAMES)
"""Frames without any sighting after which a motion is forgotten, and before which it is not foretold: the longest gap
for which models learn how far they err."""


def forgotten(shown: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(T,) frames that are more than ``REMEMBERED`` away from all of those (T,) in which anything is seen.

    Before the first of these and after the last there are none: what may be kept there is for others to say.
    """
    out = np.zeros(len(shown), dtype=bool)
    for start, stop in true_runs(~shown):
        if start > 0 and stop < len(shown):
            out[start + REMEMBERED : max(start, stop - REMEMBERED)] = True
    return out


def filter_frame(
    model: MotionModel,
    observations: Observations,
    frame: int,
    before: Moments,
    step: Step | None,
    gate_sd: float,
) -> Frame:
    """Predict one frame and condition on what it shows; without a ``step`` (at the first frame) only the latter."""
    move, predicted, state, updates = None, before, before, []
    if step is not None:
        move = model.move(before, step)
        predicted = move.ahead(before)
        state, updates = model.constrain(predicted, step)
    markers = Markers(state, model.view(state.mean, frame))
    sights = observations.sights(frame, markers.view.mean, markers.cov)
    if not len(sights.size):  # a potential would hold a shape whose phase nobody knows, and be sure of it
        return Frame(predicted, move, (), unused(sights))

    def update(here: Markers, shift: Array | None) -> tuple[Moments, tuple[Update | None, Observed]]:
        seen = sights
        if shift is not None:
            seen = seen_from(observations.sights(frame, here.view.mean, here.cov), -shift)
        found, done, what = observe(here, seen, gate_sd=gate_sd)
        return found, (done, what)

    state, (done, seen) = model.conditioned(state, frame, update, first=markers)
    return Frame(state, move, updates if done is None else [*updates, done], seen)


def filter_forward(
    model: MotionModel,
    observations: Observations,
    t_s: Array,
    *,
    frames: range | None = None,
    before: Moments | None = None,
    gate_sd: float = GATE_SD,
    progress: Progress | None = None,
) -> Iterator[Frame]:
    """Filter frames, one after the other; where a motion is ``forgotten``, from the initial state.

    A state that is predicted for hundreds of frames grows until no number holds it.

    Args:
        model: Motion model.
        observations: What each frame shows.
        t_s: (T,) times.
        frames: Consecutive frames; None: all.
        before: Filtered state of the frame before them; None: the model's initial state.
        gate_sd: Groups further off are not believed (``gate_groups``).
        progress: Called with the share of all frames done.
    """
    state = model.initial() if before is None else before
    anew = forgotten(observations.shown)
    for frame in range(observations.n_frames) if frames is None else frames:
        step = Step(frame, round(float(t_s[frame] - t_s[frame - 1]), 12)) if frame and not anew[frame] else None
        state = model.initial() if anew[frame] else state
        filtered = filter_frame(model, observations, frame, state, step, gate_sd)
        state = filtered.state
        yield filtered
        if progress is not None:
            progress((frame + 1) / observations.n_frames)


def smooth_back(frames: Iterable[Frame]) -> Iterator[tuple[Frame, Smoothed, Array]]:
    """Smooth filtered frames, from the last of a recording to the first.

    Yields:
        Each frame, its smoothed state, and Lambda: what all later frames say of its filtered state.
    """
    adjoint, later = None, None
    for frame in frames:
        state = frame.state
        if adjoint is None:  # nothing comes later
            adjoint = Adjoint(np.zeros_like(state.mean), np.zeros_like(state.cov))
        smoothed = adjoint.smoothed(state)
        if later is not None and later[0].move is not None and not frame.updates:
            cov = later[0].move.smoothed_cov(state.cov, later[1].cov)
            smoothed = Smoothed(smoothed.mean, cov, np.zeros_like(cov))
        yield frame, smoothed, adjoint.matrix
        adjoint, later = (None, None) if frame.move is None else (frame.back(adjoint), (frame, smoothed))


def smooth(
    model: MotionModel,
    observations: Observations,
    t_s: Array,
    *,
    gate_sd: float = GATE_SD,
    most_bytes: float = 1e9,
    rate_points: RatePoints | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Filter and smooth; one BLAS thread, which is up to 100 times faster than two at these sizes.

    What is not linear (rays, potentials, bones) is linearised about the prediction.

    A recording whose states would take more than ``most_bytes`` is filtered in blocks of which only the state before
    each is kept; going back, each block but the last is filtered again. The memory for states is then flat in the
    number of frames, for a third more time.

    Args:
        model: Motion model.
        observations: What each frame shows.
        t_s: (T,) times.
        gate_sd: Groups further off are not believed (``gate_groups``).
        most_bytes: See above.
        rate_points: Points and pairs whose velocities and joint covariances are kept; None: of none.
        progress: Called with the share done.
    """
    n_frames, start = observations.n_frames, model.initial().cov
    # half of the covariance and updates: 1.1 to 1.3 of what it takes, 2.5 where markers are by themselves
    length = max(2, int(most_bytes / ((1.4 if start.ndim == 2 else 3) * start.nbytes)))
    blocks = [range(max(0, stop - length), stop) for stop in range(n_frames, 0, -length)][::-1]
    xyz, cov = [], []
    keeper = None if rate_points is None else RateKeeper(model, rate_points)
    own = model.own(() if rate_points is None else rate_points.names)
    with one_blas_thread():
        half = None if progress is None else (lambda share: progress(0.5 * share))
        before: list[Moments | None] = [None]
        observed: list[Observed] = []
        filtered: list[Folded] = []
        for block in blocks:
            filtered.clear()
            for one in filter_forward(
                model, observations, t_s, frames=block, before=before[-1], gate_sd=gate_sd, progress=half
            ):
                if block is not blocks[-1]:
                    filtered.clear()
                filtered.append(Folded.of(one))
                observed.append(one.observed)
                last = one.state
            before.append(last)

        def backwards() -> Iterator[Frame]:
            for i in range(len(blocks) - 1, -1, -1):
                again = filter_forward(model, observations, t_s, frames=blocks[i], before=before[i], gate_sd=gate_sd)
                frames = filtered if blocks[i] is blocks[-1] else list(map(Folded.of, again))
                while frames:
                    yield frames.pop().unfolded

        for frame, (here, state, matrix) in zip(range(n_frames - 1, -1, -1), smooth_back(backwards()), strict=True):
            shown = state if len(here.observed.where) else model.informed(state)
            view = model.view(shown.mean, frame)
            if keeper is not None:
                keeper.take(frame, here, state, shown, matrix)
            for one in own:
                one.take(frame, shown)
            mean, spread = model.shown(shown, view, frame)
            xyz.append(mean)
            cov.append(spread)
            if progress is not None:
                progress(1 - 0.5 * frame / n_frames)
        rates = None if keeper is None else keeper.rates(n_frames)
    return Estimate(
        xyz_m=np.array(xyz[::-1]),
        cov_m2=np.array(cov[::-1]),
        observed=observed,
        rates=rates,
        own={name: of for one in own for name, of in one.values().items()},
    )
