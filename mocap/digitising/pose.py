"""Where a marker is by the markers that are seen: a Gaussian of poses, moved and turned onto them."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.filters.body_axes import nearest_rotation, trunk_shape
from mocap.filters.subspace import principal_components

FEWEST_OF_POSE = 4
"""No pose is turned onto fewer markers."""


@dataclass(frozen=True, eq=False)
class PoseGaussian:
    """Poses y = mean + loading z + noise, z ~ N(0, I), in the frame of the trunk.

    Attributes:
        mean: (M, 3) mean pose.
        loading: (M, 3, r) loadings.
        noise_m2: Variance of a coordinate about them.
        left_m2: (M,) variance of a coordinate of a marker by which it was missed in poses that were not learned from.
        trunk: (M,) True for markers that the frame is turned onto first.
    """

    mean: Array
    loading: Array
    noise_m2: float
    left_m2: Array
    trunk: NDArray[np.bool_]

    def given(self, xyz_m: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array] | None:
        """All markers of a frame given those that are seen: positions (M, 3) and covariances (M, 3, 3).

        The conditional Gaussian z | seen, in turn with the rigid motion that brings the pose nearest to what is seen
        (Kabsch 1976).

        Args:
            xyz_m: (M, 3) positions in the world.
            seen: (M,) True where they are known.

        Returns:
            None: too few markers are seen.
        """
        if seen.sum() < FEWEST_OF_POSE:
            return None
        xyz, cov = self.given_each(xyz_m[None], seen[None])
        return xyz[0], cov[0]

    def given_each(self, xyz_m: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
        """The same of N frames: of (N, M, 3) and (N, M), of which each has enough, (N, M, 3) and (N, M, 3, 3)."""
        n, rank = len(xyz_m), self.loading.shape[2]
        y = np.where(seen[..., None], xyz_m, 0.0)
        flat = self.loading.reshape(-1, rank)
        w = flat * np.repeat(seen, 3, axis=1)[..., None]
        spread = np.linalg.inv(np.eye(rank) + flat.T @ w / self.noise_m2)
        pull = spread @ np.swapaxes(w, 1, 2) / self.noise_m2
        body = seen & self.trunk
        use = np.where((body.sum(axis=1) >= FEWEST_OF_POSE)[:, None], body, seen)
        shape = np.broadcast_to(self.mean, y.shape)
        rotation, shift = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 1, 3))
        for turn in range(3):
            rotation, shift = _rigid_each(shape, y, use)
            back = (y - shift) @ rotation
            z = pull @ (back - self.mean).reshape(n, -1, 1)
            shape = self.mean + (flat @ z).reshape(n, -1, 3)
            use = seen if turn == 0 else use
        turned = rotation[:, None] @ self.loading
        cov = turned @ spread[:, None] @ np.swapaxes(turned, -1, -2) + self.left_m2[:, None, None] * np.eye(3)
        return shape @ np.swapaxes(rotation, 1, 2) + shift, cov


def rigid(a: Array, b: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,) that bring (N, 3) points a nearest to b: b ~ a R^T + shift."""
    ma, mb = a.mean(axis=0), b.mean(axis=0)
    rotation = nearest_rotation(((b - mb).T @ (a - ma))[None])[0]
    return rotation, mb - rotation @ ma


def _rigid_each(a: Array, b: Array, use: NDArray[np.bool_]) -> tuple[Array, Array]:
    """``rigid`` of (N, M, 3) points of which ``use`` (N, M) count: rotations (N, 3, 3) and shifts (N, 1, 3)."""
    share = (use / use.sum(axis=1, keepdims=True))[..., None]
    ma, mb = (np.sum(share * x, axis=1, keepdims=True) for x in (a, b))
    rotation = nearest_rotation(np.swapaxes(share * (b - mb), 1, 2) @ (a - ma))
    return rotation, mb - ma @ np.swapaxes(rotation, 1, 2)


def fit_poses(xyz_m: Array, trunk: Sequence[int], *, rank: int = 10, least_sd_m: float = 0.0) -> PoseGaussian | None:
    """Learn a Gaussian of poses.

    Args:
        xyz_m: (T, M, 3) positions, of one recording or of several on end; NaN where not seen.
        trunk: Indices of the trunk's markers; none: all.
        rank: Greatest number of components.
        least_sd_m: The noise is taken to be at least that.

    Returns:
        None: too few frames show enough of the animal.
    """
    seen = np.isfinite(xyz_m[..., 0])
    body = np.zeros(seen.shape[1], dtype=bool)
    body[list(trunk) if len(trunk) >= FEWEST_OF_POSE else slice(None)] = True
    usable = np.flatnonzero((seen[:, body].sum(axis=1) >= FEWEST_OF_POSE) & (seen.mean(axis=1) > 0.5))
    if len(usable) < 8 or not seen[usable].any(axis=0).all():
        return None
    usable = usable[np.unique(np.linspace(0, len(usable) - 1, min(400, len(usable))).astype(int))]
    points = xyz_m[usable]
    end = max(6, 2 * len(points) // 3)
    first = _fitted(points[:end], body, rank, least_sd_m)
    # each marker of later poses is hidden in turn: what has not been seen before is missed by more
    squares = np.full((len(points) - end, points.shape[1]), np.nan)
    later = points[end:][:: max(1, (len(points) - end) // 12)]
    there = np.isfinite(later[..., 0])
    row, m = np.nonzero(there & (there.sum(axis=1, keepdims=True) > FEWEST_OF_POSE))
    if len(row):
        hidden = there[row] & (np.arange(there.shape[1]) != m[:, None])
        found, _ = first.given_each(later[row], hidden)
        squares[row, m] = np.mean((found[np.arange(len(row)), m] - later[row, m]) ** 2, axis=1)
    whole = _fitted(points, body, rank, least_sd_m)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of markers that no later pose shows
        missed = np.nanmean(squares, axis=0)
    usual = float(np.nanmean(squares)) if np.isfinite(squares).any() else 4 * whole.noise_m2
    return replace(whole, left_m2=np.maximum(2.0 * np.where(np.isfinite(missed), missed, 2 * usual), whole.noise_m2))


def _fitted(points: Array, body: NDArray[np.bool_], rank: int, least_sd_m: float) -> PoseGaussian:
    seen = np.isfinite(points[..., 0])
    shape = trunk_shape(points[:, body])
    y = np.full(points.shape, np.nan)
    for frame, there in enumerate(seen):
        rotation, shift = rigid(shape[there[body]], points[frame, body & there])
        y[frame] = (points[frame] - shift) @ rotation
    rank = max(1, min(rank, len(y) // 4))
    found = principal_components(y.reshape(len(y), -1), rank, iterations=15)
    # (r, r) square root of the second moment of scores
    values, vectors = np.linalg.eigh(found.scores.T @ found.scores / len(found.scores))
    loading = (found.loading @ (vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)).reshape(*y.shape[1:], rank)
    noise = max(2.0 * found.noise, least_sd_m**2)
    return PoseGaussian(found.mean.reshape(-1, 3), loading, noise, np.full(points.shape[1], noise), body)
