"""The frame of an animal's body: where its trunk is, how it is turned, at every frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from mocap.arrays import Array, frozen


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
        return np.einsum("tji,tmj->tmi", self.rotation, xyz_m - self.position_m[:, None])


def smooth_series(y: Array, weight: Array, *, dt_s: float, cutoff_hz: float) -> Array:
    """Whittaker's smoother: minimise sum w (x - y)^2 + p sum (second difference of x)^2.

    p = (2 pi cutoff dt)^-4, so that a sine of ``cutoff_hz`` is halved; samples of weight 0 are bridged by cubics, and
    continued by straight lines before the first and after the last.

    Args:
        y: (T, K) series; values of weight 0 are not read.
        weight: (T,) weights, at least two positive.
        dt_s: Time step.
        cutoff_hz: Frequency of half amplitude.

    Returns:
        (T, K) smoothed series.
    """
    n = len(y)
    if n < 3 or np.count_nonzero(weight) < 2:
        mean = np.average(np.nan_to_num(y), axis=0, weights=weight)
        return np.repeat(mean[None], n, axis=0)
    penalty = (2 * np.pi * cutoff_hz * dt_s) ** -4
    ones = np.ones(n - 2)
    diagonal = np.zeros(n)
    for offset, factor in ((0, 1.0), (1, 4.0), (2, 1.0)):
        diagonal[offset : n - 2 + offset] += factor * ones
    first = np.zeros(n - 1)
    first[: n - 2] -= 2 * ones
    first[1:] -= 2 * ones
    bands = np.zeros((3, n))
    bands[2] = weight + penalty * diagonal
    bands[1, 1:] = penalty * first
    bands[0, 2:] = penalty
    return solveh_banded(bands, weight[:, None] * np.where(weight[:, None] > 0, y, 0.0))


def body_frames(xyz_m: Array, *, dt_s: float, cutoff_hz: float, iterations: int = 10) -> BodyFrames:
    """The frame of a set of markers: generalised Procrustes alignment with gaps, then smoothed in time.

    In each frame the rotation is the one that brings the mean shape nearest to the markers that are seen (Kabsch 1976);
    the mean shape is that of all aligned frames (Gower 1975). Frames that see fewer than three markers take their
    rotation, frames that see none also their position, from the smoothing.

    Args:
        xyz_m: (T, K, 3) trunk markers in the world; NaN where not seen.
        dt_s: Time step.
        cutoff_hz: Faster motion of the trunk is left in the body coordinates.
        iterations: Rounds of alignment.

    Returns:
        The frames. The mean shape's axes are those of the world in the frame that sees most markers. With fewer than
        three markers ever seen together the rotation is the identity.

    Raises:
        ValueError: no marker is ever seen.
    """
    seen = np.isfinite(xyz_m[..., 0])
    count = seen.sum(axis=1)
    if not count.any():
        raise ValueError("no trunk marker is ever seen: name other markers as the trunk")
    points = np.where(seen[..., None], xyz_m, 0.0)
    ever = seen.any(axis=0)
    reference = int(np.argmax(count))
    n_frames = len(xyz_m)
    rotation = np.repeat(np.eye(3)[None], n_frames, axis=0)
    shape = _first_shape(points, seen, reference)
    oriented = count >= 3
    position = np.zeros((n_frames, 3))
    for _ in range(iterations):
        weight = seen / np.maximum(count, 1)[:, None]
        shape_mean = weight @ shape
        point_mean = np.einsum("tk,tkj->tj", weight, points)
        local = np.where(seen[..., None], points - point_mean[:, None], 0.0)
        if oriented.any():
            target = shape[None] - shape_mean[:, None]
            covariance = np.einsum("tki,tkj->tij", local[oriented], np.where(seen[..., None], target, 0.0)[oriented])
            rotation[oriented] = _nearest_rotation(covariance)
        position = point_mean - np.einsum("tij,tj->ti", rotation, shape_mean)
        aligned = np.einsum("tji,tkj->tki", rotation, points - position[:, None])
        use = (seen & oriented[:, None]) if oriented.any() else seen
        total = use.sum(axis=0)
        mean = np.einsum("tk,tkj->kj", use, aligned) / np.maximum(total, 1)[:, None]
        shape = np.where(total[:, None] > 0, mean, shape)
        shape = shape - shape[ever].mean(axis=0)
    rotation = _smooth_rotations(rotation, oriented * 1.0, dt_s, cutoff_hz)
    weight = seen / np.maximum(count, 1)[:, None]
    position = np.einsum("tk,tkj->tj", weight, points) - np.einsum("tij,tj->ti", rotation, weight @ shape)
    position = smooth_series(position, count / max(count.max(), 1), dt_s=dt_s, cutoff_hz=cutoff_hz)
    return BodyFrames(rotation=rotation, position_m=position)


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


def _nearest_rotation(covariance: Array) -> Array:
    """(K, 3, 3) rotations R that maximise trace(R^T covariance)."""
    u, _, vt = np.linalg.svd(covariance)
    sign = np.sign(np.linalg.det(u @ vt))
    u[..., -1] *= sign[:, None]
    return u @ vt


def _smooth_rotations(rotation: Array, weight: Array, dt_s: float, cutoff_hz: float) -> Array:
    """Smooth the nine entries and return to the nearest rotation."""
    if np.count_nonzero(weight) < 2:
        best = rotation[np.argmax(weight)]
        return np.repeat(best[None], len(rotation), axis=0)
    flat = smooth_series(rotation.reshape(-1, 9), weight, dt_s=dt_s, cutoff_hz=cutoff_hz)
    return _nearest_rotation(flat.reshape(-1, 3, 3))
