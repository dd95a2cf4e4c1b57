"""Musculoskeletal and robot models as skeletons: OpenSim, bioMod by biobuddy, URDF and MJCF by MuJoCo."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from itertools import combinations
from math import degrees
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from eal.arrays import Array
from eal.needs import MissingPackageError, needs
from mocap.documents import regular_bytes
from mocap.errors import FormatError
from mocap.measures import Measures, Segment

_SAME_M = 1e-5
"""Two points nearer than that are one: models are written to micrometres or finer."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelPart:
    """A segment of a model.

    Attributes:
        name: What the model calls it.
        parent: Number of the segment that it moves on, an earlier one; -1: none.
        frame: (4, 4) its axes in those of the parent, with all coordinates of joints at zero.
        joint: What the joint to the parent is called; the segment's name where the model names none.
        turns: Whether the joint has angles.
        slides: Whether the joint has translations.
        limits: The range of each coordinate of the joint, in words.
        centre_m: (3,) where the joint is, in the segment's axes.
        markers: (3,) position of each marker in the segment's axes, by name.
        mass_kg: Its mass; 0: not stated.
        com_m: (3,) its centre of mass in its axes.
    """

    name: str
    parent: int
    frame: Array = field(default_factory=lambda: np.eye(4))
    joint: str
    turns: bool = False
    slides: bool = False
    limits: tuple[str, ...] = ()
    centre_m: Array = field(default_factory=lambda: np.zeros(3))
    markers: Mapping[str, Array] = field(default_factory=dict)
    mass_kg: float = 0.0
    com_m: Array = field(default_factory=lambda: np.zeros(3))


def model_skeleton(path: Path) -> tuple[dict[str, Any], dict[str, list[str]]]:
    """The skeleton that a model describes.

    Points are the markers of the model (``sites`` of MJCF); a model without any has the centres of its joints and the
    ends of its chains, by the names of their segments. Those fixed to one segment are a body (three or more that lie
    on no line) or bones; a point at the centre of a joint is fixed to both segments. A joint is between two bodies, or
    of three markers where one lies at its centre. A mass is a rod between the two points nearest to its centre.

    Args:
        path: An ``.osim``, ``.bioMod``, ``.urdf`` or ``.xml`` (MJCF) file.

    Returns:
        The arguments of ``Skeleton``, and comments for ``skeleton_text``: ranges of joints, which are not used, and
        what could not be taken.

    Raises:
        FormatError: the file is no such model, or has no points.
        MissingPackageError: the library that reads it is not installed.
    """
    read = MODELS[path.suffix.lower()]
    try:
        regular_bytes(path)  # no device is waited for
        parts = read(path)
    except (FormatError, MissingPackageError):
        raise
    except Exception as error:  # whatever the libraries meet in a file that is none
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise FormatError(f"{path}: not readable as a model: {reason}; open it in the program that made it") from None
    return _as_skeleton(_whole(parts, path), path)


@dataclass(eq=False, kw_only=True)
class _Rigid:
    """Segments that do not move on each other, in the axes of the first of them."""

    name: str
    first: ModelPart
    parent: int
    points: dict[str, Array] = field(default_factory=dict)
    shared: dict[str, Array] = field(default_factory=dict)
    ends: dict[str, Array] = field(default_factory=dict)
    masses: list[tuple[float, Array]] = field(default_factory=list)

    @property
    def fixed(self) -> dict[str, Array]:
        """Its own points, and those at the joints to others."""
        return {**self.points, **self.shared}

    @property
    def seen(self) -> bool:
        """Whether points show how it moves; a helper has at most that of its joint."""
        return bool(self.points) or len(self.shared) > 1


