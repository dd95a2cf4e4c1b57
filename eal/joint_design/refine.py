"""Positions of nodes, rest lengths and stiffnesses refined together under the limits, by nonlinear least squares."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from eal.arrays import Array
from eal.joint_design.equilibrium import descend
from eal.joint_design.limits import Limits
from eal.joint_design.target import Target
from eal.joint_design.truss import Truss, member_lengths, truss_energy

STRICT = 3.0
"""Weight of a limit that is broken by its own size, beside a difference of 1 in all of the region."""

_INSET = 0.01
"""Limits are kept by this share in the fit, so that a finer grid breaks none of them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Refined:
    """A refined truss.

    Attributes:
        truss: In the target's unit of length; its energy less ``stored`` is compared with V.
        stored: Energy at V = 0.
        cost: Sum of squares at the end.
    """

    truss: Truss
    stored: float
    cost: float


def refine(
    target: Target,
    truss: Truss,
    stored: float,
    limits: Limits,
    *,
    mirror: Array | None = None,
    evaluations: int = 60,
    progress: Callable[[], None] | None = None,
) -> Refined:
    """Minimise the differences between energy and potential, with the limits as steep penalties.

    Residuals: U - c - V inside the region and min(U - c - level, 0) outside, both over the square root of the points
    inside; the excesses over the limits; and the square root of the energy stored at V = 0.

    Args:
        target: The potential.
        truss: Start.
        stored: Start of c.
        limits: Limits.
        mirror: Members i and i + m/2 are images of each other under this (d, d) reflection, and stay so; no internal
            nodes.
        evaluations: Most evaluations of the residuals.
        progress: Called at each of them.
    """
    tie = _tie(truss, mirror)
    start = np.concatenate(
        [
            truss.fixed_m.ravel(),
            np.log(truss.rest_m),
            np.log(np.maximum(truss.stiffness_n_m, 1e-12)),
            [np.sqrt(max(stored, 0))],
        ]
    )
    theta = np.linalg.lstsq(tie, start, rcond=None)[0]
    inside = target.inside
    with jax.enable_x64(True):
        data = {
            "inside": jnp.asarray(target.q[inside]),
            "v": jnp.asarray(target.v[inside]),
            "outside": jnp.asarray(target.q[~inside]),
            "level": target.level,
            "limits": {
                name: getattr(limits, name)
                for name in ("shortest", "longest", "reach", "contraction", "extension", "prestress")
            },
            "start": jnp.asarray(truss.ends[:, 0]),
            "end": jnp.asarray(truss.ends[:, 1]),
            "law": jnp.asarray(truss.parameters()["law"]),
            "tie": jnp.asarray(tie),
        }
        shape = (len(truss.fixed_m), truss.dimension, len(truss.rest_m))
        residual, jacobian, settle = _compiled(shape)
        # where internal nodes rest, carried from one evaluation to the next
        x = {
            "inside": np.broadcast_to(truss.internal_m, (int(inside.sum()), *truss.internal_m.shape)),
            "outside": np.broadcast_to(truss.internal_m, (int((~inside).sum()), *truss.internal_m.shape)),
        }

        def settled(function: Any, values: Array) -> Array:
            if truss.internal_m.size:
                x.update(settle(values, x["inside"], x["outside"], data))
            return np.asarray(function(values, x["inside"], x["outside"], data))

        def at(values: Array) -> Array:
            if progress is not None:
                progress()
            return settled(residual, values)

        found = least_squares(
            at,
            theta,
            jac=lambda values: settled(jacobian, values),  # pyright: ignore[reportArgumentType]
            method="trf",
            max_nfev=evaluations,
            ftol=1e-5,
            xtol=1e-6,
        )
    fixed, log_rest, log_k, root = _split(tie @ found.x, shape)
    refined = replace(truss, fixed_m=np.asarray(fixed), rest_m=np.exp(log_rest), stiffness_n_m=np.exp(log_k))
    return Refined(truss=refined, stored=float(root**2), cost=float(2.0 * found.cost))


def _split(y: Any, shape: tuple[int, int, int]) -> tuple[Any, Any, Any, Any]:
    nodes, d, m = shape
    at = nodes * d
    return y[:at].reshape(nodes, d), y[at : at + m], y[at + m : at + 2 * m], y[-1]


