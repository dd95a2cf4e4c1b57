"""Theorems 1, 2 and 3 of the EAL paper, as printed and as they follow from their proofs.

gap is lambda_M - lambda_(M+1), eta the accuracy wanted of sup |V_j - V_z|, N the number of independent samples.
``docs/experiments/errata.md`` derives each correction. T_z is the mean of N rank-one operators of norm 1.
"""

import numpy as np
from numpy.typing import ArrayLike

from eal.arrays import Array


def theorem1_printed(eta: ArrayLike, *, n: float, gap: float) -> Array:
    """Equations 8 and 24 as printed: 1 up to eta_cr = 8 sqrt(N) gap, 2 exp(-N gap^2 eta^2 / 32) above.

    For N > 1/(64 gap^2) eta_cr is above 1, and V is in [0, 1]: it says nothing.
    """
    eta = np.asarray(eta, dtype=np.float64)
    return np.where(eta <= 8.0 * np.sqrt(n) * gap, 1.0, 2.0 * np.exp(-n * (gap * eta) ** 2 / 32.0))


def theorem1_gaussian(eta: ArrayLike, *, n: float, gap: float) -> Array:
    """P(sup |V_j - V_z| > eta): equation 8 from |T_z - T_rho| <= 2 sqrt(2 delta / N), lambda at mid-gap."""
    return np.minimum(1.0, 2.0 * np.exp(-n * (gap * np.asarray(eta, dtype=np.float64)) ** 2 / 32.0))


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


THEOREM2 = 2.0
"""C of equation 9, directly: from equation 18 and E|T_z - T_rho|_HS <= 1/sqrt(N)."""


def theorem2(*, n: float, gap: float) -> float:
    """Equation 9: E sup |V_j - V_z| <= C / (sqrt(N) gap) for lambda at mid-gap."""
    return THEOREM2 / (np.sqrt(n) * gap)


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
