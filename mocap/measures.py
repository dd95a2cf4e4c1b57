"""What a skeleton states beyond markers and joints: axes, distances, outlines, strokes, feet, masses."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

from mocap.errors import SkeletonError
from mocap.schema import POSITIVE, Entry, Schema, checked

AXES = {
    "x": (1.0, 0, 0),
    "y": (0, 1.0, 0),
    "z": (0, 0, 1.0),
    "-x": (-1.0, 0, 0),
    "-y": (0, -1.0, 0),
    "-z": (0, 0, -1.0),
}
"""Directions of the world by name."""
Line = tuple[str, str]
"""A direction: from one marker to another."""


LINES = {"forward": 'forward = ["PELVIS", "NECK"]', "left": 'left = ["SHOULDER_R", "SHOULDER_L"]'}
"""How axes of the trunk are stated under ``[measures]``, with names of markers that readers replace."""
Places = Mapping[str, tuple[float, float, float]]
"""Axes of a body: where three markers of it and more are in them, in metres."""
SEQUENCE = "zyx"
"""Axes that a joint turns about where no others are stated: of the parent, between, of the child."""
SEQUENCES = tuple(map("".join, (s for s in product("xyz", repeat=3) if s[0] != s[1] != s[2])))
FUNCTIONAL = ("ball", "hinge")
"""What the motion of a joint between bodies shows: its centre; its axis, too."""


@dataclass(frozen=True, kw_only=True)
class JointAxes:
    """Axes of the two segments of a joint, and the sequence in which it turns about them.

    Attributes:
        parent: Of the parent segment a long axis, from proximal to distal, and a direction to its left; of a body also
            the places of its markers. None, of bodies: axes of both that coincide in the mean pose.
        child: The same of the child segment.
        sequence: Axes that it turns about (``SEQUENCES``).
        functional: One of ``FUNCTIONAL``: the joint's centre, or its axis as z, are found from its motion; None: not.
        helical: Whether helical axes are wanted of a joint between bodies.
    """

    parent: tuple[Line, Line] | Places | None = None
    child: tuple[Line, Line] | Places | None = None
    sequence: str = SEQUENCE
    functional: str | None = None
    helical: bool = False

    def __post_init__(self) -> None:
        """Check what does not depend on the joint."""
        if self.sequence not in SEQUENCES:
            raise SkeletonError(f"measures.axes: sequence must be one of {', '.join(SEQUENCES)}, not {self.sequence!r}")
        if self.functional not in (None, *FUNCTIONAL):
            raise SkeletonError(f"measures.axes: functional must be ball or hinge, not {self.functional!r}")
        if (self.parent is None) != (self.child is None) or (self.functional and self.parent is not None):
            raise SkeletonError(
                "measures.axes: state both parent and child, or neither; none where axes are functional"
            )

    @property
    def lines(self) -> tuple[Line, ...]:
        """Directions between markers."""
        return tuple(line for part in (self.parent, self.child) if isinstance(part, tuple) for line in part)


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A part of the body that has mass.

    Attributes:
        start: Proximal marker.
        end: Distal marker; the same for a mass at one marker.
        mass_g: Mass in grams.
        centre: Where its centre of mass lies, as a share of the way from start to end.
    """

    start: str
    end: str
    mass_g: float
    centre: float = 0.5