def _tie(truss: Truss, mirror: Array | None) -> Array:
    """The linear map from free numbers to all of (nodes, logs of rest lengths and of stiffnesses, root of c)."""
    nodes, d, m = len(truss.fixed_m), truss.dimension, len(truss.rest_m)
    if mirror is None:
        return np.eye(nodes * d + 2 * m + 1)
    half = m // 2
    place = np.kron(np.concatenate([np.eye(half), np.zeros((half, half))]), np.eye(d))
    place = place + np.kron(np.concatenate([np.zeros((half, half)), np.eye(half)]), mirror.T)
    twice = np.concatenate([np.eye(half), np.eye(half)])
    total = np.zeros((nodes * d + 2 * m + 1, half * (d + 2) + 1))
    total[: m * d, : half * d] = place
    total[m * d : m * d + m, half * d : half * d + half] = twice
    total[m * d + m : -1, half * d + half : -1] = twice
    total[-1, -1] = 1.0
    return total


@lru_cache(maxsize=32)
def _compiled(shape: tuple[int, int, int]) -> tuple[Any, Any, Any]:
    """Residuals, their derivative and the internal nodes of one shape of truss."""

    def parameters(theta: Any, data: Any) -> tuple[dict[str, Any], Any]:
        fixed, log_rest, log_k, root = _split(data["tie"] @ theta, shape)
        p = {"fixed": fixed, "rest": jnp.exp(log_rest), "stiffness": jnp.exp(log_k)}
        return p | {name: data[name] for name in ("start", "end", "law")}, root

    def settled(q: Any, x: Any, p: dict[str, Any]) -> Any:
        """x* with its derivative: one Newton step from where it is (Griewank and Walther 2008, section 15)."""
        if x.size == 0:
            return x

        def energy(flat: Any, p: dict[str, Any]) -> Any:
            return truss_energy(q, flat.reshape(x.shape), p)

        flat = jax.lax.stop_gradient(x.reshape(-1))
        hessian = jax.hessian(energy)(flat, jax.lax.stop_gradient(p)) + 1e-9 * jnp.eye(flat.size)
        return (flat - jnp.linalg.solve(hessian, jax.grad(energy)(flat, p))).reshape(x.shape)

    def residual(theta: Any, x_inside: Any, x_outside: Any, data: Any) -> Any:
        p, root = parameters(theta, data)
        c, limits, pushes = root**2, data["limits"], data["law"] != 2
        n = len(data["v"])
        x = jax.vmap(settled, (0, 0, None))(data["inside"], x_inside, p)
        # by the envelope theorem the energy needs no derivative of x
        energy = jax.vmap(truss_energy, (0, 0, None))
        off = energy(data["inside"], jax.lax.stop_gradient(x), p) - c - data["v"]
        low = energy(data["outside"], x_outside, p) - c - data["level"]
        lengths = jax.vmap(member_lengths, (0, 0, None))(data["inside"], x, p)
        least, most = lengths.min(axis=0), lengths.max(axis=0)
        excess = jnp.concatenate(
            [
                1.0 - least / limits["shortest"],
                most / limits["longest"] - 1.0,
                jnp.where(pushes, 1.0 - limits["contraction"] - least / p["rest"], -1.0),
                most / p["rest"] - 1.0 - limits["extension"],
                jnp.sqrt(jnp.sum(p["fixed"] ** 2, axis=1) + 1e-24) / limits["reach"] - 1.0,
            ]
        )
        parts = [off, jnp.minimum(low, 0.0)]
        held = [STRICT * jnp.maximum(excess + _INSET, 0.0), limits["prestress"] * root[None]]
        return jnp.concatenate([jnp.concatenate(parts) / jnp.sqrt(n), *held])

    def settle(theta: Any, x_inside: Any, x_outside: Any, data: Any) -> dict[str, Any]:
        p, _ = parameters(theta, data)
        down = jax.vmap(lambda q, x: descend(q, x, p)[0])
        return {"inside": down(data["inside"], x_inside), "outside": down(data["outside"], x_outside)}

    return jax.jit(residual), jax.jit(jax.jacfwd(residual)), jax.jit(settle)
