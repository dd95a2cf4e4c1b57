"""Joints between rigid bodies: six coordinates, their rates and standard deviations."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eal.arrays import Array
from eal.vectors import skew
from mocap.filters.body_axes import aligned, nearest_rotation, trunk_shape
from mocap.filters.velocities import Motion
from mocap.kinematics import angles
from mocap.kinematics.delta import Naming, Points, with_rates
from mocap.kinematics.records import Quantity
from mocap.measures import Line
from mocap.sides import RIGHT, side_of
from mocap.skeleton import BodyJoint, Skeleton


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid body over time, fitted to its markers by least squares (Kabsch 1976).

    Attributes:
        points: Its K markers.
        place_m: (K, 3) their mean places in its axes, those of the world as it lies on average, from their centre.
        rotation: (T, 3, 3) its axes in the world.
        position_m: (T, 3) its centre.
        slip_m2: Mean variance of a marker's place that its covariance does not explain: skin, or a bead's image.
    """

    points: Points
    place_m: Array
    rotation: Array
    position_m: Array
    slip_m2: float


def pose_of(motion: Motion, markers: Sequence[str]) -> Pose:
    """The pose of a body in every frame that has three of its markers."""
    points = Points.of(motion, markers)
    seen = np.isfinite(points.x[..., 0])
    place = trunk_shape(points.x)
    place -= place.mean(axis=0)
    rotation, position, known = aligned(np.where(seen[..., None], points.x, 0.0), seen, place)
    rotation[~known], position[~known] = np.nan, np.nan
    mean = nearest_rotation(rotation[known].sum(axis=0, keepdims=True))[0] if known.any() else np.eye(3)
    rotation, place = rotation @ mean.T, place @ mean.T
    left = points.x - position[:, None] - place @ np.swapaxes(rotation, 1, 2)
    free = 3 * place.shape[0] / (3 * place.shape[0] - 6)
    size = 6 * place.shape[0]
    stated = np.diagonal(points.cov, axis1=1, axis2=2).reshape(-1, size // 6, 6)[..., :3]
    slip = free * np.nanmean(left**2) - np.nanmean(stated) if known.any() else 0.0
    return Pose(points, place, rotation, position, max(float(slip), 0.0))


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


def _along(axis: int, x: Array) -> Array:
    """(T,) where the second body's origin is along an axis of the first, from the origin of that."""
    return np.einsum("ti,ti->t", _frame(x[:, :4])[..., axis], x[:, 4] - x[:, 0])


def _about(which: int, x: Array) -> Array:
    """(T,) angle of ``cardan`` of the second body in the first."""
    return angles.cardan(np.einsum("tji,tjk->tik", _frame(x[:, :4]), _frame(x[:, 4:])))[which]


def joint_frames(parent: Pose, child: Pose, stated: Sequence[tuple[Line, Line]] | None) -> list[tuple[Array, Array]]:
    """Origin (3,) and axes (3, 3) of both bodies: stated by markers, or those that coincide in the mean pose."""
    if stated is None:
        way = np.einsum("tji,tj->ti", parent.rotation, child.position_m - parent.position_m)
        return [(np.nanmean(way, axis=0), np.eye(3)), (np.zeros(3), np.eye(3))]
    out = []
    for pose, (long, second) in zip((parent, child), stated, strict=True):
        place = dict(zip(pose.points.names, pose.place_m, strict=True))
        ends = [np.array([place[b] - place[a]]) for a, b in (long, second)]
        out.append((place[long[0]], angles.segment_frame(*ends)[0]))
    return out


def joint_quantities(motion: Motion, skeleton: Skeleton, joint: BodyJoint) -> Iterator[Quantity]:
    """Three angles and three translations of a joint between bodies, with their rates and accelerations.

    Angles are about z of the parent, y between, x of the child (``angles.cardan``); translations are those of the
    child's origin along the parent's axes. Of a right joint with stated axes all are those of its mirror image.
    """
    axes = skeleton.measures.axes.get(joint.name)
    stated = None if axes is None else [axes.parent, axes.child]
    if stated is not None and side_of(joint.name) == RIGHT:
        flip = np.tile(angles.MIRROR, 2)
        motion = replace(
            motion,
            xyz_m=motion.xyz_m * angles.MIRROR,
            velocity_m_s=motion.velocity_m_s * angles.MIRROR,
            own=motion.own * np.outer(flip, flip),
            cross=motion.cross * np.outer(flip, flip),
        )
    parent, child = (pose_of(motion, skeleton.bodies[name]) for name in (joint.parent, joint.child))
    points = joint_points(motion, parent, child, joint_frames(parent, child, stated))
    mean = "axes that coincide in the mean pose, the world's as the parent lies"
    which = mean if stated is None else "stated axes"
    for number, axis in enumerate("zyx"):
        what = f"rotation of {joint.child} on {joint.parent} about {axis}, in the sequence z, y, x; {which}"
        naming = Naming(name=f"{joint.name}_rotation_{axis}", unit="deg", what=what, kind="joint")
        value, *rates = with_rates(points, lambda x, n=number: _about(n, x), naming)
        yield replace(value, value=angles.near_the_mean(value.value))
        yield from rates
    for number, axis in enumerate("xyz"):
        what = f"translation of {joint.child} on {joint.parent} along {axis}; {which}"
        naming = Naming(name=f"{joint.name}_translation_{axis}", unit="m", what=what, kind="joint")
        yield from with_rates(points, lambda x, n=number: _along(n, x), naming)
