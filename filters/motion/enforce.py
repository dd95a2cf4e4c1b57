"""A potential as an update of the state: its most probable value under exp(-V) and the prediction.

The metric of the step is the prediction's P^-1. The implicit Euler step of the penalised mechanics has M / dt^2 there:
this is no time integrator, it conserves nothing, moves velocities only as far as P couples them to positions, and the
paper's theorems on trajectories say nothing of it.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular

from filters.ensemble import Gaussian, condition, default_points, scale, spread, triangular
from mocap.arrays import Array


def enforce(
    state: Gaussian,
    gradient: Callable[[Array], Array],
    coordinates: tuple[Array, Array],
    *,
    about: Gaussian | None = None,
) -> Gaussian:
    """Minimise 1/2 |x - x_pred|^2 in the metric P^-1 plus a potential of coordinates q that are linear in x.

    The potential's mean gradient and mean Hessian under an uncertain state come from sigma points (statistical
    linearisation; the Hessian by Stein's identity from gradients alone). Directions of negative curvature exert their
    force but do not widen the state. The result reads as a measurement update with information equal to the Hessian:
    it contracts the covariance, needs no substeps and is stable at any stiffness.

    Args:
        state: Predicted state.
        gradient: (S, d) points to (S, d) gradients of the potential, its stiffness included.
        coordinates: Mean (d,) of q, and its (k, d) ensemble rows for the first k columns of the state's factor.
        about: Where the potential is linearised: mean and factor of q; None: the prediction.
    """
    mean, rows = coordinates
    k, d = rows.shape
    here = Gaussian(mean, triangular(rows))
    about = here if about is None else about
    c, _ = scale(default_points(d))
    gradients = gradient(spread(about, c))
    force = gradients[0] + (gradients[1:] - gradients[0]).sum(axis=0) / (2 * c)
    difference = (gradients[1 : d + 1] - gradients[d + 1 :]) * (0.5 / np.sqrt(c))  # rows H L_j
    hessian = solve_triangular(about.factor, difference, lower=True, trans=1)  # L^T H = difference
    curvature = here.factor.T @ (0.5 * (hessian + hessian.T)) @ here.factor
    values, vectors = np.linalg.eigh(curvature)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    # force at the prediction by the linear model, mean gradient + H (q - about), in units of the deviations of q
    away = solve_triangular(here.factor, about.mean - mean, lower=True)
    target = root @ (root.T @ away) - here.factor.T @ force
    unit = solve_triangular(here.factor, rows.T, lower=True).T  # rows of q in these units
    posterior, _, _ = condition(state, np.ascontiguousarray(unit @ root), np.zeros(d), k)
    columns = posterior.factor[:, :k]
    inner = solve_triangular(state.factor[:k, :k], columns[:k], lower=True)  # posterior factor in the prior one's units
    return Gaussian(state.mean + columns @ (inner.T @ (unit @ target)), posterior.factor)


def informed(state: Gaussian, known: Gaussian) -> Gaussian:
    """A state that knows nothing of ``known``, (k,) mean and factor of its first k components, conditioned on it."""
    k = len(known.mean)
    rows = solve_triangular(known.factor, state.factor[:k, :k], lower=True).T  # of the components in units of known
    offset = solve_triangular(known.factor, known.mean - state.mean[:k], lower=True)
    posterior, _, _ = condition(state, np.ascontiguousarray(rows), offset, k)
    return posterior
