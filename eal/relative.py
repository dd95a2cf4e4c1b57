"""A sharper theorem for the Tikhonov filter: V_z / V_j is near 1 everywhere, from N ~ 1/lambda samples on.

The Lipschitz bounds of ``eal.bounds`` need 1/lambda^2. With A = T_rho + lambda and E = A^-1/2 (T_z - T_rho) A^-1/2,
|E| <= eps means (1 - eps) A <= T_z + lambda <= (1 + eps) A, and V = lambda (A^-1 K_q, K_q) for the Tikhonov filter,
so that for all q at once

    V_j(q) / (1 + eps) <= V_z(q) <= V_j(q) / (1 - eps).

E is the mean of N independent operators; Bernstein's inequality with intrinsic dimension (Tropp 2015, theorem 7.7.1)
bounds |E| through two numbers: the leverage R = sup (A^-1 K_x, K_x) over the support, and the effective dimension
D = trace of T_rho A^-1. Both are at most 1/lambda, whatever the distribution, and much smaller on a thin set: for the
circle at beta = 1, lambda = 1e-3 it is 10, where eps comes out 1.4 to 1.7 times the worst of 40 draws.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eal.arrays import Array
from eal.potential import EmpiricalPotential
from eal.spectral import Tikhonov


@dataclass(frozen=True, kw_only=True)
class RelativeCertificate:
    """Bounds eps on |log(V_z / V_j)|, read as V_j/(1 + eps) <= V_z <= V_j/(1 - eps); inf where they say nothing.

    Attributes:
        confidence: Of each statement.
        eps_theorem: Theorem, for independent samples of any distribution: R and D replaced by 1/lambda.
        eps_estimate: Estimate: the same inequality with R and D measured on the samples.
        leverage: R as measured: the largest V_z / lambda on the samples.
        dimension: D as measured: the effective rank.
    """

    confidence: float
    eps_theorem: float
    eps_estimate: float
    leverage: float
    dimension: float


def exceedance(eps: ArrayLike, *, n: float, leverage: float, dimension: float, top: float = 1.0) -> Array:
    """P(|E| > eps) <= 8 (D / top) exp(-N eps^2 / (2 R (top + eps/3))), for eps >= sqrt(R top / N) + R / (3 N).

    Each term of E has norm at most R / N and the sum of second moments is at most (R / N) T_rho A^-1, of norm
    R top / N and intrinsic dimension D / top; two sides and both signs give the 8.

    Args:
        eps: Relative accuracy.
        n: Independent samples.
        leverage: R, or anything above it.
        dimension: D, or anything above it.
        top: lambda_1 / (lambda_1 + lambda), or anything between that and 1.

    Returns:
        The bound, at most 1.
    """
    eps = np.asarray(eps, dtype=np.float64)
    r = max(leverage, 1.0)
    bound = 8.0 * dimension / top * np.exp(-n * eps**2 / (2.0 * r * (top + eps / 3.0)))
    return np.where(eps >= np.sqrt(r * top / n) + r / (3.0 * n), np.minimum(bound, 1.0), 1.0)


def accuracy(*, n: float, leverage: float, dimension: float, confidence: float = 0.95, top: float = 1.0) -> float:
    """The eps of that confidence: the inverse of ``exceedance``; inf where it is not below 1.

    Raises:
        ValueError: confidence outside (0, 1).
    """
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must lie between 0 and 1, but is {confidence!r}")
    r = max(leverage, 1.0)
    log_term = np.log(8.0 * dimension / (top * (1.0 - confidence)))
    a = r * log_term / 3.0
    eps = (a + np.sqrt(a**2 + 2.0 * n * r * top * log_term)) / n
    eps = max(eps, np.sqrt(r * top / n) + r / (3.0 * n))
    return float(eps) if eps < 1.0 else float("inf")


def certify_relative(
    potential: EmpiricalPotential, *, confidence: float = 0.95, effective_samples: float | None = None
) -> RelativeCertificate:
    """Relative accuracy of a potential with the Tikhonov filter.

    Args:
        potential: The potential; refit one of another filter with ``Tikhonov()``.
        confidence: Of each statement.
        effective_samples: For samples along a trajectory, see ``eal.certificate``; None: all are independent.

    Returns:
        The certificate.

    Raises:
        ValueError: another filter.
    """
    if not isinstance(potential.spectral_filter, Tikhonov):
        raise ValueError(
            f"the relative certificate is a theorem for the tikhonov filter, not for {potential.spectral_filter.name}: "
            "fit with spectral_filter=Tikhonov()"
        )
    n = float(len(potential.samples)) if effective_samples is None else float(effective_samples)
    lam = potential.sigma_lambda
    leverage = float(potential.value(potential.samples).max()) / lam
    dimension = potential.effective_rank
    return RelativeCertificate(
        confidence=confidence,
        eps_theorem=accuracy(n=n, leverage=1.0 / lam, dimension=1.0 / lam, confidence=confidence),
        eps_estimate=accuracy(n=n, leverage=leverage, dimension=dimension, confidence=confidence),
        leverage=leverage,
        dimension=dimension,
    )
