"""Gaussian-process latent variable models, with and without dynamics: points and kernels by maximum a posteriori.

GPLVM (Lawrence 2005): each coordinate of the pose is a Gaussian process of the latent point, kernel
a exp(-g/2 |x - x'|^2) + delta / b, and the points have a standard normal prior. GPDM (Wang, Fleet & Hertzmann 2005;
2008, IEEE PAMI 30, 283-298): in place of that prior the next latent point is a Gaussian process of the present one,
kernel a1 exp(-g1/2 |x - x'|^2) + a2 x.x' + delta / b1; all kernel parameters have the prior 1 / parameter. Its
dynamics are weighed by a factor: 1 as published, D / q balances it against the D coordinates (Urtasun, Fleet & Fua
2006, section 3.2).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from benchmarks.gaps.peers.latent import Regression, squared_distances
from eal.arrays import Array


@dataclass(frozen=True, eq=False)
class LatentPoses:
    """A learned model.

    Attributes:
        points: (N, q) latent points of the training poses.
        decode: Posterior mean of poses, with left-out residuals.
        objective: Negative log posterior.
    """

    points: Array
    decode: Regression
    objective: float


def fit_latent(
    sequences: Sequence[Array], size: int, *, dynamics: float | None = None, iterations: int = 100
) -> LatentPoses:
    """Learn latent points of sequences of poses.

    Args:
        sequences: (N_i, D) poses, evenly spaced in time within each.
        size: q, dimension of the latent space.
        dynamics: Weight of the dynamics (GPDM); None: no dynamics (GPLVM).
        iterations: Of L-BFGS, from principal components.
    """
    poses = np.concatenate(sequences)
    mean = poses.mean(axis=0)
    scale = np.sqrt(np.mean((poses - mean) ** 2)) + 1e-300
    y = (poses - mean) / scale
    u, s, _ = np.linalg.svd(y, full_matrices=False)
    start = u[:, :size] * np.sqrt(len(y))
    start *= s[:size] / s[0]
    ends = np.cumsum([len(part) for part in sequences])
    first = np.r_[0, ends[:-1]]
    before = np.setdiff1d(np.arange(len(y)), ends - 1)
    gram = y @ y.T
    hyper = np.log([1.0, 1.0, 100.0] + ([] if dynamics is None else [1.0, 1.0, 0.1, 100.0]))

    def objective(theta: Array) -> tuple[float, Array]:
        x, log_hyper = theta[: y.shape[0] * size].reshape(-1, size), theta[y.shape[0] * size :]
        value, grad, grad_hyper = _reconstruction(x, gram, y.shape[1], log_hyper[:3])
        value += log_hyper.sum()
        if dynamics is None:
            value += 0.5 * float(np.sum(x**2))
            return value, np.r_[(grad + x).ravel(), grad_hyper + 1]
        moved, change, change_hyper = _dynamics(x, before, log_hyper[3:])
        value += dynamics * moved + 0.5 * float(np.sum(x[first] ** 2))
        grad += dynamics * change
        grad[first] += x[first]
        return value, np.r_[grad.ravel(), grad_hyper + 1, dynamics * change_hyper + 1]

    bounds = [(None, None)] * start.size + [(np.log(1e-3), np.log(1e5))] * len(hyper)
    found = minimize(
        objective, np.r_[start.ravel(), hyper], jac=True, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": iterations},
    )  # fmt: skip
    x, (a, g, b) = found.x[: start.size].reshape(-1, size), np.exp(found.x[start.size : start.size + 3])
    inverse = _inverse(a * np.exp(-0.5 * g * squared_distances(x, x)) + np.eye(len(x)) / b)[0]
    weights = scale * inverse @ y
    left_out = weights / np.diag(inverse)[:, None]
    noise = np.sqrt(np.mean(left_out**2, axis=0)) + 1e-9
    return LatentPoses(x, Regression(x, a * weights, mean, float(1 / np.sqrt(g)), noise), float(found.fun))


def _inverse(kernel: Array) -> tuple[Array, float]:
    """Inverse and log determinant of a positive definite matrix."""
    factor = cho_factor(kernel, lower=True)
    return cho_solve(factor, np.eye(len(kernel))), 2 * float(np.log(np.diag(factor[0])).sum())


def _radial(x: Array, log_hyper: Array) -> tuple[Array, Array]:
    """Kernel a exp(-g/2 r^2) of (N, q) points and its derivative by log g."""
    squares = squared_distances(x, x)
    kernel = np.exp(log_hyper[0] - 0.5 * np.exp(log_hyper[1]) * squares)
    return kernel, -0.5 * np.exp(log_hyper[1]) * squares * kernel


def _pull(sensitivity: Array, kernel: Array, x: Array, g: float) -> Array:
    """Derivative by the points (N, q) of a function with derivative ``sensitivity`` by a radial kernel."""
    a = sensitivity * kernel
    return -2 * g * (a.sum(axis=1)[:, None] * x - a @ x)


def _reconstruction(x: Array, gram: Array, width: int, log_hyper: Array) -> tuple[float, Array, Array]:
    """width/2 log|K| + tr(K^-1 Y Y^T)/2, its derivative by the points and by log a, g, b (Wang et al., equation 3)."""
    kernel, slope = _radial(x, log_hyper)
    noise = np.exp(-log_hyper[2])
    inverse, log_det = _inverse(kernel + (noise + 1e-9) * np.eye(len(x)))
    solved = inverse @ gram
    sensitivity = 0.5 * (width * inverse - solved @ inverse)
    value = 0.5 * (width * log_det + np.trace(solved))
    by_hyper = [np.sum(sensitivity * kernel), np.sum(sensitivity * slope), -noise * np.trace(sensitivity)]
    return float(value), _pull(sensitivity, kernel, x, np.exp(log_hyper[1])), np.array(by_hyper)


def _dynamics(x: Array, before: NDArray[np.int64], log_hyper: Array) -> tuple[float, Array, Array]:
    """q/2 log|K_X| + tr(K_X^-1 X_out X_out^T)/2 of steps from ``before`` to the point after (equation 7)."""
    past, ahead = x[before], x[before + 1]
    size = x.shape[1]
    radial, slope = _radial(past, log_hyper[:2])
    linear, noise = np.exp(log_hyper[2]), np.exp(-log_hyper[3])
    products = past @ past.T
    inverse, log_det = _inverse(radial + linear * products + (noise + 1e-9) * np.eye(len(past)))
    solved = inverse @ ahead
    sensitivity = 0.5 * (size * inverse - solved @ solved.T)
    grad = np.zeros_like(x)
    grad[before] += _pull(sensitivity, radial, past, np.exp(log_hyper[1])) + 2 * linear * sensitivity @ past
    grad[before + 1] += solved
    by_hyper = [
        np.sum(sensitivity * radial),
        np.sum(sensitivity * slope),
        linear * np.sum(sensitivity * products),
        -noise * np.trace(sensitivity),
    ]
    return float(0.5 * (size * log_det + np.sum(ahead * solved))), grad, np.array(by_hyper)
