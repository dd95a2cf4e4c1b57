"""The fitted animal as an MJCF file, for MuJoCo and programs that read its models.

MJCF: https://mujoco.readthedocs.io/en/stable/XMLreference.html. Lengths in metres, masses in kilograms, angles
in radians.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from filters.joint_types import Articulation, articulation
from mocap.arrays import Array
from mocap.body import body_frames
from mocap.errors import MocapError
from mocap.measures import AXES
from mocap.pipeline.limb_mechanics import UNKNOWN_KG, rod_masses
from mocap.pipeline.run import Run
from mocap.records import Status

FILE = "skeleton.mjcf.xml"
JOINT_HZ = 30.0
THIN = 0.03
"""Radius of a capsule over its segment's length."""
GRAVITY_M_S2 = 9.81


def write_mjcf(run: Run, path: Path) -> None:
    """Write the animal in its mean pose: the trunk with a free joint, segments as capsules, joints, markers as sites.

    Segments of constant (median) length hang on each other by the joints that the samples need
    (``filters.joint_types``); masses are those that the skeleton states, else of uniform rods.

    Args:
        run: A tracked recording.
        path: The file.

    Raises:
        MocapError: its skeleton has no trunk, or no limb is known often enough.
    """
    path.write_text(mjcf_text(run), encoding="utf-8")


def mjcf_text(run: Run) -> str:
    """The file; see ``write_mjcf``."""
    skeleton, markers = run.skeleton, run.tracked.markers
    names = list(markers.names)
    if not skeleton.trunk:
        raise MocapError(
            f"{run.name}: its skeleton names no trunk, which the segments of an MJCF file hang on: state one"
        )
    trunk = [names.index(m) for m in skeleton.trunk]
    axes = body_frames(markers.xyz_m[:, trunk], dt_s=_step(markers.t_s), cutoff_hz=JOINT_HZ)
    known = markers.status == Status.MEASURED
    xyz = np.where(known[..., None], markers.xyz_m, np.nan)
    joints = articulation(names, xyz, markers.sd_m, skeleton, axes.rotation)
    if not joints:
        raise MocapError(f"{run.name}: no segment beyond the trunk is seen often enough for an MJCF file")
    body = axes.to_body(xyz)
    mean = {m: _mean(body[:, names.index(m)]) for m in skeleton.trunk}
    masses = _masses(run, joints)
    root = ElementTree.Element("mujoco", model=_name(run.name))
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    up = np.array(AXES[skeleton.measures.up])
    ElementTree.SubElement(root, "option", gravity=_numbers(-GRAVITY_M_S2 * up))
    world = ElementTree.SubElement(root, "worldbody")
    whole = ElementTree.SubElement(world, "body", name="trunk", pos="0 0 0")
    ElementTree.SubElement(whole, "freejoint", name="root")
    size = max(float(np.ptp([p for p in mean.values() if np.isfinite(p).all()], axis=0).max()) / 4.0, 1e-4)
    stated = [p for p in skeleton.measures.segments.values() if {p.start, p.end} <= set(skeleton.trunk)]
    trunk_kg = 1e-3 * sum(part.mass_g for part in stated) or UNKNOWN_KG
    ElementTree.SubElement(whole, "geom", name="trunk", type="sphere", size=_numbers([size]), mass=f"{trunk_kg:.9g}")
    for marker, at in mean.items():
        if np.isfinite(at).all():
            ElementTree.SubElement(whole, "site", name=_name(marker), pos=_numbers(at), size="0.001")
    _segments(whole, joints, dict(mean), body, names, masses)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _segments(
    whole: ElementTree.Element,
    joints: Sequence[Articulation],
    trunk: dict[str, Array],
    body: Array,
    names: Sequence[str],
    masses: Mapping[str, float],
) -> None:
    """A body for each segment, inside that of the segment it hangs on, its axes those of the trunk in the mean pose."""
    places: dict[str, tuple[ElementTree.Element, Array]] = {m: (whole, at) for m, at in trunk.items()}
    for joint in joints:  # parents come first
        if joint.centre not in places or not np.isfinite(places[joint.centre][1]).all():
            continue
        holder, at = places[joint.centre]
        way = body[:, names.index(joint.child)] - body[:, names.index(joint.centre)]
        direction = _mean(way)
        vector = joint.length_m * direction / np.linalg.norm(direction)
        title = _name(f"{joint.centre}_{joint.child}")
        part = ElementTree.SubElement(holder, "body", name=title, pos=_numbers(at))
        _joint(part, joint, title, vector)
        ElementTree.SubElement(
            part,
            "geom",
            name=title,
            type="capsule",
            fromto=_numbers([0.0, 0.0, 0.0, *vector]),
            size=_numbers([THIN * joint.length_m]),
            mass=f"{masses[joint.child]:.9g}",
        )
        ElementTree.SubElement(part, "site", name=_name(joint.child), pos=_numbers(vector), size="0.001")
        places[joint.child] = (part, vector)


def _joint(part: ElementTree.Element, joint: Articulation, title: str, vector: Array) -> None:
    if joint.kind == "ball":
        ElementTree.SubElement(part, "joint", name=title, type="ball")
    elif joint.kind == "hinge":
        ElementTree.SubElement(part, "joint", name=title, type="hinge", axis=_numbers(joint.axis))
    elif joint.kind == "universal":
        first = joint.axis - (joint.axis @ vector) * vector / (vector @ vector)
        first = first / np.linalg.norm(first)
        second = np.cross(vector / np.linalg.norm(vector), first)
        for letter, axis in (("a", first), ("b", second)):
            ElementTree.SubElement(part, "joint", name=f"{title}_{letter}", type="hinge", axis=_numbers(axis))


def _masses(run: Run, joints: Sequence[Articulation]) -> dict[str, float]:
    bones = [(j.centre, j.child) for j in joints]
    lengths = np.array([j.length_m for j in joints])
    mass, _, _ = rod_masses(bones, lengths, list(run.skeleton.measures.segments.values()))
    return {joint.child: float(m) for joint, m in zip(joints, mass, strict=True)}


def _mean(xyz: Array) -> Array:
    known = xyz[np.isfinite(xyz).all(axis=-1)]
    return known.mean(axis=0) if len(known) else np.full(3, np.nan)


def _step(t_s: Array) -> float:
    return float(np.diff(t_s).mean()) if len(t_s) > 1 else 1.0


def _numbers(values: Sequence[float] | Array) -> str:
    return " ".join(f"{float(x) + 0.0:.9g}" for x in values)


def _name(name: str) -> str:
    """A name without what XML's attributes or MuJoCo's paths give a meaning."""
    return re.sub(r"[^\w.-]", "_", name) or "_"
