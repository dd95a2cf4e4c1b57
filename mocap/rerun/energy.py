"""Theorem 3 at a joint: how far a free joint with the recorded energy could leave the data."""

from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from eal.bounds import theorem3

STIFFNESS = 20.0
"""1/eps^2 in units of the greatest kinetic energy: that motion alone could raise V by a twentieth."""
_MM2_PER_M2 = 1e6


@dataclass(frozen=True, eq=False, kw_only=True)
class JointEnergy:
    """Energy of a joint as a free mass of 1 kg in its plane, held by V_z/eps^2.

    Attributes:
        strength: 1/eps^2 in J/kg; 0 where the joint is never known in two frames on end.
        kinetic: (T,) |dq/dt|^2 / 2 in J/kg; NaN where unknown.
        potential: (T,) V_z(q) / eps^2 in J/kg.
        bound: (T,) what V_z stays below if the joint is let go where it is fastest: Theorem 3. Where the recorded V_z
            is above it, no free joint of the recorded energy would be.
    """

    strength: float
    kinetic: Array
    potential: Array
    bound: Array


def joint_energy(t_s: Array, path_mm: Array, value: Array) -> JointEnergy:
    """Energy along a path.

    Args:
        t_s: (T,) times.
        path_mm: (T, d) the joint over time; NaN where unknown.
        value: (T,) V_z there.
    """
    speed = np.gradient(path_mm, t_s, axis=0) if len(t_s) > 1 else np.full_like(path_mm, np.nan)
    kinetic = 0.5 * np.square(speed).sum(axis=1) / _MM2_PER_M2
    known = np.flatnonzero(np.isfinite(kinetic) & np.isfinite(value))
    bound, strength = np.full(len(t_s), np.nan), 0.0
    if len(known):
        fastest = known[np.argmax(kinetic[known])]
        strength = STIFFNESS * float(kinetic[fastest])
    if strength > 0:
        bound[:] = theorem3(
            strength, value0=value[fastest], kinetic0=float(kinetic[fastest]), potential0=0.0, potential_min=0.0
        )
    return JointEnergy(strength=strength, kinetic=kinetic, potential=strength * value, bound=bound)
