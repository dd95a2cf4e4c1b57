"""Poses as a smooth map of a few latent coordinates, followed in time by the unscented Kalman filter."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mocap.filters.ensemble import Gaussian, default_points, ensemble, predict, scale, smooth_step, update
from mocap.filters.ensemble import spread as spread_points
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from threadpoolctl import threadpool_limits

from benchmarks.gaps.method import Estimate, Trial
from benchmarks.gaps.peers.coordinates import Body
from benchmarks.gaps.peers.edges import Blend, fill_blended
from eal.arrays import Array


def squared_distances(a: Array, b: Array) -> Array:
    """(N, P) squared distances of (N, q) and (P, q) points."""
    return np.maximum((a**2).sum(axis=1)[:, None] - 2 * a @ b.T + (b**2).sum(axis=1), 0.0)


@dataclass(frozen=True, eq=False)
class Regression:
    """Gaussian-process regression with kernel exp(-|z - z'|^2 / (2 length^2)), the same for all outputs.

    Attributes:
        inputs: (P, q) latent points.
        weights: (P, D) kernel weights.
        mean: (D,) mean of the outputs.
        length: Of the kernel.
        noise_sd: (D,) standard deviation of a training output about the map, left out one at a time.
    """

    inputs: Array
    weights: Array
    mean: Array
    length: float
    noise_sd: Array

    def __call__(self, z: Array) -> Array:
        """(S, D) outputs at (S, q) points."""
        return self.mean + np.exp(-0.5 * squared_distances(z, self.inputs) / self.length**2) @ self.weights


def regress(inputs: Array, outputs: Array, *, lengths: Array | None = None) -> Regression:
    """Length and noise of largest marginal likelihood on a grid (Rasmussen & Williams 2006, equation 5.8).

    The amplitude has its closed-form optimum; left-out residuals are equation 5.12.

    Args:
        inputs: (P, q) points.
        outputs: (P, D) values.
        lengths: Kernel lengths to choose from; None: multiples of the median distance.
    """
    mean = outputs.mean(axis=0)
    centred = outputs - mean
    squares = squared_distances(inputs, inputs)
    grid = np.sqrt(np.median(squares)) * np.array([0.25, 0.5, 1.0, 2.0]) if lengths is None else lengths
    choices: list[tuple[float, float, float]] = []
    for length in grid.tolist():
        values, vectors = np.linalg.eigh(np.exp(-0.5 * squares / length**2))
        power = ((vectors.T @ centred) ** 2).sum(axis=1)
        for noise in (10.0 ** np.arange(-6.0, 0.1)).tolist():
            spectrum = np.maximum(values, 0.0) + noise
            choices.append((float(np.log(np.mean(power / spectrum)) + np.log(spectrum).mean()), length, noise))
    _, length, noise = min(choices)
    kernel = np.exp(-0.5 * squares / length**2) + noise * np.eye(len(inputs))
    inverse = cho_solve(cho_factor(kernel, lower=True), np.eye(len(inputs)))
    weights = inverse @ centred
    left_out = weights / np.diag(inverse)[:, None]
    return Regression(inputs, weights, mean, length, np.sqrt(np.mean(left_out**2, axis=0)) + 1e-9)


@dataclass(frozen=True, eq=False, kw_only=True)
class LatentModel:
    """Poses y = decode(z) + noise; the state begins with z.

    Attributes:
        decode: Latent points to poses.
        size: q.
        step: (S, n) states to states a frame later.
        noise: (n, n) lower factor of the process noise.
        start: State before the first frame.
        sd: (D,) standard deviation of an observation about the map.
    """

    decode: Regression
    size: int
    step: Callable[[Array], Array]
    noise: Array
    start: Gaussian
    sd: Array


def follow(model: LatentModel, y: Array) -> tuple[Array, Array]:
    """Unscented filter and smoother over poses with NaN.

    Args:
        model: The model.
        y: (T, 3 M) poses.

    Returns:
        (T, 3 M) decoded poses, and (T, M, 3, 3) how far the uncertainty of the state spreads each marker (zero in
        frames that are complete).
    """
    points = default_points(len(model.start.mean))
    seen = np.isfinite(y)
    filtered, predictions = [], []
    state = first_state(model, y)
    with threadpool_limits(1):
        for t in range(len(y)):
            if t:
                predictions.append(predict(state, model.step, model.noise, points))
                state = predictions[-1].state
            use = seen[t]
            if use.any():
                state = update(
                    state,
                    lambda z, use=use: model.decode(z[:, : model.size])[:, use],
                    y[t, use],
                    model.sd[use],
                    points,
                ).state
            filtered.append(state)
        for t in range(len(y) - 2, -1, -1):
            filtered[t] = smooth_step(filtered[t], predictions[t], filtered[t + 1])
    means = np.array([state.mean[: model.size] for state in filtered])
    spread = np.zeros((len(y), y.shape[1] // 3, 3, 3))
    c, gamma = scale(points)
    for t in np.flatnonzero(~seen.all(axis=1)):
        sigma = spread_points(filtered[t], c)[:, : model.size]
        rows = ensemble(model.decode(sigma), c, gamma)[1].reshape(-1, y.shape[1] // 3, 3)
        spread[t] = np.einsum("kmi,kmj->mij", rows, rows)
    return model.decode(means), spread


def first_state(model: LatentModel, y: Array) -> Gaussian:
    """The start, moved to the training pose that is most like the first frame that shows something."""
    seen = np.isfinite(y)
    if not seen.any():
        return model.start
    frame = int(np.argmax(seen.any(axis=1)))
    known = model.decode(model.decode.inputs)
    misfit = np.where(seen[frame], (known - np.nan_to_num(y[frame])) ** 2, 0.0).sum(axis=1)
    mean = model.start.mean.copy()
    mean[: model.size] = model.decode.inputs[int(np.argmin(misfit))]
    return Gaussian(mean, model.start.factor)


def linear_dynamics(decode: Regression, z: list[Array], sd: Array, *, ridge: float | None) -> LatentModel:
    """Latent points whose next position is linear in the last two, learned from how training points move.

    The state is [z_t, z_t - z_(t-1)], and the velocity has v' = A z + B v + noise by ridge regression, shrunk towards
    constant velocity (A = 0, B = 1). If it grew without bound it is damped until it does not.

    Args:
        decode: The map.
        z: (T, q) latent points of the training trials, frame by frame.
        sd: (D,) of an observation.
        ridge: Share of the mean square of [z, v] that is added to it; None: constant velocity.
    """
    q = z[0].shape[1]
    spread = np.concatenate(z)
    centre = spread.mean(axis=0)
    long = [part for part in z if len(part) > 2]
    state = np.concatenate([np.column_stack([p[1:-1] - centre, np.diff(p, axis=0)[:-1]]) for p in long])
    change = np.concatenate([np.diff(p, 2, axis=0) for p in long])
    gain = np.zeros((2 * q, q))
    if ridge is not None:
        scale = np.sqrt(np.mean(state**2, axis=0)) + 1e-12
        unit = state / scale
        gain = np.linalg.solve(unit.T @ unit + ridge * len(unit) * np.eye(2 * q), unit.T @ change) / scale[:, None]
    eye = np.eye(q)
    matrix = np.block([[eye + gain[:q].T, eye + gain[q:].T], [gain[:q].T, eye + gain[q:].T]])
    if ridge is not None:
        matrix /= max(1.0, float(np.abs(np.linalg.eigvals(matrix)).max()))
    left = change - state @ gain
    acceleration = left.T @ left / len(left) + 1e-9 * np.diag(change.var(axis=0) + 1e-12)
    noise = np.kron([[1 / 3, 1 / 2], [1 / 2, 1]], acceleration)
    noise[np.diag_indices(2 * q)] *= 1 + 1e-9
    middle = np.concatenate([centre, np.zeros(q)])
    start = np.concatenate([spread.std(axis=0), np.sqrt(np.mean(state[:, q:] ** 2, axis=0))]) + 1e-9
    return LatentModel(
        decode=decode,
        size=q,
        step=lambda x: middle + (x - middle) @ matrix.T,
        noise=np.linalg.cholesky(noise),
        start=Gaussian(middle, np.diag(start)),
        sd=sd,
    )


@dataclass(frozen=True, eq=False)
class LatentFiller:
    """A latent model in body coordinates, and how what it says is blended in."""

    coordinates: Body
    model: LatentModel
    blend: Blend

    def __call__(self, trial: Trial) -> Estimate:
        """Follow the latent point and blend what it says into the gaps; the map's error is carried from the edges."""
        placed = self.coordinates.place(trial)
        poses, latent = follow(self.model, placed.poses)
        model = poses.reshape(placed.y.shape)
        error = (self.model.decode.noise_sd.reshape(-1, 3) ** 2)[..., None] * np.eye(3)

        def predict(_values: Array, frames: NDArray[np.int64], _masks: NDArray[np.bool_]) -> tuple[Array, Array]:
            return model[frames], np.repeat(error[None], len(frames), axis=0)

        y, spread = fill_blended(placed, predict, self.blend)
        return placed.leave(y, spread + latent)
