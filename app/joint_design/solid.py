"""The truss as parts to print: base with posts, one flat spring a member, and the moving pin; all in millimetres."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from manifold3d import CrossSection, JoinType, Manifold, OpType, set_min_circular_angle, set_min_circular_edge_length

from app.joint_design.flexure import MM, ROOT_M, Flexure, Printing
from app.joint_design.stacking import PLAY_M
from eal.arrays import Array
from eal.joint_design import Truss

PLATE_MM = 4.0
RIM_MM = 6.0
FOOT_RADIUS_MM = 8.0
FOOT_MM = 3.0
_TIP_MM = 0.3


@dataclass(frozen=True, eq=False, kw_only=True)
class Part:
    """One part to print.

    Attributes:
        name: ``base``, ``member_1``, ... or ``mover``.
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
        order: Members from the lowest layer to the highest.
        printing: What they were made for.
        bottoms_mm: (m,) height of each member's lower face.
        parts: Base, members, mover.
    """

    truss: Truss
    flexures: Sequence[Flexure]
    order: Sequence[int]
    printing: Printing
    bottoms_mm: Array
    parts: tuple[Part, ...]


def make_kit(
    truss: Truss, flexures: Sequence[Flexure], order: Sequence[int], region_m: Array, printing: Printing
) -> Kit:
    """All parts.

    Args:
        truss: At printed size, without internal nodes.
        flexures: Its members.
        order: Members from below.
        region_m: (n, 2) where the moving point may be; the base reaches under all of it.
        printing: Sizes.
    """
    set_min_circular_angle(6.0)
    set_min_circular_edge_length(0.2)
    bottoms = np.zeros(len(flexures))
    height = PLATE_MM + FOOT_MM + PLAY_M / MM
    for i in order:
        height += PLAY_M / MM
        bottoms[i] = height
        height += flexures[i].depth_m / MM
    members = [
        Part(name=f"member_{i + 1}", solid=Manifold.extrude(outline, flexure.depth_m / MM), outline=outline)
        for i, flexure in enumerate(flexures)
        for outline in [member_outline(flexure, flexure.rest_m, printing)]
    ]
    base = _base(truss, flexures, bottoms, region_m, printing)
    pin = Manifold.cylinder(height + _TIP_MM - PLATE_MM, printing.pin_m / MM / 2)
    mover = pin + Manifold.cylinder(FOOT_MM, FOOT_RADIUS_MM)
    parts = (Part(name="base", solid=base, outline=None), *members, Part(name="mover", solid=mover, outline=None))
    return Kit(truss=truss, flexures=flexures, order=order, printing=printing, bottoms_mm=bottoms, parts=parts)


def _base(truss: Truss, flexures: Sequence[Flexure], bottoms: Array, region_m: Array, printing: Printing) -> Manifold:
    anchors = truss.fixed_m / MM
    corners = np.concatenate([anchors, region_m / MM])
    rim = RIM_MM + printing.eye_m / MM
    plate = CrossSection.hull_points(corners).offset(rim, JoinType.Round)
    base = Manifold.extrude(plate, PLATE_MM)
    for flexure, (start, _), bottom in zip(flexures, truss.ends, bottoms, strict=True):
        x, y = (float(c) for c in anchors[start])
        post = Manifold.cylinder(float(bottom) - PLAY_M / MM / 2, printing.eye_m / MM)
        pin = Manifold.cylinder(float(bottom) + flexure.depth_m / MM + _TIP_MM, printing.pin_m / MM / 2)
        base += (post + pin).translate((x, y, 0.0))
    return base


def member_outline(flexure: Flexure, length_m: float, printing: Printing) -> CrossSection:
    """A member in its plane when its pins are ``length_m`` apart: the moving pin at (0, 0), the other on the x axis.

    The meander's pitch takes up the change of length; a cable that is slack keeps its shape and slides.
    """
    taut = max(length_m, flexure.rest_m) if flexure.slot_m else length_m
    eye, hole, t = printing.eye_m / MM, printing.hole_m / MM / 2, flexure.thickness_m / MM
    line = meander_line(flexure, length_m, printing) / MM
    spring = CrossSection.batch_boolean([_bar(a, b, t) for a, b in pairwise(line)], OpType.Add)
    inner = (taut - flexure.slot_m) / MM
    far = CrossSection.batch_hull([CrossSection.circle(eye).translate((x, 0.0)) for x in (inner, taut / MM)])
    slot = CrossSection.batch_hull([CrossSection.circle(hole).translate((x, 0.0)) for x in (inner, taut / MM)])
    return (spring + CrossSection.circle(eye) + far) - CrossSection.circle(hole) - slot


def meander_line(flexure: Flexure, length_m: float, printing: Printing) -> Array:
    """(K, 2) centre line of a member's meander in metres, from the root at the moving pin's eye to the other's."""
    taut = max(length_m, flexure.rest_m) if flexure.slot_m else length_m
    first = printing.eye_m + ROOT_M
    last = taut - flexure.slot_m - first
    n, half = flexure.beams, flexure.width_m / 2
    x = np.repeat(np.linspace(first, last, n + 1), 2)
    side = half * np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    y = np.concatenate([[0.0], np.repeat(side, 2), [0.0]])
    root = np.array([[first - ROOT_M, 0.0]])
    return np.concatenate([root, np.column_stack([x, y]), [[last + ROOT_M, 0.0]]])


def _bar(a: Array, b: Array, thickness: float) -> CrossSection:
    dot = CrossSection.circle(thickness / 2)
    return CrossSection.batch_hull([dot.translate((float(p[0]), float(p[1]))) for p in (a, b)])


def assembled(kit: Kit, q_m: Array) -> list[tuple[str, Manifold]]:
    """All parts in place with the moving point at (2,) ``q_m``: members turned, and stretched as they then are."""
    base, mover = kit.parts[0].solid, kit.parts[-1].solid
    x, y = (float(c) for c in q_m / MM)
    placed = [("base", base), ("mover", mover.translate((x, y, PLATE_MM)))]
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
    return len(outline.offset(-0.49 * wall_mm, JoinType.Round).decompose()) == 1
