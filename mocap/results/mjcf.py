"""The fitted animal as an MJCF file, for MuJoCo and programs that read its models.

MJCF: https://mujoco.readthedocs.io/en/stable/XMLreference.html. Lengths in metres, masses in kilograms, angles
in radians.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from eal.arrays import Array
from eal.systems import GRAVITY_M_S2
from mocap.errors import MocapError
from mocap.filters.anatomy import masses_of
from mocap.filters.bodies import UNKNOWN_KG, rod_masses
from mocap.filters.body_axes import body_frames
from mocap.filters.joint_types import Articulation, articulation
from mocap.measures import AXES
from mocap.records import Status
from mocap.tracking.result import Result


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedAnimal:
    """An animal in its mean pose, about its trunk.

    Attributes:
        names: The M markers.
        trunk: Mean place of each marker of the trunk, where it is known.
        body: (T, M, 3) measured markers in the trunk's axes.
        joints: Segments that hang on it, parents first.
        masses: Mass of each segment in kg, by the marker at its outer end.
        trunk_kg: That of the trunk.
    """

    names: tuple[str, ...]
    trunk: Mapping[str, Array]
    body: Array
    joints: Sequence[Articulation]
    masses: Mapping[str, float]
    trunk_kg: float

    def segments(self) -> Iterator[tuple[Articulation, Array, Array]]:
        """Each segment whose beginning is known: its joint, that place in the segment before it, and its vector."""
        places = dict(self.trunk)
        for joint in self.joints:
            if joint.centre not in places or not np.isfinite(places[joint.centre]).all():
                continue
            way = self.body[:, self.names.index(joint.child)] - self.body[:, self.names.index(joint.centre)]
            direction = _mean(way)
            vector = joint.length_m * direction / np.linalg.norm(direction)
            yield joint, places[joint.centre], vector
            places[joint.child] = vector


def fitted_animal(run: Result, *, what: str) -> FittedAnimal:
    """The animal of a tracked recording.

    Raises:
        MocapError: its skeleton has no trunk, or no limb is known often enough.
    """
    skeleton, markers = run.skeleton, run.tracks
    names = markers.names
    if not skeleton.trunk:
        raise MocapError(
            f"{run.name}: its skeleton names no trunk, to which the segments of {what} are attached: state one"
        )
    trunk = [names.index(m) for m in skeleton.trunk]
    axes = body_frames(markers.xyz_m[:, trunk], dt_s=_step(markers.t_s))
    measured = markers.status == Status.MEASURED
    xyz = np.where(measured[..., None], markers.xyz_m, np.nan)
    joints = articulation(names, xyz, markers.sd_m, axes.rotation, trunk=skeleton.trunk, bones=skeleton.rigid)
    if not joints:
        raise MocapError(f"{run.name}: no segment beyond the trunk is seen often enough for {what}")
    body = axes.to_body(xyz)
    lengths = np.array([j.length_m for j in joints])
    bones = [(names.index(j.centre), names.index(j.child)) for j in joints]
    mass, _, _ = rod_masses(bones, lengths, masses_of(names, skeleton.measures.masses))
    trunk_parts = [p for p in skeleton.measures.segments.values() if {p.start, p.end} <= set(skeleton.trunk)]
    return FittedAnimal(
        names=names,
        trunk={m: _mean(body[:, names.index(m)]) for m in skeleton.trunk},
        body=body,
        joints=joints,
        masses={joint.child: float(m) for joint, m in zip(joints, mass, strict=True)},
        trunk_kg=1e-3 * sum(part.mass_g for part in trunk_parts) or UNKNOWN_KG,
    )


def mjcf_text(run: Result) -> str:
    """The animal in its mean pose: the trunk with a free joint, segments as capsules, joints, markers as sites.

    Segments of constant (median) length hang on each other by the joints that the samples need
    (``mocap.filters.joint_types``); masses are those that the skeleton states, else of uniform rods.

    Raises:
        MocapError: its skeleton has no trunk, or no limb is known often enough.
    """
    animal = fitted_animal(run, what="an MJCF file")
    mean, skeleton = animal.trunk, run.skeleton
    root = ElementTree.Element("mujoco", model=plain_name(run.name))
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    up = np.array(AXES[skeleton.measures.up])
    ElementTree.SubElement(root, "option", gravity=numbers(-GRAVITY_M_S2 * up))
    world = ElementTree.SubElement(root, "worldbody")
    whole = ElementTree.SubElement(world, "body", name="trunk", pos="0 0 0")
    ElementTree.SubElement(whole, "freejoint", name="root")
    size = max(float(np.ptp([p for p in mean.values() if np.isfinite(p).all()], axis=0).max()) / 4.0, 1e-4)
    ElementTree.SubElement(
        whole, "geom", name="trunk", type="sphere", size=numbers([size]), mass=f"{animal.trunk_kg:.9g}"
    )
    for marker, at in mean.items():
        if np.isfinite(at).all():
            ElementTree.SubElement(whole, "site", name=plain_name(marker), pos=numbers(at), size="0.001")
    _segments(whole, animal)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _segments(whole: ElementTree.Element, animal: FittedAnimal) -> None:
    """A body for each segment, inside that of the segment it hangs on, its axes those of the trunk in the mean pose."""
    holders = dict.fromkeys(animal.trunk, whole)
    for joint, at, vector in animal.segments():
        holder = holders[joint.centre]
        title = plain_name(f"{joint.centre}_{joint.child}")
        part = ElementTree.SubElement(holder, "body", name=title, pos=numbers(at))
        _joint(part, joint, title, vector)
        ElementTree.SubElement(
            part,
            "geom",
            name=title,
            type="capsule",
            fromto=numbers([0.0, 0.0, 0.0, *vector]),
            size=numbers([0.03 * joint.length_m]),
            mass=f"{animal.masses[joint.child]:.9g}",
        )
        ElementTree.SubElement(part, "site", name=plain_name(joint.child), pos=numbers(vector), size="0.001")
        holders[joint.child] = part


def _joint(part: ElementTree.Element, joint: Articulation, title: str, vector: Array) -> None:
    if joint.kind == "ball":
        ElementTree.SubElement(part, "joint", name=title, type="ball")
    elif joint.kind == "hinge":
        ElementTree.SubElement(part, "joint", name=title, type="hinge", axis=numbers(joint.axis))
    elif joint.kind == "universal":
        first = joint.axis - (joint.axis @ vector) * vector / (vector @ vector)
        first = first / np.linalg.norm(first)
        second = np.cross(vector / np.linalg.norm(vector), first)
        for letter, axis in (("a", first), ("b", second)):
            ElementTree.SubElement(part, "joint", name=f"{title}_{letter}", type="hinge", axis=numbers(axis))


def _mean(xyz: Array) -> Array:
    finite = xyz[np.isfinite(xyz).all(axis=-1)]
    return finite.mean(axis=0) if len(finite) else np.full(3, np.nan)


def _step(t_s: Array) -> float:
    return float(np.diff(t_s).mean()) if len(t_s) > 1 else 1.0


def numbers(values: Sequence[float] | Array) -> str:
    """As XML has them, nine digits."""
    return " ".join(f"{float(x) + 0.0:.9g}" for x in values)


def plain_name(name: str) -> str:
    """A name without what XML's attributes or MuJoCo's paths give a meaning."""
    return re.sub(r"[^\w.-]", "_", name) or "_"