@dataclass(frozen=True, kw_only=True)
class Measures:
    """What is measured beyond joints.

    Attributes:
        up: Direction of the world that points up.
        forward: Direction of the trunk that points ahead; None: yaw and pitch are not stated.
        left: Direction of the trunk that points to its left; None: roll is not stated.
        axes: Axes of joints by their name; a joint without has one angle, between its two segments.
        distances: Pairs of markers by name.
        areas: Outlines, marker after marker, by name.
        strokes: Root and tip of limbs that beat (wings, fins), by name.
        feet: Markers that touch the ground, in the order of the gait diagram.
        ground: What feet stand on, found from the footholds: ``plane`` or ``rod``.
        chain: Markers along a body that undulates, from head to tail.
        segments: Parts that have mass, by name.
    """

    up: str = "z"
    forward: Line | None = None
    left: Line | None = None
    axes: Mapping[str, JointAxes] = field(default_factory=dict)
    distances: Mapping[str, Line] = field(default_factory=dict)
    areas: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    strokes: Mapping[str, Line] = field(default_factory=dict)
    feet: tuple[str, ...] = ()
    ground: str = "plane"
    chain: tuple[str, ...] = ()
    segments: Mapping[str, Segment] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check what does not depend on the markers."""
        if self.up not in AXES:
            raise SkeletonError(f"measures: up must be one of {', '.join(AXES)}, not {self.up!r}")
        if self.ground not in ("plane", "rod"):
            raise SkeletonError(f"measures: ground must be plane or rod, not {self.ground!r}")
        for name, outline in self.areas.items():
            if len(outline) < 3:
                raise SkeletonError(f"measures: the outline of area {name!r} needs at least 3 markers")
        for name, part in self.segments.items():
            if not part.mass_g > 0:
                raise SkeletonError(f"measures: segment {name!r} needs a positive mass_g, not {part.mass_g:g}")

    @property
    def cyclic(self) -> bool:
        """Whether anything is named that moves in cycles."""
        return bool(self.strokes or self.feet or self.chain)

    @property
    def masses(self) -> list[tuple[str, str, float, float]]:
        """First and last marker, kilograms and centre of each segment."""
        return [(s.start, s.end, 1e-3 * s.mass_g, s.centre) for s in self.segments.values()]

    def and_of(self, other: "Measures") -> "Measures":
        """What the other states, and of these what it does not; its ``up`` and ``ground``."""
        both = {name: {**getattr(self, name), **getattr(other, name)} for name in ("strokes", "distances", "areas")}
        first = {name: getattr(other, name) or getattr(self, name) for name in ("forward", "left", "feet", "chain")}
        return replace(other, **both, **first)

    def uses(self) -> Iterator[tuple[str, str]]:
        """What uses which marker."""
        lines: list[tuple[str, Line]] = [(f"distance {k}", v) for k, v in self.distances.items()]
        lines += [(f"stroke {k}", v) for k, v in self.strokes.items()]
        lines += [("forward", self.forward)] if self.forward else []
        lines += [("left", self.left)] if self.left else []
        for name, axes in self.axes.items():
            lines += [(f"axes of {name}", line) for line in axes.lines]
        lines += [(f"segment {k}", (s.start, s.end)) for k, s in self.segments.items()]
        for what, line in lines:
            yield from ((what, marker) for marker in line)
        for what, several in [*((f"area {k}", v) for k, v in self.areas.items()), ("feet", self.feet)]:
            yield from ((what, marker) for marker in several)
        yield from (("chain", marker) for marker in self.chain)


_KEYS = {"up", "forward", "left", "axes", "distances", "areas", "strokes", "feet", "ground", "chain", "segments"}


def read_measures(table: Mapping[str, Any]) -> Measures:
    """Measures from the table ``[measures]`` of a skeleton file.

    Raises:
        ValueError: a key or an entry is not as described.
    """
    unknown = set(table) - _KEYS
    if unknown:
        raise ValueError(f"unknown key {min(unknown)!r} in [measures]: it has {', '.join(sorted(_KEYS))}")

    def each(key: str, read: Callable[[str, Any], Any]) -> dict[str, Any]:
        return {str(name): read(f"{key}.{name}", entry) for name, entry in dict(table.get(key, {})).items()}

    return Measures(
        up=str(table.get("up", "z")),
        forward=_line("forward", table["forward"]) if "forward" in table else None,
        left=_line("left", table["left"]) if "left" in table else None,
        axes=each("axes", _axes),
        distances=each("distances", _line),
        areas=each("areas", _several),
        strokes=each("strokes", _line),
        feet=_several("feet", table.get("feet", ())),
        ground=str(table.get("ground", "plane")),
        chain=_several("chain", table.get("chain", ())),
        segments=each("segments", _segment),
    )


def measures_lines(measures: Measures, quoted: Callable[[object], str]) -> list[str]:
    """Lines of a skeleton file that ``read_measures`` reads; none where nothing is stated.

    Args:
        measures: What to write.
        quoted: A string or a list of strings as TOML.
    """
    if measures == Measures():
        return []
    lines = ["", "[measures]", f"up = {quoted(measures.up)}"]
    for key in ("forward", "left", "feet", "chain"):
        if getattr(measures, key):
            lines.append(f"{key} = {quoted(getattr(measures, key))}")
    if measures.feet:
        lines.append(f"ground = {quoted(measures.ground)}")
    for key in ("distances", "areas", "strokes"):
        if getattr(measures, key):
            lines += ["", f"[measures.{key}]"]
            lines += [f"{quoted(name)} = {quoted(entry)}" for name, entry in getattr(measures, key).items()]
    if measures.axes:
        lines += ["", "[measures.axes]"]
        for name, axes in measures.axes.items():
            lines.append(f"{quoted(name)} = {{ {', '.join(_axes_entries(axes, quoted))} }}")
    if measures.segments:
        lines += ["", "[measures.segments]"]
        for name, part in measures.segments.items():
            ends = quoted([part.start, part.end])
            mass, centre = float(part.mass_g), float(part.centre)
            lines.append(f"{quoted(name)} = {{ ends = {ends}, mass_g = {mass!r}, centre = {centre!r} }}")
    return lines


def _several(key: str, entry: Any) -> tuple[str, ...]:
    if not isinstance(entry, Sequence) or isinstance(entry, str) or not all(isinstance(one, str) for one in entry):
        raise ValueError(f'measures.{key} is a list of markers ["a", "b", ...], not {entry!r}')
    return tuple(entry)


def _line(key: str, entry: Any) -> Line:
    several = _several(key, entry)
    if len(several) != 2:
        raise ValueError(f'measures.{key} is two markers ["from", "to"], not {entry!r}')
    return several[0], several[1]


def _axes_entries(axes: JointAxes, quoted: Callable[[object], str]) -> Iterator[str]:
    for part in ("parent", "child"):
        value = getattr(axes, part)
        if isinstance(value, tuple):
            yield f"{part} = {quoted(value)}"
        elif value is not None:
            places = (f"{quoted(name)} = {[round(float(x), 9) for x in at]}" for name, at in value.items())
            yield f"{part} = {{ {', '.join(places)} }}"
    if axes.sequence != SEQUENCE or (axes.parent is None and not axes.functional):
        yield f"sequence = {quoted(axes.sequence)}"
    if axes.functional:
        yield f"functional = {quoted(axes.functional)}"
    if axes.helical:
        yield "helical = true"


_AXES: Schema = {
    "sequence": Entry(kind="s", needed=False),
    "functional": Entry(kind="s", needed=False),
    "helical": Entry(kind="b", needed=False),
}


def _axes(key: str, entry: Any) -> JointAxes:
    if not isinstance(entry, Mapping) or not entry or not set(entry) <= {"parent", "child", *_AXES}:
        raise ValueError(
            f"measures.{key} is {{ parent = [long axis, left], child = [long axis, left] }}, with sequence, functional "
            f"or helical if need be, not {entry!r}"
        )
    rest = checked(f"measures.{key}", {k: v for k, v in entry.items() if k in _AXES}, _AXES, again="correct it")
    parts = {part: _axes_of(f"{key}.{part}", entry[part]) for part in ("parent", "child") if part in entry}
    return JointAxes(**parts, **{k: v[()] for k, v in rest.items()})


def _axes_of(key: str, entry: Any) -> tuple[Line, Line] | Places:
    if isinstance(entry, Mapping):
        found = checked(f"measures.{key}", entry, dict.fromkeys(entry, Entry(shape=(3,))), again="correct it")
        return {str(name): (float(x), float(y), float(z)) for name, (x, y, z) in found.items()}
    if not isinstance(entry, list | tuple) or len(entry) != 2:
        raise ValueError(
            f'measures.{key} is two directions [["a", "b"], ["c", "d"]], or places of markers '
            f"{{ a = [0.01, 0.0, 0.0], ... }} in metres, not {entry!r}"
        )
    return _line(key, entry[0]), _line(key, entry[1])


_SEGMENT: Schema = {"mass_g": Entry(least=POSITIVE), "centre": Entry(needed=False)}


def _segment(key: str, entry: Any) -> Segment:
    if not isinstance(entry, Mapping) or not {"ends", "mass_g"} <= set(entry) <= {"ends", "mass_g", "centre"}:
        raise ValueError(f'measures.{key} is {{ ends = ["a", "b"], mass_g = 1.2, centre = 0.5 }}, not {entry!r}')
    start, end = _line(f"{key}.ends", entry["ends"])
    found = checked(f"measures.{key}", entry, _SEGMENT, again="correct it")
    return Segment(start=start, end=end, mass_g=float(found["mass_g"]), centre=float(found.get("centre", 0.5)))
