"""Holonomic constraints phi(q) = 0 with multipliers: the truth that penalties approximate.

EAL paper, equations 1 and 2: M a = f - G^T mu, phi(q) = 0, with G the Jacobian of phi.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from eal.lagrangian import LagrangianSystem


@dataclass(frozen=True, eq=False, kw_only=True)
class Constraint:
    """c holonomic constraints.

    Attributes:
        value: phi(q): (..., d) to (..., c).
        jacobian: G(q): (..., d) to (..., c, d).
        bend: (dG/dt) v from q and v: (..., c).
    """

    value: Callable[[Array], Array]
    jacobian: Callable[[Array], Array]
    bend: Callable[[Array, Array], Array]


def unit_sphere() -> Constraint:
    """(|x|^2 - 1)/2 = 0: equation 36 halved, so that G = x."""
    return Constraint(
        value=lambda q: 0.5 * (np.einsum("...i,...i->...", q, q) - 1.0)[..., None],
        jacobian=lambda q: q[..., None, :],
        bend=lambda q, v: np.einsum("...i,...i->...", v, v)[..., None],  # noqa: ARG005
    )


def unit_radius() -> Constraint:
    """R - 1 = 0 in the first coordinate: equation 28."""

    def jacobian(q: Array) -> Array:
        result = np.zeros((*q.shape[:-1], 1, q.shape[-1]))
        result[..., 0, 0] = 1.0
        return result

    return Constraint(value=lambda q: q[..., :1] - 1.0, jacobian=jacobian, bend=lambda q, v: np.zeros_like(q[..., :1]))  # noqa: ARG005


def constrained_acceleration(
    system: LagrangianSystem, constraint: Constraint
) -> Callable[[float, Array, Array], Array]:
    """a(t, q, v) with the multipliers eliminated: G a = -(dG/dt) v (the index-1 form of equations 1 and 2)."""

    def acceleration(t_s: float, q: Array, v: Array) -> Array:  # noqa: ARG001
        jacobian = constraint.jacobian(q)
        free = system.solve(q, system.force(q, v))
        spread = inverse_mass_rows(system, q, jacobian)
        push = np.einsum("...ci,...i->...c", jacobian, free) + constraint.bend(q, v)
        multiplier = np.linalg.solve(jacobian @ spread.swapaxes(-1, -2), push[..., None])[..., 0]
        return free - np.einsum("...ci,...c->...i", spread, multiplier)

    return acceleration


def inverse_mass_rows(system: LagrangianSystem, q: Array, rows: Array) -> Array:
    """M(q)^-1 applied to each row of (..., c, d): (..., c, d)."""
    return np.stack([system.solve(q, rows[..., c, :].copy()) for c in range(rows.shape[-2])], axis=-2)