def _whole(parts: Sequence[ModelPart], path: Path) -> list[_Rigid]:
    """Segments that are welded together as one; each with the points that are fixed to it."""
    groups: list[_Rigid] = []
    of: list[tuple[int, Array]] = []  # the group of each segment, and its axes in those of the group
    carries = {part.parent for part in parts}
    world = parts and parts[0].parent < 0 and not (parts[0].turns or parts[0].markers or parts[0].mass_kg)
    if world and 0 in carries:  # what the model stands on
        parts = [replace(part, parent=part.parent - 1) for part in parts[1:]]
        carries = {part.parent for part in parts}
    for number, part in enumerate(parts):
        if part.parent < 0 or part.turns or part.slides:
            parent = of[part.parent][0] if part.parent >= 0 else -1
            frame = part.frame if part.parent < 0 else of[part.parent][1] @ part.frame
            of.append((len(groups), np.eye(4)))
            groups.append(_Rigid(name=part.name, first=replace(part, frame=frame), parent=parent))
        else:
            group, frame = of[part.parent]
            of.append((group, frame @ part.frame))
        group, frame = of[number]
        found = groups[group]
        for name, position in part.markers.items():
            if any(name in other.points for other in groups):
                raise FormatError(f"{path}: marker {name!r} is there twice: rename one of them")
            found.points[name] = _at(frame, position)
        if part.mass_kg > 0:
            if not found.masses:
                found.name = part.name  # of OpenSim's, the one that is no helper for a single axis
            found.masses.append((part.mass_kg, _at(frame, part.com_m)))
        if number not in carries and found.first.name != part.name:
            found.ends[part.name] = _at(frame, np.zeros(3))
    if not any(group.points for group in groups):
        _origins(groups)
    if not any(group.points for group in groups):
        raise FormatError(f"{path}: has no segment, and so no points: expected a model with markers or joints")
    _share(groups)
    return groups


def _origins(groups: list[_Rigid]) -> None:
    """Take the centres of the joints, and the ends of chains, for points."""
    children = [[other for other in groups if other.parent == number] for number in range(len(groups))]
    for group, below in zip(groups, children, strict=True):
        centre = group.first.centre_m
        helper = len(below) == 1 and not group.masses and _same(_place(below[0]), centre)
        if not helper:
            group.points[group.name] = centre
        at = [*group.points.values(), *map(_place, below)]
        group.points |= {n: xyz for n, xyz in group.ends.items() if not any(_same(xyz, other) for other in at)}


def _share(groups: Sequence[_Rigid]) -> None:
    """Points at the centre of a joint are fixed to both of its segments, and on through helpers for single axes."""
    before = -1
    while before != (before := sum(len(group.shared) for group in groups)):
        for group in groups:
            if group.parent < 0 or group.first.slides:
                continue
            parent, centre, place = groups[group.parent], group.first.centre_m, _place(group)
            up = {name: place for name, xyz in group.fixed.items() if _same(xyz, centre)}
            down = {name: centre for name, xyz in parent.fixed.items() if _same(xyz, place)}
            parent.shared |= {name: xyz for name, xyz in up.items() if name not in parent.points}
            group.shared |= {name: xyz for name, xyz in down.items() if name not in group.points}


def _above(groups: Sequence[_Rigid], group: _Rigid) -> tuple[_Rigid, bool, tuple[str, ...]] | None:
    """The next segment with points that a segment moves on, past helpers without any; whether it turns, and how far."""
    turns, limits = group.first.turns, group.first.limits
    while group.parent >= 0:
        group = groups[group.parent]
        if group.seen:
            return group, turns, limits
        turns, limits = turns or group.first.turns, (*group.first.limits, *limits)
    return None


