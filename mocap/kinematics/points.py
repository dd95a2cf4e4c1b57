"""Which points and pairs of points a smoother is asked for, and what hangs on a joint, on which only gravity acts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from mocap.filters.velocities import RatePoints
from mocap.measures import Segment
from mocap.skeleton import Joint, Skeleton


@dataclass(frozen=True, kw_only=True)
class Distal:
    """The part of an animal beyond a joint, which no force from outside but gravity acts on.

    Attributes:
        joint: The joint.
        segments: Its parts that have mass.
        feet: Feet among its markers: while one of them stands, the ground pushes.
    """

    joint: Joint
    segments: tuple[Segment, ...]
    feet: tuple[str, ...]

    @property
    def markers(self) -> tuple[str, ...]:
        """Parent, centre and child of the joint, then the other ends of segments."""
        ends = [end for part in self.segments for end in (part.start, part.end)]
        return tuple(dict.fromkeys([self.joint.parent, self.joint.centre, self.joint.child, *ends]))


def distal_parts(skeleton: Skeleton) -> dict[str, Distal | str]:
    """What is beyond each joint, by its name; or why forces there cannot be known."""
    neighbours = _neighbours(skeleton)
    return {joint.name: _beyond(skeleton, joint, neighbours) for joint in skeleton.joints}


def _neighbours(skeleton: Skeleton) -> dict[str, set[str]]:
    lines = [(bone.a, bone.b) for bone in skeleton.bones]
    lines += [line for j in skeleton.joints for line in ((j.parent, j.centre), (j.centre, j.child))]
    out: dict[str, set[str]] = {}
    for a, b in lines:
        out.setdefault(a, set()).add(b)
        out.setdefault(b, set()).add(a)
    return out


def _beyond(skeleton: Skeleton, joint: Joint, neighbours: Mapping[str, set[str]]) -> Distal | str:
    measures = skeleton.measures
    if not measures.segments:
        return "the skeleton states no masses under [measures.segments]"
    beyond, new = set[str](), {joint.child}
    while new:
        beyond |= new
        new = {b for a in new for b in neighbours[a]} - beyond - {joint.centre}
    if joint.parent in beyond:
        return "its bones form a loop: forces may pass beside it"
    if beyond & set(skeleton.trunk):
        return "the trunk is beyond it"
    if beyond & {tip for _, tip in measures.strokes.values()}:
        return "what is beyond it beats: forces of air or water are not known"
    if beyond & set(measures.chain):
        return "what is beyond it undulates: forces of what it lies on or swims in are not known"
    near = beyond | {joint.centre}
    here = {name: part for name, part in measures.segments.items() if {part.start, part.end} & beyond}
    across = [name for name, part in here.items() if not {part.start, part.end} <= near]
    if across:
        return f"the segment {across[0]} spans it: state a mass on each side"
    bare = sorted(beyond - {end for part in here.values() for end in (part.start, part.end)})
    if bare:
        return f"no segment with mass ends at {_few(bare)}"
    return Distal(joint=joint, segments=tuple(here.values()), feet=tuple(f for f in measures.feet if f in beyond))


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")


BODY, MASS = "body", "centre_of_mass"
"""Means of the markers of the trunk, and of all segments by their masses."""


def rate_points_for(names: Sequence[str], skeleton: Skeleton, *, n_frames: int) -> RatePoints:
    """All that the quantities of a skeleton need."""
    body = skeleton.trunk or names
    weights = [tuple(1 / len(body) if name in body else 0.0 for name in names)]
    means = [BODY]
    if skeleton.measures.segments:
        weights.append(mass_weights(names, list(skeleton.measures.segments.values())))
        means.append(MASS)
    index = {name: i for i, name in enumerate((*names, *means))}
    joints = [(j.parent, j.centre, j.child) for j in skeleton.joints]
    joints += [(*skeleton.bodies[j.parent], *skeleton.bodies[j.child]) for j in skeleton.body_joints]
    moments = [part.markers for part in distal_parts(skeleton).values() if isinstance(part, Distal)]
    needed = [joints, measured_sets(skeleton), moments]
    pairs: list[tuple[int, int]] = []
    for sets in needed:
        found = {
            (min(index[a], index[b]), max(index[a], index[b]))
            for points in sets
            for a, b in combinations(dict.fromkeys(points), 2)
            if a in index and b in index
        }
        more = [*pairs, *sorted(found - set(pairs))]
        if 4 * 36 * len(more) * n_frames <= 4e8:  # of longer recordings covariances of joints alone
            pairs = more
    return RatePoints(names=(*names, *means), weights=tuple(weights), pairs=tuple(pairs))


def measured_sets(skeleton: Skeleton) -> list[tuple[str, ...]]:
    """Points that enter one quantity together, beyond joints."""
    measures = skeleton.measures
    sets: list[tuple[str, ...]] = [(bone.a, bone.b) for bone in skeleton.bones]
    sets += list(measures.distances.values()) + list(measures.areas.values())
    trunk_lines = [line for line in (measures.forward, measures.left) if line]
    body = tuple(marker for line in trunk_lines for marker in line)
    sets += [body] + [(*body, *line) for line in measures.strokes.values()]
    for axes in measures.axes.values():
        sets.append(tuple(marker for line in axes.lines for marker in line))
    return sets


def mass_weights(names: Sequence[str], segments: Sequence[Segment]) -> tuple[float, ...]:
    """Weights of the centre of mass of segments, whose own lie on the line between their ends."""
    total = sum(part.mass_g for part in segments)
    weights = dict.fromkeys(names, 0.0)
    for part in segments:
        weights[part.start] += (1 - part.centre) * part.mass_g / total
        weights[part.end] += part.centre * part.mass_g / total
    return tuple(weights.values())
