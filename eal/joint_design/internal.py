"""Internal nodes: a member opened in its middle and braced, and members that cross."""

from dataclasses import replace

import numpy as np

from eal.arrays import Array
from eal.joint_design.errors import Law, Mask
from eal.joint_design.path import over_grid
from eal.joint_design.target import Target
from eal.joint_design.truss import Truss

_BRACE = 0.3
"""Stiffness of a new brace over that of the member that it holds."""


def with_internal_node(truss: Truss, target: Target, rng: np.random.Generator) -> Truss:
    """A member to the moving point in two halves of twice its stiffness, their joint braced to another fixed node.

    Only where the brace pulls sideways does the energy change much: two halves in series are as stiff as the whole.

    Args:
        truss: A truss with at least two members to the moving point.
        target: The region; its deepest point is where the brace is at rest.
        rng: Chooses the member, by stiffness, and the brace.
    """
    direct = [i for i, (a, b) in enumerate(truss.ends) if a < truss.moving and b == truss.moving]
    weight = truss.stiffness_n_m[direct] + 1e-12
    opened = int(rng.choice(direct, p=weight / weight.sum()))
    anchor = int(truss.ends[opened, 0])
    brace = int(rng.choice([a for a in range(truss.moving) if a != anchor]))
    deepest = target.q[np.argmin(target.v)]
    place = 0.5 * (truss.fixed_m[anchor] + deepest)
    node = truss.moving + 1 + len(truss.internal_m)
    ends, rest, stiffness = (np.array(part) for part in (truss.ends, truss.rest_m, truss.stiffness_n_m))
    ends[opened] = (anchor, node)
    rest[opened] *= 0.5
    stiffness[opened] *= 2.0
    law: Law = "linear" if truss.laws[opened] in ("cable", "strut") else truss.laws[opened]
    laws = tuple(law if i == opened else name for i, name in enumerate(truss.laws))
    return replace(
        truss,
        internal_m=np.concatenate([truss.internal_m, place[None]]),
        ends=np.concatenate([ends, [[node, truss.moving], [brace, node]]]),
        rest_m=np.append(rest, [rest[opened], np.linalg.norm(truss.fixed_m[brace] - place)]),
        stiffness_n_m=np.append(stiffness, [stiffness[opened], _BRACE * stiffness[opened]]),
        laws=(*laws, laws[opened], "linear"),
    )


def crossings(truss: Truss, target: Target) -> int:
    """Pairs of members that cross at some point of the region; members of one node, and those in space, do not."""
    if truss.dimension != 2 or not truss.internal_m.size:
        return 0
    states = over_grid(truss, target)
    inside = target.inside
    q, x = states.q_m[inside], states.x_m[inside]
    nodes = np.concatenate([np.broadcast_to(truss.fixed_m, (len(q), *truss.fixed_m.shape)), q[:, None], x], axis=1)
    count = 0
    for i, (a, b) in enumerate(truss.ends):
        for c, d in truss.ends[:i]:
            if len({a, b, c, d}) == 4:
                count += bool(_cross(nodes[:, a], nodes[:, b], nodes[:, c], nodes[:, d]).any())
    return count


def _cross(a: Array, b: Array, c: Array, d: Array) -> Mask:
    """(n,) whether segments a-b and c-d cross: each separates the other's ends."""

    def side(p: Array, q: Array, r: Array) -> Array:
        u, w = q - p, r - p
        return u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]

    return (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
