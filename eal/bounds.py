"""Theorems 1, 2 and 3 of the EAL paper, as printed and as they follow from their proofs.

gap is lambda_M - lambda_(M+1), eta the accuracy wanted of sup |V_j - V_z|, N the number of independent samples.
``docs/paper/errata.md`` derives each correction. T_z is the mean of N rank-one operators of norm 1.
"""

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf, erfc

from eal.arrays import Array

Constant = Literal["gaussian", "two-branch", "unclipped", "direct"]


def theorem1_printed(eta: ArrayLike, *, n: float, gap: float) -> Array:
    """Equations 8 and 24 as printed: 1 up to eta_cr = 8 sqrt(N) gap, 2 exp(-N gap^2 eta^2 / 32) above.

    For N > 1/(64 gap^2) eta_cr is above 1, and V is in [0, 1]: it says nothing.
    """
    eta = np.asarray(eta, dtype=np.float64)
    return np.where(eta <= 8.0 * np.sqrt(n) * gap, 1.0, 2.0 * np.exp(-n * (gap * eta) ** 2 / 32.0))


def theorem1(eta: ArrayLike, *, n: float, gap: float) -> Array:
    """Equation 8 from equations 18, 19 and 23: P(sup |V_j - V_z| > eta).

    delta = N gap^2 eta^2 / 32 up to eta_cr = 8 / (sqrt(N) gap), sqrt(N) gap eta / 4 above; the probability is at most
    min(1, 2 exp(-delta)). Equation 18 needs lambda at mid-gap (or equal ranks).
    """
    x = np.sqrt(n) * gap * np.asarray(eta, dtype=np.float64)
    return np.minimum(1.0, 2.0 * np.exp(-np.where(x <= 8.0, x**2 / 32.0, x / 4.0)))


def theorem1_gaussian(eta: ArrayLike, *, n: float, gap: float) -> Array:
    """As ``theorem1`` with the Gaussian branch for every eta, from |T_z - T_rho| <= 2 sqrt(2 delta / N)."""
    return np.minimum(1.0, 2.0 * np.exp(-n * (gap * np.asarray(eta, dtype=np.float64)) ** 2 / 32.0))


def gap_free(eta: ArrayLike, *, n: float, lam: float) -> Array:
    """P(sup |V_j - V_z| > eta) for the tail filter: 2 exp(-N lambda^2 eta^2 / 8), without a gap.

    t -> min(t / lambda, 1) has Lipschitz constant 1/lambda, so that sup |V_j - V_z| <= |T_z - T_rho|_HS / lambda.
    """
    return np.minimum(1.0, 2.0 * np.exp(-n * (lam * np.asarray(eta, dtype=np.float64)) ** 2 / 8.0))


def sharper(eta: ArrayLike, *, n: float, lam: float, norm2: float = 0.0) -> Array:
    """P(sup |V_j - V_z| > eta) for the tail filter by McDiarmid's inequality.

    |T_z - T_rho|_HS has mean at most sqrt((1 - |T_rho|^2) / N) and changes by at most sqrt(2)/N with one sample:
    P <= exp(-(sqrt(N) lambda eta - sqrt(1 - |T_rho|^2))^2) where the bracket is positive.

    Args:
        eta: Accuracy.
        n: Independent samples.
        lam: lambda.
        norm2: |T_rho|_HS^2, the sum of squares of its eigenvalues, or anything below it.
    """
    excess = np.sqrt(n) * lam * np.asarray(eta, dtype=np.float64) - np.sqrt(1.0 - norm2)
    return np.where(excess > 0.0, np.exp(-(np.maximum(excess, 0.0) ** 2)), 1.0)


def theorem2_constant(kind: Constant = "direct") -> float:
    """C of equation 9, E sup |V_j - V_z| <= C / (sqrt(N) gap).

    ``gaussian``, ``two-branch``: the integral over eta in [0, inf) of the clipped bounds; ``unclipped``: of
    2 exp(-x^2/32); ``direct``: 2, from equation 18 and E|T_z - T_rho|_HS <= 1/sqrt(N).

    Raises:
        ValueError: another kind.
    """
    if kind not in get_args(Constant):
        raise ValueError(f"kind must be one of {', '.join(get_args(Constant))}, but is {kind!r}")
    knee, whole = np.sqrt(32.0 * np.log(2.0)), np.sqrt(32.0 * np.pi)
    inner = erf(np.sqrt(2.0)) - erf(np.sqrt(np.log(2.0)))
    return {
        "gaussian": float(knee + whole * erfc(np.sqrt(np.log(2.0)))),
        "two-branch": float(knee + whole * inner + 8.0 * np.exp(-2.0)),
        "unclipped": float(whole),
        "direct": 2.0,
    }[kind]


def theorem2(*, n: float, gap: float, kind: Constant = "direct") -> float:
    """Equation 9: E sup |V_j - V_z| <= C / (sqrt(N) gap) for lambda at mid-gap."""
    return theorem2_constant(kind) / (np.sqrt(n) * gap)


def theorem2_gap_free(*, n: float, lam: float, norm2: float = 0.0) -> float:
    """E sup |V_j - V_z| <= sqrt(1 - |T_rho|^2) / (lambda sqrt(N)) for the tail filter, without a gap."""
    return float(np.sqrt(1.0 - norm2) / (lam * np.sqrt(n)))


def theorem3_printed(strength: ArrayLike, *, kinetic0: float, potential0: float) -> Array:
    """V(q(t)) <= eps^2 (T0 + U0) as printed: it takes V(q0) = 0 and U >= 0 for granted."""
    return (kinetic0 + potential0) / np.asarray(strength, dtype=np.float64)


def theorem3(
    strength: ArrayLike, *, value0: ArrayLike, kinetic0: float, potential0: float, potential_min: float
) -> Array:
    """V(q(t)) <= V(q0) + eps^2 (T0 + U0 - min U), from the energy of a natural, unforced system.

    Args:
        strength: 1/eps^2 in J.
        value0: V(q0), never 0 for V_z: hence the plateaus.
        kinetic0: T0 in J.
        potential0: U0 in J.
        potential_min: Least U over what the motion can reach, in J.
    """
    return np.asarray(value0) + (kinetic0 + potential0 - potential_min) / np.asarray(strength, dtype=np.float64)
