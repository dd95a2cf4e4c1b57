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


def filter_forward(
    model: MotionModel,
    observations: Observations,
    t_s: Array,
    *,
    gate_sd: float = 6.0,
    keep: bool = True,
    progress: Progress | None = None,
) -> tuple[list[Gaussian], list[Prediction], dict[str, list]]:
    """Filter all frames.

    Args:
        model: Motion model.
        observations: Rows of each frame.
        t_s: (T,) times.
        gate_sd: Rays further off are not believed (``gate_groups``).
        keep: Whether to keep the states for smoothing; without, only the statistics are returned.
        progress: Called with the share done.

    Returns:
        Filtered states, predictions (prediction k leads to frame k + 1), and the statistics of each frame.
    """
    statistics: dict[str, list] = {k: [] for k in ("innovation", "used", "rows", "nis", "n_rows", "log_likelihood")}
    states: list[Gaussian] = []
    predictions: list[Prediction] = []
    state = model.initial()
    c, _ = scale(model.points)
    noise_of: dict[float, Array] = {}
    for frame in range(observations.n_frames):
        if frame:
            dt = round(float(t_s[frame] - t_s[frame - 1]), 12)
            if dt not in noise_of:
                noise_of[dt] = model.noise(dt)
            step = _stepper(model, dt)
            prediction = predict(state, step, noise_of[dt], model.points, linear=model.linear)
            if keep:
                predictions.append(prediction)
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
        statistics["innovation"].append(result.innovation)
        statistics["used"].append(result.used)
        statistics["rows"].append(rows)
        statistics["nis"].append(result.nis)
        statistics["n_rows"].append(int(result.used.sum()))
        statistics["log_likelihood"].append(result.log_likelihood)
        if progress is not None:
            progress((frame + 1) / observations.n_frames)
    return states, predictions, statistics


def _stepper(model: MotionModel, dt_s: float) -> Callable[[Array], Array]:
    return lambda states: model.step(states, dt_s)


def _gater(rows: Rows, gate_sd: float) -> Callable[[Array], NDArray[np.bool_]]:
    return lambda normalised: gate_groups(normalised, rows, gate_sd)


def log_likelihood(model: MotionModel, observations: Observations, t_s: Array, *, gate_sd: float = 6.0) -> float:
    """Log density of all observations under a model: what its parameters are chosen by."""
    with threadpool_limits(1):
        return float(sum(filter_forward(model, observations, t_s, gate_sd=gate_sd, keep=False)[2]["log_likelihood"]))


def smooth(
    model: MotionModel,
    observations: Observations,
    t_s: Array,
    *,
    gate_sd: float = 6.0,
    progress: Progress | None = None,
) -> Smoothed:
    """Filter and smooth; one BLAS thread, which is up to 100 times faster than two at these sizes."""
    with threadpool_limits(1):
        half = None if progress is None else (lambda share: progress(0.5 * share))
        states, predictions, statistics = filter_forward(model, observations, t_s, gate_sd=gate_sd, progress=half)
        n_frames = len(states)
        xyz, cov = [], []
        state = states[-1]
        for frame in range(n_frames - 1, -1, -1):
            if frame < n_frames - 1:
                state = smooth_step(states[frame], predictions[frame], state)
                states.pop()
                predictions.pop()
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
