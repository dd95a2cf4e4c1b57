"""A point that walks at random near a circle, held by V_z and seen at both ends of a gap: its posterior on a grid."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from mocap.filters.trajectory import Quadratic
from scipy.linalg import toeplitz

from eal import EmpiricalPotential, GaussianKernel, fit_potential
from eal.arrays import Array

SEEN = 10
"""Steps that are seen before the gap, and after it."""
NOISE = 0.03
FIRST = (np.array([1.0, 0.0]), 0.05)
"""Mean and deviation of the first place."""
EDGE, CELLS = 1.8, 181


def potential() -> EmpiricalPotential:
    """V_z of 200 places on the unit circle."""
    angle = 2 * np.pi * np.arange(200) / 200
    return fit_potential(np.column_stack([np.cos(angle), np.sin(angle)]), kernel=GaussianKernel(1.0), lam=1e-4)


@dataclass(frozen=True, eq=False)
class Walk:
    """One draw.

    Attributes:
        walk: Deviation of a step.
        weight: Factor s on the barrier in each step.
        seen: (T, 2) what was seen; NaN in the gap.
        truth: (T, 2).
    """

    walk: float
    weight: float
    seen: Array
    truth: Array


def drawn(v: EmpiricalPotential, walk: float, weight: float, gap: int, rng: np.random.Generator) -> Walk:
    """A draw of the walk itself, by particles with resampling: the ancestors of one of the last."""
    steps, particles = 2 * SEEN + gap, 2000
    at = FIRST[0] + FIRST[1] * rng.normal(size=(particles, 2))
    places, parents = [], []
    for t in range(steps):
        if t:
            at = at + walk * rng.normal(size=at.shape)
        log = -weight * v.barrier_value(at)
        share = np.exp(log - log.max())
        parent = rng.choice(particles, particles, p=share / share.sum())
        at = at[parent]
        places.append(at)
        parents.append(parent)
    truth, one = np.zeros((steps, 2)), int(rng.integers(particles))
    for t in range(steps - 1, -1, -1):
        truth[t] = places[t][one]
        one = int(parents[t][one])
    seen = truth + NOISE * rng.normal(size=truth.shape)
    seen[SEEN : SEEN + gap] = np.nan
    return Walk(walk, weight, seen, truth)


@cache
def _grid(v: EmpiricalPotential) -> tuple[Array, Array, Array]:
    """(CELLS,) an axis, (CELLS, CELLS, 2) places, (CELLS, CELLS) the barrier there."""
    axis = np.linspace(-EDGE, EDGE, CELLS)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    return axis, grid, v.barrier_value(grid.reshape(-1, 2)).reshape(CELLS, CELLS)


def exact(v: EmpiricalPotential, one: Walk) -> tuple[Array, Array]:
    """Means (T, 2) and deviations (T, 2) of the posterior of each step, by recursions on the grid."""
    axis, grid, barrier = _grid(v)
    held = np.exp(-one.weight * barrier)
    kernel = toeplitz(np.exp(-0.5 * ((axis - axis[0]) / one.walk) ** 2)) * (axis[1] - axis[0])

    def moved(p: Array) -> Array:
        return kernel @ p @ kernel

    def local(t: int) -> Array:
        if np.isnan(one.seen[t, 0]):
            return held
        return held * np.exp(-0.5 * np.sum((grid - one.seen[t]) ** 2, axis=-1) / NOISE**2)

    forward = []
    p = np.exp(-0.5 * np.sum((grid - FIRST[0]) ** 2, axis=-1) / FIRST[1] ** 2)
    for t in range(len(one.seen)):
        p = (moved(p) if t else p) * local(t)
        p /= p.sum()
        forward.append(p)
    later, mean, sd = np.ones_like(p), np.zeros_like(one.seen), np.zeros_like(one.seen)
    for t in range(len(one.seen) - 1, -1, -1):
        both = forward[t] * later
        both /= both.sum()
        mean[t] = np.einsum("ij,ijk->k", both, grid)
        sd[t] = np.sqrt(np.einsum("ij,ijk->k", both, (grid - mean[t]) ** 2))
        later = moved(later * local(t))
        later /= later.max()
    return mean, sd


@dataclass(frozen=True, eq=False)
class Circle:
    """The walk as a problem of ``mocap.filters.trajectory``."""

    v: EmpiricalPotential
    walk: Walk

    def cost(self, x: Array) -> float:
        """Minus log of the density."""
        first = np.sum((x[0] - FIRST[0]) ** 2) / FIRST[1] ** 2
        steps = np.sum(np.diff(x, axis=0) ** 2) / self.walk.walk**2
        seen = np.nansum((x - self.walk.seen) ** 2) / NOISE**2
        return float(0.5 * (first + steps + seen) + self.walk.weight * self.v.barrier_value(x).sum())

    def quadratic(self, x: Array) -> Quadratic:
        """To second order, without negative curvature."""
        seen, one = np.isfinite(self.walk.seen[:, :1]), 1 / self.walk.walk**2
        gradient = np.where(seen, x - np.nan_to_num(self.walk.seen), 0.0) / NOISE**2
        gradient += self.walk.weight * self.v.barrier_gradient(x)
        gradient[0] += (x[0] - FIRST[0]) / FIRST[1] ** 2
        gradient[1:] += one * np.diff(x, axis=0)
        gradient[:-1] -= one * np.diff(x, axis=0)
        own = seen[:, 0] / NOISE**2 + one * np.r_[1, np.full(len(x) - 2, 2), 1]
        own[0] += 1 / FIRST[1] ** 2
        values, vectors = np.linalg.eigh(self.walk.weight * self.v.barrier_hessian(x))
        bent = (vectors * np.maximum(values, 0)[:, None]) @ np.swapaxes(vectors, 1, 2)
        across = np.broadcast_to(-one * np.eye(2), (len(x) - 1, 2, 2))
        return Quadratic(gradient=gradient, band=(own[:, None, None] * np.eye(2) + bent, across))

    def moved(self, x: Array, step: Array) -> Array:
        """Straight on."""
        return x + step

    def start(self) -> Array:
        """On the circle, from what was seen before the gap to what was seen after it."""
        seen = np.isfinite(self.walk.seen[:, 0])
        angle = np.unwrap(np.arctan2(self.walk.seen[seen, 1], self.walk.seen[seen, 0]))
        angle = np.interp(np.arange(len(seen)), np.flatnonzero(seen), angle)
        return np.column_stack([np.cos(angle), np.sin(angle)])
