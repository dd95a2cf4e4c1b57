"""The fitted animal as an OpenSim model (.osim): for its inverse kinematics with the recording's .trc.

The XML of OpenSim 4 (https://opensimconfluence.atlassian.net/wiki/spaces/OpenSim/). Lengths in metres, masses in
kilograms, angles in radians.
"""

from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from eal.arrays import Array
from eal.systems import GRAVITY_M_S2
from mocap.filters.joint_types import Articulation
from mocap.measures import AXES
from mocap.results.mjcf import fitted_animal, numbers, plain_name
from mocap.tracking.result import Result

VERSION = "40500"
KINDS = {"ball": "BallJoint", "universal": "UniversalJoint", "hinge": "PinJoint", "fixed": "WeldJoint"}
Element = ElementTree.Element


def osim_text(run: Result) -> str:
    """The animal in its mean pose: the trunk with a free joint, segments of median length, joints, markers.

    The same animal as the MJCF file's (``mocap.results.mjcf``): its joints are those that the samples need, its masses
    those that the skeleton states. A marker lies at the outer end of each segment, those of the trunk at their mean
    places.

    Raises:
        MocapError: its skeleton has no trunk, or no limb is known often enough.
    """
    animal = fitted_animal(run, what="an OpenSim model")
    document = Element("OpenSimDocument", Version=VERSION)
    model = ElementTree.SubElement(document, "Model", name=plain_name(run.name))
    _text(model, "gravity", numbers(-GRAVITY_M_S2 * np.array(AXES[run.skeleton.measures.up])))
    sets = (ElementTree.SubElement(model, kind, name=kind.lower()) for kind in ("BodySet", "JointSet", "MarkerSet"))
    bodies, joints, markers = (ElementTree.SubElement(one, "objects") for one in sets)
    trunk = {name: at for name, at in animal.trunk.items() if np.isfinite(at).all()}
    places = np.array(list(trunk.values()))
    spread = max(float(np.mean(places.var(axis=0).sum())), 1e-8)
    _body(bodies, "trunk", animal.trunk_kg, places.mean(axis=0), animal.trunk_kg * spread * np.eye(3))
    _joint(joints, "FreeJoint", "root", ("/ground", np.zeros(3)), "/bodyset/trunk", np.eye(3))
    holders = dict.fromkeys(trunk, "trunk")
    for name, at in trunk.items():
        _marker(markers, name, "trunk", at)
    for joint, at, vector in animal.segments():
        title, mass = plain_name(f"{joint.centre}_{joint.child}"), animal.masses[joint.child]
        # OpenSim wants some about the rod's own axis
        across = np.eye(3) * (vector @ vector) * (1 + 1e-3) - np.outer(vector, vector)
        _body(bodies, title, mass, vector / 2, mass * (1 / 12) * across)  # a thin uniform rod about its centre
        parent = (f"/bodyset/{holders[joint.centre]}", at)
        _joint(joints, KINDS[joint.kind], title, parent, f"/bodyset/{title}", _axes(joint, vector))
        _marker(markers, joint.child, title, vector)
        holders[joint.child] = title
    ElementTree.indent(document)
    return ElementTree.tostring(document, encoding="unicode", xml_declaration=True) + "\n"


def _axes(joint: Articulation, vector: Array) -> Array:
    """(3, 3) columns x, y, z of the joint's frames: a pin turns about z, a universal joint about x, then y."""
    along = vector / np.linalg.norm(vector)
    if joint.kind == "hinge":
        z = joint.axis / np.linalg.norm(joint.axis)
        x = along - (along @ z) * z
        x /= np.linalg.norm(x)
        return np.column_stack([x, np.cross(z, x), z])
    if joint.kind == "universal":
        x = joint.axis - (joint.axis @ along) * along
        x /= np.linalg.norm(x)
        return np.column_stack([x, np.cross(along, x), along])
    return np.eye(3)


def _body(bodies: Element, name: str, mass_kg: float, centre: Array, inertia: Array) -> None:
    body = ElementTree.SubElement(bodies, "Body", name=name)
    _text(body, "mass", f"{mass_kg:.9g}")
    _text(body, "mass_center", numbers(centre))
    _text(body, "inertia", numbers([*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]))


def _joint(joints: Element, kind: str, name: str, parent: tuple[str, Array], child: str, axes: Array) -> None:
    """A joint whose two frames, of the same axes, lie in the parent at a place and at the origin of the child."""
    joint = ElementTree.SubElement(joints, kind, name=f"{name}_joint")
    _text(joint, "socket_parent_frame", f"{name}_parent")
    _text(joint, "socket_child_frame", f"{name}_child")
    frames = ElementTree.SubElement(joint, "frames")
    turned = numbers(Rotation.from_matrix(axes).as_euler("XYZ"))
    for end, holder, at in (("parent", *parent), ("child", child, np.zeros(3))):
        frame = ElementTree.SubElement(frames, "PhysicalOffsetFrame", name=f"{name}_{end}")
        _text(frame, "socket_parent", holder)
        _text(frame, "translation", numbers(at))
        _text(frame, "orientation", turned)


def _marker(markers: Element, name: str, holder: str, at: Array) -> None:
    marker = ElementTree.SubElement(markers, "Marker", name=plain_name(name))
    _text(marker, "socket_parent_frame", f"/bodyset/{holder}")
    _text(marker, "location", numbers(at))


def _text(parent: Element, tag: str, value: str) -> None:
    ElementTree.SubElement(parent, tag).text = value
