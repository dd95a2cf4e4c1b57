"""Velocities and joint covariances of markers, taken from a smoother's states while it goes back in time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from mocap.filters.gaussian import Smoothed
from mocap.filters.motion.base import Frame, MotionModel
from mocap.filters.velocities import RatePoints
from numpy.typing import NDArray

from eal.arrays import Array

EVERY = 8
"""Covariances of frames with those before them are computed in every so many frames. Chosen; not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Rates:
    """What a smoother knows of velocities; shapes and meaning as in ``mocap.filters.velocities.Motion``.

    Attributes:
        rate_points: Points and pairs.
        velocity_m_s: (T, N, 3).
        own: (T, N, 6, 6) float32.
        cross: (T, P, 6, 6) float32.
        kept: (T, N, 3).
        acceleration_m_s2: (T, N, 3); None: accelerations are no part of the model's state.
        acceleration_cov: (T, N, 3, 3) float32, covariance of each; None: so.
    """

    rate_points: RatePoints
    velocity_m_s: Array
    own: NDArray[np.float32]
    cross: NDArray[np.float32]
    kept: Array
    acceleration_m_s2: Array | None = None
    acceleration_cov: NDArray[np.float32] | None = None


@dataclass(eq=False)
class RateKeeper:
    """Takes smoothed frames from the last to the first, and keeps what is asked of each.

    Attributes:
        model: Motion model.
        rate_points: What to keep.
    """

    model: MotionModel
    rate_points: RatePoints
    _velocity: list[Array] = field(default_factory=list)
    _own: list[NDArray] = field(default_factory=list)
    _cross: list[NDArray] = field(default_factory=list)
    _kept: dict[int, Array] = field(default_factory=dict)
    _accelerations: list[Array] = field(default_factory=list)
    _their_cov: list[NDArray] = field(default_factory=list)
    _ahead: list[tuple[Frame, Array, Array]] = field(default_factory=list)

    @cached_property
    def _weights(self) -> Array:
        return self.rate_points.all_weights

    @cached_property
    def _pairs(self) -> NDArray[np.int64]:
        return np.array(self.rate_points.pairs, dtype=np.int64).reshape(-1, 2)

    def take(self, frame: int, filtered: Frame, smoothed: Smoothed, state: Smoothed, matrix: Array) -> None:
        """One frame.

        Args:
            frame: Which; the frame before was the one after it.
            filtered: What the filter made of it.
            smoothed: Its smoothed state.
            state: The same with what is known of any frame, if nothing is seen (``MotionModel.informed``).
            matrix: Lambda: what later frames say of the filtered state.
        """
        found = self.model.rates(state.mean, frame)
        if found is None:
            return
        velocity, jacobian = found
        if jacobian.ndim == 2 and len(self._weights) > len(velocity):
            means = self._weights[len(velocity) :]
            rows = jacobian.reshape(len(velocity), -1)
            jacobian = np.concatenate([rows, means @ rows]).reshape(-1, jacobian.shape[1])
        gains, left = shown = _through(jacobian, state.filtered, state.matrix)
        if jacobian.ndim == 2:
            every = (gains @ left.T).reshape(-1, 6, len(gains) // 6, 6)  # faster than of the pairs alone
            own = np.einsum("iaib->iab", every)
            own = 0.5 * (own + own.swapaxes(1, 2))
            cross = every[self._pairs[:, 0], :, self._pairs[:, 1]]
        else:  # markers are independent
            flat = gains @ left.swapaxes(1, 2)
            flat = (0.5 * (flat + flat.swapaxes(1, 2))).reshape(len(jacobian), 36)
            own = (self._weights**2 @ flat).reshape(-1, 6, 6)
            both = self._weights[self._pairs[:, 0]] * self._weights[self._pairs[:, 1]]
            cross = (both @ flat).reshape(-1, 6, 6)
        self._velocity.append(self._weights @ velocity)
        self._own.append(own.astype(np.float32))
        self._cross.append(cross.astype(np.float32))
        accelerated = self.model.accelerations(state.mean, frame)
        if accelerated is not None:
            of, rows = accelerated
            gains, left = _through(rows, state.filtered, state.matrix)
            self._accelerations.append(self._weights @ of)
            alone = (gains @ left.swapaxes(1, 2)).reshape(len(of), 9)
            self._their_cov.append((self._weights**2 @ alone).reshape(-1, 3, 3).astype(np.float32))
        if frame % EVERY not in (0, 1, 2):
            return
        speed, cov = _speeds(jacobian), filtered.state.cov
        alone = (
            [_speeds(part) for part in shown]
            if smoothed is state
            else _through(speed, smoothed.filtered, smoothed.matrix)
        )
        gains, left = alone if smoothed.filtered is cov and smoothed.matrix is matrix else _through(speed, cov, matrix)
        variance = np.einsum("...ij,...ij->...i", *alone).reshape(-1, 3)
        if len(self._ahead) == 2 and frame % EVERY == 0:
            self._kept[frame + 1] = self._change(gains, variance)
        self._ahead = [(filtered, left, variance), *self._ahead[:1]]

    def _change(self, gains: Array, variance: Array) -> Array:
        """(N, 3) variance of the change of velocity over two steps, over the sum of the variances at both ends.

        Cov(x(t+2), x(t)) given all frames is (1 - P Lambda) of t+2 times what steps and observations up to there made
        of P(t).

        Args:
            gains: (..., 3m, n) covariance of the velocities of the first of three frames with its filtered state.
            variance: (N', 3) their smoothed variances.
        """
        (middle, _, _), (last, left, after) = self._ahead
        for one in (middle, last):
            gains = one.carry(gains)
        shared = np.einsum("...ij,...ij->...i", gains, left).reshape(-1, 3)
        weights = self._weights**2 if gains.ndim == 3 else np.eye(len(variance))
        own = weights @ (variance + after)
        share = np.divide(weights @ shared, own, out=np.zeros_like(own), where=own > 0)  # rounding: no variance is left
        return np.clip(1 - 2 * share, 0.0, 2.0)

    def rates(self, n_frames: int) -> Rates | None:
        """All frames, from the first on; None where the model has no velocities."""
        if not self._velocity:
            return None
        kept = between(self._kept, (n_frames, *self._velocity[0].shape))
        return Rates(
            rate_points=self.rate_points,
            velocity_m_s=np.array(self._velocity[::-1]),
            own=np.array(self._own[::-1]),
            cross=np.array(self._cross[::-1]),
            kept=kept,
            acceleration_m_s2=np.array(self._accelerations[::-1]) if self._accelerations else None,
            acceleration_cov=np.array(self._their_cov[::-1]) if self._their_cov else None,
        )


def _through(rows: Array, filtered: Array, matrix: Array) -> tuple[Array, Array]:
    """Rows J of a state of covariance P_s = P - P Lambda P: J P, and J - J P Lambda. One by the other is J P_s J^T."""
    gains = rows @ filtered
    return gains, rows - gains @ matrix


def _speeds(rows: Array) -> Array:
    """(..., 3m, n) the velocities of (..., 6m, n) positions and velocities."""
    return rows.reshape(*rows.shape[:-2], -1, 2, 3, rows.shape[-1])[..., 1, :, :].reshape(
        *rows.shape[:-2], -1, rows.shape[-1]
    )


def between(anchors_of: Mapping[int, Array], shape: tuple[int, ...]) -> Array:
    """(T, ...) values of some frames, linear between these and constant beyond them; 1 where there is none."""
    frames = sorted(anchors_of)
    if not frames:
        return np.full(shape, 1.0)
    anchors = np.array([anchors_of[f] for f in frames]).reshape(len(frames), -1)
    return np.stack([np.interp(np.arange(shape[0]), frames, one) for one in anchors.T], axis=1).reshape(shape)


def rate_points_of(names: Sequence[str], rate_points: RatePoints) -> RatePoints:
    """What is asked, for a part of the markers; means and pairs that need another are left out."""
    every = rate_points.names[: len(rate_points.names) - len(rate_points.weights)]
    place = {name: i for i, name in enumerate(names)}
    index = [place.get(name) for name in every]
    kept, means = list(names), []
    numbers = dict(enumerate(index))
    for k, (name, row) in enumerate(zip(rate_points.names[len(every) :], rate_points.weights, strict=True)):
        total = sum(weight for weight, i in zip(row, index, strict=True) if i is not None)
        numbers[len(every) + k] = None
        if total > 0.5:
            new = np.zeros(len(names))
            for weight, i in zip(row, index, strict=True):
                if i is not None:
                    new[i] = weight / total
            numbers[len(every) + k] = len(kept)
            kept.append(name)
            means.append(tuple(new.tolist()))
    pairs = []
    for pair in rate_points.pairs:
        a, b = numbers[pair[0]], numbers[pair[1]]
        if a is not None and b is not None:
            pairs.append((a, b))
    return RatePoints(names=tuple(kept), weights=tuple(means), pairs=tuple(pairs))
