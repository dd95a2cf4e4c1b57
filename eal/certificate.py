"""How far V_z of given samples may be from its limit: theorems on the data, and estimates, each named as such."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import beta as beta_distribution

from eal import bounds
from eal.arrays import Array
from eal.kernels import Kernel
from eal.potential import EmpiricalPotential, fit_potential


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """Accuracy of a fitted potential.

    The theorems hold for independent samples; with samples along a trajectory they hold for ``effective_samples`` of
    them only as a rule of thumb.

    Attributes:
        samples: N.
        effective_samples: N divided by the correlation time, an estimate.
        confidence: Of every statement.
        radius_hoeffding: Theorem (gap-free form of theorem 1): sup |V_z - V_j| is below this.
        radius_theorem: Theorem (McDiarmid; the data bound |T_rho| below on the same event): the same, sharper.
        radius_bootstrap: Estimate: the quantile of sup |V* - V_z| over resampled fits.
        level: A value of V.
        coverage: Theorem (exact binomial, sample splitting): a new sample has V below ``level``, for the V of half of
            the samples, with at least this probability.
    """

    samples: int
    effective_samples: float
    confidence: float
    radius_hoeffding: float
    radius_theorem: float
    radius_bootstrap: float
    level: float
    coverage: float


def certify(
    potential: EmpiricalPotential,
    *,
    rng: np.random.Generator,
    confidence: float = 0.95,
    level: float = 0.05,
    resamples: int = 100,
    ordered: bool = True,
) -> Certificate:
    """Accuracy certificate of a potential from its own samples.

    Args:
        potential: With the tail filter, for the two theorems on sup |V_z - V_j|.
        rng: For the bootstrap and the split.
        confidence: Of every statement.
        level: V below which a configuration counts as inside.
        resamples: Bootstrap fits.
        ordered: The samples are in the order of time: effective sample size and blocks are used.

    Returns:
        The certificate.

    Raises:
        ValueError: fewer than 8 samples.
    """
    z, n = potential.samples, len(potential.samples)
    if n < 8:
        raise ValueError(f"a certificate needs at least 8 samples, but there are {n}")
    effective = effective_sample_size(z, potential.kernel) if ordered else float(n)
    lam = potential.sigma_lambda
    hoeffding = float(np.sqrt(8.0 * np.log(2.0 / (1.0 - confidence)) / effective) / lam)
    most = bounds.radius(n=effective, lam=1.0, confidence=confidence)  # of |T_z - T_rho|, whatever |T_rho| is
    norm2 = max(float(np.linalg.norm(potential.eigenvalues)) - most, 0.0) ** 2
    block = max(1, round(n / effective))
    return Certificate(
        samples=n,
        effective_samples=effective,
        confidence=confidence,
        radius_hoeffding=min(hoeffding, 1.0),
        radius_theorem=min(bounds.radius(n=effective, lam=lam, confidence=confidence, norm2=norm2), 1.0),
        radius_bootstrap=bootstrap_radius(potential, rng=rng, confidence=confidence, resamples=resamples, block=block),
        level=level,
        coverage=coverage(potential, rng=rng, confidence=confidence, level=level, block=block),
    )


def bootstrap_radius(
    potential: EmpiricalPotential,
    *,
    rng: np.random.Generator,
    confidence: float = 0.95,
    resamples: int = 100,
    block: int = 1,
) -> float:
    """Estimate of the radius: the quantile of sup |V* - V_z| over fits to resampled blocks.

    The supremum is over the samples and over points one kernel width off them.

    Args:
        potential: The potential.
        rng: For the resampling.
        confidence: Quantile.
        resamples: Fits.
        block: Consecutive samples drawn together.

    Returns:
        The radius.
    """
    z, n = potential.samples, len(potential.samples)
    near = z[rng.choice(n, min(n, 200), replace=False)]
    width = 1.0 / np.sqrt(max(potential.kernel.curvature, 1e-12)) if np.isfinite(potential.kernel.curvature) else 0.0
    q = np.concatenate([near, near + width * rng.standard_normal(near.shape)])
    base, found = potential.value(q), np.empty(resamples)
    for i in range(resamples):
        starts = rng.integers(0, n, -(-n // block))
        chosen = ((starts[:, None] + np.arange(block)) % n).reshape(-1)[:n]
        rows, counts = np.unique(chosen, return_counts=True)
        again = fit_potential(
            z[rows],
            kernel=potential.kernel,
            lam=potential.sigma_lambda,
            spectral_filter=potential.spectral_filter,
            weights=counts * potential.weights[rows],
        )
        found[i] = np.abs(again.value(q) - base).max()
    return float(np.quantile(found, confidence))


def coverage(
    potential: EmpiricalPotential, *, rng: np.random.Generator, confidence: float, level: float, block: int = 1
) -> float:
    """Least probability that a new sample has V < level, for the V learned from half of the samples.

    k of m samples left out are inside: Clopper and Pearson's lower limit, exact for independent samples. Blocks are
    split whole, and each counts once.

    Returns:
        The probability.
    """
    z = potential.samples
    blocks = np.arange(len(z)) // block
    left = rng.permutation(blocks[-1] + 1)[: max(1, (blocks[-1] + 1) // 2)]
    out = np.isin(blocks, left)
    half = fit_potential(
        z[~out],
        kernel=potential.kernel,
        lam=potential.sigma_lambda,
        spectral_filter=potential.spectral_filter,
        weights=potential.weights[~out],
    )
    inside = half.value(z[out]) < level
    whole = np.array([inside[blocks[out] == b].all() for b in np.unique(blocks[out])])
    k, m = int(whole.sum()), len(whole)
    return 0.0 if k == 0 else float(beta_distribution.ppf(1.0 - confidence, k, m - k + 1))


def effective_sample_size(samples: Array, kernel: Kernel, *, most: int = 2000) -> float:
    """N / (1 + 2 sum of the correlations of K_z (x) K_z over lags), for samples in the order of time.

    The variance of T_z is (1/N) sum over lags of c_l = E K(z_t, z_(t+l))^2 - |T|^2; the sum stops at the first lag
    whose pair with the next is negative (Geyer 1992). At most N: anticorrelation is not counted on.

    Args:
        samples: (N, d) samples.
        kernel: The kernel.
        most: Longest run used; longer ones are cut.

    Returns:
        The size, between 1 and N.
    """
    z = np.asarray(samples, dtype=np.float64)[:most]
    n = len(z)
    squared = kernel.gram(z, z) ** 2
    norm2 = float(squared.mean())
    lags = np.array([np.mean(np.diagonal(squared, lag)) for lag in range(n // 2)]) - norm2
    if lags[0] <= 0.0:
        return 1.0
    total, lag = 0.0, 1
    while lag + 1 < len(lags) and lags[lag] + lags[lag + 1] > 0.0:
        total += lags[lag] + lags[lag + 1]
        lag += 2
    return float(np.clip(len(samples) / (1.0 + 2.0 * total / lags[0]), 1.0, len(samples)))
