"""What hangs on a joint, and whether the forces on that from outside are known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
