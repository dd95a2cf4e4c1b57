"""How far V_z lies from its limit V_j, by a block bootstrap that is valid for samples along a trajectory.

Theorems 1 and 2 of the EAL paper bound sup |V_z - V_j| for independent samples only, and are 7 to 150 times loose. A
bootstrap of single samples takes a trajectory for independent draws, and its 95 % radius held 60 to 80 %. Blocks as
long as the samples stay correlated carry that correlation over (Kuensch 1989; circular: Politis and Romano 1992).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eal.arrays import Array, points
from eal.correlation import effective_sample_size
from eal.lowrank import pivoted_cholesky
from eal.potential import EmpiricalPotential, fit_potential

MOST_PIVOTS = 300
LEAST = 20
"""Effective samples; with 14 (a walk that had not been round the circle) the 95 % radius held 73 %."""


@dataclass(frozen=True, kw_only=True)
class Radius:
    """A confidence radius of V_z.

    Attributes:
        radius: r such that sup |V_z - V_j| <= r over the points in about ``level`` of all recordings of this kind.
        level: Probability.
        effective_samples: Number of independent samples that the trajectory is worth.
        block: Consecutive samples drawn together.
    """

    radius: float
    level: float
    effective_samples: float
    block: int


def confidence_radius(
    potential: EmpiricalPotential,
    q: ArrayLike,
    *,
    rng: np.random.Generator,
    level: float = 0.95,
    block: int | None = None,
    resamples: int = 200,
) -> Radius:
    """The radius about V_z that holds its limit V_j, samples being in the order of time.

    T_z is a mean over samples; a resample draws whole blocks of consecutive ones, V* is the potential of T*, and the
    radius is the quantile of sup |V* - V_z| over the points. In the basis of the pivots' kernels a resample costs one
    eigenproblem of that size.

    Args:
        potential: V_z, learned from samples in the order of time, equally spaced in it.
        q: (n, d) points over which the largest deviation is taken.
        rng: For the blocks.
        level: Probability, between 0 and 1.
        block: Samples in a block; None: N over the effective sample size. 1: as if samples were independent.
        resamples: Number of resamples.

    Returns:
        The radius.

    Raises:
        ValueError: a level that is no probability, a block outside 1 .. N, points of another dimension, or samples that
            are worth fewer than ``LEAST`` independent ones.
    """
    z, n = potential.samples, len(potential.samples)
    if not 0.0 < level < 1.0:
        raise ValueError(f"level must be a probability between 0 and 1, but is {level!r}")
    effective = effective_sample_size(z, potential.kernel)
    block = max(1, round(n / effective)) if block is None else block
    if effective < LEAST:
        raise ValueError(
            f"the samples are worth only {effective:.1f} independent samples and at least {LEAST} are needed: a "
            "trajectory that has been round its range a few times only does not tell how far V_z is off; record longer"
        )
    middle, values = resampled_values(potential, q, rng=rng, block=block, resamples=resamples)
    largest = np.abs(values - middle).max(axis=1)
    return Radius(radius=float(np.quantile(largest, level)), level=level, effective_samples=effective, block=int(block))


def value_deviation(
    potential: EmpiricalPotential,
    q: ArrayLike,
    *,
    rng: np.random.Generator,
    trials: Sequence[int] | None = None,
    block: int | None = None,
    resamples: int = 40,
) -> Array:
    """Standard deviation of V_z at each point, from other recordings of the kind that it was learned from.

    Args:
        potential: V_z, learned from samples in the order of time, trial after trial.
        q: (..., d) points.
        rng: For what is drawn.
        trials: Numbers of samples of the trials, which are drawn whole. None: blocks of consecutive samples.
        block: Samples in a block; None: N over the effective sample size.
        resamples: Number of resamples: 40 know a standard deviation to 11 %.

    Returns:
        (...) standard deviations.

    Raises:
        ValueError: trials whose samples are not N together, a block outside 1 .. N, or points of another dimension.
    """
    middle, values = resampled_values(potential, q, rng=rng, block=block, trials=trials, resamples=resamples)
    return np.sqrt(((values - middle) ** 2).mean(axis=0)).reshape(np.shape(q)[:-1])


def resampled_values(
    potential: EmpiricalPotential,
    q: ArrayLike,
    *,
    rng: np.random.Generator,
    resamples: int,
    block: int | None = None,
    trials: Sequence[int] | None = None,
) -> tuple[Array, Array]:
    """(n,) V of all samples and (resamples, n) V of what is drawn, at the points; see ``value_deviation``."""
    z, n = potential.samples, len(potential.samples)
    at = points("q", q, potential.dimension).reshape(-1, potential.dimension)
    if trials is None:
        block = max(1, round(n / effective_sample_size(z, potential.kernel))) if block is None else block
        if not 1 <= block <= n:
            raise ValueError(f"block must be 1 to {n}, the number of samples, but is {block!r}")
    elif sum(trials) != n:
        raise ValueError(f"trials must have {n} samples together, as the potential, but have {sum(trials)}")
    lam = potential.sigma_lambda
    factor = pivoted_cholesky(potential.kernel, z, tolerance=1e-4 * lam, max_rank=MOST_PIVOTS)
    rows = factor.rows
    features = np.linalg.solve(factor.corner, potential.kernel.gram(z[factor.pivots], at)).T

    def value(weights: Array) -> Array:
        sigma, vectors = np.linalg.eigh((rows * (weights / weights.sum())[:, None]).T @ rows)
        response = potential.spectral_filter.response(sigma, lam)
        return 1.0 - ((features @ vectors) ** 2) @ response

    def counts() -> Array:
        if trials is not None:
            drawn = np.bincount(rng.integers(0, len(trials), len(trials)), minlength=len(trials))
            return np.repeat(drawn, trials).astype(np.float64)
        starts = rng.integers(0, n, -(-n // block))
        return np.bincount(((starts[:, None] + np.arange(block)) % n).reshape(-1)[:n], minlength=n).astype(np.float64)

    return value(potential.weights), np.stack([value(counts() * potential.weights) for _ in range(resamples)])


def valley_covariance(
    potential: EmpiricalPotential,
    q: ArrayLike,
    *,
    rng: np.random.Generator,
    block: int | None = None,
    resamples: int = 40,
) -> Array:
    """How far the valley of V_z itself may lie from that of its limit, near q.

    V* of resampled blocks pulls at q with another gradient; the valley moves by -H^+ (grad V* - grad V), H the
    Hessian of V_z in the directions across the valley, those of more than a tenth of its greatest curvature. A state
    that V_z holds there is off by as much, which no covariance of a filter knows.

    Args:
        potential: V_z, learned from samples in the order of time.
        q: (n, d) places on the valley.
        rng: For the blocks.
        block: Samples in a block; None: N over the effective sample size.
        resamples: Number of resamples.

    Returns:
        (n, d, d) covariances.
    """
    z, n = potential.samples, len(potential.samples)
    at = points("q", q, potential.dimension).reshape(-1, potential.dimension)
    block = max(1, round(n / effective_sample_size(z, potential.kernel))) if block is None else block
    values, vectors = np.linalg.eigh(potential.hessian(at))
    across = values > 0.1 * potential.curvature_limit
    inverse = np.where(across, 1.0 / np.where(across, values, 1.0), 0.0)
    here = potential.gradient(at)
    total = np.zeros((len(at), potential.dimension, potential.dimension))
    for _ in range(resamples):
        starts = rng.integers(0, n, -(-n // block))
        rows, counts = np.unique(((starts[:, None] + np.arange(block)) % n).reshape(-1)[:n], return_counts=True)
        again = fit_potential(
            z[rows],
            kernel=potential.kernel,
            lam=potential.sigma_lambda,
            spectral_filter=potential.spectral_filter,
            weights=counts * potential.weights[rows],
            accuracy=1e-3,
        )
        pull = np.einsum("nij,ni->nj", vectors, again.gradient(at) - here) * inverse
        moved = np.einsum("nij,nj->ni", vectors, pull)
        total += moved[:, :, None] * moved[:, None, :]
    return total / resamples