def _as_skeleton(groups: Sequence[_Rigid], path: Path) -> tuple[dict[str, Any], dict[str, list[str]]]:
    used = [group for group in groups if group.seen]
    markers = [name for group in used for name in group.points]
    bodies: dict[str, list[str]] = {}
    bones: list[tuple[str, str]] = []
    for group in used:
        free = {n: xyz for n, xyz in group.fixed.items() if not any(n in members for members in bodies.values())}
        if _spans(list(free.values())):
            bodies[group.name] = list(free)
        body = bodies.get(group.name, ())
        bones += [(a, b) for a, b in combinations(group.fixed, 2) if not (a in body and b in body)]
    comments: dict[str, list[str]] = {}
    joints: dict[str, tuple[str, ...]] = {}
    missing: list[str] = []
    for group in used:
        above = _above(groups, group)
        if above is None or not above[1]:
            continue
        parent, _, limits = above
        name = group.first.joint if group.name == group.first.name else group.name
        if parent.name in bodies and group.name in bodies:
            joints[name] = (parent.name, group.name)
        elif ends := _ends(parent, group):
            joints[name] = ends
        else:
            missing.append(name)
        comments[f"joint {name}"] = ["; ".join(limits)] if limits else []
    segments: dict[str, Segment] = {}
    notes = [f"from {path.name}; the ranges of its joints stand behind them, and limit nothing"]
    for group in groups:
        if not group.masses:
            continue
        mass = sum(one for one, _ in group.masses)
        com = np.sum([one * xyz for one, xyz in group.masses], axis=0) / mass
        if not group.fixed:
            notes.append(f"{group.name}: {1e3 * mass:g} g left out, as no marker is on it")
            continue
        away, start, end, share = min(_rods(group.fixed, com))
        segments[group.name] = Segment(start=start, end=end, mass_g=float(f"{1e3 * mass:.6g}"), centre=share)
        if away > _SAME_M:
            notes.append(f"{group.name}: its centre of mass is {1e3 * away:.1f} mm from where [measures] puts it")
    if missing:
        notes.append(f"no angle at {', '.join(missing)}: needs 3 markers on both segments, or one at its centre")
    root = next((group for group in used if len(group.fixed) > 2), None)
    parts = {
        "name": path.stem,
        "markers": markers,
        "bones": list(dict.fromkeys(bones)),
        "bodies": bodies,
        "joints": joints,
        "trunk": list(root.fixed) if root is not None else [],
        "measures": Measures(segments=segments),
    }
    return parts, {"": notes, **comments}


def _ends(parent: _Rigid, child: _Rigid) -> tuple[str, str, str] | None:
    """Three markers of a joint: of those on either segment the farthest from the one at its centre."""
    centre = next((n for n in child.fixed if n in parent.fixed), None)
    if centre is None:
        return None

    def farthest(points: Mapping[str, Array]) -> str | None:
        others = [(float(np.linalg.norm(xyz - points[centre])), n) for n, xyz in points.items() if n != centre]
        return max(others)[1] if others else None

    start, end = farthest(parent.fixed), farthest(child.fixed)
    return None if start is None or end is None else (start, centre, end)


def _rods(points: Mapping[str, Array], com: Array) -> Iterator[tuple[float, str, str, float]]:
    """How far a centre of mass is from each rod between two points, its ends, and the share of the way along it."""
    yield from ((float(np.linalg.norm(com - xyz)), name, name, 0.5) for name, xyz in points.items())
    for (a, start), (b, end) in combinations(points.items(), 2):
        along = end - start
        if length2 := float(along @ along):
            share = float(np.clip((com - start) @ along / length2, 0, 1))
            yield float(np.linalg.norm(com - start - share * along)), a, b, round(share, 4)


def _place(group: _Rigid) -> Array:
    """The centre of its joint in the axes of what it moves on."""
    return _at(group.first.frame, group.first.centre_m)


def _at(frame: Array, position: Array) -> Array:
    return frame[:3, :3] @ np.asarray(position, dtype=float)[:3] + frame[:3, 3]


def _same(a: Array, b: Array) -> bool:
    return bool(np.linalg.norm(a - b) < _SAME_M)


def _spans(points: Sequence[Array]) -> bool:
    """Whether points have axes: three or more that lie on no line."""
    if len(points) < 3:
        return False
    widths = np.linalg.svd(np.asarray(points) - np.mean(points, axis=0), compute_uv=False)
    return bool(widths[1] > _SAME_M)


