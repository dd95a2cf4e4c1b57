"""Mechanical systems of the EAL paper and their like, in closed form; ``eal.autodiff`` is the check on each.

Kinetic and potential energies take arrays of any library that knows the array standard, so that they can be
differentiated automatically.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eal.arrays import Array, positive
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


GRAVITY_M_S2 = 9.81
"""Of the EAL paper, and of everything else that weighs something: within 0.5 % of all places on earth."""


def planar_pendulum(*, mass_kg: float = 1.0, gravity_m_s2: float = GRAVITY_M_S2) -> LagrangianSystem:
    """A point mass in the plane, polar: T = m (r'^2 + r^2 theta'^2)/2, U = m g r sin theta; equation 27.

    The constraint r = 1, equation 28, is left to the penalty.
    """
    m, g = positive("mass_kg", mass_kg), float(gravity_m_s2)

    def force(q: Array, v: Array) -> Array:
        r, angle, speed = q[..., 0], q[..., 1], v[..., 1]
        total = np.empty(np.broadcast_shapes(q.shape, v.shape))
        total[..., 0] = m * (r * speed * speed - g * np.sin(angle))
        total[..., 1] = -m * r * (2.0 * v[..., 0] * speed + g * np.cos(angle))
        return total

    def solve(q: Array, f: Array) -> Array:
        result = f / m
        result[..., 1] /= q[..., 0] ** 2
        return result

    def mass(q: Array) -> Array:
        result = np.zeros((*q.shape, 2))
        result[..., 0, 0], result[..., 1, 1] = m, m * q[..., 0] ** 2
        return result

    return LagrangianSystem(
        name="planar pendulum, polar",
        names=("r", "theta"),
        units=("m", "rad"),
        kinetic=lambda q, v: 0.5 * m * (v[..., 0] ** 2 + (q[..., 0] * v[..., 1]) ** 2),
        potential=lambda q: m * g * q[..., 0] * _namespace(q).sin(q[..., 1]),
        mass=mass,
        force=force,
        solve=solve,
    )


def spherical_pendulum(*, mass_kg: float = 1.0, gravity_m_s2: float = GRAVITY_M_S2) -> LagrangianSystem:
    """A point mass in space, Cartesian, U = m g x3: equation 35; |x| = 1 is left to the penalty."""
    m, g = positive("mass_kg", mass_kg), float(gravity_m_s2)
    weight = np.array([0.0, 0.0, -m * g])
    return _particle("spherical pendulum, Cartesian", ("x1", "x2", "x3"), m, weight)


def free_joint(dimension: int = 2, *, mass_kg: float = 1.0) -> LagrangianSystem:
    """A joint's child about its parent: T = m |x'|^2 / 2, U = 0; in the plane section 8, the lizard's wrist."""
    return _particle("free joint", ("x", "y", "z")[:dimension], positive("mass_kg", mass_kg), np.zeros(dimension))


def _particle(name: str, names: tuple[str, ...], m: float, weight: Array) -> LagrangianSystem:
    identity = m * np.eye(len(names))
    return LagrangianSystem(
        name=name,
        names=names,
        units=("m",) * len(names),
        kinetic=lambda q, v: 0.5 * m * _namespace(v).sum(v * v, axis=-1) + 0.0 * q[..., 0],
        potential=lambda q: -_namespace(q).sum(_namespace(q).asarray(weight) * q, axis=-1),
        mass=lambda q: np.broadcast_to(identity, (*q.shape, len(names))),
        force=lambda q, v: np.broadcast_to(weight, np.broadcast_shapes(q.shape, v.shape)).copy(),
        solve=lambda q, f: f / m,  # noqa: ARG005
    )


def _namespace(array: Any) -> Any:
    return array.__array_namespace__()
