"""Triangulation about given points as a linear problem: weights may then change many times at little cost."""

from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.cameras.normal_equations import (
    factor,
    in_blocks,
    normal_equations,
    points_last,
    projected,
    solve,
    squared_length,
)


@dataclass(frozen=True, eq=False)
class Linearised:
    """How the pixels of K points differ from their projections, and how these move with the points.

    Attributes:
        error: (C, 2, K) pixels less projections; 0 where not seen.
        slope: (C, 2, 3, K) pixels a metre; 0 where not seen.
        seen: (C, K) 1.0 where seen, else 0.0.
    """

    error: Array
    slope: Array
    seen: Array

    @property
    def jacobian(self) -> Array:
        """(C, K, 2, 3) the slopes by ray."""
        return np.moveaxis(self.slope, -1, 1)

    @property
    def squares(self) -> Array:
        """(C, K) squared errors."""
        return np.sum(self.error**2, axis=1)


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
    at, slope = projected(matrices, np.nan_to_num(xyz_m).T)
    return Linearised(
        error=np.where(seen[:, None], points_last(uv_px) - at, 0.0),
        slope=np.where(seen[:, None, None], slope, 0.0),
        seen=seen.astype(float),
    )


def fit(problem: Linearised, weight: Array) -> Fit:
    """Least squares with (C, K) weights; a point with one ray lies on it, and one with none stays."""
    weight = weight * problem.seen
    slope, error = problem.slope, problem.error
    step, residual = np.empty((error.shape[-1], 3)), np.empty((*weight.shape, 2))
    redundancy = np.empty_like(weight)
    for block in in_blocks(*weight.shape):
        rows, heavy = slope[..., block], weight[:, block]
        normal, right = normal_equations(rows, heavy, error[..., block])
        size = normal[0] + normal[3] + normal[5]
        normal[[0, 3, 5]] += 1e-12 * size + (size == 0)
        factored = factor(normal)
        moved = solve(factored, right)
        left = error[..., block] - np.einsum("crik,ik->crk", rows, moved)
        taken = squared_length(factored, rows).sum(axis=1) * heavy
        step[block], residual[:, block] = moved.T, np.moveaxis(left, 1, 2)
        redundancy[:, block] = np.maximum(2.0 - taken, 0.0) * problem.seen[:, block]
    return Fit(step, residual, redundancy)
