"""The frame of an animal's body: where its trunk is, how it is turned, at every frame."""

from dataclasses import dataclass

import numpy as np
from mocap.filters.whittaker import FASTEST_HZ, smooth_series
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from eal.arrays import Array, frozen


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyFrames:
    """A right-handed frame that travels with the trunk.

    Attributes:
        rotation: (T, 3, 3) body axes to world axes.
        position_m: (T, 3) origin of the body in the world.
    """

    rotation: Array
    position_m: Array

    def __post_init__(self) -> None:
        """Copy and freeze."""
        object.__setattr__(self, "rotation", frozen("rotation", self.rotation, (None, 3, 3)))
        object.__setattr__(self, "position_m", frozen("position_m", self.position_m, (len(self.rotation), 3)))

    def to_body(self, xyz_m: Array) -> Array:
        """World points (T, M, 3) in body coordinates (T, M, 3), metres."""
        return (xyz_m - self.position_m[:, None]) @ self.rotation


def trunk_shape(xyz_m: Array) -> Array:
    """(K, 3) mean shape of trunk markers by generalised Procrustes analysis with gaps (Gower 1975), about its centre.

    In each frame the rotation is the one that brings the mean shape nearest to the markers that are seen (Kabsch 1976);
    the mean shape is that of all aligned frames. Its axes are those of the world in the frame that sees most markers.
    Markers that are never seen are at the centre.

    Args:
        xyz_m: (T, K, 3) trunk markers in the world, of one recording or of several on end; NaN where not seen.

    Raises:
        ValueError: no marker is ever seen.
    """
    seen = np.isfinite(xyz_m[..., 0])
    if not seen.any():
        raise ValueError("no trunk marker is ever seen: name other markers as the trunk")
    points = np.where(seen[..., None], xyz_m, 0.0)
    ever = np.asarray(seen.any(axis=0))
    shape = _first_shape(points, seen, int(np.argmax(seen.sum(axis=1))))
    for _ in range(10):  # rounds of alignment
        rotation, position, oriented = aligned(points, seen, shape)
        turned = np.einsum("tji,tkj->tki", rotation, points - position[:, None])
        use = (seen & oriented[:, None]) if oriented.any() else seen
        total = use.sum(axis=0)
        mean = np.einsum("tk,tkj->kj", use, turned) / np.maximum(total, 1)[:, None]
        shape = np.where(total[:, None] > 0, mean, shape)
        shape = shape - shape[ever].mean(axis=0)
    return np.where(ever[:, None], shape, 0.0)


def body_frames(
    xyz_m: Array,
    *,
    dt_s: float,
    cutoff_hz: float = FASTEST_HZ,
    shape: Array | None = None,
    loose_rad: float = 0.3,
    turns: bool = True,
) -> BodyFrames:
    """The frame of a set of markers: aligned with their mean shape, smoothed in time.

    In each frame the rotation R maximises trace(R^T (C + s^2 / loose_rad^2 R_slow)), C the covariance of markers and
    shape (Kabsch 1976), s the misfit of the two, R_slow the rotation of the covariances' moving average: about an axis
    that the trunk hardly determines (markers in a line, a trunk that bends) the body turns slowly.

    Args:
        xyz_m: (T, K, 3) trunk markers in the world; NaN where not seen.
        dt_s: Time step.
        cutoff_hz: Faster motion of the trunk is left in the body coordinates.
        shape: (K, 3) mean shape, which defines the body's axes; None: that of this recording (``trunk_shape``).
        loose_rad: Deviation of the body's rotation from its slow part.
        turns: False: the axes keep the mean rotation of the recording, only the position is followed.

    Returns:
        The frames. Frames that see fewer than three markers take their rotation, frames that see none also their
        position, from the smoothing.

    Raises:
        ValueError: no marker is ever seen.
    """
    seen = np.isfinite(xyz_m[..., 0])
    count = seen.sum(axis=1)
    shape = trunk_shape(xyz_m) if shape is None else shape
    if not count.any():
        raise ValueError("no trunk marker is ever seen: name other markers as the trunk")
    points = np.where(seen[..., None], xyz_m, 0.0)
    if turns:
        rotation = _followed(points, seen, shape, dt_s, cutoff_hz, loose_rad)
    else:
        mean = nearest_rotation(_covariance(points, seen, shape).sum(axis=0, keepdims=True))
        rotation = np.repeat(mean, len(points), axis=0)
    weight = seen / np.maximum(count, 1)[:, None]
    position = np.einsum("tk,tkj->tj", weight, points) - np.einsum("tij,tj->ti", rotation, weight @ shape)
    position = smooth_series(position, count / max(count.max(), 1), dt_s=dt_s, cutoff_hz=cutoff_hz)
    return BodyFrames(rotation=rotation, position_m=position)


