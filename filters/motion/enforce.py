"""A potential enforced implicitly: one implicit Euler step of the penalised mechanics, as an update of the state."""

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular

from filters.ensemble import Gaussian, condition, default_points, scale, spread
from mocap.arrays import Array


def enforce(state: Gaussian, gradient: Callable[[Array], Array], k: int, *, iterations: int = 1) -> Gaussian:
    """Minimise 1/2 |x - x_pred|^2 in the metric P^-1 plus a potential of the first k components.

    The potential's mean gradient and mean Hessian under the state's own uncertainty come from sigma points (statistical
    linearisation; the Hessian by Stein's identity from gradients alone). Directions of negative curvature exert their
    force but do not widen the state. The result reads as a measurement update with information equal to the Hessian:
    it contracts the covariance, needs no substeps and is stable at any stiffness.

    Args:
        state: Predicted state; its first k components are the potential's coordinates.
        gradient: (S, k) points to (S, k) gradients of the potential, its stiffness included.
        k: Number of coordinates.
        iterations: Times that the potential is linearised anew about the result.
    """
    c, _ = scale(default_points(k))
    factor = state.factor[:k, :k]
    result = state
    for _ in range(iterations):
        points = spread(result, c, columns=k, rows=k)
        gradients = gradient(points)
        mean = gradients[0] + (gradients[1:] - gradients[0]).sum(axis=0) / (2 * c)
        difference = (gradients[1 : k + 1] - gradients[k + 1 :]) * (0.5 / np.sqrt(c))  # rows H L_j
        moving = result.factor[:k, :k]
        hessian_times = np.linalg.solve(moving.T, difference)  # rows: H, by L^T H = difference
        curvature = factor.T @ (0.5 * (hessian_times + hessian_times.T)) @ factor
        values, vectors = np.linalg.eigh(curvature)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        # force at the prediction: the gradient there by the linear model, gradient = mean + H (x - result)
        force = -factor.T @ mean
        offset = np.linalg.solve(factor, result.mean[:k] - state.mean[:k])
        target = force + root @ (root.T @ offset)
        posterior, _, _ = condition(state, root, np.zeros(k), k)
        columns = posterior.factor[:, :k]
        inner = np.linalg.solve(factor, columns[:k])  # posterior factor in units of the prior one
        result = Gaussian(state.mean + columns @ (inner.T @ target), posterior.factor)
    return result


def informed(state: Gaussian, known: Gaussian) -> Gaussian:
    """A state that knows nothing of ``known``, (k,) mean and factor of its first k components, conditioned on it."""
    k = len(known.mean)
    rows = solve_triangular(known.factor, state.factor[:k, :k], lower=True).T  # of the components in units of known
    offset = solve_triangular(known.factor, known.mean - state.mean[:k], lower=True)
    posterior, _, _ = condition(state, np.ascontiguousarray(rows), offset, k)
    return posterior
