"""All quantities of a motion that a skeleton names."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from eal.arrays import Array
from mocap.filters.velocities import Motion, with_means
from mocap.kinematics import angles
from mocap.kinematics.bodies import joint_quantities
from mocap.kinematics.delta import (
    Naming,
    Points,
    acceleration,
    called,
    central,
    change_sd,
    edges,
    length_sd,
    made,
    of_velocity,
    with_rates,
)
from mocap.kinematics.points import BODY, MASS, rate_points_for
from mocap.kinematics.records import Kinematics, Quantity, without_unknown_angles
from mocap.kinematics.stroke import stroke_quantities
from mocap.measures import AXES, LINES, SEQUENCE, JointAxes
from mocap.sides import LEFT, RIGHT, TRUNK, side_of
from mocap.skeleton import Joint, Skeleton


def kinematics(motion: Motion, skeleton: Skeleton, *, recording: str = "") -> Kinematics:
    """Angles, velocities, accelerations, lengths, areas and strokes, each with its standard deviation.

    Every quantity is a function of positions and velocities of points. Its standard deviation is that of the function
    to first order, from the joint covariance of these that the smoother has (the delta method); the rate of a quantity
    is its slope along the velocities of the state, never a difference of positions; accelerations are changes of the
    state's velocities from the frame before to the frame after, with the covariance of these.
    """
    if BODY not in motion.names:
        motion = with_means(motion, rate_points_for(motion.names, skeleton, n_frames=len(motion.t_s)))
    up = np.array(AXES[skeleton.measures.up])
    found, notes = list(_joints(motion, skeleton)), list[str]()
    for joint in skeleton.body_joints:
        six, reasons = joint_quantities(motion, skeleton, joint)
        found, notes = found + six, notes + reasons
    found += _body(motion, skeleton, up)
    if MASS in motion.names:
        found += point_quantities(motion, MASS, kind="mass")
    found += stroke_quantities(motion, skeleton)
    found += _lengths(motion, skeleton)
    for name in motion.names:
        if name not in (BODY, MASS):
            found += point_quantities(motion, name, kind="marker")
    unique = list({one.name: one for one in reversed(found)}.values())[::-1]
    known, unknown = without_unknown_angles(unique)
    return Kinematics(
        recording=recording,
        t_s=motion.t_s,
        quantities=tuple(known),
        notes=(*_notes(motion, skeleton), *notes, *unknown),
    )


def _notes(motion: Motion, skeleton: Skeleton) -> Iterator[str]:
    measures = skeleton.measures
    apart = [
        j.name
        for j in skeleton.joints
        if not motion.knows([motion.index(name) for name in (j.parent, j.centre, j.child)])
    ]
    if apart:
        yield (
            f"covariances between the markers of {', '.join(apart)} were not kept: these markers are taken for "
            "independent, so that intervals of angles are usually too wide"
        )
    if not skeleton.joints and not skeleton.body_joints:
        yield "the skeleton has no joints: there are no angles; `mocap skeleton` proposes some"
    lost = {"forward": "yaw, pitch and roll", "left": "roll"}
    name = next((name for name in lost if getattr(measures, name) is None), None)
    if name is not None:
        yield f"the skeleton states no `{name}` under [measures]: there is no {lost[name]}: add {LINES[name]}"
    if not measures.segments:
        yield "the skeleton states no masses of segments under [measures.segments]: there is no centre of mass"


def _joints(motion: Motion, skeleton: Skeleton) -> Iterator[Quantity]:
    for joint in skeleton.joints:
        axes = skeleton.measures.axes.get(joint.name)
        three = Points.of(motion, (joint.parent, joint.centre, joint.child))
        what = f"angle between {joint.parent}, {joint.centre}, {joint.child}; 180 where they lie in line"
        naming = Naming(f"{joint.name}_angle", "deg", what, "joint")
        flexed = Naming(
            f"{joint.name}_flexion",
            "deg",
            f"flexion of {joint.name}: 180 degrees less the angle of its three markers",
            "joint",
        )
        flexion, *rates = with_rates(three, angles.flexion, flexed, rates=axes is None)
        flexion = replace(flexion, sd=np.where(np.isfinite(flexion.value), _flexion_sd_deg(three), np.nan))
        yield called(naming, three.names, 180 - flexion.value, flexion.sd, flexion.rests)
        if axes is None:
            yield from (flexion, *rates)
        else:
            yield from _three_angles(motion, joint, axes)


def _flexion_sd_deg(three: Points) -> Array:
    """(T,) root mean square errors of flexion, also of a joint that is nearly straight, or folded, degrees."""
    place = np.arange(18).reshape(3, 6)[:, :3].ravel()
    with np.errstate(invalid="ignore", divide="ignore"):
        tangent, g = angles.flexion_slopes(three.x)
        cov = g @ three.cov[:, place][:, :, place] @ np.swapaxes(g, 1, 2)
        return np.degrees(length_sd(np.stack([tangent, np.zeros_like(tangent)], axis=1), cov))


def _three_angles(motion: Motion, joint: Joint, axes: JointAxes) -> Iterator[Quantity]:
    """Flexion, abduction and rotation about stated axes; of a right joint in frames that are a left one's mirror image.

    A line from one side of the animal to the other leads to the side of the joint, whichever way it is stated.
    """
    side = next((one for one in map(side_of, (joint.name, joint.centre)) if one != TRUNK), TRUNK)
    crossing = {LEFT, RIGHT}
    lines = [(b, a) if {side_of(a), side_of(b)} == crossing and side_of(a) == side else (a, b) for a, b in axes.lines]
    points = Points.of(motion, [marker for line in lines for marker in line])
    about = (
        ("flexion", "in the parent's plane of flexion, about its axis normal to its long axis and second direction"),
        ("abduction", "out of the parent's plane of flexion"),
        ("rotation", "of the child about its long axis"),
    )
    if axes.sequence != SEQUENCE:
        about = tuple(
            (f"rotation_{one}", f"about {one[0]}, in the sequence {', '.join(axes.sequence)}")
            for one in angles.turns(axes.sequence)
        )
    for which, (name, what) in enumerate(about):
        naming = Naming(f"{joint.name}_{name}", "deg", f"{name} of {joint.name}: {what}", "joint")
        angle = angles.joint_angle(which, mirrored=side == RIGHT, sequence=axes.sequence)
        value, *rates = with_rates(points, angle, naming)
        yield replace(value, value=angles.near_the_mean(value.value))
        yield from rates


def point_quantities(motion: Motion, name: str, *, kind: str) -> list[Quantity]:
    """Velocity, speed and acceleration of a point; its position too where it is a mean of markers."""
    points = Points.of(motion, (name,))
    variance = np.einsum("tii->ti", points.cov)
    sd, rests = np.sqrt(np.maximum(variance, 0.0)), points.rests

    def named(what: str, unit: str, words: str) -> Naming:
        return Naming(f"{name}_{what}", unit, f"{words} of {name}", kind)

    out: list[Quantity] = []
    if kind != "marker":
        for k, axis in enumerate("xyz"):
            out.append(made(points, named(axis, "m", axis), points.x[:, 0, k], sd[:, k], rests))
    parts = [
        made(points, named(f"velocity_{axis}", "m_s", f"velocity along {axis}"), points.v[:, 0, k], sd[:, 3 + k], rests)
        for k, axis in enumerate("xyz")
    ]
    speed = angles.length(points.v[:, 0]), length_sd(points.v[:, 0], points.cov[:, 3:, 3:])
    out += [*parts, made(points, named("speed", "m_s", "speed"), *speed, rests)]
    changes = [
        acceleration(points, k, named(f"acceleration_{axis}", "m_s2", f"acceleration along {axis}"), part)
        for k, (axis, part) in enumerate(zip("xyz", parts, strict=True))
    ]
    vector, deviation = (np.stack([getattr(c, field) for c in changes], axis=1) for field in ("value", "sd"))
    size = angles.length(vector)
    spread = length_sd(vector, deviation[..., None] ** 2 * np.eye(3))
    whole = named("acceleration", "m_s2", "size of the acceleration")
    return [*out, *changes, made(points, whole, size, spread, changes[0].rests)]


def _body(motion: Motion, skeleton: Skeleton, up: Array) -> list[Quantity]:
    """Position, velocity and acceleration of the trunk, its course and how it is turned."""
    out = point_quantities(motion, BODY, kind="body")
    body = Points.of(motion, (BODY,))
    heading = Naming("body_heading", "deg", "course of the body seen from above", "body")
    out.append(of_velocity(body, angles.yaw(up), heading))
    out.append(of_velocity(body, angles.pitch(up), Naming("body_climb", "deg", "climb of the body's course", "body")))
    out.append(_turning(out[-2], body))
    measures = skeleton.measures
    if measures.forward is not None:
        ahead = Points.of(motion, measures.forward)
        line = f"the line from {measures.forward[0]} to {measures.forward[1]}"
        for name, function, what in (
            ("yaw", angles.yaw(up), f"direction of {line} seen from above"),
            ("pitch", angles.pitch(up), f"angle of {line} above the horizontal"),
        ):
            naming = Naming(f"body_{name}", "deg", what, "body")
            out += with_rates(ahead, function, naming)
        if measures.left is not None:
            four = Points.of(motion, (*measures.forward, *measures.left))
            what = f"turn of the trunk about {line}; positive where its left side is up"
            naming = Naming("body_roll", "deg", what, "body")
            out += with_rates(four, angles.roll(up), naming)
    return out


def _turning(heading: Quantity, body: Points) -> Quantity:
    """Turning rate of the course, from the change of the velocity's direction."""
    t_s = body.motion.t_s
    value = np.degrees(central(t_s, np.radians(heading.value), angle=True))
    naming = Naming("body_turning_rate", "deg_s", "rate of change of body_heading", "body")
    return called(naming, (BODY,), value, change_sd(t_s, heading.sd, body.kept), edges(heading.rests))


def _lengths(motion: Motion, skeleton: Skeleton) -> list[Quantity]:
    """Lengths of bones, stated distances and areas; the last two with their rates."""
    out: list[Quantity] = []
    for name, pair in skeleton.measures.distances.items():
        naming = Naming(name, "m", f"distance from {pair[0]} to {pair[1]}", "length")
        out += with_rates(Points.of(motion, pair), angles.distance, naming)
    for name, outline in skeleton.measures.areas.items():
        what = f"area of the outline {', '.join(outline)}"
        naming = Naming(f"{name}_area", "m2", what, "area")
        out += with_rates(Points.of(motion, outline), angles.area, naming)
    for bone in skeleton.bones:
        what = f"length from {bone.a} to {bone.b}"
        naming = Naming(f"{bone.a}_to_{bone.b}", "m", what, "length")
        out += with_rates(Points.of(motion, (bone.a, bone.b)), angles.distance, naming, rates=False)
    return out
