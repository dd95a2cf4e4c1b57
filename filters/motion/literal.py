"""The EAL model to the letter of the paper: V_z as a force, integrated with substeps."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array as Exact
from eal.integrators import StabilityError, verlet_step
from eal.lagrangian import Penalty
from filters.ensemble import Gaussian
from filters.motion.shape import ShapeMechanics, unscented_flow
from mocap.arrays import Array

REACH = 0.5
"""Most omega h of a substep, omega the fastest oscillation. Verlet's limit is 2; at 0.5 the frequency of that one is
off by (omega h)^2 / 24 = 1 %, its energy swings by (omega h)^2 / 4 = 6 % and does not drift (Hairer et al. 2003)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LiteralShape(ShapeMechanics):
    """zddot = f(z, zdot) - (1/eps^2) grad V_z(z): EAL paper, equation 7, with unit mass and a known force f.

    Kept beside ``enforce`` as what the paper states. The potential ends at 1, so its force dies far from the samples,
    and what it contains has kinetic energy below 1/eps^2: V(z(t)) <= V(z(0)) + eps^2 T(0) (theorem 3).

    Attributes:
        potential: V_z of z over ``unit``.
        unit: Metres of shape in a unit of the samples.
        strength: 1/eps^2 in m^2/s^2: energy over mass.
        density: See ``ShapeMechanics``.
        known: (S, 2r) states to (S, r) known accelerations; None: none.
        known_rad_s: Fastest rate of the known accelerations.
        most_substeps: More are refused.
    """

    potential: Penalty
    unit: float
    strength: float
    density: Array
    known: Callable[[Array], Array] | None = None
    known_rad_s: float = 0.0
    most_substeps: int = 500

    @property
    def fastest_rad_s(self) -> float:
        """Largest angular frequency of oscillations about the samples: sqrt(V'' / eps^2), with that of the force."""
        return float(np.hypot(np.sqrt(self.strength * self.potential.curvature_limit) / self.unit, self.known_rad_s))

    def substeps(self, dt_s: float) -> int:
        """Number of substeps that keep omega h below ``REACH``.

        Raises:
            StabilityError: that are more than ``most_substeps``.
        """
        needed = max(1, int(np.ceil(dt_s * self.fastest_rad_s / REACH)))
        if needed > self.most_substeps:
            raise StabilityError(
                f"the force of V_z oscillates with {self.fastest_rad_s:.3g} rad/s and needs {needed} substeps in "
                f"{dt_s:g} s, more than {self.most_substeps}: lower weight, or enforce the potential implicitly"
            )
        return needed

    def energy(self, states: Array) -> Array:
        """(S, 2r) states to (S,) kinetic energy plus penalty, over mass, in m^2/s^2: kept without a known force."""
        z, rate = np.split(np.asarray(states, dtype=np.float64), 2, axis=1)
        return 0.5 * np.sum(rate**2, axis=1) + self.strength * self.potential.value(z / self.unit)

    def linearised(self, state: Gaussian, dt_s: float) -> tuple[Array, Array, Array]:
        """Velocity Verlet, which keeps energy, of the unscented transform's points, read as a linear map."""
        return unscented_flow(state, lambda x: self.flow(x, dt_s))

    def flow(self, states: Array, dt_s: float) -> Array:
        """(S, 2r) states to (S, 2r) states ``dt_s`` later."""
        z, rate = np.split(np.asarray(states, dtype=np.float64), 2, axis=1)
        n = self.substeps(dt_s)
        for i in range(n):
            z, rate = verlet_step(
                self._acceleration, i * dt_s / n, z, rate, dt_s / n, velocity_iterations=1 if self.known is None else 2
            )
        return np.concatenate([z, rate], axis=1)

    def _acceleration(self, _t_s: float, z: Exact, rate: Exact) -> Exact:
        force = -self.strength / self.unit * self.potential.gradient(z / self.unit)
        if self.known is not None:
            force = force + np.asarray(self.known(np.concatenate([z, rate], axis=1)), dtype=np.float64)
        return force
