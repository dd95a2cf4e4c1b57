"""Internal nodes in equilibrium: the energy of a truss as a function of its moving point alone.

U(q) = E(q, x*(q)) with dE/dx = 0 and d2E/dx2 positive at x*. By the envelope theorem dU/dq = dE/dq, and the stiffness
is the Schur complement E_qq - E_qx E_xx^-1 E_xq.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from eal.arrays import Array
from eal.joint_design.laws import Mask
from eal.joint_design.truss import Truss, member_lengths, truss_energy
from eal.optional_jax import jax, jnp

TOLERANCE = 1e-9
"""Largest Newton step over the largest rest length, at which an equilibrium counts as found. Chosen: Newton's
method squares errors, and the next step would be rounding."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Equilibria:
    """A truss at n positions of its moving point.

    Attributes:
        q_m: (n, d) moving point.
        x_m: (n, I, d) internal nodes.
        energy_j: (n,) U.
        force_n: (n, d) dU/dq: what holds the point there.
        stiffness_n_m: (n, d, d) d2U/dq2.
        stable: (n,) smallest eigenvalue of d2E/dx2 over the largest stiffness; infinite without internal nodes.
        stretch: (n, m) l / L of every member.
        found: (n,) whether the internal nodes are in equilibrium.
    """

    q_m: Array
    x_m: Array
    energy_j: Array
    force_n: Array
    stiffness_n_m: Array
    stable: Array
    stretch: Array
    found: Mask


def equilibria(truss: Truss, q_m: Array, x_m: Array | None = None) -> Equilibria:
    """Internal nodes at rest, each position from its own start.

    Args:
        truss: The truss.
        q_m: (n, d) moving point.
        x_m: (n, I, d) starts; None: ``truss.internal_m``.
    """
    q = np.asarray(q_m, dtype=np.float64).reshape(-1, truss.dimension)
    start = np.broadcast_to(truss.internal_m if x_m is None else x_m, (len(q), *truss.internal_m.shape))
    n, m = len(q), len(truss.rest_m)
    full = truss.padded(-(-m // 12) * 12, -(-truss.moving // 12) * 12)  # multiples of 12: few shapes are compiled
    with jax.enable_x64(True):
        found = _solver(_filled(q), _filled(start), full.parameters())
    x, energy, force, stiffness, stable, stretch, step = (np.asarray(part)[:n] for part in found)
    return Equilibria(
        q_m=q,
        x_m=x,
        energy_j=energy,
        force_n=force,
        stiffness_n_m=stiffness,
        stable=stable,
        stretch=stretch[:, :m],
        found=step <= TOLERANCE * truss.rest_m.max(),
    )


def _filled(rows: Array) -> Array:
    """Rows up to the next of 16, 64, 256, ..."""
    count = 16  # 16, 64, 256, ...
    while count < len(rows):
        count *= 4
    return np.concatenate([rows, np.repeat(rows[-1:], count - len(rows), axis=0)])


def descend(q: Any, x0: Any, p: dict[str, Any]) -> tuple[Any, Any]:
    """Newton's method with |eigenvalues| (Dauphin et al. 2014) and halved steps: down to a minimum, not to a saddle.

    Args:
        q: (d,) moving point.
        x0: (I, d) start.
        p: As ``Truss.parameters`` gives.

    Returns:
        (I, d) internal nodes, and the length of the last step.
    """
    if x0.size == 0:
        return x0, jnp.zeros(())
    longest = 0.3 * jnp.max(p["rest"])
    floor = 1e-7 * jnp.max(p["stiffness"])

    def energy(flat: Any) -> Any:
        return truss_energy(q, flat.reshape(x0.shape), p)

    def newton(state: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        flat, _, count = state
        values, vectors = jnp.linalg.eigh(jax.hessian(energy)(flat))
        step = -vectors @ ((vectors.T @ jax.grad(energy)(flat)) / jnp.maximum(jnp.abs(values), floor))
        step = step * jnp.minimum(1.0, longest / (jnp.linalg.norm(step) + 1e-300))
        shares = 0.5 ** jnp.arange(12)
        tried = jax.vmap(lambda share: energy(flat + share * step))(shares)
        rounding = 1e-14 * jnp.abs(energy(flat))
        share = shares[jnp.argmax(tried <= energy(flat) + rounding)]
        return flat + share * step, jnp.linalg.norm(step), count + 1

    def going(state: tuple[Any, Any, Any]) -> Any:
        return (state[1] > 0.1 * TOLERANCE * jnp.max(p["rest"])) & (state[2] < 60)

    flat, step, _ = jax.lax.while_loop(going, newton, (x0.reshape(-1), jnp.asarray(jnp.inf), 0))
    return flat.reshape(x0.shape), step


def _state(q: Any, x0: Any, p: dict[str, Any]) -> tuple[Any, ...]:
    x, step = descend(q, x0, p)
    flat = x.reshape(-1)

    def energy(position: Any, inner: Any) -> Any:
        return truss_energy(position, inner.reshape(x0.shape), p)

    force = jax.grad(energy)(q, flat)
    stiffness = jax.hessian(energy)(q, flat)
    stable = jnp.asarray(jnp.inf)
    if x0.size:
        inner = jax.hessian(energy, argnums=1)(q, flat)
        mixed = jax.jacfwd(jax.grad(energy, argnums=1))(q, flat)
        stiffness = stiffness - mixed.T @ jnp.linalg.solve(inner, mixed)
        stable = jnp.linalg.eigvalsh(inner)[0] / jnp.max(p["stiffness"])
    return x, energy(q, flat), force, stiffness, stable, member_lengths(q, x, p) / p["rest"], step


_solver = jax.jit(jax.vmap(_state, in_axes=(0, 0, None)))
