"""Trials, and their poses in the frame of the body: what a pose model is learned from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.body_axes import BodyFrames, body_frames, trunk_shape
from mocap.filters.independent import INDEPENDENT
from mocap.filters.subspace import PoseSubspace, fit_subspace, structure, white_variance
from mocap.filters.whittaker import fastest_hz, smooth_series
from numpy.typing import NDArray

from eal.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkerTrial:
    """One recording as it was measured.

    Attributes:
        name: Of the recording.
        t_s: (T,) times, evenly spaced.
        xyz_m: (T, M, 3) markers in the world; NaN where not seen.
        sd_m: (T, M) standard deviation of a measured coordinate.
    """

    name: str
    t_s: Array
    xyz_m: Array
    sd_m: Array

    @property
    def dt_s(self) -> float:
        """Time step."""
        return float(self.t_s[1] - self.t_s[0]) if len(self.t_s) > 1 else 1.0

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(T, M) True where measured."""
        return np.isfinite(self.xyz_m[..., 0])


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseTrial:
    """One recording in the frame of the body.

    Attributes:
        t_s: (T,) times, evenly spaced.
        frames: Body frame of every frame.
        y: (T, 3M) markers in the body frame, metres; NaN where not seen.
        sd_m: (T, M) standard deviation of a measured coordinate.
    """

    t_s: Array
    frames: BodyFrames
    y: Array
    sd_m: Array

    @property
    def dt_s(self) -> float:
        """Time step."""
        return float(self.t_s[1] - self.t_s[0]) if len(self.t_s) > 1 else 1.0


def pose_trial(t_s: Array, xyz_m: Array, frames: BodyFrames, sd_m: Array | None = None) -> PoseTrial:
    """Markers (T, M, 3) of the world as poses; their deviations (T, M), 0 where none are given."""
    sd_m = np.zeros(xyz_m.shape[:2]) if sd_m is None else sd_m
    return PoseTrial(t_s=t_s, frames=frames, y=frames.to_body(xyz_m).reshape(len(xyz_m), -1), sd_m=sd_m)


LEAST_KNOWN = 0.8
"""Poses known better than this (``Components.certainty``) are learned from. Chosen, not measured."""


def poses_of(trials: Sequence[MarkerTrial], trunk: Sequence[int], *, body_hz: float = 3.0) -> list[PoseTrial]:
    """Poses of trials about one body: its axes are those of the mean shape of all their trunks.

    Args:
        trials: Trials of the same markers.
        trunk: Indices of the trunk's markers; in a trial that shows none of them all markers are taken.
        body_hz: Faster motion of the trunk is left to the shape.
    """
    chosen = list(trunk)
    if not all(trial.seen[:, chosen].any() for trial in trials):
        chosen = list(range(trials[0].xyz_m.shape[1]))
    shape = trunk_shape(np.concatenate([trial.xyz_m[:, chosen] for trial in trials]))
    out = []
    for trial in trials:
        frames = body_frames(trial.xyz_m[:, chosen], dt_s=trial.dt_s, cutoff_hz=body_hz, shape=shape)
        out.append(pose_trial(trial.t_s, trial.xyz_m, frames, trial.sd_m))
    return out


@dataclass(frozen=True, eq=False, kw_only=True)
class Shapes:
    """The shapes z of all poses of some trials, about one subspace.

    Attributes:
        subspace: Subspace of all trials.
        z: (T, r) shapes of each trial.
        rate: (T, r) their velocities, smoothed, a second.
        acceleration: (T, r) their accelerations.
        certainty: (T,) how well each pose is known from what its frame shows (``Components.certainty``).
        offset: (G, 3M) what each trial adds to the mean pose.
        offset_sd: (G, 3M) how uncertain that is.
        residual: (T, 3M) what the subspace leaves of each pose; NaN where not seen.
        ranks: Ranks that predict hidden samples within 5 % of the best; the subspace is of the first.
    """

    subspace: PoseSubspace
    z: list[Array]
    rate: list[Array]
    acceleration: list[Array]
    certainty: list[Array]
    offset: Array
    offset_sd: Array
    residual: list[Array]
    ranks: tuple[int, ...]


