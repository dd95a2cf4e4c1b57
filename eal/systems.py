"""Mechanical systems of the EAL paper and their like, in closed form; ``eal.autodiff`` is the check on each.

Kinetic and potential energies take arrays of any library that knows the array standard, so that they can be
differentiated automatically.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from eal.arrays import Array, positive
from eal.lagrangian import LagrangianSystem

GRAVITY_M_S2 = 9.81


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


def free_joint(*, mass_kg: float = 1.0) -> LagrangianSystem:
    """A joint's child about its parent in the plane: T = m (x'^2 + y'^2)/2, U = 0; section 8, the lizard's wrist."""
    return _particle("free planar joint", ("x", "y"), positive("mass_kg", mass_kg), np.zeros(2))


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


def chain(
    lengths_m: Sequence[float], *, masses_kg: Sequence[float] | None = None, gravity_m_s2: float = GRAVITY_M_S2
) -> LagrangianSystem:
    """N point masses on N massless links, angles from the downward vertical.

    M_ij = l_i l_j m_(max(i,j)) cos(q_i - q_j) with m_(k) the mass from link k on; U = -g sum_i m_(i) l_i cos q_i.

    Args:
        lengths_m: N link lengths.
        masses_kg: N masses at the ends of the links; None: 1 kg each.
        gravity_m_s2: Gravity.
    """
    length = np.array([positive("a link length", x, "m") for x in lengths_m])
    masses = np.ones(len(length)) if masses_kg is None else np.array([positive("a mass", x, "kg") for x in masses_kg])
    if len(masses) != len(length):
        raise ValueError(f"{len(length)} links and {len(masses)} masses: give one mass a link")
    beyond = np.cumsum(masses[::-1])[::-1]
    index = np.arange(len(length))
    coupling = length[:, None] * length * beyond[np.maximum(index[:, None], index)]
    weight = gravity_m_s2 * beyond * length

    def mass(q: Any) -> Any:
        return coupling * _namespace(q).cos(q[..., :, None] - q[..., None, :])

    def kinetic(q: Any, v: Any) -> Any:
        return 0.5 * _namespace(q).sum(mass(q) * v[..., :, None] * v[..., None, :], axis=(-2, -1))

    def force(q: Array, v: Array) -> Array:
        swing = coupling * np.sin(q[..., :, None] - q[..., None, :])
        return -np.einsum("...ij,...j->...i", swing, v * v) - weight * np.sin(q)

    return LagrangianSystem(
        name=f"chain of {len(length)} links",
        names=tuple(f"angle{i + 1}" for i in index),
        units=("rad",) * len(length),
        kinetic=kinetic,
        potential=lambda q: -_namespace(q).sum(weight * _namespace(q).cos(q), axis=-1),
        mass=mass,
        force=force,
        solve=lambda q, f: np.asarray(np.linalg.solve(mass(q), f[..., None])[..., 0], dtype=np.float64),
    )


def double_pendulum(*, gravity_m_s2: float = GRAVITY_M_S2) -> LagrangianSystem:
    """Two links of 1 m with 1 kg at each end."""
    return chain((1.0, 1.0), gravity_m_s2=gravity_m_s2)


def _namespace(array: Any) -> Any:
    return array.__array_namespace__()
