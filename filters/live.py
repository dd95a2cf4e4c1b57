"""Tracking while a recording grows: each frame's markers, smoothed by the frames that have come since."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from mocap.filters.motion.base import Frame, MotionModel, Step
from mocap.filters.observations import Observations
from mocap.filters.observe import GATE_SD, Observed
from mocap.filters.track import filter_frame, smooth_back

from eal.arrays import Array
from eal.threads import one_blas_thread


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


class _Kept(NamedTuple):
    """A frame that is not given away yet."""

    number: int
    t_s: float
    frame: Frame


def live(
    model: MotionModel,
    observations: Observations,
    t_s: Iterable[float],
    *,
    lag: int,
    every: int = 1,
    gate_sd: float = GATE_SD,
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
        observations: What each frame shows, asked for when its time has come.
        t_s: Time of each frame as they come; may wait between them.
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
    for frame, time in enumerate(map(float, t_s)):
        with one_blas_thread():
            if frame:
                dt = round(time - last_s, 12)
                if not dt > 0:
                    raise ValueError(f"times must increase, but frame {frame} at {time} s follows one at {last_s} s")
                step = Step(frame, dt)
            last_s = time
            filtered = filter_frame(model, observations, frame, state, step, gate_sd)
            state = filtered.state
            kept.append(_Kept(frame, time, filtered))
            done = _smoothed(model, kept, every) if len(kept) == lag + every else []
        for estimate in done:
            kept.popleft()
            yield estimate
    with one_blas_thread():
        done = _smoothed(model, kept, len(kept))
    yield from done


def _smoothed(model: MotionModel, kept: deque[_Kept], n: int) -> list[LiveEstimate]:
    """Smooth back from the last of the kept frames; the first n of them."""
    out = []
    for later, (_, state, _) in enumerate(smooth_back(one.frame for one in reversed(kept))):
        one = kept[-1 - later]
        if later >= len(kept) - n:
            seen = one.frame.observed
            shown = state if len(seen.where) else model.informed(state)
            xyz, cov = model.shown(shown, model.view(shown.mean, one.number), one.number)
            out.append(
                LiveEstimate(
                    frame=one.number,
                    t_s=one.t_s,
                    ahead=later,
                    xyz_m=xyz,
                    cov_m2=cov,
                    observed=seen,
                )
            )
    return out[::-1]
