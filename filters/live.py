"""Tracking while a recording grows: each frame's markers, smoothed by the frames that have come since."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from mocap.filters.ensemble import Gaussian, Prediction
from mocap.filters.motion.base import MotionModel, Step
from mocap.filters.observations import Observations, Sights
from mocap.filters.observe import Observed
from mocap.filters.smoother import smooth_step
from mocap.filters.track import filter_frame, marker_moments

from eal.arrays import Array
from eal.threads import one_blas_thread

Look = Callable[[Array, Array], Sights]
"""What one frame shows of markers predicted at (M, 3) with covariance (M, 3, 3)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveEstimate:
    """The markers of one frame as they are known a little later.

    Attributes:
        frame: Number of the frame, from 0.
        t_s: Its time.
        ahead: Number of later frames that it rests on.
        xyz_m: (M, 3) positions.
        cov_m2: (M, 3, 3) their covariance.
        observed: What was seen in the frame, and how it was believed.
    """

    frame: int
    t_s: float
    ahead: int
    xyz_m: Array
    cov_m2: Array
    observed: Observed


@dataclass(frozen=True, eq=False)
class _Kept:
    """What smoothing back needs of a frame."""

    frame: int
    t_s: float
    prediction: Prediction | None
    state: Gaussian
    observed: Observed


@dataclass(frozen=True)
class _Now:
    """The one frame that is being looked at."""

    look: Look
    n_frames: int = 1

    def sights(self, frame: int, mean: Array, cov: Array) -> Sights:  # noqa: ARG002
        return self.look(mean, cov)


def looks(observations: Observations, t_s: Array) -> Iterator[tuple[float, Look]]:
    """Time and look of each frame of a recording, one after the other."""
    for frame, time in enumerate(t_s):
        yield float(time), lambda mean, cov, frame=frame: observations.sights(frame, mean, cov)


def live(
    model: MotionModel,
    frames: Iterable[tuple[float, Look]],
    *,
    lag: int,
    every: int = 1,
    gate_sd: float = 6.0,
) -> Iterator[LiveEstimate]:
    """Fixed-lag smoothing (Anderson & Moore 1979, chapter 7): every frame once, with ``lag`` frames of hindsight.

    A frame is filtered as it comes. Then the last states are smoothed back, and those that have seen ``lag`` later
    frames are given away; when no more frames come, the rest follows with what hindsight there is. A frame is estimated
    exactly as ``track.smooth`` does it of a recording that ends where the window ends: with a lag of the whole
    recording it is that to rounding, with lag 0 the filtered state.

    Cost a frame: one filter step and (lag + every - 1) / every smoothing steps; memory: lag + every states and
    predictions, whatever the number of frames. With ``every`` > 1 so many frames come at once, with up to every - 1
    frames more hindsight than ``lag``: at every = lag, two smoothing steps a frame at most.

    Args:
        model: Motion model.
        frames: Time and look of each frame as they come; may wait between them.
        lag: Least number of later frames that an estimate rests on (but at the end).
        every: Number of frames that are smoothed back together.
        gate_sd: Groups further off are not believed (``gate_groups``).

    Raises:
        ValueError: a negative lag, ``every`` below 1, or a time that does not increase.
    """
    if lag < 0 or every < 1:
        raise ValueError(f"lag must be 0 or more and every 1 or more, but they are {lag} and {every}")
    kept: deque[_Kept] = deque()
    state, step, last_s = model.initial(), None, -np.inf
    for frame, (time, look) in enumerate(frames):
        with one_blas_thread():
            if frame:
                dt = round(time - last_s, 12)
                if not dt > 0:
                    raise ValueError(f"times must increase, but frame {frame} at {time} s follows one at {last_s} s")
                noise = step.noise if step is not None and step.dt_s == dt else model.noise(dt)
                step = Step(frame, dt, noise)
            last_s = time
            prediction, state, seen = filter_frame(model, _Now(look), frame, state, step, gate_sd)
            kept.append(_Kept(frame, time, prediction, state, seen))
            done = _smoothed(model, kept, every) if len(kept) == lag + every else []
        for estimate in done:
            kept.popleft()
            yield estimate
    with one_blas_thread():
        done = _smoothed(model, kept, len(kept))
    yield from done


def _smoothed(model: MotionModel, kept: deque[_Kept], n: int) -> list[LiveEstimate]:
    """Smooth back from the last of the kept frames; the first n of them."""
    out, state, ahead = [], None, None
    for i in range(len(kept) - 1, -1, -1):
        here = kept[i]
        state = here.state if ahead is None or state is None else smooth_step(here.state, ahead, state)
        ahead = here.prediction
        if i < n:
            dark = not len(here.observed.where)
            xyz, cov = marker_moments(model, model.informed(state) if dark else state, here.frame)
            later = len(kept) - 1 - i
            out.append(
                LiveEstimate(frame=here.frame, t_s=here.t_s, ahead=later, xyz_m=xyz, cov_m2=cov, observed=here.observed)
            )
    return out[::-1]
