"""Potentials that hold a pose: each an update, to the most probable state under exp(-V) and the prediction.

The metric of the step is the prediction's P^-1. The implicit Euler step of the penalised mechanics has M / dt^2 there:
this is no time integrator, it conserves nothing, moves velocities only as far as P couples them to positions, and the
paper's theorems on trajectories say nothing of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from mocap.filters.gaussian import Markers, Moments, Smoothed, Update, condition, pushed
from numpy.typing import NDArray

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


@dataclass(frozen=True, eq=False, kw_only=True)
class Bones:
    """B distances that are kept: V_b = sum (|a - b| - L)^2 / (2 s^2).

    Attributes:
        ends: (B, 2) indices of the markers a and b.
        length_m: (B,) lengths L.
        sd_m: (B,) deviation s of the distance from that.
    """

    ends: NDArray[np.int64]
    length_m: Array
    sd_m: Array


def bones_term(bones: Bones, markers: Markers, stiffness: float) -> Term:
    """V_b, linearised about the prediction.

    The difference of two markers has the mean d and, across it, the covariance P. Their distance then has the mean
    |d| + tr P / 2|d| and, besides the part that is linear in the state, the variance tr P^2 / 2|d|^2 (second order): of
    a bone whose direction nobody knows the length says little.

    Args:
        bones: The bones.
        markers: In any axes.
        stiffness: Factor on V_b.
    """
    (a, b), view = bones.ends.T, markers.view
    each = markers.spread.reshape(len(view.mean), 3, len(view.mean), 3)
    away = view.mean[a] - view.mean[b]
    spread = each[a, :, a] - each[a, :, b] - each[b, :, a] + each[b, :, b]
    distance = np.maximum(np.sqrt((away**2).sum(axis=1)), 1e-3 * bones.length_m)
    unit = away / distance[:, None]
    seen = (spread @ unit[..., None])[..., 0]
    own = (seen * unit).sum(axis=1)  # variance along the bone
    longer = (np.einsum("bii->b", spread) - own) / (2 * distance)
    bent = ((spread**2).sum(axis=(1, 2)) - 2 * (seen**2).sum(axis=1) + own**2) / (2 * distance**2)
    sd = np.sqrt((bones.sd_m**2 + np.maximum(bent, 0.0)) / stiffness)  # of a bone that is vague along itself, rounding
    along, bone = np.zeros((len(a), len(view.mean), 3)), np.arange(len(a))
    along[bone, a] = unit / sd[:, None]
    along[bone, b] = -along[bone, a]
    along = along.reshape(len(a), -1)
    return Term(view.combined(along), along @ markers.gains, (bones.length_m - distance - longer) / sd)


class BarrierPotential(Protocol):
    """V >= 0 that pulls at any distance: an ``eal.EmpiricalPotential``, or whatever answers the same."""

    def value(self, q: Array, /) -> Array:
        """V: (..., d) to (...)."""
        ...

    def barrier_gradient(self, q: Array, /) -> Array:
        """Gradient of -log(1 - V): (..., d) to (..., d)."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Pull:
    """Gradient of -log(1 - V_z) / eps^2 a second: as of V_z near the data, but it pulls at any distance.

    Attributes:
        potential: V_z.
        stiffness: 1/eps^2 a second.
    """

    potential: BarrierPotential
    stiffness: float

    def __call__(self, x: Array) -> Array:
        """(S, k) coordinates to (S, k)."""
        return self.potential.barrier_gradient(x) * self.stiffness


@dataclass(frozen=True, eq=False, kw_only=True)
class PosePotential:
    """A potential of coordinates q = mean + on_shape [z, zdot] + on_residual e of a pose.

    Attributes:
        mean: (d,) q of the mean pose.
        on_shape: (d, 2r).
        on_residual: (d, 3M).
        samples: (N, d) what it was learned from.
        gradient: (S, d) q to (S, d) gradients of the potential over eps^2, a second.
        potential: V_z of q that the gradient is of; None: it is quadratic.
        root: Marker that a limb hangs on.
        children: Markers of a limb; empty: the potential is of the whole pose.
    """

    mean: Array
    on_shape: Array
    on_residual: Array
    samples: Array
    gradient: Callable[[Array], Array]
    potential: BarrierPotential | None = None
    root: int = -1
    children: tuple[int, ...] = ()

    @cached_property
    def centre(self) -> Array:
        """(d,) mean of the samples."""
        return self.samples.mean(axis=0)

    @cached_property
    def plane(self) -> Array:
        """(d, 2) directions of the two leading principal components of the samples."""
        _, _, vt = np.linalg.svd(self.samples - self.centre, full_matrices=False)
        largest = np.abs(vt[:2]).argmax(axis=1)
        return (vt[:2] * np.sign(vt[np.arange(len(vt[:2])), largest])[:, None]).T

    def rows(self, chains: int) -> Array:
        """(d, r) how q changes with the components of a state [z, zdot, ..., e] whose chains begin at ``chains``."""
        n, d = self.on_shape.shape[1], self.on_residual.shape[1]
        out = np.zeros((len(self.mean), chains + d))
        out[:, :n], out[:, chains:] = self.on_shape, self.on_residual
        return out
