"""Positions of nodes, rest lengths and stiffnesses refined together under the limits, by nonlinear least squares."""

from dataclasses import asdict, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from eal.arrays import Array
from eal.joint_design.equilibrium import descend
from eal.joint_design.laws import pulls, pushes
from eal.joint_design.target import Limits, Target
from eal.joint_design.truss import Truss, member_lengths, truss_energy
from eal.optional_jax import jax, jnp


def refine(
    target: Target,
    truss: Truss,
    stored: float,
    limits: Limits,
    *,
    mirror: Array | None = None,
    evaluations: int = 60,
) -> tuple[Truss, float]:
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

    Returns:
        The truss, in the target's unit of length, and its energy at V = 0, less which it is compared with V.
    """
    inside = target.inside
    m, nodes = len(truss.rest_m), truss.moving
    full = truss.padded(limits.members, limits.members)
    start = np.concatenate(
        [
            _parted(full.fixed_m, 1e-3 * limits.spacing).ravel(),
            np.log(full.rest_m),
            np.log(np.maximum(full.stiffness_n_m, 1e-30)),
            [np.sqrt(max(stored, 0.0))],
        ]
    )
    tie = _tie(truss, limits.members, mirror)
    theta = np.linalg.lstsq(tie, start, rcond=None)[0]
    base = np.where(tie.any(axis=1), 0.0, start)
    positions = {"inside": target.q[inside], "outside": target.q[~inside]}
    x = {name: np.broadcast_to(full.internal_m, (len(q), *full.internal_m.shape)) for name, q in positions.items()}
    with jax.enable_x64(True):
        names = ("shortest", "longest", "reach", "contraction", "extension", "spacing", "prestress")
        data = {
            **positions,
            "v": target.v[inside],
            "level": target.level,
            "limits": {name: value for name, value in asdict(limits).items() if name in names},
            "base": base,
            "tie": tie,
            "real": np.arange(limits.members) < m,
            "pushes": pushes(full.laws),
            "pulls": pulls(full.laws),
            "real_node": np.arange(limits.members) < nodes,
            **{name: full.parameters()[name] for name in ("start", "end", "law")},
        }
        data = jax.tree.map(jnp.asarray, data)
        residual, jacobian, settle = _compiled((full.moving, full.dimension, limits.members))

        def settled(function: Any, values: Array) -> Array:
            if full.internal_m.size:
                x.update(settle(values, x["inside"], x["outside"], data))
            return np.asarray(function(values, x["inside"], x["outside"], data))

        found = least_squares(
            lambda values: settled(residual, values),
            theta,
            jac=lambda values: settled(jacobian, values),  # pyright: ignore[reportArgumentType]
            method="trf",
            max_nfev=evaluations,
            ftol=1e-5,
            xtol=1e-6,
        )
    fixed, log_rest, log_k, root = _split(tie @ found.x + base, (full.moving, full.dimension, limits.members))
    refined = replace(
        truss,
        fixed_m=np.asarray(fixed)[:nodes],
        rest_m=np.exp(log_rest)[:m],
        stiffness_n_m=np.exp(log_k)[:m],
    )
    return refined, float(root**2)


def _parted(nodes: Array, distance: float) -> Array:
    """Nodes moved a little, each another way, so that two that coincide can go apart."""
    angle = 2.399963 * np.arange(len(nodes))  # the golden angle
    away = np.zeros_like(nodes)
    away[:, 0], away[:, 1] = np.cos(angle), np.sin(angle)
    return nodes + distance * away


def _split(y: Any, shape: tuple[int, int, int]) -> tuple[Any, Any, Any, Any]:
    nodes, d, m = shape
    at = nodes * d
    return y[:at].reshape(nodes, d), y[at : at + m], y[at + m : at + 2 * m], y[-1]


def _tie(truss: Truss, members: int, mirror: Array | None) -> Array:
    """The linear map from free numbers to (nodes, logs of rest lengths and of stiffnesses, root of c), all padded.

    Idle members and nodes have zero rows, what is not needed zero columns: all designs have one shape.
    """
    nodes, d, m = truss.moving, truss.dimension, len(truss.rest_m)
    at = members * d
    total = np.zeros((at + 2 * members + 1,) * 2)
    total[-1, -1] = 1.0
    if mirror is None:
        for first, count in ((0, nodes * d), (at, m), (at + members, m)):
            rows = np.arange(first, first + count)
            total[rows, rows] = 1.0
        return total
    half = m // 2
    for first in (at, at + members):
        for row in range(m):
            total[first + row, first + row % half] = 1.0
    for row in range(m):
        block = np.eye(d) if row < half else mirror.T
        total[row * d : (row + 1) * d, (row % half) * d : (row % half + 1) * d] = block
    return total


@lru_cache(maxsize=32)
def _compiled(shape: tuple[int, int, int]) -> tuple[Any, Any, Any]:
    """Residuals, their derivative and the internal nodes of one shape of truss."""

    def parameters(theta: Any, data: Any) -> tuple[dict[str, Any], Any]:
        fixed, log_rest, log_k, root = _split(data["tie"] @ theta + data["base"], shape)
        p = {"fixed": fixed, "rest": jnp.exp(log_rest), "stiffness": jnp.exp(log_k)}
        return p | {name: data[name] for name in ("start", "end", "law")}, root

    def residual(theta: Any, x_inside: Any, x_outside: Any, data: Any) -> Any:
        p, root = parameters(theta, data)
        # the internal nodes are held: the energy needs no derivative of theirs (envelope theorem); in those of lengths
        # at internal nodes it is left out
        energy = jax.vmap(truss_energy, (0, 0, None))
        off = energy(data["inside"], x_inside, p) - root**2 - data["v"]
        low = energy(data["outside"], x_outside, p) - root**2 - data["level"]
        points = jnp.concatenate([off, jnp.minimum(low, 0.0)]) / jnp.sqrt(len(data["v"]))
        lengths = jax.vmap(member_lengths, (0, 0, None))(data["inside"], x_inside, p)
        # a limit broken by its own size weighs 3; kept by 1 % so that a finer grid breaks none
        room = 3.0 * jnp.maximum(excess(lengths, p, data) + 0.01, 0.0)
        return jnp.concatenate([points, room, data["limits"]["prestress"] * root[None]])

    def excess(lengths: Any, p: dict[str, Any], data: Any) -> Any:
        """What ``eal.joint_design.target.broken`` says, for all members and nodes that are real."""
        limits, real = data["limits"], data["real"]
        least, most = lengths.min(axis=0), lengths.max(axis=0)
        members = [
            1.0 - least / limits["shortest"],
            most / limits["longest"] - 1.0,
            jnp.where(data["pushes"], 1.0 - limits["contraction"] - least / p["rest"], -1.0),
            jnp.where(data["pulls"], most / p["rest"] - 1.0 - limits["extension"], -1.0),
        ]
        away = jnp.sqrt(jnp.sum(p["fixed"] ** 2, axis=1) + 1e-24) / limits["reach"] - 1.0
        apart = p["fixed"][:, None] - p["fixed"]
        distance = jnp.sqrt(jnp.sum(apart * apart, axis=-1) + 1e-24)
        pair = jnp.triu(data["real_node"][:, None] & data["real_node"], 1)
        close = 1.0 - distance / jnp.maximum(limits["spacing"], 1e-12)
        return jnp.concatenate(
            [
                *(jnp.where(real, part, -1.0) for part in members),
                jnp.where(data["real_node"], away, -1.0),
                jnp.where(pair, close, -1.0).reshape(-1),
            ]
        )

    def settle(theta: Any, x_inside: Any, x_outside: Any, data: Any) -> dict[str, Any]:
        p, _ = parameters(theta, data)
        down = jax.vmap(lambda q, x: descend(q, x, p)[0])
        return {"inside": down(data["inside"], x_inside), "outside": down(data["outside"], x_outside)}

    return jax.jit(residual), jax.jit(jax.jacfwd(residual)), jax.jit(settle)
