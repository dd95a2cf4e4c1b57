"""The GPLVM as the latent space of an unscented Kalman smoother.

Each coordinate of the pose is a Gaussian process of the latent point, kernel a exp(-g/2 |x - x'|^2) + delta / b; points
have a standard normal prior, kernel parameters the prior 1 / parameter (Lawrence 2005); all by maximum a posteriori,
from up to 200 poses: of each training trial a stretch, every so many frames that a step is a third of the poses'
deviation. In between, latent points are interpolated by splines, which gives the motion from frame to frame (linear
dynamics). It is followed by the unscented filter (Ko & Fox 2009) and smoothed; the residual at the edges is carried
into the gap. The GPDM, whose dynamics are a Gaussian process too, was the best peer of no cell (``gap_benchmark.md``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from benchmarks.gaps.method import Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, completed, learn_body
from benchmarks.gaps.peers.edges import Blend
from benchmarks.gaps.peers.intervals import tune_blended
from benchmarks.gaps.peers.latent import LatentFiller, Regression, linear_dynamics, squared_distances
from eal.arrays import Array

POSES = 200


@dataclass(frozen=True, eq=False)
class LatentPoses:
    """A learned model.

    Attributes:
        points: (N, q) latent points of the training poses.
        decode: Posterior mean of poses, with left-out residuals.
    """

    points: Array
    decode: Regression


def fit_latent(sequences: Sequence[Array], size: int, *, iterations: int = 100) -> LatentPoses:
    """Learn latent points of sequences of poses.

    Args:
        sequences: (N_i, D) poses.
        size: q, dimension of the latent space.
        iterations: Of L-BFGS, from principal components.
    """
    poses = np.concatenate(sequences)
    mean = poses.mean(axis=0)
    scale = np.sqrt(np.mean((poses - mean) ** 2)) + 1e-300
    y = (poses - mean) / scale
    u, s, _ = np.linalg.svd(y, full_matrices=False)
    start = u[:, :size] * np.sqrt(len(y))
    start *= s[:size] / s[0]
    gram, hyper = y @ y.T, np.log([1.0, 1.0, 100.0])

    def objective(theta: Array) -> tuple[float, Array]:
        x, log_hyper = theta[: start.size].reshape(-1, size), theta[start.size :]
        value, grad, grad_hyper = _reconstruction(x, gram, y.shape[1], log_hyper)
        return value + log_hyper.sum() + 0.5 * float(np.sum(x**2)), np.r_[(grad + x).ravel(), grad_hyper + 1]

    bounds = [(None, None)] * start.size + [(np.log(1e-3), np.log(1e5))] * len(hyper)
    found = minimize(
        objective, np.r_[start.ravel(), hyper], jac=True, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": iterations},
    )  # fmt: skip
    x, (a, g, b) = found.x[: start.size].reshape(-1, size), np.exp(found.x[start.size :])
    inverse = _inverse(a * np.exp(-0.5 * g * squared_distances(x, x)) + np.eye(len(x)) / b)[0]
    weights = scale * inverse @ y
    left_out = weights / np.diag(inverse)[:, None]
    noise = np.sqrt(np.mean(left_out**2, axis=0)) + 1e-9
    return LatentPoses(x, Regression(x, a * weights, mean, float(1 / np.sqrt(g)), noise))


def _inverse(kernel: Array) -> tuple[Array, float]:
    """Inverse and log determinant of a positive definite matrix."""
    factor = cho_factor(kernel, lower=True)
    return cho_solve(factor, np.eye(len(kernel))), 2 * float(np.log(np.diag(factor[0])).sum())


def _reconstruction(x: Array, gram: Array, width: int, log_hyper: Array) -> tuple[float, Array, Array]:
    """width/2 log|K| + tr(K^-1 Y Y^T)/2, its derivative by the points and by log a, g, b (Wang et al., equation 3)."""
    squares, g, noise = squared_distances(x, x), np.exp(log_hyper[1]), np.exp(-log_hyper[2])
    kernel = np.exp(log_hyper[0] - 0.5 * g * squares)
    inverse, log_det = _inverse(kernel + (noise + 1e-9) * np.eye(len(x)))
    solved = inverse @ gram
    sensitivity = 0.5 * (width * inverse - solved @ inverse)
    value = 0.5 * (width * log_det + np.trace(solved))
    a = sensitivity * kernel
    by_hyper = [np.sum(a), -0.5 * g * np.sum(a * squares), -noise * np.trace(sensitivity)]
    return float(value), -2 * g * (a.sum(axis=1)[:, None] * x - a @ x), np.array(by_hyper)


def stride(poses: Sequence[Array], *, share: float = 0.1) -> int:
    """Frames after which the mean squared change of a pose is a share of what it is between any two poses."""
    total = 2 * np.concatenate(poses).var(axis=0).sum()
    longest = max(1, min(len(p) for p in poses) // 8)
    for step in range(1, longest):
        change = np.concatenate([((p[step:] - p[:-step]) ** 2).sum(axis=1) for p in poses])
        if change.mean() >= share * total:
            return step
    return longest


def stretches(poses: Sequence[Array], known: Sequence[Array], step: int) -> list[Array]:
    """Of each trial the best known stretch, every ``step`` frames, ``POSES`` in all; ``known`` has shares (T,)."""
    count = max(8, POSES // len(poses))
    out = []
    for p, share in zip(poses, known, strict=True):
        length = min(len(p), count * step)
        total = np.concatenate([[0.0], np.cumsum(share)])
        start = int(np.argmax(total[length:] - total[: len(total) - length]))
        out.append(p[start : start + length : step])
    return out


def between(points: Array, lengths: Sequence[int], step: int) -> list[Array]:
    """Latent points of each stretch at every frame."""
    parts = np.split(points, np.cumsum(lengths)[:-1])
    return [CubicSpline(step * np.arange(len(p)), p)(np.arange(step * (len(p) - 1) + 1)) for p in parts if len(p) > 3]


@dataclass(frozen=True)
class GaussianProcessLatent:
    """The model."""

    name: str = "gplvm_ukf"

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose the dimension and the noises."""

        @cache
        def prepared(trials: tuple[Trial, ...]) -> tuple[Body, list[Array], int]:
            body = learn_body(trials)
            placed = [body.place(trial) for trial in trials]
            poses = completed(placed)
            step = stride(poses)
            known = [np.isfinite(p.poses).mean(axis=1) for p in placed]
            return body, stretches(poses, known, step), step

        @cache
        def learned(size: int, trials: tuple[Trial, ...]) -> LatentPoses:
            return fit_latent(prepared(trials)[1], size)

        def fit(candidate: tuple[int, float, float], blend: Blend, trials: Sequence[Trial]) -> Filler:
            size, ridge, trust = candidate
            body, sequences, step = prepared(tuple(trials))
            model = learned(size, tuple(trials))
            sd = trust * np.hypot(model.decode.noise_sd, np.repeat(trials[0].sd_m, 3))
            z = between(model.points, [len(s) for s in sequences], step)
            return LatentFiller(body, linear_dynamics(model.decode, z, sd, ridge=ridge or None), blend)

        return tune_blended([(3, 0.01, 3), (5, 0.01, 3), (5, 0.01, 10), (5, 0, 3), (8, 0.01, 3)], training, fit)


def peers() -> list[Method]:
    """The GPLVM."""
    return [GaussianProcessLatent()]
