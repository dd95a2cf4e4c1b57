"""A potential as an update of the state: its most probable value under exp(-V) and the prediction.

The metric of the step is the prediction's P^-1. The implicit Euler step of the penalised mechanics has M / dt^2 there:
this is no time integrator, it conserves nothing, moves velocities only as far as P couples them to positions, and the
paper's theorems on trajectories say nothing of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.gaussian import Moments, Smoothed, Update, condition, pushed

from eal.arrays import Array


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Numbers q that are linear in a state.

    Attributes:
        mean: (d,) their mean.
        rows: (d, r) change with the first r components of the state.
        gains: (d, n) their covariance with the state.
    """

    mean: Array
    rows: Array
    gains: Array

    @property
    def cov(self) -> Array:
        """(d, d)."""
        return self.gains[:, : self.rows.shape[1]] @ self.rows.T


@dataclass(frozen=True, eq=False)
class Term:
    """What one potential says of a state, linearised: rows that are 0, and a force.

    Attributes:
        rows: (m, r) of unit noise, on the first r components of the state.
        gains: (m, n) their covariance with the state.
        away: (m,) innovations.
        force: (r,) on these components; None: there is none.
    """

    rows: Array
    gains: Array
    away: Array
    force: Array | None = None


def potential_term(
    gradient: Callable[[Array], Array],
    coordinates: Coordinates,
    *,
    least_sd: float = 0.0,
) -> Term:
    """A potential of coordinates q that are linear in the state, as its mean gradient and mean Hessian.

    They come from sigma points of an uncertain q along its principal directions (statistical linearisation; the
    Hessian by Stein's identity from gradients alone). Directions of negative curvature exert their force but do not
    widen the state.

    Args:
        gradient: (S, d) points to (S, d) gradients of the potential, its stiffness included.
        coordinates: q.
        least_sd: Directions that are known better than this are left out: no potential moves q along them by much.
    """
    variance, directions = np.linalg.eigh(coordinates.cov)
    sure = int(np.searchsorted(variance, max(least_sd**2, 1e-24 * variance[-1])))
    directions, sd = directions[:, sure:], np.sqrt(variance[sure:])
    p = len(sd)
    unit = (directions / sd).T  # q along these directions, in units of their deviations
    if not p:
        return Term(unit @ coordinates.rows, unit @ coordinates.gains, np.zeros(0))
    c = min(3.0, p)  # spread of the sigma points; their second moment is 3, if there are so many directions
    here, steps = coordinates.mean, np.sqrt(c) * (directions * sd).T
    gradients = gradient(np.concatenate([here[None], here + steps, here - steps])) @ directions
    force = gradients[0] + (gradients[1:] - gradients[0]).sum(axis=0) / (2 * c)
    hessian = (gradients[1 : p + 1] - gradients[p + 1 :]) * (0.5 / np.sqrt(c)) / sd[:, None]
    values, vectors = np.linalg.eigh((0.5 * (hessian + hessian.T)) * sd[:, None] * sd)
    bent = values > 1e-13  # the others take no part: a thousand of them would change a variance by 1e-10
    root = vectors[:, bent] * np.sqrt(values[bent])
    curved = root.T @ unit
    zero = np.zeros(len(curved))
    return Term(curved @ coordinates.rows, curved @ coordinates.gains, zero, (-sd * force @ unit) @ coordinates.rows)


def enforce(state: Moments, terms: Sequence[Term], *, farthest: float = np.inf) -> tuple[Moments, list[Update]]:
    """Minimise 1/2 |x - x_pred|^2 in the metric P^-1 plus potentials, all at once.

    The result reads as a measurement update with information equal to the sum of the Hessians: it contracts the
    covariance, needs no substeps and is stable at any stiffness.

    Args:
        state: Predicted state.
        terms: Potentials.
        farthest: Forces move the state by at most so many of its deviations: no further than they were linearised for.

    Returns:
        The state, and how it came about.
    """
    if not terms:
        return state, []
    rows, gains = np.concatenate([t.rows for t in terms]), np.concatenate([t.gains for t in terms])
    after, update = condition(state, rows, gains, np.concatenate([t.away for t in terms]))
    forces = [term.force for term in terms if term.force is not None]
    if forces:
        after, update = pushed(after, update, np.sum(forces, axis=0), farthest)
    return after, [update]


def informed(state: Smoothed, given: Moments) -> Smoothed:
    """A state that knows nothing of ``known``, moments of its first k components, conditioned on it."""
    k, before = len(given.mean), Moments(state.mean, state.cov)
    white = np.linalg.inv(np.linalg.cholesky(given.cov))
    after, _ = condition(before, white, white @ before.cov[:k], white @ (given.mean - before.mean[:k]))
    return Smoothed(after.mean, after.cov, np.zeros_like(after.cov))
