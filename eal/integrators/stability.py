"""The largest penalty that an explicit step can follow."""

import numpy as np

from eal.arrays import Array
from eal.lagrangian import PenalisedModel

LIMITS = {"rk4": 2.0 * np.sqrt(2.0), "verlet": 2.0, "midpoint": np.inf}
"""Largest omega h of an undamped oscillation that a method does not amplify."""


class StabilityError(ValueError):
    """The step is too long for the penalty."""


def largest_strength(method: str, h_s: float, *, curvature: float, mass: float = 1.0) -> float:
    """The 1/eps^2 up to which a method is stable: (omega h)_max^2 m / (V'' h^2); 8 / (4 beta h^2) for RK4.

    Args:
        method: ``rk4``, ``verlet`` or ``midpoint``.
        h_s: Step in s.
        curvature: Largest eigenvalue of the Hessian of V, 4 beta for the Gaussian kernel, in 1/unit^2.
        mass: Smallest eigenvalue of the mass matrix.

    Returns:
        1/eps^2 in J.
    """
    if method not in LIMITS:
        raise ValueError(f"method must be one of {', '.join(LIMITS)}, but is {method!r}")
    return float(LIMITS[method] ** 2 * mass / (curvature * h_s**2))


def check_step(method: str, h_s: float, model: PenalisedModel, q0: Array) -> None:
    """Refuse a step that the penalty makes unstable.

    Args:
        method: As in ``largest_strength``.
        h_s: Step in s.
        model: System, penalty and 1/eps^2.
        q0: (..., d) start; the mass is taken there.

    Raises:
        StabilityError: 1/eps^2 is above the limit; the message names the limit and the step that would do.
    """
    if np.isinf(LIMITS[method]):
        return
    mass = float(np.linalg.eigvalsh(model.system.mass(q0)).min())
    limit = largest_strength(method, h_s, curvature=model.penalty.curvature_limit, mass=mass)
    worst = float(np.max(model.strength))
    if worst >= limit:
        needed = h_s * np.sqrt(limit / worst)
        raise StabilityError(
            f"1/eps^2 = {worst:.3g} is above the stability limit {limit:.3g} of {method} with a step of {h_s:g} s: "
            f"take a step below {needed:.2g} s, or midpoint, which has no limit"
        )