def _range(name: str, least: float, most: float, *, angle: bool) -> str:
    if angle:
        return f"{name} {degrees(least):.0f} to {degrees(most):.0f} deg"
    return f"{name} {1e3 * least:g} to {1e3 * most:g} mm"


_COORDINATES = {
    "PinJoint": (1, 0),
    "UniversalJoint": (2, 0),
    "GimbalJoint": (3, 0),
    "BallJoint": (3, 0),
    "EllipsoidJoint": (3, 0),
    "ScapulothoracicJoint": (4, 0),
    "SliderJoint": (0, 1),
    "PlanarJoint": (1, 2),
    "FreeJoint": (3, 3),
}
"""How many angles and translations a joint of OpenSim has, in this order; a CustomJoint says which itself."""


def _osim(path: Path) -> list[ModelPart]:
    """Bodies, joints and markers of an OpenSim 4 model.

    Read here, as biobuddy 0.3 knows two of OpenSim's kinds of joints, and so 4 of 10 models of OpenSim's collection.
    """
    content = path.read_bytes()
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:  # entities may stand for more than fits in memory
        raise FormatError(
            f"{path}: declares its own entities, which no model of OpenSim does: save it in OpenSim again"
        )
    root = ElementTree.fromstring(re.sub(rb"(</?\w+)::", rb"\1.", content))  # OpenSim writes names that are no XML
    model = root.find("Model")
    if root.tag != "OpenSimDocument" or model is None:
        raise FormatError(f"{path}: starts with <{root.tag}>, expected <OpenSimDocument> with a <Model>")
    version = int(root.get("Version", 0))
    if version < 40000:
        raise FormatError(f"{path}: is of OpenSim {version / 10000:.1f}, expected 4: open and save it in OpenSim 4")
    frames = {str(frame.get("name")): frame for frame in model.iter("PhysicalOffsetFrame")}
    joints = {}
    for joint in model.iterfind("JointSet/objects/*"):
        own = {str(frame.get("name")): frame for frame in joint.iterfind("frames/PhysicalOffsetFrame")}
        ends = [_text(joint, f"socket_{which}_frame") for which in ("parent", "child")]
        bare = [end.rsplit("/", 1)[-1] for end in ends]  # biobuddy writes the path of the body, and means its own frame
        (parent, before), (child, behind) = (
            _frame(name if name in own else end, frames | own) for name, end in zip(bare, ends, strict=True)
        )
        joints[child] = (parent, before, behind, joint)
    bodies = {str(body.get("name")): body for body in model.iterfind("BodySet/objects/Body")}
    world = {"ground", "root"} - bodies.keys()  # root: as biobuddy calls it
    markers: dict[str, dict[str, Array]] = {name: {} for name in bodies}
    for marker in model.iterfind("MarkerSet/objects/Marker"):
        body, offset = _frame(_text(marker, "socket_parent_frame"), frames)
        if body not in markers and body not in world:
            raise FormatError(f"{path}: marker {marker.get('name')!r} is on {body!r}, which is no body of the model")
        markers.setdefault(body, {})[str(marker.get("name"))] = _at(offset, _numbers(marker, "location"))
    numbers: dict[str, int] = {}
    parts: list[ModelPart] = []
    while waiting := [
        n for n in bodies if n not in numbers and (n not in joints or joints[n][0] in world | {*numbers})
    ]:
        for name in waiting:
            parent, before, behind, joint = joints.get(name, ("", np.eye(4), np.eye(4), ElementTree.Element(name)))
            moved, turns, slides, limits = _motion(joint)
            numbers[name] = len(parts)
            parts.append(
                ModelPart(
                    name=name,
                    joint=str(joint.get("name", name)),
                    parent=numbers.get(parent, -1),
                    frame=before @ moved @ np.linalg.inv(behind),
                    turns=turns,
                    slides=slides,
                    limits=limits,
                    centre_m=behind[:3, 3],
                    markers=markers[name],
                    mass_kg=float(_text(bodies[name], "mass") or 0),
                    com_m=_numbers(bodies[name], "mass_center"),
                )
            )
    if left := bodies.keys() - numbers:
        raise FormatError(f"{path}: body {min(left)!r} is on a loop of joints, or on a body that is not there: mend it")
    return parts


