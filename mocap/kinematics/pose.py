"""The pose of a rigid body in each frame, fitted to its markers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.filters.body_axes import aligned, nearest_rotation, trunk_shape
from mocap.filters.velocities import Motion
from mocap.kinematics.delta import Points


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
