"""RATTLE: constraints with multipliers, order 2, symplectic (Andersen 1983; Hairer, Lubich and Wanner, VII.1)."""

from collections.abc import Callable

import numpy as np

from eal.arrays import Array
from eal.constraints import Constraint, inverse_mass_rows
from eal.integrators.midpoint import IntegrationError
from eal.lagrangian import LagrangianSystem

Step = Callable[[Callable[[float, Array, Array], Array], float, Array, Array, float], tuple[Array, Array]]


def rattle_step(system: LagrangianSystem, constraint: Constraint, *, iterations: int = 50) -> Step:
    """A step for ``integrate`` that keeps phi(q) = 0 and G v = 0 to rounding.

    v' = v + (h/2) M^-1 (f - G^T mu) with mu such that phi(q + h v') = 0, then the same with f and G at the new
    configuration and the multiplier such that G v = 0. The mass must not depend on q.

    Args:
        system: Gives mass and solve.
        constraint: phi.
        iterations: Most Newton iterations for mu.

    Returns:
        step(acceleration, t, q, v, h), where the acceleration is the unconstrained one.

    Raises:
        ValueError: at the first step, where the mass depends on the configuration.
        IntegrationError: at a step, where mu was not found.
    """

    def step(
        acceleration: Callable[[float, Array, Array], Array], t_s: float, q: Array, v: Array, h_s: float
    ) -> tuple[Array, Array]:
        if t_s == 0.0 and not np.allclose(system.mass(q), system.mass(q + 0.1)):
            raise ValueError(
                f"RATTLE needs a constant mass matrix, but that of the {system.name} depends on the configuration: "
                "use Cartesian coordinates, or constrained_acceleration with rk4_step"
            )
        jacobian = constraint.jacobian(q)
        spread = inverse_mass_rows(system, q, jacobian)
        half = v + 0.5 * h_s * acceleration(t_s, q, v)
        for _ in range(iterations):
            q_new = q + h_s * half
            residual = constraint.value(q_new)
            if np.abs(residual).max() <= 4e-16:
                break
            core = constraint.jacobian(q_new) @ spread.swapaxes(-1, -2)
            push = np.linalg.solve(core, residual[..., None])[..., 0] / h_s
            half = half - np.einsum("...ci,...c->...i", spread, push)
            if np.abs(h_s * push).max() <= 1e-16:
                break
        else:
            raise IntegrationError(f"RATTLE: no multiplier found at t = {t_s:g} s: take a smaller step than {h_s:g} s")
        q_new = q + h_s * half
        free = half + 0.5 * h_s * acceleration(t_s + h_s, q_new, half)
        jacobian = constraint.jacobian(q_new)
        spread = inverse_mass_rows(system, q_new, jacobian)
        normal = np.einsum("...ci,...i->...c", jacobian, free)
        push = np.linalg.solve(jacobian @ spread.swapaxes(-1, -2), normal[..., None])[..., 0]
        return q_new, free - np.einsum("...ci,...c->...i", spread, push)

    return step