def _motion(joint: ElementTree.Element) -> tuple[Array, bool, bool, tuple[str, ...]]:
    """How a joint stands with its coordinates at zero, whether it has angles and translations, and their ranges."""
    free: dict[str, ElementTree.Element] = {}
    at: dict[str, float] = {}
    for coordinate in joint.iterfind("coordinates/Coordinate"):
        name, fixed = str(coordinate.get("name")), _text(coordinate, "locked") == "true"
        at[name] = float(_text(coordinate, "default_value") or 0) if fixed else 0.0
        if not fixed:
            free[name] = coordinate
    axes = joint.findall("SpatialTransform/TransformAxis")
    moved = np.eye(4)
    if axes:
        of = [[name for name in _text(axis, "coordinates").split() if name in free] for axis in axes]
        angles = {name for names in of[:3] for name in names}
        lengths = {name for names in of[3:] for name in names} - angles  # a knee's centre that moves as it bends stays
        for i, axis in enumerate(axes):
            value = _function(axis, [at[name] for name in _text(axis, "coordinates").split() if name in at])
            along = value * _numbers(axis, "axis")
            if i < 3:
                moved[:3, :3] = moved[:3, :3] @ Rotation.from_rotvec(along).as_matrix()
            else:
                moved[:3, 3] += along
    else:
        several, more = _COORDINATES.get(joint.tag, (0, 0))
        angles, lengths = {*[*at][:several]} & free.keys(), {*[*at][several : several + more]} & free.keys()
    limits = [
        _range(name, *_numbers(free[name], "range", (0.0, 0.0)), angle=name in angles)
        for name in free
        if _text(free[name], "range")
    ]
    return moved, bool(angles), bool(lengths), tuple(limits)


def _function(axis: ElementTree.Element, at: Sequence[float]) -> float:
    """What the function of an axis gives for a value of its coordinate."""
    here = at[0] if at else 0.0
    scale = np.prod([float(_text(one, "scale") or 1) for one in axis.iter("MultiplierFunction")])
    for found in axis.iter():
        if found.tag == "Constant":
            return float(scale) * float(_text(found, "value") or 0)
        if found.tag == "LinearFunction":
            return float(scale) * float(np.polyval(_numbers(found, "coefficients", (1.0, 0.0)), here))
        if found.find("x") is not None and found.find("y") is not None:
            return float(scale) * float(np.interp(here, _numbers(found, "x"), _numbers(found, "y")))
    return 0.0


def _frame(socket: str, frames: Mapping[str, ElementTree.Element]) -> tuple[str, Array]:
    """The body of a frame, and (4, 4) its axes in those of the body."""
    axes, left = np.eye(4), {**frames}
    while not socket.endswith(f"bodyset/{(name := socket.rsplit('/', 1)[-1])}"):  # a frame may be called as its body
        frame = left.pop(name, None)  # each once
        if frame is None:
            break
        step = np.eye(4)
        step[:3, :3] = Rotation.from_euler("XYZ", _numbers(frame, "orientation")).as_matrix()
        step[:3, 3] = _numbers(frame, "translation")
        axes, socket = step @ axes, _text(frame, "socket_parent")
    return socket.rsplit("/", 1)[-1], axes


def _text(element: ElementTree.Element, name: str) -> str:
    return (element.findtext(name) or "").strip()


