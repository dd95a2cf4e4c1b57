"""A potential as an update of the state: its most probable value under exp(-V) and the prediction.

The metric of the step is the prediction's P^-1. The implicit Euler step of the penalised mechanics has M / dt^2 there:
this is no time integrator, it conserves nothing, moves velocities only as far as P couples them to positions, and the
paper's theorems on trajectories say nothing of it.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular

from filters.ensemble import Gaussian, condition, default_points, scale, spread
from mocap.arrays import Array


def enforce(state: Gaussian, gradient: Callable[[Array], Array], k: int, *, about: Gaussian | None = None) -> Gaussian:
    """Minimise 1/2 |x - x_pred|^2 in the metric P^-1 plus a potential of the first k components.

    The potential's mean gradient and mean Hessian under an uncertain state come from sigma points (statistical
    linearisation; the Hessian by Stein's identity from gradients alone). Directions of negative curvature exert their
    force but do not widen the state. The result reads as a measurement update with information equal to the Hessian:
    it contracts the covariance, needs no substeps and is stable at any stiffness.

    Args:
        state: Predicted state; its first k components are the potential's coordinates.
        gradient: (S, k) points to (S, k) gradients of the potential, its stiffness included.
        k: Number of coordinates.
        about: Where the potential is linearised: a state whose first k components it has; None: the prediction.
    """
    c, _ = scale(default_points(k))
    factor = state.factor[:k, :k]
    about = state if about is None else about
    gradients = gradient(spread(about, c, columns=k, rows=k))
    mean = gradients[0] + (gradients[1:] - gradients[0]).sum(axis=0) / (2 * c)
    difference = (gradients[1 : k + 1] - gradients[k + 1 :]) * (0.5 / np.sqrt(c))  # rows H L_j
    hessian = np.linalg.solve(about.factor[:k, :k].T, difference)  # L^T H = difference
    curvature = factor.T @ (0.5 * (hessian + hessian.T)) @ factor
    values, vectors = np.linalg.eigh(curvature)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    # force at the prediction x: the gradient there by the linear model, mean + H (x - about)
    target = root @ (root.T @ np.linalg.solve(factor, about.mean[:k] - state.mean[:k])) - factor.T @ mean
    posterior, _, _ = condition(state, root, np.zeros(k), k)
    columns = posterior.factor[:, :k]
    inner = np.linalg.solve(factor, columns[:k])  # posterior factor in units of the prior one
    return Gaussian(state.mean + columns @ (inner.T @ target), posterior.factor)


def informed(state: Gaussian, known: Gaussian) -> Gaussian:
    """A state that knows nothing of ``known``, (k,) mean and factor of its first k components, conditioned on it."""
    k = len(known.mean)
    rows = solve_triangular(known.factor, state.factor[:k, :k], lower=True).T  # of the components in units of known
    offset = solve_triangular(known.factor, known.mean - state.mean[:k], lower=True)
    posterior, _, _ = condition(state, np.ascontiguousarray(rows), offset, k)
    return posterior
