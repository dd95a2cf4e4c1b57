"""A potential as an update of the state: its most probable value under exp(-V) and the prediction.

The metric of the step is the prediction's P^-1. The implicit Euler step of the penalised mechanics has M / dt^2 there:
this is no time integrator, it conserves nothing, moves velocities only as far as P couples them to positions, and the
paper's theorems on trajectories say nothing of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.ensemble import Gaussian, condition, default_points, scale, triangular
from scipy.linalg.blas import dtrsm, dtrsv  # type: ignore[attr-defined]  # made at run time

from eal.arrays import Array


@dataclass(frozen=True, eq=False)
class Term:
    """What one potential says of a state, linearised: rows that are 0, and a pull.

    Attributes:
        rows: (k, m) whitened ensemble rows, for the first k columns of the state's factor.
        away: (m,) whitened innovations.
        pull: (k,) force, in units of these columns.
    """

    rows: Array
    away: Array
    pull: Array


def potential_term(
    gradient: Callable[[Array], Array],
    coordinates: tuple[Array, Array],
    *,
    about: Gaussian | None = None,
    least_sd: float = 0.0,
) -> Term:
    """A potential of coordinates q that are linear in the state, as its mean gradient and mean Hessian.

    They come from sigma points of an uncertain q along its principal directions (statistical linearisation; the
    Hessian by Stein's identity from gradients alone). Directions of negative curvature exert their force but do not
    widen the state.

    Args:
        gradient: (S, d) points to (S, d) gradients of the potential, its stiffness included.
        coordinates: Mean (d,) of q, and its (k, d) ensemble rows for the first k columns of the state's factor.
        about: Where the potential is linearised: mean and factor of q; None: the prediction.
        least_sd: Directions that are known better than this are left out: no potential moves q along them by much.
    """
    mean, rows = coordinates
    variance, directions = np.linalg.eigh(rows.T @ rows)
    sure = int(np.searchsorted(variance, max(least_sd**2, 1e-24 * variance[-1])))
    directions, sd = directions[:, sure:], np.sqrt(variance[sure:])
    p = len(sd)
    unit = (rows @ directions) / sd  # rows of q along these directions, in units of their deviations
    if not p:
        return Term(unit, np.zeros(0), np.zeros(len(unit)))
    c, _ = scale(default_points(p))
    factor = np.diag(sd) if about is None else triangular(about.factor.T @ directions)
    here = mean if about is None else about.mean
    steps = np.sqrt(c) * (directions @ factor).T
    gradients = gradient(np.concatenate([here[None], here + steps, here - steps])) @ directions
    force = gradients[0] + (gradients[1:] - gradients[0]).sum(axis=0) / (2 * c)
    difference = (gradients[1 : p + 1] - gradients[p + 1 :]) * (0.5 / np.sqrt(c))  # rows H L_j
    hessian = dtrsm(1.0, factor, difference, lower=1, trans_a=1)  # L^T H = difference
    values, vectors = np.linalg.eigh((0.5 * (hessian + hessian.T)) * sd[:, None] * sd)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    # force at the prediction by the linear model, mean gradient + H (q - about), in units of the deviations of q
    target = -sd * force
    if about is not None:
        target += root @ (root.T @ (directions.T @ (about.mean - mean) / sd))
    return Term(unit @ root, np.zeros(p), unit @ target)


def enforce(state: Gaussian, terms: Sequence[Term], *, farthest: float = np.inf) -> Gaussian:
    """Minimise 1/2 |x - x_pred|^2 in the metric P^-1 plus potentials, all at once.

    The result reads as a measurement update with information equal to the sum of the Hessians: it contracts the
    covariance, needs no substeps and is stable at any stiffness.

    Args:
        state: Predicted state.
        terms: Potentials.
        farthest: Forces move the state by at most so many of its deviations: no further than they were linearised for.
    """
    if not terms:
        return state
    rows = np.concatenate([term.rows for term in terms], axis=1)
    k = len(rows)
    posterior, _, _ = condition(state, rows, np.concatenate([term.away for term in terms]), k)
    columns = posterior.factor[:, :k]
    pull = dtrsv(state.factor[:k, :k], np.sum([term.pull for term in terms], axis=0), lower=1, trans=1)
    move = columns[:k].T @ pull  # in deviations of the posterior
    size = float(np.linalg.norm(move))
    if size > farthest:
        move *= farthest / size
    return Gaussian(posterior.mean + columns @ move, posterior.factor)


def informed(state: Gaussian, known: Gaussian) -> Gaussian:
    """A state that knows nothing of ``known``, (k,) mean and factor of its first k components, conditioned on it."""
    k = len(known.mean)
    rows = dtrsm(1.0, known.factor, state.factor[:k, :k], lower=1).T  # of the components in units of known
    offset = dtrsv(known.factor, known.mean - state.mean[:k], lower=1)
    posterior, _, _ = condition(state, np.ascontiguousarray(rows), offset, k)
    return posterior