def _numbers(element: ElementTree.Element, name: str, other: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    return np.array(_text(element, name).split() or other, dtype=float)


def _biomod(path: Path) -> list[ModelPart]:
    return _of_biobuddy(_library("biobuddy", path).BiomechanicalModelReal().from_biomod(str(path)))


def _of_biobuddy(model: Any) -> list[ModelPart]:
    numbers: dict[str, int] = {}
    parts = []
    for segment in model.segments:
        angles = segment.rotations.value or ""
        ranges = segment.q_ranges
        slides = len(segment.translations.value or "")
        bounds = [] if ranges is None else list(zip(ranges.min_bound, ranges.max_bound, strict=True))
        limits = [
            _range(name, *bound, angle=i >= slides)
            for i, (name, bound) in enumerate(zip(segment.dof_names, bounds, strict=False))
        ]
        inertia = segment.inertia_parameters
        numbers[segment.name] = len(parts)
        parts.append(
            ModelPart(
                name=segment.name,
                joint=segment.name,
                parent=numbers.get(segment.parent_name, -1),
                frame=np.asarray(segment.segment_coordinate_system.scs.rt_matrix, dtype=float),
                turns=bool(angles),
                slides=slides > 0,
                limits=tuple(limits),
                markers={marker.name: np.ravel(marker.mean_position)[:3] for marker in segment.markers},
                mass_kg=0.0 if inertia is None else float(inertia.mass),
                com_m=np.zeros(3) if inertia is None else np.ravel(inertia.center_of_mass)[:3],
            )
        )
    return parts


def _mujoco(path: Path) -> list[ModelPart]:
    """Bodies, joints and sites of MJCF, or links of URDF; meshes are not needed."""
    mujoco = _library("mujoco", path)
    spec = mujoco.MjSpec.from_file(str(path))
    unit = np.pi / 180 if spec.compiler.degree else 1.0
    masses = _masses(mujoco, path)
    parts: list[ModelPart] = []
    waiting = [(spec.worldbody, -1)]
    while waiting:
        body, parent = waiting.pop(0)
        name = body.name or f"body{len(parts)}"
        frame = np.eye(4)
        frame[:3, :3] = Rotation.from_quat(body.quat, scalar_first=True).as_matrix()
        frame[:3, 3] = body.pos
        joints = list(body.joints)
        hinges = [j for j in joints if j.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_BALL)]
        free = any(j.type == mujoco.mjtJoint.mjJNT_FREE for j in joints)
        mass, com = masses.get(body.name, (0.0, np.zeros(3)))
        waiting += [(child, len(parts)) for child in body.bodies]
        parts.append(
            ModelPart(
                name=name,
                joint=(joints[0].name if len(joints) == 1 else "") or name,
                parent=parent,
                frame=frame,
                turns=bool(hinges) or free,
                slides=free or any(j.type == mujoco.mjtJoint.mjJNT_SLIDE for j in joints),
                limits=tuple(
                    _range(j.name or name, *(j.range * (unit if j in hinges else 1)), angle=j in hinges)
                    for j in joints
                    if j.range[0] < j.range[1]
                ),
                centre_m=np.array(hinges[0].pos) if hinges else np.zeros(3),
                markers={site.name: np.array(site.pos) for site in body.sites if site.name},
                mass_kg=mass,
                com_m=com,
            )
        )
    return parts


def _masses(mujoco: Any, path: Path) -> dict[str, tuple[float, Array]]:
    """Mass and its centre by body: those of the compiled model, or where meshes are missing those that are stated."""
    spec = mujoco.MjSpec.from_file(str(path))
    try:
        model = spec.compile()
    except ValueError:
        return {b.name: (float(b.mass), np.array(b.ipos)) for b in spec.bodies if b.explicitinertial}
    return {model.body(i).name: (float(model.body_mass[i]), model.body_ipos[i].copy()) for i in range(1, model.nbody)}


def _library(name: str, path: Path) -> Any:
    needs(f"{path.name}: reading such a model", "models", name)
    return import_module(name)


MODELS: dict[str, Callable[[Path], list[ModelPart]]] = {
    ".osim": _osim,
    ".biomod": _biomod,
    ".urdf": _mujoco,
    ".xml": _mujoco,
    ".mjcf": _mujoco,
}
"""What reads a model, by the end of its name (``skeleton_files.is_model``)."""
