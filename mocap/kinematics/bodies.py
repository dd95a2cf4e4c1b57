"""Joints between rigid bodies: six coordinates, their rates and standard deviations."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from eal.arrays import Array, cross, skew
from mocap.errors import MocapError
from mocap.filters.body_axes import nearest_rotation
from mocap.filters.velocities import Motion
from mocap.kinematics import angles
from mocap.kinematics.delta import Naming, Points, of_motion, with_rates
from mocap.kinematics.functional import Pose, frames_of, functional_joint, pose_of
from mocap.kinematics.records import Quantity
from mocap.measures import JointAxes, Line, Places
from mocap.sides import RIGHT, side_of
from mocap.skeleton import BodyJoint, Skeleton


def axes_points(pose: Pose, origin_m: Array, axes: Array) -> tuple[Array, Array, Array, Array]:
    """Four points of a body, its origin and the ends of its three axes, as functions of its markers.

    Args:
        pose: The body.
        origin_m: (3,) in its axes.
        axes: (3, 3) columns, in its axes.

    Returns:
        (T, 4, 3) positions, (T, 4, 3) velocities, (T, 12, 3K) how they change with the markers, and (T, 12, 12) the
        covariance of the positions that markers' slips add.
    """
    arms = pose.place_m @ np.swapaxes(pose.rotation, 1, 2)
    inertia = np.einsum("tki,tki->t", arms, arms)[:, None, None] * np.eye(3) - np.einsum("tki,tkj->tij", arms, arms)
    count = arms.shape[1]
    turn = np.swapaxes(np.linalg.solve(inertia[:, None], skew(arms)), 1, 2).reshape(len(arms), 3, 3 * count)
    size = float(np.sqrt(np.mean(np.sum(pose.place_m**2, axis=1))))
    local = origin_m + np.concatenate([np.zeros((1, 3)), size * axes.T])
    away = local @ np.swapaxes(pose.rotation, 1, 2)
    shift = np.tile(np.eye(3) / count, (1, count))
    by = (shift - skew(away) @ turn[:, None]).reshape(len(arms), 12, 3 * count)
    velocity = (by @ pose.points.v.reshape(len(arms), -1, 1)).reshape(-1, 4, 3)
    return pose.position_m[:, None] + away, velocity, by, pose.slip_m2 * by @ np.swapaxes(by, 1, 2)


def joint_points(motion: Motion, parent: Pose, child: Pose, frames: Sequence[tuple[Array, Array]]) -> Points:
    """The eight points (``axes_points``) of two bodies in their frames (origin, axes), with their joint covariance."""
    names = (*parent.points.names, *child.points.names)
    both = Points.of(motion, names)
    parts = [axes_points(pose, *frame) for pose, frame in zip((parent, child), frames, strict=True)]
    k, steps = len(names), len(both.x)
    by, slip, at = np.zeros((steps, 24, 3 * k)), np.zeros((steps, 24, 24)), 0
    for n, (_, _, own, added) in enumerate(parts):
        rows = slice(12 * n, 12 * n + 12)
        by[:, rows, at : at + own.shape[2]], slip[:, rows, rows] = own, added
        at += own.shape[2]
    order = np.arange(6 * k).reshape(k, 2, 3)
    cov = np.zeros((steps, 8, 2, 3, 8, 2, 3))
    for a in range(2):
        for b in range(2):
            rows, columns = order[:, a].ravel(), order[:, b].ravel()
            block = by @ both.cov[:, rows][:, :, columns] @ np.swapaxes(by, 1, 2)
            cov[:, :, a, :, :, b] = (block + slip if a == b == 0 else block).reshape(steps, 8, 3, 8, 3)
    x, v = (np.concatenate([part[n] for part in parts], axis=1) for n in (0, 1))
    return replace(both, x=x, v=v, cov=cov.reshape(steps, 48, 48))


def _frame(x: Array) -> Array:
    """(T, 3, 3) axes of the first four points."""
    return angles.segment_frame(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])


def _relative(x: Array) -> Array:
    """(T, 3, 3) axes of the second body in those of the first."""
    return np.einsum("tji,tjk->tik", _frame(x[:, :4]), _frame(x[:, 4:]))


def _shift(x: Array) -> Array:
    """(T, 3) from the first body's origin to the second's, along the axes of the first."""
    return np.einsum("tji,tj->ti", _frame(x[:, :4]), x[:, 4] - x[:, 0])


def _spin(x: Array, v: Array) -> Array:
    """(T, 3) angular velocity of a body of four points: half the sum of its axes cross their velocities."""
    axes, rates = x[:, 1:] - x[:, :1], v[:, 1:] - v[:, :1]
    return 0.5 * np.sum(cross(axes, rates), axis=1) / np.sum(axes[:, :1] ** 2, axis=-1)


def _spins(x: Array, v: Array) -> Array:
    """(T, 3) angular velocity of the second body against the first, along the axes of the first."""
    return np.einsum("tji,tj->ti", _frame(x[:, :4]), _spin(x[:, 4:], v[:, 4:]) - _spin(x[:, :4], v[:, :4]))


def helical(x: Array) -> tuple[Array, Array, Array, Array]:
    """The finite helical axis that leads from axes which coincide to those of two bodies of four points each.

    A body that goes from the other's pose to its own turns by an angle about the axis and shifts along it (Woltring et
    al. 1985).

    Returns:
        (T,) angle in rad, (T,) shift in m, (T, 3) direction, and (T, 3) the point of the axis that is nearest to the
        first body's origin, both along its axes.
    """
    turned, way = _relative(x), _shift(x)
    double = np.stack([turned[:, i, j] - turned[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    sine = angles.length(double)
    angle = np.arctan2(sine, np.einsum("tii->t", turned) - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = double / sine[:, None]
        shift = np.einsum("ti,ti->t", along, way)
        across = way - shift[:, None] * along
        point = 0.5 * (across + cross(along, way) / np.tan(0.5 * angle)[:, None])
    return angle, shift, along, point


@dataclass(frozen=True, eq=False)
class JointFrames:
    """Axes in which a joint between two bodies is measured.

    Attributes:
        frames: Origin (3,) and axes (3, 3) in the axes of the parent, and in those of the child.
        what: What they are, in words.
        note: What a reader must know of them.
    """

    frames: tuple[tuple[Array, Array], tuple[Array, Array]]
    what: str
    note: str | None = None


def joint_frames(parent: Pose, child: Pose, axes: JointAxes) -> JointFrames:
    """Axes of both bodies: stated by markers or their places, of a functional joint, or of the mean pose.

    Raises:
        MocapError: a functional joint does not show its axes.
    """
    if axes.functional is not None:
        found = functional_joint(parent, child, axes.functional)
        finite = np.isfinite(parent.rotation).all(axis=(1, 2)) & np.isfinite(child.rotation).all(axis=(1, 2))
        both = np.swapaxes(parent.rotation[finite], 1, 2) @ child.rotation[finite]
        first, second = frames_of(found, nearest_rotation(both.sum(axis=0, keepdims=True))[0])
        note = f"centre known to {1e3 * np.sqrt(np.mean(found.centre_sd_m**2)):.2g} mm"
        if axes.functional == "hinge":
            note += f", axis to {np.sqrt(np.mean(found.axis_sd_deg**2)):.2g} degrees"
        note = f"functional {axes.functional}, {note} (standard deviations of a coordinate, and in each direction)"
        return JointFrames((first, second), f"axes of a functional {axes.functional}", note)
    if axes.parent is None or axes.child is None:
        way = np.einsum("tji,tj->ti", parent.rotation, child.position_m - parent.position_m)
        mean = "axes that coincide in the mean pose, the world's as the parent lies"
        return JointFrames(((np.nanmean(way, axis=0), np.eye(3)), (np.zeros(3), np.eye(3))), mean)
    (first, off), (second, off_too) = (
        _axes_of(pose, part) for pose, part in ((parent, axes.parent), (child, axes.child))
    )
    worst = 1e3 * max(off, off_too)
    return JointFrames(
        (first, second), "stated axes", f"markers fit the stated places to {worst:.2g} mm" if worst else None
    )


def _axes_of(pose: Pose, part: tuple[Line, Line] | Places) -> tuple[tuple[Array, Array], float]:
    """Origin and axes of one body, and by how much (m, rms) its markers miss the places that state them."""
    own = dict(zip(pose.points.names, pose.place_m, strict=True))
    if isinstance(part, tuple):
        ends = [np.array([own[b] - own[a]]) for a, b in part]
        return (own[part[0][0]], angles.segment_frame(*ends)[0]), 0.0
    here, there = np.array([own[name] for name in part]), np.array(list(part.values()))
    middle, centre = here.mean(axis=0), there.mean(axis=0)
    turn = Rotation.align_vectors(here - middle, there - centre)[0]
    left = here - middle - turn.apply(there - centre)
    return (middle - turn.apply(centre), turn.as_matrix()), float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def with_places(motion: Motion, skeleton: Skeleton) -> Skeleton:
    """The skeleton with the axes of all joints between bodies as places of markers, for other recordings of the animal.

    Raises:
        MocapError: a functional joint does not show its axes.
    """
    axes = dict(skeleton.measures.axes)
    for joint in skeleton.body_joints:
        before = axes.get(joint.name, JointAxes())
        poses = [pose_of(motion, skeleton.bodies[name]) for name in (joint.parent, joint.child)]
        found = joint_frames(poses[0], poses[1], before)
        parts = [
            {
                name: tuple(map(float, at))
                for name, at in zip(pose.points.names, (pose.place_m - origin) @ turn, strict=True)
            }
            for pose, (origin, turn) in zip(poses, found.frames, strict=True)
        ]
        axes[joint.name] = replace(before, parent=parts[0], child=parts[1], functional=None)
    return replace(skeleton, measures=replace(skeleton.measures, axes=axes))


def joint_quantities(motion: Motion, skeleton: Skeleton, joint: BodyJoint) -> tuple[list[Quantity], list[str]]:
    """Three angles and three translations of a joint between bodies, with their rates and accelerations.

    Angles are those of ``angles.euler`` in the joint's sequence, from the parent to the child; translations those of
    the child's origin, and angular velocities those of the child against the parent, along the parent's axes. Of a
    right joint whose axes are stated by lines between markers all are those of its mirror image.

    Returns:
        The quantities, and notes on the axes; no quantities where a functional joint does not show them.
    """
    axes = skeleton.measures.axes.get(joint.name, JointAxes())
    if axes.lines and side_of(joint.name) == RIGHT:
        flip = np.tile(angles.MIRROR, 2)
        motion = replace(
            motion,
            xyz_m=motion.xyz_m * angles.MIRROR,
            velocity_m_s=motion.velocity_m_s * angles.MIRROR,
            own=motion.own * np.outer(flip, flip),
            cross=motion.cross * np.outer(flip, flip),
        )
    parent, child = (pose_of(motion, skeleton.bodies[name]) for name in (joint.parent, joint.child))
    try:
        found = joint_frames(parent, child, axes)
    except MocapError as error:
        return [], [f"{joint.name}: {error}"]
    points = joint_points(motion, parent, child, found.frames)
    who, out = f"of {joint.child} on {joint.parent}", list[Quantity]()

    def named(what: str, unit: str, words: str) -> Naming:
        return Naming(f"{joint.name}_{what}", unit, f"{words}; {found.what}", "joint")

    for number, one in enumerate(angles.turns(axes.sequence)):
        what = f"rotation {who} about {one[0]}, in the sequence {', '.join(axes.sequence)}"
        value, *rates = with_rates(
            points,
            lambda x, n=number: angles.euler(_relative(x), axes.sequence)[n],
            named(f"rotation_{one}", "deg", what),
        )
        out += [replace(value, value=angles.near_the_mean(value.value)), *rates]
    for number, one in enumerate("xyz"):
        what = named(f"translation_{one}", "m", f"translation {who} along {one}")
        out += with_rates(points, lambda x, n=number: _shift(x)[:, n], what)
        what = named(f"angular_velocity_{one}", "deg_s", f"angular velocity {who} along {one} of {joint.parent}")
        out.append(of_motion(points, lambda x, v, n=number: _spins(x, v)[:, n], what))
    if axes.helical:
        out += _helical(points, named, who)
    return out, [] if found.note is None else [f"{joint.name}: {found.note}"]


def _helical(points: Points, named: Callable[[str, str, str], Naming], who: str) -> Iterator[Quantity]:
    """Angle, shift, direction and point of the finite helical axis from coinciding axes to each frame's."""
    for number, (name, unit, what) in enumerate((("angle", "deg", "angle"), ("shift", "m", "shift"))):
        naming = named(f"helical_{name}", unit, f"{what} {who} about and along its helical axis")
        yield from with_rates(points, lambda x, n=number: helical(x)[n], naming, rates=False)
    for number, one in enumerate("xyz"):
        naming = named(f"helical_direction_{one}", "1", f"{one} of the helical axis {who}")
        yield from with_rates(points, lambda x, n=number: helical(x)[2][:, n], naming, rates=False)
        naming = named(f"helical_point_{one}", "m", f"{one} of the point of that axis nearest to the parent's origin")
        yield from with_rates(points, lambda x, n=number: helical(x)[3][:, n], naming, rates=False)
