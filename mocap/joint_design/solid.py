"""The truss as parts to print: base with posts, one flat spring a member, and the moving pin; all in millimetres."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import networkx as nx
import numpy as np
from manifold3d import CrossSection, JoinType, Manifold, OpType

from eal.arrays import Array
from eal.joint_design import Truss
from mocap.joint_design.flexure import MM, ROOT_M, Flexure, MakeError, Printing

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
    # pairs (i, j): member i comes over the place of member j's post
    posts = truss.fixed_m[truss.ends[:, 0]]
    near = clearance(truss, flexures, region_m, printing, posts) < printing.eye_m + PLAY_M
    sweeps = {(i, j) for i, j in np.argwhere(near).tolist() if i != j}
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


PLATE_MM = 4.0  # thickness; this and what follows chosen, not measured
FOOT_RADIUS_MM = 8.0  # of the moving pin
FOOT_MM = 3.0  # its height
COLUMN_MM = 4.0
"""Radius of the columns that carry a top plate."""
_TIP_MM = 0.3  # by which a pin stands out of what it carries
ROUND = 48
"""Sides of a circle: its polygon is thinner by 1 - cos(pi / 48), 0.2 %."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PrintedPart:
    """One part to print.

    Attributes:
        name: ``base``, ``member_1``, ..., ``mover`` or ``top``.
        solid: As printed, lying on z = 0.
        outline: Of a member its plane shape; None of the others.
    """

    name: str
    solid: Manifold
    outline: CrossSection | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Kit:
    """All parts of a joint.

    Attributes:
        truss: At printed size.
        flexures: Its members.
        stack: Their order, and whose posts hang.
        printing: What they were made for.
        bottoms_mm: (m,) height of each member's lower face.
        parts: Base, members, mover, and a top where posts hang.
        top_mm: Height of the top's lower face.
    """

    truss: Truss
    flexures: Sequence[Flexure]
    stack: Stack
    printing: Printing
    bottoms_mm: Array
    parts: tuple[PrintedPart, ...]
    top_mm: float


def make_kit(truss: Truss, flexures: Sequence[Flexure], stack: Stack, region_m: Array, printing: Printing) -> Kit:
    """All parts.

    Args:
        truss: At printed size, without internal nodes.
        flexures: Its members.
        stack: Their order.
        region_m: (n, 2) where the moving point may be; the base reaches under all of it.
        printing: Sizes.
    """
    bottoms = np.zeros(len(flexures))
    height = PLATE_MM + FOOT_MM + PLAY_M / MM
    for i in stack.order:
        height += PLAY_M / MM
        bottoms[i] = height
        height += flexures[i].depth_m / MM
    members = [
        PrintedPart(name=f"member_{i + 1}", solid=Manifold.extrude(outline, flexure.depth_m / MM), outline=outline)
        for i, flexure in enumerate(flexures)
        for outline in [member_outline(flexure, flexure.rest_m, printing)]
    ]
    top = height + 2.0 * PLAY_M / MM
    posts = _posts(truss, flexures, bottoms, stack, top, printing)
    columns = _columns(truss, flexures, region_m, printing) if stack.hanging else np.empty((0, 2))
    corners = np.concatenate([truss.fixed_m / MM, region_m / MM, columns])
    rim = CrossSection.hull_points(np.asarray(corners, dtype=np.float64)).offset(
        6.0 + printing.eye_m / MM, JoinType.Round, circular_segments=ROUND
    )
    base = Manifold.extrude(rim, PLATE_MM) + Manifold.batch_boolean(
        [posts[i] for i in range(len(flexures)) if i not in stack.hanging], OpType.Add
    )
    for x, y in columns:
        column = _rod(0.0, top, COLUMN_MM) + _rod(0.0, top + PLATE_MM, COLUMN_MM / 2)
        base += column.translate((x, y, 0.0))
    pin = _rod(0.0, height + _TIP_MM - PLATE_MM, printing.pin_m / MM / 2)
    mover = pin + _rod(0.0, FOOT_MM, FOOT_RADIUS_MM)
    parts = [
        PrintedPart(name="base", solid=base, outline=None),
        *members,
        PrintedPart(name="mover", solid=mover, outline=None),
    ]
    if stack.hanging:
        plate = Manifold.extrude(rim, PLATE_MM).translate((0.0, 0.0, top))
        for x, y in columns:
            hole = _rod(top - PLATE_MM / 2, top + 2.0 * PLATE_MM, COLUMN_MM / 2 + printing.gap_m / MM / 2)
            plate -= hole.translate((x, y, 0.0))
        plate += Manifold.batch_boolean([posts[i] for i in stack.hanging], OpType.Add)
        turned = plate.rotate((180.0, 0.0, 0.0)).translate((0.0, 0.0, top + PLATE_MM))
        parts.append(PrintedPart(name="top", solid=turned, outline=None))
    return Kit(
        truss=truss,
        flexures=flexures,
        stack=stack,
        printing=printing,
        bottoms_mm=bottoms,
        parts=tuple(parts),
        top_mm=top,
    )