def shapes_of(trials: Sequence[PoseTrial], *, ranks: Sequence[int]) -> Shapes:
    """Fit one subspace to trials and read off the motion of the shape.

    Args:
        trials: Trials of the same markers and rate.
        ranks: Ranks to choose from, on hidden samples (``fit_subspace``).
    """
    dt_s = trials[0].dt_s
    lengths = [len(trial.y) for trial in trials]
    member = np.repeat(np.arange(len(trials)), lengths)
    y = np.concatenate([trial.y for trial in trials])
    block = max(3, round(0.05 / dt_s))
    sd = np.concatenate([trial.sd_m for trial in trials])
    rng = np.random.default_rng(0)
    subspace, found, z, good = fit_subspace(y, ranks=ranks, block=block, rng=rng, trial=member, sd=sd)
    cuts = np.cumsum(lengths)[:-1]
    smooth = [
        smooth_series(part, np.ones(len(part)), dt_s=dt_s, cutoff_hz=fastest_hz(dt_s)) for part in np.split(z, cuts)
    ]
    rate = [_derivative(part, dt_s) for part in smooth]
    left = np.where(np.isfinite(y), y - found.poses, np.nan)
    count = np.array([np.isfinite(trial.y).sum(axis=0) for trial in trials])
    precision = INDEPENDENT * count / max(found.noise, 1e-14) + 1 / np.maximum(found.trial_sd, 1e-7) ** 2
    return Shapes(
        subspace=subspace,
        z=np.split(z, cuts),
        rate=rate,
        acceleration=[_derivative(part, dt_s) for part in rate],
        certainty=np.split(found.certainty, cuts),
        offset=found.trial_offset,
        offset_sd=1 / np.sqrt(precision),
        residual=np.split(left, cuts),
        ranks=good,
    )


def _derivative(series: Array, dt_s: float) -> Array:
    return np.gradient(series, dt_s, axis=0) if len(series) > 1 else np.zeros_like(series)


MATERN_3_2_HALF, MATERN_HALF = 1.6783, 2.3303
"""Lags at which the correlations of Matern-3/2 and Matern-5/2 processes of unit rate are a half: of (1 + s) exp(-s) and
(1 + s + s^2 / 3) exp(-s)."""


def residual_memory_s(
    residual: Sequence[Array], dt_s: float, turn_s: float, *, hidden_sd: Array | float = 0.0
) -> float:
    """Time in seconds in which residuals lose half of their correlation.

    Their structure function E (e(t + s) - e(t))^2 is half of 2 var there, found on a line between two lags. It begins
    as a parabola: what remains of two lags at s = 0 is twice the variance of measurement noise. Where noise hides the
    residual (less than two standard errors of that are left), or where a subspace that holds the poses whole leaves
    less than a hundredth of ``hidden_sd``, it is taken to be 0.42 of the time in which the motion turns by a radian.

    Args:
        residual: (T, 3M) residuals of each trial; NaN where not seen.
        dt_s: Time step.
        turn_s: Time in which the motion turns by a radian (``radian``).
        hidden_sd: Deviations of what the process stands for, coordinates that are not seen (``PoseSubspace``).
    """
    series, trial = np.concatenate(residual), np.repeat(np.arange(len(residual)), [len(part) for part in residual])
    variance, count = float(np.nanmean(series**2)), np.count_nonzero(np.isfinite(series))
    noise = white_variance(series, trial)
    left = variance - noise
    if left <= max(4 * variance * np.sqrt(2 / count), 1e-4 * float(np.mean(np.square(hidden_sd)))):
        return 0.42 * turn_s
    longest = max(2, max(len(part) for part in residual) // 2)
    before = changed = 0.0
    for lag in np.unique(np.geomspace(1, longest, 40).astype(int)).tolist():
        changes = structure(series, lag, trial) - 2 * noise
        if changes >= left:
            lag = before + (lag - before) * (left - changed) / (changes - changed)
            break
        if changes > changed:
            before, changed = float(lag), changes
    return lag * dt_s


def known_shapes(shapes: Shapes) -> list[NDArray[np.bool_]]:
    """(T,) masks of the poses that are known better than ``LEAST_KNOWN``; of the 30 best known, if these are fewer."""
    certainty, limit, least = np.concatenate(shapes.certainty), LEAST_KNOWN, 30
    if np.count_nonzero(certainty > limit) < least:
        limit = float(np.sort(certainty)[-min(least, len(certainty))]) - 1e-12
    return [part > limit for part in shapes.certainty]


def radian(shapes: Shapes) -> float:
    """Time in seconds in which the motion turns by a radian."""
    z, rate = np.concatenate(shapes.z), np.concatenate(shapes.rate)
    return float(np.sqrt(z.var(axis=0).sum() / max(rate.var(axis=0).sum(), 1e-300)))
