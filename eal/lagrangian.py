"""Lagrangian systems, and the empirical-analytical model: a natural system with a penalty (1/eps^2) V.

EAL paper, equations 5 and 7: d/dt dT/dv - dT/dq + dU/dq + (1/eps^2) dV/dq = Theta, with T = v^T M(q) v / 2.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from eal.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class LagrangianSystem:
    """A natural system; every function takes (..., d) arrays. ``eal.autodiff`` derives one from its energies.

    Attributes:
        name: What it is.
        names: d coordinate names.
        units: d units.
        kinetic: T(q, v): (...) in J.
        potential: U(q): (...) in J.
        mass: M(q): (..., d, d).
        force: -C(q, v) v - dU/dq: (..., d), all of M a but penalty, damping and Theta.
        solve: M(q)^-1 f from q and f: (..., d).
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    kinetic: Callable[[Array, Array], Array]
    potential: Callable[[Array], Array]
    mass: Callable[[Array], Array]
    force: Callable[[Array, Array], Array]
    solve: Callable[[Array, Array], Array]

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return len(self.names)


class Penalty(Protocol):
    """Any V >= 0: an EmpiricalPotential, a PotentialStack, an AnalyticPenalty."""

    @property
    def curvature_limit(self) -> float:
        """Largest eigenvalue of the Hessian of V on its zero set."""
        ...

    def value(self, q: Array, /) -> Array:
        """V: (..., d) to (...)."""
        ...

    def gradient(self, q: Array, /) -> Array:
        """Gradient of V: (..., d) to (..., d)."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class AnalyticPenalty:
    """V given by functions: V_rho in closed form, or |phi|^2 / 2 of a known constraint.

    Attributes:
        value: V(q): (..., d) to (...).
        gradient: Its gradient: (..., d) to (..., d).
        curvature_limit: Largest eigenvalue of its Hessian on the zero set.
    """

    value: Callable[[Array], Array]
    gradient: Callable[[Array], Array]
    curvature_limit: float


def no_force(t_s: float, q: Array, v: Array) -> Array:  # noqa: ARG001
    """Theta = 0."""
    return np.zeros(1)


@dataclass(frozen=True, eq=False, kw_only=True)
class PenalisedModel:
    """System, penalty, Rayleigh damping and generalised forces: equation 7.

    Attributes:
        system: The natural system.
        penalty: V.
        strength: 1/eps^2 in J; a number, or an array that broadcasts to the batch (...).
        damping: (d, d) symmetric matrix D of Rayleigh's function v^T D v / 2, or 0.
        external: Theta(t, q, v): (..., d).
    """

    system: LagrangianSystem
    penalty: Penalty
    strength: Array | float
    damping: Array | float = 0.0
    external: Callable[[float, Array, Array], Array] = no_force

    def __post_init__(self) -> None:
        """Check strength and damping."""
        strength = np.asarray(self.strength, dtype=np.float64)
        if not (np.isfinite(strength).all() and (strength >= 0.0).all()):
            raise ValueError(f"strength (1/eps^2) must be finite and at least 0, but is {self.strength!r}")
        d = self.system.dimension
        damping = np.asarray(self.damping, dtype=np.float64)
        if damping.shape not in ((), (d, d)) or (damping.ndim == 0 and damping != 0.0):
            raise ValueError(f"damping must be 0 or a ({d}, {d}) matrix, but has shape {damping.shape}")
        if damping.ndim and not np.allclose(damping, damping.T):
            raise ValueError("damping must be symmetric: it is the matrix of Rayleigh's function v^T D v / 2")
        object.__setattr__(self, "strength", strength)
        object.__setattr__(self, "damping", damping)

    def acceleration(self, t_s: float, q: Array, v: Array) -> Array:
        """A from M a = force - (1/eps^2) dV/dq - D v + Theta: (..., d)."""
        total = self.system.force(q, v) - np.asarray(self.strength)[..., None] * self.penalty.gradient(q)
        if np.ndim(self.damping):
            total -= v @ np.asarray(self.damping).T
        if self.external is not no_force:
            total = total + self.external(t_s, q, v)
        return self.system.solve(q, total)

    def energy(self, q: Array, v: Array) -> Array:
        """T + U + (1/eps^2) V in J: (...); constant without damping and Theta."""
        return self.system.kinetic(q, v) + self.system.potential(q) + self.strength * self.penalty.value(q)