def _posts(
    truss: Truss, flexures: Sequence[Flexure], bottoms: Array, stack: Stack, top: float, printing: Printing
) -> list[Manifold]:
    """Each member's post in place: thick up or down to its member, thin through the member's hole."""
    posts = []
    for i, (flexure, (start, _), bottom) in enumerate(zip(flexures, truss.ends, bottoms, strict=True)):
        x, y = (float(c) for c in truss.fixed_m[start] / MM)
        low, high, half = float(bottom), float(bottom) + flexure.depth_m / MM, PLAY_M / MM / 2
        if i in stack.hanging:
            post = _rod(high + half, top, printing.eye_m / MM) + _rod(low - _TIP_MM, top, printing.pin_m / MM / 2)
        else:
            post = _rod(0.0, low - half, printing.eye_m / MM) + _rod(0.0, high + _TIP_MM, printing.pin_m / MM / 2)
        posts.append(post.translate((x, y, 0.0)))
    return posts


def _rod(low: float, high: float, radius: float) -> Manifold:
    return Manifold.cylinder(high - low, radius, circular_segments=ROUND).translate((0.0, 0.0, low))


def _columns(truss: Truss, flexures: Sequence[Flexure], region_m: Array, printing: Printing) -> Array:
    """(4, 2) places in mm that nothing comes over, the nearest to the middle in each quadrant.

    Raises:
        MakeError: a quadrant has none.
    """
    fixed = np.concatenate([truss.fixed_m, region_m])
    low, high = fixed.min(axis=0), fixed.max(axis=0)
    wide = 0.5 * float((high - low).max())
    lines = (np.arange(a - wide, b + wide, 4.0 * MM) for a, b in zip(low, high, strict=True))
    places = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
    from_middle = places - (low + high) / 2
    quadrant = (from_middle > 0).astype(int) @ np.array([1, 2])
    radius = COLUMN_MM * MM + PLAY_M
    chosen = []
    for number in range(4):
        nearest = places[quadrant == number][np.argsort(np.linalg.norm(from_middle[quadrant == number], axis=1))]
        for some in np.array_split(nearest, max(len(nearest) // 50, 1)):
            free = _away(some, truss.fixed_m) > radius + printing.eye_m
            if chosen:
                free &= _away(some, np.array(chosen) * MM) > 4.0 * COLUMN_MM * MM
            free &= _away(some, region_m) > radius + FOOT_RADIUS_MM * MM
            free[free] = clearance(truss, flexures, region_m, printing, some[free]).min(axis=0) > radius
            if free.any():
                chosen.append(some[free][0] / MM)
                break
        else:
            raise MakeError(
                "there is no room for the columns of a top plate: ask for fewer `members` or another `seed`"
            )
    return np.array(chosen)


def _away(places: Array, others: Array) -> Array:
    """(P,) distance of (P, 2) places from the nearest of (n, 2) others."""
    return np.linalg.norm(places[:, None] - others, axis=-1).min(axis=1)


def member_outline(flexure: Flexure, length_m: float, printing: Printing) -> CrossSection:
    """A member in its plane when its pins are ``length_m`` apart: the moving pin at (0, 0), the other on the x axis.

    The meander's pitch takes up the change of length; a cable or strut without force keeps its shape and slides.
    """
    eye, hole, t = printing.eye_m / MM, printing.hole_m / MM / 2, flexure.thickness_m / MM
    line = meander_line(flexure, length_m, printing) / MM
    spring = CrossSection.batch_boolean([_bar(a, b, t) for a, b in pairwise(line)], OpType.Add)
    ends = [float(end) / MM for end in flexure.slot_ends_m(length_m)]
    far = CrossSection.batch_hull([CrossSection.circle(eye, ROUND).translate((x, 0.0)) for x in ends])
    slot = CrossSection.batch_hull([CrossSection.circle(hole, ROUND).translate((x, 0.0)) for x in ends])
    return (spring + CrossSection.circle(eye, ROUND) + far) - CrossSection.circle(hole, ROUND) - slot


def meander_line(flexure: Flexure, length_m: float, printing: Printing) -> Array:
    """(K, 2) centre line of a member's meander in metres, from the root at the moving pin's eye to the other's."""
    first = printing.eye_m + ROOT_M
    last = float(flexure.slot_ends_m(length_m)[0]) - first
    n, half = flexure.beams, flexure.width_m / 2
    x = np.repeat(np.linspace(first, last, n + 1), 2)
    side = half * np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    y = np.concatenate([[0.0], np.repeat(side, 2), [0.0]])
    root = np.array([[first - ROOT_M, 0.0]])
    return np.concatenate([root, np.column_stack([x, y]), [[last + ROOT_M, 0.0]]])


def _bar(a: Array, b: Array, thickness: float) -> CrossSection:
    dot = CrossSection.circle(thickness / 2, ROUND)
    return CrossSection.batch_hull([dot.translate((float(p[0]), float(p[1]))) for p in (a, b)])


def assembled(kit: Kit, q_m: Array) -> list[tuple[str, Manifold]]:
    """All parts in place with the moving point at (2,) ``q_m``: members turned, and stretched as they then are."""
    solids = {part.name: part.solid for part in kit.parts}
    x, y = (float(c) for c in q_m / MM)
    placed = [("base", solids["base"]), ("mover", solids["mover"].translate((x, y, PLATE_MM)))]
    if "top" in solids:
        placed.append(("top", solids["top"].rotate((180.0, 0.0, 0.0)).translate((0.0, 0.0, kit.top_mm + PLATE_MM))))
    for i, (flexure, (start, _)) in enumerate(zip(kit.flexures, kit.truss.ends, strict=True)):
        way = kit.truss.fixed_m[start] - q_m
        outline = member_outline(flexure, float(np.linalg.norm(way)), kit.printing)
        solid = Manifold.extrude(outline, flexure.depth_m / MM)
        turned = solid.rotate((0.0, 0.0, float(np.degrees(np.arctan2(way[1], way[0])))))
        placed.append((f"member_{i + 1}", turned.translate((x, y, float(kit.bottoms_mm[i])))))
    return placed


def overlaps(placed: Sequence[tuple[str, Manifold]]) -> list[tuple[str, str, float]]:
    """Pairs of parts that share a volume, with it in mm^3."""
    found = [(a, b, float((one ^ other).volume())) for (a, one), (b, other) in combinations(placed, 2)]
    return [entry for entry in found if entry[2] > 1e-6]


def keeps_wall(outline: CrossSection, wall_mm: float) -> bool:
    """Whether no neck of a plane shape is thinner than a wall: shrunk by half of it the shape stays in one piece."""
    return len(outline.offset(-0.49 * wall_mm, JoinType.Round, circular_segments=ROUND).decompose()) == 1
