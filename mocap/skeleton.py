"""The skeleton of an animal: its markers, bones, rigid bodies, joints and trunk, read from TOML."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from eal.arrays import short_repr, unique
from mocap.documents import decoded, from_toml, regular_bytes
from mocap.errors import FormatError, SkeletonError
from mocap.measures import Measures, measures_lines, read_measures
from mocap.schema import POSITIVE, Entry, Schema, checked, names
from mocap.sides import other_side, side_of
from mocap.text import unfit, visible


@dataclass(frozen=True, kw_only=True)
class Bone:
    """Two markers; ``rigid`` when their distance is one length (to the marker placement and soft tissue)."""

    a: str
    b: str
    rigid: bool = True


@dataclass(frozen=True, kw_only=True)
class Joint:
    """Parent, centre and child markers: shoulder, elbow, wrist describe the elbow."""

    name: str
    parent: str
    centre: str
    child: str


@dataclass(frozen=True, kw_only=True)
class BodyJoint:
    """A joint by which one rigid body moves on another."""

    name: str
    parent: str
    child: str


@dataclass(frozen=True, kw_only=True, init=False)
class Skeleton:
    """What is known of the animal before it moves.

    ``Skeleton(markers=["a", "b", "c"], bones=[("a", "b"), ("b", "c")], joints={"elbow": ("a", "b", "c")})``: what a
    skeleton file says, without one.

    Attributes:
        name: Species or subject.
        markers: All marker names, unique; a recording may have more.
        bones: Pairs of markers; of those given as texts a third, ``"soft"``, says that the length changes.
        joints: Triples of markers (parent, centre, child), given by name.
        bodies: Markers of each rigid body, three or more, by its name; no marker is in two.
        body_joints: Joints between two bodies, given among ``joints`` as the names of both.
        trunk: Markers that move as one body and define its frame; empty: all markers do.
        aliases: Name in the file (``pt1``) to name here, for files that number their points.
        max_speed_m_s: No marker moves faster; None: not known.
        measures: What is measured beyond joints.
    """

    name: str
    markers: tuple[str, ...]
    bones: tuple[Bone, ...]
    joints: tuple[Joint, ...]
    bodies: dict[str, tuple[str, ...]]
    body_joints: tuple[BodyJoint, ...]
    trunk: tuple[str, ...]
    aliases: dict[str, str]
    max_speed_m_s: float | None
    measures: Measures

    __repr__ = short_repr

    def __init__(
        self,
        *,
        markers: Sequence[str],
        bones: Sequence[Bone | Sequence[str]] = (),
        joints: Sequence[Joint | BodyJoint] | Mapping[str, Sequence[str]] = (),
        bodies: Mapping[str, Sequence[str]] | None = None,
        trunk: Sequence[str] = (),
        aliases: Mapping[str, str] | None = None,
        max_speed_m_s: float | None = None,
        measures: Measures | Mapping[str, Any] | None = None,
        name: str = "skeleton",
        body_joints: Sequence[BodyJoint] = (),
    ) -> None:
        """Take what is given apart, and check names.

        Args:
            markers: All marker names.
            bones: Pairs of markers, with ``"soft"`` as a third where the length changes.
            joints: Parent, centre and child marker of each joint, or parent and child body, by its name.
            bodies: Three markers or more that move as one, by the name of the body.
            trunk: Markers that move as one body.
            aliases: Names in files by names here.
            max_speed_m_s: No marker moves faster.
            measures: As under ``[measures]`` of a skeleton file (docs/reference/kinematics.md).
            name: Species or subject.
            body_joints: Joints between bodies, as another skeleton has them.

        Raises:
            SkeletonError: something is given otherwise, or uses a marker that is not among ``markers``.
        """
        for what, names_given in (("markers", markers), ("trunk", trunk)):
            if not _is_text(names_given):
                raise SkeletonError(f"skeleton {name!r}: {what} is {names_given!r}, expected a list of texts")
        try:
            named = joints.items() if isinstance(joints, Mapping) else ()
            parts: dict[str, Any] = {
                "bones": tuple(bone if isinstance(bone, Bone) else _bone(bone) for bone in bones),
                "bodies": {name: _body(name, entry) for name, entry in dict(bodies or {}).items()},
                "joints": tuple(_joint(*one) for one in named) or tuple(joints),
                "measures": measures if isinstance(measures, Measures) else read_measures(measures or {}),
            }
        except (TypeError, ValueError, AttributeError, FormatError) as error:
            raise SkeletonError(f"skeleton {name!r}: {error}") from None
        odd = next((joint for joint in parts["joints"] if not isinstance(joint, Joint | BodyJoint)), None)
        if odd is not None:
            raise SkeletonError(
                f'skeleton {name!r}: joints holds {odd!r}, expected {{"elbow": ("shoulder", "elbow", "wrist"), ...}}'
            )
        found = (joint for joint in parts["joints"] if isinstance(joint, BodyJoint))
        parts["body_joints"] = (*body_joints, *found)
        parts["joints"] = tuple(joint for joint in parts["joints"] if isinstance(joint, Joint))
        jointed = (joint.name for joint in (*parts["joints"], *parts["body_joints"]))
        for one in (*markers, *trunk, *parts["bodies"], *jointed, *(aliases or {}).values()):
            if trouble := unfit(one):
                raise SkeletonError(f"skeleton {name!r}: the name {one!r} {trouble}: give it another")
        parts |= {"name": name, "markers": tuple(markers), "trunk": tuple(trunk)}
        parts |= {"aliases": dict(aliases or {}), "max_speed_m_s": max_speed_m_s}
        for key, value in parts.items():
            object.__setattr__(self, key, value)
        self._check()

    def _check(self) -> None:
        try:
            unique("marker", self.markers)
            unique("joint", tuple(j.name for j in (*self.joints, *self.body_joints)))
        except ValueError as error:
            raise SkeletonError(f"skeleton {self.name!r}: {error}") from None
        if not self.markers:
            raise SkeletonError(f"skeleton {self.name!r}: markers is empty: name at least one")
        if self.max_speed_m_s is not None and not 0 < self.max_speed_m_s < float("inf"):
            raise SkeletonError(
                f"skeleton {self.name!r}: max_speed_m_s must be a positive speed, not {self.max_speed_m_s:g}"
            )
        for joint in (*self.joints, *self.body_joints):
            if any(c in joint.name for c in "/\\") or joint.name.startswith("."):
                raise SkeletonError(f"skeleton {self.name!r}: joint name {joint.name!r} cannot name a file: rename it")
        parts = [(f"bone {b.a}-{b.b}", (b.a, b.b)) for b in self.bones]
        parts += [(f"joint {j.name}", (j.parent, j.centre, j.child)) for j in self.joints]
        for where, members in parts:
            if len(set(members)) < len(members):
                raise SkeletonError(f"skeleton {self.name!r}: {where} has a marker twice: {', '.join(members)}")
        uses = [(f"bone {b.a}-{b.b}", m) for b in self.bones for m in (b.a, b.b)]
        uses += [(f"joint {j.name}", m) for j in self.joints for m in (j.parent, j.centre, j.child)]
        uses += [("trunk", m) for m in self.trunk] + [("aliases", m) for m in self.aliases.values()]
        uses += [(f"body {name}", m) for name, members in self.bodies.items() for m in members]
        uses += list(self.measures.uses())
        for where, marker in uses:
            if marker not in self.markers:
                raise SkeletonError(
                    f"skeleton {self.name!r}: {where} uses marker {marker!r}, which is not in its markers"
                )
        self._check_bodies()
        for name, axes in self.measures.axes.items():
            where = f"skeleton {self.name!r}: measures.axes.{name}"
            joint = next((j for j in (*self.joints, *self.body_joints) if j.name == name), None)
            if joint is None:
                raise SkeletonError(f"skeleton {self.name!r}: measures.axes names {name!r}, which is no joint of it")
            if isinstance(joint, BodyJoint):
                for body, part in ((joint.parent, axes.parent), (joint.child, axes.child)):
                    used = [m for line in part for m in line] if isinstance(part, tuple) else list(part or ())
                    odd = next((marker for marker in used if marker not in self.bodies[body]), None)
                    if odd is not None:
                        raise SkeletonError(f"{where} uses marker {odd!r} for {body!r}, which has no such marker")
                    if isinstance(part, Mapping) and len(part) < 3:
                        raise SkeletonError(f"{where} places {len(part)} markers of {body!r}: axes need 3 at least")
            elif not (isinstance(axes.parent, tuple) and isinstance(axes.child, tuple)) or axes.helical:
                raise SkeletonError(
                    f"{where}: axes of a joint of three markers are directions between markers, parent and child; "
                    "places, functional and helical are of joints between bodies"
                )

    def _check_bodies(self) -> None:
        first: dict[str, str] = {}
        for name, members in self.bodies.items():
            if len(set(members)) < 3:
                raise SkeletonError(
                    f"skeleton {self.name!r}: body {name!r} has {len(set(members))} different markers, and needs at "
                    "least 3 to have axes: state two markers that keep their distance as a bone"
                )
            for marker in members:
                if first.setdefault(marker, name) != name:
                    raise SkeletonError(
                        f"skeleton {self.name!r}: marker {marker!r} is in the bodies {first[marker]!r} and {name!r}: "
                        "leave it in the one that it is fixed to"
                    )
        for joint in self.body_joints:
            for body in (joint.parent, joint.child):
                if body not in self.bodies:
                    raise SkeletonError(
                        f"skeleton {self.name!r}: joint {joint.name!r} is between two names, and {body!r} is none of "
                        f"its bodies ({', '.join(self.bodies) or 'it has none'}): give two bodies, or "
                        '["parent", "centre", "child"] markers'
                    )
            if joint.parent == joint.child:
                raise SkeletonError(f"skeleton {self.name!r}: joint {joint.name!r} joins {joint.parent!r} to itself")

    def for_markers(self, names: Sequence[str], *, source: str = "the recording") -> "Skeleton":
        """This skeleton, checked against the markers of a recording.

        Raises:
            SkeletonError: a bone, joint or the trunk uses a marker that the recording lacks.
        """
        for marker in self.markers:
            if marker not in names:
                raise SkeletonError(
                    f"skeleton {self.name!r} has marker {marker!r}, but {source} has {', '.join(names)}: "
                    "correct the name, or map file names under [aliases] in the skeleton"
                )
        return self

    @property
    def rigid(self) -> tuple[tuple[str, str], ...]:
        """Ends of the rigid bones."""
        return tuple((bone.a, bone.b) for bone in self.bones if bone.rigid)

    def renamed(self, names: Sequence[str]) -> tuple[str, ...]:
        """File names to names of this skeleton, by its aliases."""
        return tuple(self.aliases.get(name, name) for name in names)


def mirrored(skeleton: Skeleton) -> Skeleton:
    """A skeleton with what one side has on the other, too: bones, joints and bodies whose markers have a twin there.

    Sides are those that names say (``mocap.sides``); what is there already stays.
    """

    def across(names: Sequence[str]) -> tuple[str, ...] | None:
        twins = tuple(map(other_side, names))
        return None if twins == tuple(names) or not set(twins) <= set(skeleton.markers) else twins

    bones = {frozenset((bone.a, bone.b)): bone for bone in skeleton.bones}
    for bone in skeleton.bones:
        if twins := across((bone.a, bone.b)):
            bones.setdefault(frozenset(twins), Bone(a=twins[0], b=twins[1], rigid=bone.rigid))
    joints = {joint.name: joint for joint in skeleton.joints}
    ends = {(joint.parent, joint.centre, joint.child) for joint in skeleton.joints}
    for joint in skeleton.joints:
        twins = across((joint.parent, joint.centre, joint.child))
        if twins and twins not in ends:
            name = other_side(joint.name)
            name = f"{name}_{side_of(twins[-1])}" if name == joint.name else name
            joints.setdefault(name, Joint(name=name, parent=twins[0], centre=twins[1], child=twins[2]))
    bodies, used = dict(skeleton.bodies), {marker for body in skeleton.bodies.values() for marker in body}
    for name, members in skeleton.bodies.items():
        if (twins := across(members)) and not used & set(twins):
            bodies[other_side(name)] = twins
    return replace(skeleton, bones=tuple(bones.values()), joints=tuple(joints.values()), bodies=bodies)


_AGAIN = "correct it"
_ENTRIES: Schema = {
    "name": Entry(kind="s", needed=False),
    "markers": Entry(kind="s", shape=(None,)),
    "trunk": Entry(kind="s", shape=(None,), needed=False),
    "max_speed_m_s": Entry(least=POSITIVE, needed=False),
}
_KEYS = {"name", "markers", "bones", "bodies", "joints", "trunk", "aliases", "max_speed_m_s", "measures"}


def skeleton_from_toml(path: Path) -> Skeleton:
    """Read a skeleton's own file.

    ``markers = ["a", "b", ...]``; ``bones = [["a", "b"], ...]``, a third entry ``"soft"`` for one whose length changes
    (or a table ``[bones]`` with ``thigh = ["a", "b"]``, whose names are not kept);
    ``trunk = [...]``; ``max_speed_m_s = 20.0``; a table ``[joints]`` with ``elbow = ["shoulder", "elbow", "wrist"]``;
    a table ``[bodies]`` with ``cranium = ["b1", "b2", "b3"]``, and a joint ``jaw = ["cranium", "mandible"]`` of two;
    a table ``[aliases]`` with ``pt1 = "shoulder"``; a table ``[measures]`` (docs/reference/kinematics.md).

    Raises:
        SkeletonError: the file cannot be read as that.
    """
    try:
        text, _ = decoded(path, regular_bytes(path))  # > of PowerShell writes UTF-16, that of cmd Windows-1252
    except OSError as error:
        raise SkeletonError(f"{path}: cannot be read: {error.strerror}") from None
    except FormatError as error:
        raise SkeletonError(f"{path}: not a readable TOML file: {error}") from None
    try:
        table = from_toml(text, str(path))
    except FormatError as error:
        raise SkeletonError(str(error)) from None
    unknown = set(table) - _KEYS
    if unknown:
        raise SkeletonError(f"{path}: unknown key {min(unknown)!r}: a skeleton has {', '.join(sorted(_KEYS))}")
    try:
        found, bones = checked("skeleton", table, _ENTRIES, again=_AGAIN), table.get("bones", ())
        return Skeleton(
            name=visible(found["name"][()]) if "name" in found else path.stem,
            markers=tuple(found["markers"]),
            bones=list(_named(table, "bones").values()) if isinstance(bones, dict) else bones,
            joints=_named(table, "joints"),
            bodies=_named(table, "bodies"),
            trunk=tuple(found.get("trunk", ())),
            aliases={visible(name): visible(_alias(name, alias)) for name, alias in _named(table, "aliases").items()},
            max_speed_m_s=float(found["max_speed_m_s"]) if "max_speed_m_s" in found else None,
            measures=_named(table, "measures"),
        )
    except (TypeError, ValueError, AttributeError, FormatError, SkeletonError) as error:
        raise SkeletonError(f"{path}: {error}") from None


def _named(table: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A table of the file by its names."""
    found = table.get(key, {})
    if not isinstance(found, Mapping):
        raise FormatError(f"{key} is {found!r}, expected a table [{key}]")
    checked(key, {"names": [*found]}, {"names": names()}, again=_AGAIN)
    return found


