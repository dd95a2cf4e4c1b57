"""Members one above the other: which must lie higher, because it sweeps over another's post."""

from collections.abc import Sequence

import networkx as nx
import numpy as np

from app.joint_design.flexure import MM, Flexure, Printing
from app.joint_design.material import MakeError
from eal.arrays import Array
from eal.joint_design import Truss

PLAY_M = 0.5 * MM
"""Distance kept between a member and a post that it passes, and between layers."""


def layers(truss: Truss, flexures: Sequence[Flexure], region_m: Array, printing: Printing) -> list[int]:
    """Members from the lowest to the highest.

    A post carries its member and ends there; a member that somewhere in the region comes over the place of another's
    post must lie above that member.

    Args:
        truss: Without internal nodes.
        flexures: Its members.
        region_m: (n, 2) positions of the moving point.
        printing: Sizes of eyes and posts.

    Returns:
        Indices of members.

    Raises:
        MakeError: members sweep over each other's posts.
    """
    m = len(flexures)
    above: nx.DiGraph = nx.DiGraph()
    above.add_nodes_from(range(m))
    anchors = truss.fixed_m[truss.ends[:, 0]]
    for i, flexure in enumerate(flexures):
        half = max((flexure.width_m + flexure.thickness_m) / 2, printing.eye_m)
        behind = _far_ends(anchors[i], region_m, flexure)
        for j in range(m):
            if i != j and _distance(region_m, behind, anchors[j]).min() < half + printing.eye_m + PLAY_M:
                above.add_edge(j, i)
    try:
        return list(nx.lexicographical_topological_sort(above))
    except nx.NetworkXUnfeasible:
        loop = " and ".join(str(a + 1) for a, _ in nx.find_cycle(above))
        raise MakeError(
            f"members {loop} sweep over each other's posts: they cannot be stacked; narrow them with a smaller "
            "--width-mm, ask for fewer --members, or take another --seed"
        ) from None


def _far_ends(anchor_m: Array, region_m: Array, flexure: Flexure) -> Array:
    """(n, 2) ends of the member: its post, or behind it the end of a slot that slid back."""
    way = anchor_m - region_m
    length = np.linalg.norm(way, axis=1, keepdims=True)
    return region_m + way * np.where(flexure.slot_m > 0.0, np.maximum(flexure.rest_m / length, 1.0), 1.0)


def _distance(start: Array, end: Array, point: Array) -> Array:
    """(n,) distances of a point from segments."""
    way = end - start
    share = np.clip(np.einsum("nd,nd->n", point - start, way) / np.einsum("nd,nd->n", way, way), 0.0, 1.0)
    return np.linalg.norm(start + share[:, None] * way - point, axis=1)
