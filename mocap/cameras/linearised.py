"""Triangulation about given points as a linear problem: weights may then change many times at little cost."""

from dataclasses import dataclass

import numpy as np

from mocap.arrays import Array


@dataclass(frozen=True, eq=False)
class Linearised:
    """How the pixels of K points differ from their projections, and how these move with the points.

    Attributes:
        error: (C, K, 2) pixels less projections; 0 where not seen.
        jacobian: (C, K, 2, 3) pixels a metre; 0 where not seen.
        seen: (C, K) 1.0 where seen, else 0.0.
    """

    error: Array
    jacobian: Array
    seen: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """The weighted least squares of K points.

    Attributes:
        step_m: (K, 3) from the points about which the problem was linear.
        residual: (C, K, 2) what is left of the errors, in pixels.
        redundancy: (C, K) 2 - tr H, the share of a ray's two errors that its own point does not take up (H the ray's
            block of the hat matrix); 0 where not seen. It sums to 2 n - 3 over the n rays of a point.
    """

    step_m: Array
    residual: Array
    redundancy: Array


def linearise(matrices: Array, uv_px: Array, xyz_m: Array) -> Linearised:
    """About (K, 3) points, from (C, K, 2) pixels, NaN where not seen."""
    seen = np.isfinite(uv_px[..., 0]) & np.isfinite(xyz_m[:, 0])
    homogeneous = np.einsum("cij,kj->cki", matrices[:, :, :3], np.nan_to_num(xyz_m)) + matrices[:, None, :, 3]
    at = homogeneous[..., :2] / homogeneous[..., 2:]
    jacobian = (matrices[:, None, :2, :3] - at[..., None] * matrices[:, None, 2:, :3]) / homogeneous[..., 2:, None]
    return Linearised(
        error=np.where(seen[..., None], np.nan_to_num(uv_px) - at, 0.0),
        jacobian=np.where(seen[..., None, None], jacobian, 0.0),
        seen=seen.astype(float),
    )


def fit(problem: Linearised, weight: Array) -> Fit:
    """Least squares with (C, K) weights; a point with one ray lies on it, and one with none stays."""
    weight = weight * problem.seen
    n_cameras, n_points = weight.shape
    rows = np.moveaxis(problem.jacobian, 0, 1).reshape(n_points, 2 * n_cameras, 3)
    error = np.moveaxis(problem.error, 0, 1).reshape(n_points, 2 * n_cameras, 1)
    heavy = rows * np.repeat(weight.T, 2, axis=1)[..., None]
    transposed = np.swapaxes(heavy, 1, 2)
    normal = transposed @ rows
    size = np.trace(normal, axis1=1, axis2=2)
    normal += (1e-12 * size + (size == 0))[:, None, None] * np.eye(3)
    cov = np.linalg.inv(normal)
    step = cov @ (transposed @ error)
    residual = np.moveaxis((error - rows @ step).reshape(n_points, n_cameras, 2), 1, 0)
    taken = np.sum((heavy @ cov) * rows, axis=-1).reshape(n_points, n_cameras, 2).sum(axis=-1).T
    return Fit(step[..., 0], residual, np.maximum(2.0 - taken, 0.0) * problem.seen)
