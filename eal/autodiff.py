"""Equations of motion from energies, by automatic differentiation (JAX, in double precision)."""

from collections.abc import Callable
from typing import Any

import numpy as np

from eal.arrays import Array
from eal.lagrangian import LagrangianSystem
from eal.optional_jax import jax, jnp

Energy = Callable[..., Any]


def system_from_energies(
    kinetic: Energy, potential: Energy, *, names: tuple[str, ...], units: tuple[str, ...], name: str = "from energies"
) -> LagrangianSystem:
    """A Lagrangian system from T(q, v) and U(q) of one configuration, written with ``jax.numpy``.

    Args:
        kinetic: T(q, v) in J from (d,) arrays, quadratic in v (a natural system).
        potential: U(q) in J.
        names: d coordinate names.
        units: d units.
        name: What it is.

    Returns:
        The system; its functions take and give NumPy arrays (..., d).

    Raises:
        ValueError: T is not v^T M(q) v / 2 at a test point: the system is not natural.
    """
    d = len(names)

    def batched(function: Energy) -> Callable[..., Array]:
        compiled = jax.jit(jax.vmap(function))

        def call(*arrays: Array) -> Array:
            same = np.broadcast_arrays(*arrays)
            lead = same[0].shape[:-1]
            with jax.enable_x64(True):
                result = np.asarray(compiled(*(np.asarray(a, dtype=np.float64).reshape(-1, d) for a in same)))
            return result.reshape(lead + result.shape[1:])

        return call

    def force(q: Any, v: Any) -> Any:
        """DT/dq - (d2T/dv dq) v - dU/dq: what M a equals (Coriolis terms and gravity)."""
        _, along = jax.jvp(lambda x: jax.grad(kinetic, argnums=1)(x, v), (q,), (v,))
        return jax.grad(lambda x: kinetic(x, v) - potential(x))(q) - along

    mass = batched(lambda q: jax.hessian(kinetic, argnums=1)(q, jnp.zeros(d)))
    energy = batched(kinetic)
    q, v = np.linspace(0.3, 0.7, d), np.linspace(-0.5, 0.8, d)
    natural = 0.5 * v @ mass(q) @ v
    if not np.isclose(energy(q, v), natural, rtol=1e-9, atol=1e-12) or energy(q, np.zeros(d)) != 0.0:
        raise ValueError(
            f"the kinetic energy must be v^T M(q) v / 2, but is {float(energy(q, v)):g} J at a test point where that "
            f"is {natural:g} J: linear or constant parts in v are not a natural system"
        )
    return LagrangianSystem(
        name=name,
        names=names,
        units=units,
        kinetic=energy,
        potential=batched(potential),
        mass=mass,
        force=batched(force),
        solve=lambda q, f: np.asarray(np.linalg.solve(mass(q), f[..., None])[..., 0], dtype=np.float64),
    )