def quoted(value: object) -> str:
    """A string, or a list of strings, of TOML: those of JSON, but for a control that JSON lets stand."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def skeleton_text(skeleton: Skeleton, *, comments: Mapping[str, Sequence[str]] | None = None) -> str:
    """A skeleton as ``skeleton_from_toml`` reads it.

    Args:
        skeleton: What to write.
        comments: Lines by what they are said of: ``""`` the whole, ``bones``, ``trunk``, ``bodies``, ``joints``,
            ``aliases`` (they stand before it), ``bone A B``, ``body NAME`` and ``joint NAME`` (behind it).
    """
    remarks = comments or {}

    def before(what: str) -> list[str]:
        return [f"# {line}".rstrip() for line in remarks.get(what, ())]

    def behind(what: str) -> str:
        return "".join(f"  # {line}" for line in remarks.get(what, ()))

    lines = [*before(""), f"name = {quoted(skeleton.name)}", f"markers = {quoted(skeleton.markers)}"]
    lines += [*before("bones"), "bones = ["]
    for bone in skeleton.bones:
        ends = [bone.a, bone.b] if bone.rigid else [bone.a, bone.b, "soft"]
        lines.append(f"    {quoted(ends)},{behind(f'bone {bone.a} {bone.b}')}")
    lines += ["]", *before("trunk"), f"trunk = {quoted(skeleton.trunk)}"]
    if skeleton.max_speed_m_s is not None:
        lines += [f"max_speed_m_s = {float(skeleton.max_speed_m_s)!r}"]
    if skeleton.bodies:
        lines += ["", *before("bodies"), "[bodies]"]
    for name, members in skeleton.bodies.items():
        lines.append(f"{quoted(name)} = {quoted(members)}{behind(f'body {name}')}")
    lines += ["", *before("joints"), "[joints]"]
    for joint in skeleton.body_joints:
        lines.append(f"{quoted(joint.name)} = {quoted([joint.parent, joint.child])}{behind(f'joint {joint.name}')}")
    for joint in skeleton.joints:
        ends = [joint.parent, joint.centre, joint.child]
        lines.append(f"{quoted(joint.name)} = {quoted(ends)}{behind(f'joint {joint.name}')}")
    lines += ["", *before("aliases"), "[aliases]"]
    lines += [f"{quoted(k)} = {quoted(v)}" for k, v in skeleton.aliases.items()]
    lines += measures_lines(skeleton.measures, quoted)
    return "\n".join(lines) + "\n"


def write_skeleton(path: Path, skeleton: Skeleton) -> None:
    """Write a skeleton as ``skeleton_from_toml`` reads it."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(skeleton_text(skeleton))


