"""The tracker: filter forward, smooth backward, return markers with covariance."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from filters.ensemble import Gaussian, Prediction, Update, ensemble, predict, scale, spread, update
from filters.motion.base import MotionModel
from filters.observations import WHOLE, Observations, Rows
from filters.smoother import smooth_step
from mocap.arrays import Array

Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False, kw_only=True)
class Smoothed:
    """Markers as a tracker sees them with hindsight, and how surprised it was.

    Attributes:
        xyz_m: (T, M, 3) smoothed positions.
        cov_m2: (T, M, 3, 3) their covariance.
        rows: Each frame's observations.
        innovation: Each frame's (m,) observed minus predicted rows.
        used: Each frame's (m,) mask of rows that were believed.
        nis: (T,) normalised innovation squared; NaN without rows.
        n_rows: (T,) rows that were believed.
        log_likelihood: (T,) log density of the rows given those before.
    """

    xyz_m: Array
    cov_m2: Array
    rows: list[Rows]
    innovation: list[Array]
    used: list[NDArray[np.bool_]]
    nis: Array
    n_rows: NDArray[np.int64]
    log_likelihood: Array


def gate_groups(normalised: Array, rows: Rows, gate_sd: float) -> NDArray[np.bool_]:
    """(m,) rows to believe.

    A ray further than ``gate_sd`` standard deviations from its prediction is not believed, unless another ray of its
    marker is far off as well: as triangulation found all of them to meet, the prediction was wrong, and rays that are
    near it merely look along the way that the marker went.
    """
    far = np.zeros(len(rows.where), dtype=bool)
    far[rows.group[np.abs(normalised) > gate_sd]] = True
    if far.any():
        marker = rows.where[:, 1]
        agreed = np.bincount(marker[far], minlength=marker.max() + 1) >= 2
        far &= ~agreed[marker] & (rows.where[:, 0] != WHOLE)
    return ~far[rows.group]


@dataclass(frozen=True, eq=False)
class Filtered:
    """Frames that were filtered one after the other.

    Attributes:
        states: Filtered state of each frame; empty where they were not kept.
        predictions: What led to each frame; None to the first of the recording.
        statistics: Lists with an entry a frame.
        last: Filtered state of the last frame.
    """

    states: list[Gaussian]
    predictions: list[Prediction | None]
    statistics: dict[str, list]
    last: Gaussian


def filter_forward(
    model: MotionModel,
    observations: Observations,
    t_s: Array,
    *,
    frames: range | None = None,
    before: Gaussian | None = None,
    gate_sd: float = 6.0,
    keep: bool = True,
    progress: Progress | None = None,
) -> Filtered:
    """Filter frames.

    Args:
        model: Motion model.
        observations: Rows of each frame.
        t_s: (T,) times.
        frames: Consecutive frames; None: all.
        before: Filtered state of the frame before them; not read at frame 0.
        gate_sd: Rays further off are not believed (``gate_groups``).
        keep: Whether to keep states and predictions for smoothing; the statistics always are.
        progress: Called with the share of all frames done.
    """
    frames = range(observations.n_frames) if frames is None else frames
    statistics: dict[str, list] = {k: [] for k in ("innovation", "used", "rows", "nis", "n_rows", "log_likelihood")}
    states: list[Gaussian] = []
    predictions: list[Prediction | None] = []
    state = model.initial() if before is None else before
    c, _ = scale(model.points)
    noise_of: dict[float, Array] = {}
    for frame in frames:
        prediction = None
        if frame:
            dt = round(float(t_s[frame] - t_s[frame - 1]), 12)
            if dt not in noise_of:
                noise_of[dt] = model.noise(dt)
            prediction = predict(state, _stepper(model, dt), noise_of[dt], model.points, linear=model.linear)
            state = model.constrain(prediction.state, dt)
        markers = model.markers(spread(state, c, columns=model.reads, rows=model.reads), frame)
        rows = observations.rows(frame, marker_spread(markers, c))
        result = Update(state, np.zeros(0), np.zeros(0, dtype=bool), np.nan, 0.0)
        if len(rows.y):
            seen = rows.h(markers)
            gate = _gater(rows, gate_sd)
            result = update(
                state, lambda _, seen=seen: seen, rows.y, rows.sd, model.points, reads=model.reads, gate=gate
            )
            state = result.state
        if keep:
            states.append(state)
            predictions.append(prediction)
        statistics["innovation"].append(result.innovation)
        statistics["used"].append(result.used)
        statistics["rows"].append(rows)
        statistics["nis"].append(result.nis)
        statistics["n_rows"].append(int(result.used.sum()))
        statistics["log_likelihood"].append(result.log_likelihood)
        if progress is not None:
            progress((frame + 1) / observations.n_frames)
    return Filtered(states, predictions, statistics, state)


def _stepper(model: MotionModel, dt_s: float) -> Callable[[Array], Array]:
    return lambda states: model.step(states, dt_s)


def _gater(rows: Rows, gate_sd: float) -> Callable[[Array], NDArray[np.bool_]]:
    return lambda normalised: gate_groups(normalised, rows, gate_sd)


def log_likelihood(model: MotionModel, observations: Observations, t_s: Array, *, gate_sd: float = 6.0) -> float:
    """Log density of all observations under a model: what its parameters are chosen by."""
    with threadpool_limits(1):
        filtered = filter_forward(model, observations, t_s, gate_sd=gate_sd, keep=False)
    return float(sum(filtered.statistics["log_likelihood"]))


def smooth(
    model: MotionModel,
    observations: Observations,
    t_s: Array,
    *,
    gate_sd: float = 6.0,
    most_bytes: float = 1e9,
    progress: Progress | None = None,
) -> Smoothed:
    """Filter and smooth; one BLAS thread, which is up to 100 times faster than two at these sizes.

    A recording whose states would take more than ``most_bytes`` is filtered in blocks of which only the state before
    each is kept; going back, each block is filtered again. The memory for states is then flat in the number of
    frames, for a third more time.
    """
    n_frames, size = observations.n_frames, 2 * model.reads
    length = max(2, int(most_bytes / (3 * 8 * size**2)))
    blocks = [range(start, min(start + length, n_frames)) for start in range(0, n_frames, length)]
    with threadpool_limits(1):
        half = None if progress is None else (lambda share: progress(0.5 * share))
        before: list[Gaussian | None] = [None]
        statistics: dict[str, list] = {}
        filtered = None
        for block in blocks:
            keep = block is blocks[-1]
            filtered = filter_forward(
                model, observations, t_s, frames=block, before=before[-1], gate_sd=gate_sd, keep=keep, progress=half
            )
            before.append(filtered.last)
            for name, values in filtered.statistics.items():
                statistics.setdefault(name, []).extend(values)
        xyz, cov = [], []
        state, ahead = before[-1], None
        for i in range(len(blocks) - 1, -1, -1):
            if filtered is None or i < len(blocks) - 1:
                filtered = filter_forward(model, observations, t_s, frames=blocks[i], before=before[i], gate_sd=gate_sd)
            for frame in reversed(blocks[i]):
                here = filtered.states.pop()
                state = here if ahead is None or state is None else smooth_step(here, ahead, state)
                ahead = filtered.predictions.pop()
                mean, covariance = marker_moments(model, state, frame)
                xyz.append(mean)
                cov.append(covariance)
                if progress is not None:
                    progress(1 - 0.5 * frame / n_frames)
    return Smoothed(
        xyz_m=np.array(xyz[::-1]),
        cov_m2=np.array(cov[::-1]),
        rows=statistics["rows"],
        innovation=statistics["innovation"],
        used=statistics["used"],
        nis=np.array(statistics["nis"]),
        n_rows=np.array(statistics["n_rows"]),
        log_likelihood=np.array(statistics["log_likelihood"]),
    )


def marker_moments(model: MotionModel, state: Gaussian, frame: int) -> tuple[Array, Array]:
    """Mean (M, 3) and covariance (M, 3, 3) of the markers of a state."""
    c, gamma = scale(model.points)
    markers = model.markers(spread(state, c, columns=model.reads, rows=model.reads), frame)
    mean, rows = ensemble(markers.reshape(len(markers), -1), c, gamma, linear=model.linear)
    deviations = np.moveaxis(rows.reshape(len(rows), -1, 3), 0, 1)  # (M, k, 3)
    return mean.reshape(-1, 3), np.swapaxes(deviations, 1, 2) @ deviations


def marker_spread(markers: Array, c: float) -> Array:
    """(M,) root mean square standard deviation of a coordinate, from sigma points (2k + 1, M, 3) of spread c."""
    k = len(markers) // 2
    difference = (markers[1 : k + 1] - markers[k + 1 :]).reshape(k, -1, 3)
    return np.sqrt(np.einsum("kmi,kmi->m", difference, difference) / (12 * c))
