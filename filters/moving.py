"""Velocities and joint covariances of markers, taken from a smoother's states while it goes back in time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from mocap.filters.ensemble import Gaussian, Prediction
from mocap.filters.motion.base import MotionModel
from mocap.filters.velocities import Asked
from numpy.typing import NDArray
from scipy.linalg.blas import dtrmm, dtrsm  # type: ignore[attr-defined]  # made at run time

from eal.arrays import Array

EVERY = 8
"""Covariances of frames with those before them are computed in every so many frames."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Rates:
    """What a smoother knows of velocities; shapes and meaning as in ``mocap.filters.velocities.Motion``.

    Attributes:
        asked: Points and pairs.
        velocity_m_s: (T, N, 3).
        own: (T, N, 6, 6) float32.
        cross: (T, P, 6, 6) float32.
        kept: (T, N, 3).
    """

    asked: Asked
    velocity_m_s: Array
    own: NDArray[np.float32]
    cross: NDArray[np.float32]
    kept: Array


@dataclass(eq=False)
class RateKeeper:
    """Takes smoothed frames from the last to the first, and keeps what is asked of each.

    Attributes:
        model: Motion model.
        asked: What to keep.
    """

    model: MotionModel
    asked: Asked
    _velocity: list[Array] = field(default_factory=list)
    _own: list[NDArray] = field(default_factory=list)
    _cross: list[NDArray] = field(default_factory=list)
    _kept: dict[int, Array] = field(default_factory=dict)
    _ahead: list[tuple[Gaussian, Prediction | None, Array, Array]] = field(default_factory=list)

    @cached_property
    def _weights(self) -> Array:
        return self.asked.all_weights

    @cached_property
    def _pairs(self) -> NDArray[np.int64]:
        return np.array(self.asked.pairs, dtype=np.int64).reshape(-1, 2)

    def take(self, frame: int, filtered: Gaussian, prediction: Prediction | None, state: Gaussian) -> None:
        """One frame.

        Args:
            frame: Which; the frame before was the one after it.
            filtered: Its filtered state.
            prediction: From it to the next frame; None at the last.
            state: Its smoothed state.
        """
        found = self.model.rates(state.mean, frame)
        if found is None:
            return
        velocity, jacobian = found
        weights = self._weights
        count, n = len(velocity), len(state.mean)
        if len(weights) > count:
            means = np.tensordot(weights[count:], jacobian, 1)
            jacobian = np.concatenate([jacobian, means])
            velocity = np.concatenate([velocity, weights[count:] @ velocity])
        flat = jacobian.reshape(-1, n)
        rows: NDArray = flat.astype(np.float32) @ state.factor.astype(np.float32)
        every = (rows @ rows.T).reshape(len(jacobian), 6, len(jacobian), 6).swapaxes(1, 2)
        each = np.arange(len(jacobian))
        self._velocity.append(velocity)
        self._own.append(every[each, each])
        self._cross.append(every[self._pairs[:, 0], self._pairs[:, 1]])
        speeds = np.ascontiguousarray(jacobian[:, 3:].reshape(-1, n))
        if len(self._ahead) == 2 and frame % EVERY == 0 and prediction is not None:
            self._kept[frame + 1] = self._change(filtered, prediction, speeds)
        self._ahead = [(filtered, prediction, speeds, state.factor), *self._ahead[:1]]

    def _change(self, filtered: Gaussian, prediction: Prediction, speeds: Array) -> Array:
        """(N, 3) variance of the change of velocity over two steps, over the sum of the variances at both ends.

        x(t) = G x(t+1) + r with the smoother's gain G and r independent of x(t+1), of covariance P - G P- G^T; twice.
        """
        (middle, onward, _, _), (_, _, last, factor) = self._ahead
        if onward is None:
            raise ValueError("the middle one of three frames has a prediction to the last")
        hold = speeds
        variance = np.zeros(len(speeds))
        for state, step in ((filtered, prediction), (middle, onward)):
            n = len(state.mean)
            w = dtrsm(1.0, step.state.factor, step.rows[:n].T, lower=1)
            now = dtrmm(1.0, state.factor, hold, side=1, lower=1)
            then = now @ w.T
            variance += np.sum(now**2, axis=1) - np.sum(then**2, axis=1)
            hold = dtrsm(1.0, step.state.factor, then, side=1, lower=1)
        both = dtrmm(1.0, factor, last - hold, side=1, lower=1)
        variance += np.sum(both**2, axis=1)
        own = np.einsum("nii->ni", self._own[-1])[:, 3:] + np.einsum("nii->ni", self._own[-3])[:, 3:]
        return np.clip(variance.reshape(-1, 3) / np.maximum(own, 1e-300), 0.0, 2.0)

    def rates(self, n_frames: int) -> Rates | None:
        """All frames, from the first on; None where the model has no velocities."""
        if not self._velocity:
            return None
        kept = between(self._kept, (n_frames, *self._velocity[0].shape))
        return Rates(
            asked=self.asked,
            velocity_m_s=np.array(self._velocity[::-1]),
            own=np.array(self._own[::-1]),
            cross=np.array(self._cross[::-1]),
            kept=kept,
        )


def between(known: Mapping[int, Array], shape: tuple[int, ...]) -> Array:
    """(T, ...) values of some frames, linear between these and constant beyond them; 1 where there is none."""
    frames = sorted(known)
    if not frames:
        return np.full(shape, 1.0)
    anchors = np.array([known[f] for f in frames])
    at = np.clip(np.searchsorted(frames, np.arange(shape[0]), side="right") - 1, 0, len(frames) - 1)
    after = np.minimum(at + 1, len(frames) - 1)
    place = np.array(frames, dtype=float)
    width = np.maximum(place[after] - place[at], 1.0)
    share = np.clip((np.arange(shape[0]) - place[at]) / width, 0.0, 1.0)[:, None, None]
    return (1 - share) * anchors[at] + share * anchors[after]


def asked_of(names: Sequence[str], asked: Asked) -> Asked:
    """What is asked, for a part of the markers; means and pairs that need another are left out."""
    every = asked.names[: len(asked.names) - len(asked.weights)]
    place = {name: i for i, name in enumerate(names)}
    index = [place.get(name) for name in every]
    kept, means = list(names), []
    numbers = dict(enumerate(index))
    for k, (name, row) in enumerate(zip(asked.names[len(every) :], asked.weights, strict=True)):
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
    for pair in asked.pairs:
        a, b = numbers[pair[0]], numbers[pair[1]]
        if a is not None and b is not None:
            pairs.append((a, b))
    return Asked(names=tuple(kept), weights=tuple(means), pairs=tuple(pairs))