def aligned(points: Array, seen: NDArray[np.bool_], shape: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Rotation and position of each frame that bring ``shape`` nearest to its points, and whether it has three."""
    count = seen.sum(axis=1)
    oriented = count >= 3
    weight = seen / np.maximum(count, 1)[:, None]
    shape_mean, point_mean = weight @ shape, np.einsum("tk,tkj->tj", weight, points)
    rotation = np.repeat(np.eye(3)[None], len(points), axis=0)
    if oriented.any():
        rotation[oriented] = nearest_rotation(_covariance(points, seen, shape)[oriented])
    return rotation, point_mean - np.einsum("tij,tj->ti", rotation, shape_mean), oriented


def _first_shape(points: Array, seen: NDArray[np.bool_], reference: int) -> Array:
    """The markers of the reference frame, completed by their mean offsets from those that it sees."""
    shape = points[reference].copy()
    have = seen[reference].copy()
    for marker in np.flatnonzero(~have & seen.any(axis=0)):
        together = seen[:, marker, None] & seen & have
        frames, others = np.nonzero(together)
        if len(frames):
            shape[marker] = np.mean(points[frames, marker] - points[frames, others] + shape[others], axis=0)
    return shape


def nearest_rotation(covariance: Array) -> Array:
    """(K, 3, 3) rotations R that maximise trace(R^T covariance)."""
    u, _, vt = np.linalg.svd(covariance)
    sign = np.sign(np.linalg.det(u @ vt))
    u[..., -1] *= sign[:, None]
    return u @ vt


def _followed(
    points: Array, seen: NDArray[np.bool_], shape: Array, dt_s: float, cutoff_hz: float, loose_rad: float
) -> Array:
    """(T, 3, 3) rotations that follow the trunk as well as it determines them; see ``body_frames``."""
    rotation, position, oriented = aligned(points, seen, shape)
    if not oriented.any():
        return rotation
    misfit = np.einsum("tji,tkj->tki", rotation, points - position[:, None]) - shape
    squares = np.sum(np.where(seen[..., None], misfit, 0.0)[oriented] ** 2)
    prior = squares / (3 * seen[oriented].sum()) / loose_rad**2
    covariance = _covariance(points, seen, shape)
    width = 10 / (2 * np.pi * cutoff_hz * dt_s)
    radius = min(int(4 * width + 0.5), 1 << 20)  # memory does not grow with the frame rate
    slow = gaussian_filter1d(covariance, width, axis=0, mode="constant", radius=radius)
    slow = nearest_rotation(slow + 1e-6 * covariance.mean(axis=0))
    spread = np.linalg.svd(covariance, compute_uv=False)[:, 1:].sum(axis=1)
    weight = oriented * spread / (spread + prior + 1e-30)
    return _smooth_rotations(nearest_rotation(covariance + prior * slow), weight, dt_s, cutoff_hz)


def _covariance(points: Array, seen: NDArray[np.bool_], shape: Array) -> Array:
    """(T, 3, 3) sum over the seen markers of (point - mean) (shape - mean)^T."""
    weight = seen / np.maximum(seen.sum(axis=1), 1)[:, None]
    local = np.where(seen[..., None], points - np.einsum("tk,tkj->tj", weight, points)[:, None], 0.0)
    target = np.where(seen[..., None], shape - (weight @ shape)[:, None], 0.0)
    return np.einsum("tki,tkj->tij", local, target)


def _smooth_rotations(rotation: Array, weight: Array, dt_s: float, cutoff_hz: float) -> Array:
    """Smooth the nine entries and return to the nearest rotation."""
    if np.count_nonzero(weight) < 2:
        best = rotation[np.argmax(weight)]
        return np.repeat(best[None], len(rotation), axis=0)
    flat = smooth_series(rotation.reshape(-1, 9), weight, dt_s=dt_s, cutoff_hz=cutoff_hz)
    return nearest_rotation(flat.reshape(-1, 3, 3))