def _alias(name: str, alias: Any) -> str:
    return checked("aliases", {name: alias}, {name: Entry(kind="s")}, again=_AGAIN)[name][()]


def _bone(entry: Any) -> Bone:
    if not _is_text(entry) or len(entry) not in (2, 3) or (len(entry) == 3 and entry[2] not in ("rigid", "soft")):
        raise ValueError(f'a bone is ["a", "b"] or ["a", "b", "soft"], not {entry!r}')
    return Bone(a=visible(entry[0]), b=visible(entry[1]), rigid=len(entry) == 2 or entry[2] == "rigid")


def _joint(name: str, entry: Any) -> Joint | BodyJoint:
    if not _is_text(entry) or len(entry) not in (2, 3):
        raise ValueError(
            f'joint {name!r} is ["parent", "centre", "child"] markers or ["parent", "child"] bodies, not {entry!r}'
        )
    ends = tuple(map(visible, entry))
    if len(ends) == 2:
        return BodyJoint(name=name, parent=ends[0], child=ends[1])
    return Joint(name=name, parent=ends[0], centre=ends[1], child=ends[2])


def _body(name: str, entry: Any) -> tuple[str, ...]:
    if not _is_text(entry):
        raise ValueError(f'body {name!r} is a list of markers ["a", "b", "c"], not {entry!r}')
    return tuple(map(visible, entry))


def _is_text(entry: Any) -> bool:
    return isinstance(entry, list | tuple) and all(isinstance(one, str) for one in entry)


def __getattr__(name: str) -> Any:
    """Names that moved to ``mocap.skeleton_files``, which knows the models of other programs too."""
    if name in ("is_model", "read_model", "read_skeleton"):
        return getattr(import_module("mocap.skeleton_files"), name)
    raise AttributeError(f"module 'mocap.skeleton' has no attribute {name!r}")
