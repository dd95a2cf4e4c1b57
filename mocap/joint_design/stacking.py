"""Members one above the other: which must lie higher, because it sweeps over another's post."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import networkx as nx
import numpy as np

from eal.arrays import Array
from eal.joint_design import Truss
from mocap.joint_design.flexure import MM, Flexure, Printing
from mocap.joint_design.material import MakeError

PLAY_M = 0.5 * MM
"""Distance kept between a member and a post that it passes, and between layers."""


@dataclass(frozen=True, kw_only=True)
class Stack:
    """The order of members.

    Attributes:
        order: Members from the lowest to the highest.
        hanging: Members whose posts hang from a top plate; those of the others stand on the base.
    """

    order: tuple[int, ...]
    hanging: frozenset[int]


def stacked(truss: Truss, flexures: Sequence[Flexure], region_m: Array, printing: Printing) -> Stack:
    """An order in which no member meets another's post, with as few hanging posts as possible.

    A post ends at its member. A member that somewhere in the region comes over the place of another's post must lie
    above that member where the post stands, below where it hangs.

    Args:
        truss: Without internal nodes.
        flexures: Its members.
        region_m: (n, 2) positions of the moving point.
        printing: Sizes of eyes and posts.

    Raises:
        MakeError: three or more members sweep over each other's posts.
    """
    sweeps = _sweeps(truss, flexures, region_m, printing)
    m = len(flexures)
    mutual = [(i, j) for i, j in sweeps if i < j and (j, i) in sweeps]
    needed = {k for pair in mutual for k in pair}
    for count in range(m + 1):
        for hanging in combinations(sorted(needed) if mutual else range(m), count):
            above: nx.DiGraph = nx.DiGraph()
            above.add_nodes_from(range(m))
            above.add_edges_from((i, j) if j in hanging else (j, i) for i, j in sweeps)
            if nx.is_directed_acyclic_graph(above):
                order = tuple(nx.lexicographical_topological_sort(above))
                return Stack(order=order, hanging=frozenset(hanging))
    names = ", ".join(str(k + 1) for k in sorted(needed or {k for pair in sweeps for k in pair}))
    raise MakeError(
        f"members {names} sweep over each other's posts: they cannot be stacked; narrow them with a smaller "
        "`width_mm`, ask for fewer `members`, or take another `seed`"
    )


def _sweeps(truss: Truss, flexures: Sequence[Flexure], region_m: Array, printing: Printing) -> set[tuple[int, int]]:
    """Pairs (i, j): member i comes over the place of member j's post."""
    posts = truss.fixed_m[truss.ends[:, 0]]
    near = clearance(truss, flexures, region_m, printing, posts) < printing.eye_m + PLAY_M
    return {(i, j) for i, j in np.argwhere(near).tolist() if i != j}


def clearance(truss: Truss, flexures: Sequence[Flexure], region_m: Array, printing: Printing, places_m: Array) -> Array:
    """(m, P) least distance of each member, wherever the point is, from (P, 2) places; negative where it covers one."""
    found = np.empty((len(flexures), len(places_m)))
    for i, flexure in enumerate(flexures):
        way = truss.fixed_m[truss.ends[i, 0]] - region_m
        length = np.linalg.norm(way, axis=1, keepdims=True)
        inner, outer = (region_m + way / length * end for end in flexure.slot_ends_m(length))
        spring = (flexure.width_m + flexure.thickness_m) / 2
        for k, place in enumerate(places_m):
            meander = float(_distance(region_m, inner, place).min()) - spring
            found[i, k] = min(meander, float(_distance(inner, outer, place).min()) - printing.eye_m)
    return found


def _distance(start: Array, end: Array, point: Array) -> Array:
    """(n,) distances of a point from segments."""
    way = end - start
    squared = np.maximum(np.einsum("nd,nd->n", way, way), 1e-30)
    share = np.clip(np.einsum("nd,nd->n", point - start, way) / squared, 0.0, 1.0)
    return np.linalg.norm(start + share[:, None] * way - point, axis=1)
