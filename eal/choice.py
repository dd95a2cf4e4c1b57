"""Choosing beta and lambda: a start from distances, held-out likelihood, and the balance of bias and variance.

Every choice comes with its curve.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array, frozen
from eal.kernels import GaussianKernel, Kernel
from eal.potential import EmpiricalPotential, fit_potential


@dataclass(frozen=True, eq=False, kw_only=True)
class Choice:
    """A choice and the curve that it was read from.

    Attributes:
        beta: Chosen beta; that of the kernel where only lambda was chosen.
        lam: Chosen lambda.
        betas: (B,) candidates.
        lams: (L,) candidates.
        score: (B, L) what was minimised.
        parts: Named parts of the score, each (B, L), see ``by_balance``.
    """

    beta: float
    lam: float
    betas: Array
    lams: Array
    score: Array
    parts: dict[str, Array]

    def __post_init__(self) -> None:
        """Copy and freeze."""
        for name in ("betas", "lams", "score"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def median_beta(samples: Array, *, most: int = 1000) -> float:
    """1 / median |x - y|^2 over pairs: a kernel as wide as the cloud, to start from.

    Args:
        samples: (N, d) samples.
        most: Samples used, evenly spaced.

    Returns:
        beta in 1/unit^2.

    Raises:
        ValueError: half of the samples coincide.
    """
    z = np.asarray(samples, dtype=np.float64)
    z = z[:: max(1, -(-len(z) // most))]
    squared = ((z[:, None] - z) ** 2).sum(axis=2)[np.triu_indices(len(z), 1)]
    middle = float(np.median(squared)) if len(squared) else 0.0
    if middle == 0.0:
        raise ValueError("the median distance between samples is 0: half of them coincide, drop repeated ones")
    return 1.0 / middle


def by_balance(
    samples: Array,
    lams: Sequence[float],
    *,
    kernel: Kernel,
    rng: np.random.Generator,
    repeats: int = 8,
) -> Choice:
    """Lambda where the bias and the bound on the variance balance, section 7 and equation 25 of the EAL paper.

    Bias: mean V on samples left out, measured (V_rho vanishes on the support). Variance: |T_z - T_rho|_HS / lambda,
    the gap-free bound, with |T_z - T_rho| measured as the distance of two thirds of the samples, scaled to N. A bound
    on a supremum is cautious: the lambda is on the large side, and ``by_likelihood`` goes lower. The variance of V
    itself, also measured, is returned beside it.

    Args:
        samples: (N, d) samples.
        lams: Candidates.
        kernel: The kernel.
        rng: For the thirds.
        repeats: Splits that are averaged.

    Returns:
        The choice; the parts are ``bias``, ``variance`` (the bound) and ``measured`` (root mean square difference of
        two fits over sqrt 2, one kernel width off the samples left out).

    Raises:
        ValueError: fewer than 12 samples.
    """
    z = np.asarray(samples, dtype=np.float64)
    if len(z) < 12:
        raise ValueError(f"the balance needs at least 12 samples, but has {len(z)}")
    values = np.sort(np.asarray(lams, dtype=np.float64))
    width = 1.0 / np.sqrt(kernel.curvature) if np.isfinite(kernel.curvature) else 0.0
    bias, operator, measured = np.zeros(len(values)), 0.0, np.zeros(len(values))
    for _ in range(repeats):
        a, b, rest = np.array_split(rng.permutation(z), 3)
        near = rest + width * rng.standard_normal(rest.shape)
        own, other, mixed = (np.mean(kernel.gram(x, y) ** 2) for x, y in ((a, a), (b, b), (a, b)))
        operator += max(own + other - 2.0 * mixed, 0.0) / 2.0 * len(a) / len(z) / repeats
        one, two = (fit_potential(part, kernel=kernel, lam=float(values[0])) for part in (a, b))
        for i, lam in enumerate(values):
            first, second = one.with_lambda(float(lam)), two.with_lambda(float(lam))
            bias[i] += 0.5 * (first.value(rest).mean() + second.value(rest).mean()) / repeats
            measured[i] += 0.5 * np.mean((first.value(near) - second.value(near)) ** 2) / repeats
    variance = np.sqrt(operator) / values
    score = (bias + variance)[None]
    beta = float(getattr(kernel, "beta", np.nan))
    parts = {"bias": bias[None], "variance": variance[None], "measured": np.sqrt(measured)[None]}
    best = float(values[int(np.argmin(score))])
    return Choice(beta=beta, lam=best, betas=np.array([beta]), lams=values, score=score, parts=parts)


def by_likelihood(
    samples: Array,
    betas: Sequence[float],
    lams: Sequence[float],
    *,
    folds: int = 5,
    block: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Choice:
    """Beta and lambda by the held-out likelihood of the Gibbs density of the barrier -log(1 - V).

    At temperature 1 the density is p(q) = (1 - V(q)) / Z, and for the Gaussian kernel Z is exact in any dimension,
    see ``log_normaliser``. (exp(-V) itself does not normalise: V is 1 far away.)

    Args:
        samples: (N, d) samples in the order of time.
        betas: Candidates.
        lams: Candidates.
        folds: Parts that are held out in turn.
        block: Samples that stay together, for samples along a trajectory: longer than their correlation.
        progress: Told the fraction done.

    Returns:
        The choice; the score is minus the mean held-out log density.

    Raises:
        ValueError: fewer samples than folds.
    """
    z = np.asarray(samples, dtype=np.float64)
    if len(z) < 2 * folds * block:
        raise ValueError(f"{folds} folds of blocks of {block} need {2 * folds * block} samples, but there are {len(z)}")
    part = (np.arange(len(z)) // block) % folds
    tried, values = np.sort(np.asarray(betas, float)), np.sort(np.asarray(lams, float))
    score = np.zeros((len(tried), len(values)))
    for i, beta in enumerate(tried):
        for fold in range(folds):
            fitted = fit_potential(z[part != fold], kernel=GaussianKernel(beta), lam=float(values[0]))
            for j, lam in enumerate(values):
                potential = fitted.with_lambda(float(lam))
                inside = -potential.barrier_value(z[part == fold]).mean()
                score[i, j] -= (inside - log_normaliser(potential)) / folds
        if progress is not None:
            progress((i + 1) / len(tried))
    b, c = np.unravel_index(int(np.argmin(score)), score.shape)
    return Choice(beta=float(tried[b]), lam=float(values[c]), betas=tried, lams=values, score=score, parts={})


def log_normaliser(potential: EmpiricalPotential) -> float:
    """Log of the integral of 1 - V over all configurations, for the Gaussian kernel.

    int K(x, q) K(y, q) dq = (pi / 2 beta)^(d/2) exp(-beta |x - y|^2 / 2), so that Z is that factor times the trace of
    B^T G B with G_ij = exp(-beta |z_i - z_j|^2 / 2).

    Raises:
        ValueError: another kernel.
    """
    if not isinstance(potential.kernel, GaussianKernel):
        raise ValueError(f"the integral is known for the Gaussian kernel, not for a {type(potential.kernel).__name__}")
    beta = potential.kernel.beta
    overlap = GaussianKernel(0.5 * beta).gram(potential.centres, potential.centres)
    trace = float(np.einsum("mr,mr->", overlap @ potential.root, potential.root))
    return float(np.log(trace) + 0.5 * potential.dimension * np.log(np.pi / (2.0 * beta)))
