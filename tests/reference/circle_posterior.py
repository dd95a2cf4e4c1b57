"""A point that walks at random near a circle, held by V_z and seen at both ends of a gap: its posterior on a grid."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import convolve1d

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


def exact(v: EmpiricalPotential, one: Walk) -> tuple[Array, Array]:
    """Means (T, 2) and deviations (T, 2) of the posterior of each step, by recursions on the grid."""
    axis = np.linspace(-EDGE, EDGE, CELLS)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    held = np.exp(-one.weight * v.barrier_value(grid.reshape(-1, 2)).reshape(CELLS, CELLS))
    offsets = np.arange(-int(5 * one.walk / (axis[1] - axis[0])) - 1, int(5 * one.walk / (axis[1] - axis[0])) + 2)
    kernel = np.exp(-0.5 * ((axis[1] - axis[0]) * offsets / one.walk) ** 2)

    def moved(p: Array) -> Array:
        for k in (0, 1):
            p = convolve1d(p, kernel / kernel.sum(), axis=k, mode="constant")
        return p

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
