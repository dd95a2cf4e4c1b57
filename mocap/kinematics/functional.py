"""Poses of bodies, and joint centres and axes from motion: what keeps its place in two bodies, with deviations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from eal.arrays import Array
from mocap.errors import MocapError
from mocap.filters.body_axes import aligned, nearest_rotation, trunk_shape
from mocap.filters.rigid import independent_samples
from mocap.filters.velocities import Motion
from mocap.kinematics.delta import Points
from mocap.text import number_of


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid body over time, fitted to its markers by least squares (Kabsch 1976).

    Attributes:
        points: Its K markers.
        place_m: (K, 3) their mean places in its axes, those of the world as it lies on average, from their centre.
        rotation: (T, 3, 3) its axes in the world.
        position_m: (T, 3) its centre.
        noise_m2: Mean variance of a coordinate of a marker in its axes, as the fit's residuals show it.
        slip_m2: The part of it that the markers' covariances do not explain: skin, or a bead's image.
    """

    points: Points
    place_m: Array
    rotation: Array
    position_m: Array
    noise_m2: float
    slip_m2: float


def pose_of(motion: Motion, markers: Sequence[str]) -> Pose:
    """The pose of a body in every frame that has three of its markers."""
    points = Points.of(motion, markers)
    seen = np.isfinite(points.x[..., 0])
    place = trunk_shape(points.x)
    place -= place.mean(axis=0)
    rotation, position, posed = aligned(np.where(seen[..., None], points.x, 0.0), seen, place)
    rotation[~posed], position[~posed] = np.nan, np.nan
    mean = nearest_rotation(rotation[posed].sum(axis=0, keepdims=True))[0] if posed.any() else np.eye(3)
    rotation, place = rotation @ mean.T, place @ mean.T
    left = points.x - position[:, None] - place @ np.swapaxes(rotation, 1, 2)
    free = 3 * place.shape[0] / (3 * place.shape[0] - 6)
    size = 6 * place.shape[0]
    noise_m2 = np.diagonal(points.cov, axis1=1, axis2=2).reshape(-1, size // 6, 6)[..., :3]
    noise = float(free * np.nanmean(left**2)) if posed.any() else 0.0
    slip = max(noise - float(np.nanmean(noise_m2)), 0.0) if posed.any() else 0.0
    return Pose(points, place, rotation, position, noise, slip)


FEWEST, MOST = 6, 20
"""Parts of the motion of which each is left out once: 20 give a standard deviation to 1 / sqrt(2 * 19) = 16 %, 6 to a
third, which is chosen."""


@dataclass(frozen=True, eq=False)
class FunctionalJoint:
    """Where two bodies are joined, as their motion shows it.

    Attributes:
        centre_m: (2, 3) the centre of rotation in the axes of the parent and of the child.
        axis: (2, 3) the axis of a hinge, likewise; NaN of a ball.
        centre_sd_m: (2, 3) standard deviations of the centre; along a hinge's axis it is a convention.
        axis_sd_deg: (2,) standard deviation of the axis in each direction across it; NaN of a ball.
    """

    centre_m: Array
    axis: Array
    centre_sd_m: Array
    axis_sd_deg: Array


def functional_joint(parent: Pose, child: Pose, kind: str) -> FunctionalJoint:
    """Fit a ball or a hinge to the motion of two bodies.

    The centre is the point c of both bodies for which sum |R1 c1 + t1 - R2 c2 - t2|^2 is least (symmetrical centre of
    rotation, Ehrig et al. 2006), the axis the direction a for which sum |R1 a1 - R2 a2|^2 is (symmetrical axis of
    rotation, Ehrig et al. 2007): the first singular vectors of sum R1^T R2. A hinge's centre is halfway between the
    bodies' centres along its axis. Noise of the rotations, which the residuals of the markers show, shrinks these sums
    and is divided out. Standard deviations are those of the jackknife over parts of the motion (Kunsch 1989), as
    neighbouring frames share their errors: half as many as the misfits have independent samples.

    Raises:
        MocapError: both are seen together in too few frames.
    """
    finite = np.isfinite(parent.rotation).all(axis=(1, 2)) & np.isfinite(child.rotation).all(axis=(1, 2))
    if finite.sum() < 2 * MOST:
        raise MocapError(
            f"{number_of(int(finite.sum()), 'frame shows', 'frames show')} both bodies with three markers: a "
            f"functional {kind} needs {2 * MOST} at least"
        )
    one, two = parent.rotation[finite], child.rotation[finite]
    way = child.position_m[finite] - parent.position_m[finite]
    shrunk = [np.linalg.inv(_mean_turn(pose)) for pose in (parent, child)]
    each = (
        np.ones(len(way)),
        shrunk[0] @ np.swapaxes(one, 1, 2) @ two @ shrunk[1].T,
        np.einsum("tji,tj->ti", one, way) @ shrunk[0].T,
        np.einsum("tji,tj->ti", two, way) @ shrunk[1].T,
    )
    centre, axis = _fit([part.sum(axis=0) for part in each], kind)
    left = np.einsum("tij,j->ti", one, centre[0]) - np.einsum("tij,j->ti", two, centre[1]) - way
    shown = float(np.median(independent_samples(left - left.mean(axis=0))))
    parts = int(np.clip(shown / 2, FEWEST, MOST))  # two such samples each: neighbours of one share half of an error
    starts = np.linspace(0, len(way), parts + 1).astype(int)[:-1]
    sums = [np.add.reduceat(part, starts) for part in each]
    without = [_fit([part.sum(axis=0) - part[b] for part in sums], kind) for b in range(parts)]
    centres, axes = np.array([c for c, _ in without]), np.array([a for _, a in without])
    axes *= np.sign(np.sum(axes * axis, axis=(1, 2), keepdims=True))
    factor = (parts - 1) ** 2 / (parts * (parts - 3))  # of the jackknife, and of Student's t with parts - 1 degrees
    spread = factor * np.sum((axes - axes.mean(axis=0)) ** 2, axis=(0, 2))
    return FunctionalJoint(
        centre_m=centre,
        axis=axis,
        centre_sd_m=np.sqrt(factor * np.sum((centres - centres.mean(axis=0)) ** 2, axis=0)),
        axis_sd_deg=np.degrees(np.sqrt(spread / 2)),
    )


def _mean_turn(pose: Pose) -> Array:
    """(3, 3) mean of the rotations by which a pose errs, of small ones with covariance C: 1 - (tr C - C) / 2."""
    place = pose.place_m
    spin = pose.noise_m2 * np.linalg.inv(np.sum(place**2) * np.eye(3) - place.T @ place)
    return np.eye(3) - 0.5 * (np.trace(spin) * np.eye(3) - spin)


def _fit(sums: list[Array], kind: str) -> tuple[Array, Array]:
    """Centre and axis (2, 3) each of the sums of 1, R1^T R2, R1^T w and R2^T w, w the way from parent to child."""
    count, turned, ahead, back = sums
    normal = np.block([[count * np.eye(3), -turned], [-turned.T, count * np.eye(3)]])
    right = np.concatenate([ahead, -back])
    axis = np.full((2, 3), np.nan)
    if kind == "hinge":
        left_vectors, _, right_vectors = np.linalg.svd(turned)
        axis = np.stack([left_vectors[:, 0], right_vectors[0]])
        along = axis.ravel() / np.sqrt(2)  # what the motion does not determine, or hardly
        normal, right = normal + count * np.outer(along, along), right - along * (along @ right)
    return np.linalg.lstsq(normal, right, rcond=None)[0].reshape(2, 3), axis


def frames_of(joint: FunctionalJoint, between: Array) -> list[tuple[Array, Array]]:
    """Origin (3,) and axes (3, 3) of both bodies at a functional joint, which coincide in the mean pose.

    z of a hinge is its axis, and leads where its largest coordinate is positive; else axes are those of the world as
    the parent lies on average.

    Args:
        joint: The joint.
        between: (3, 3) the mean rotation from the child's axes to the parent's.
    """
    if np.isnan(joint.axis).any():
        return [(joint.centre_m[0], np.eye(3)), (joint.centre_m[1], between.T)]
    ends = joint.axis * np.sign(joint.axis[0, np.argmax(np.abs(joint.axis[0]))])
    turns = []
    for end, first in zip(ends, (np.eye(3), between.T), strict=True):
        z = first[:, 2]
        cosine, across = z @ end, np.cross(z, end)
        angle = np.arctan2(np.linalg.norm(across), cosine)
        normal = across if np.linalg.norm(across) > 0 else first[:, 0]
        turns.append(Rotation.from_rotvec(angle * normal / np.linalg.norm(normal)).as_matrix() @ first)
    return list(zip(joint.centre_m, turns, strict=True))
