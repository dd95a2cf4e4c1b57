"""Least squares of many points at once: three unknowns each, two equations for each ray.

Arrays have the points last, so that every step is a few operations on long runs of memory: a tenth of the time of
products of matrices that are as small as these.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eal.arrays import Array

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Entries of a symmetric 3 x 3 matrix, in the order in which they are stored."""


class Factor(NamedTuple):
    """L D L^T of K symmetric 3 x 3 matrices: (K,) each; NaN where singular to rounding (two cameras on one ray)."""

    d0: Array
    d1: Array
    d2: Array
    l10: Array
    l20: Array
    l21: Array


def in_blocks(n_cameras: int, n_points: int) -> Iterator[slice]:
    """Points a few thousand at a time."""
    size = max(16384 // max(n_cameras, 1), 256)  # rays that the processor keeps at hand
    for start in range(0, n_points, size):
        yield slice(start, min(start + size, n_points))


def points_last(values: Array) -> Array:
    """(C, ..., D) of C cameras as (C, D, K), contiguous."""
    return np.ascontiguousarray(np.swapaxes(values.reshape(len(values), -1, values.shape[-1]), 1, 2))


def projected(matrices: Array, x: Array) -> tuple[Array, Array]:
    """Pixels (C, 2, K) of points (3, K), and their slopes (C, 2, 3, K) in pixels a metre."""
    h = matrices[:, :, :3] @ x + matrices[:, :, 3:]
    depth = 1 / h[:, 2]
    uv = h[:, :2] * depth[:, None]
    slope = matrices[:, :2, :3, None] - uv[:, :, None] * matrices[:, 2:, :3, None]
    slope *= depth[:, None, None]
    return uv, slope


def normal_equations(slope: Array, weight: Array, error: Array) -> tuple[Array, Array]:
    """J^T W J as (6, K), in the order of ``PAIRS``, and J^T W e as (3, K).

    Args:
        slope: (C, 2, 3, K) J.
        weight: (C, K) of both coordinates of a ray.
        error: (C, 2, K) e.
    """
    heavy = slope * weight[:, None, None]
    normal = np.stack([np.einsum("crk,crk->k", heavy[:, :, i], slope[:, :, j]) for i, j in PAIRS])
    return normal, np.stack([np.einsum("crk,crk->k", heavy[:, :, i], error) for i in range(3)])


def towards(slope: Array, weight: Array, error: Array) -> Array:
    """J^T W e as (3, K) alone; arguments as of ``normal_equations``."""
    heavy = error * weight[:, None]
    return np.stack([np.einsum("crk,crk->k", slope[:, :, i], heavy) for i in range(3)])


def factor(normal: Array) -> Factor:
    """Of (6, K) symmetric matrices that are not indefinite."""
    a, b, c, d, e, f = normal
    with np.errstate(divide="ignore", invalid="ignore"):
        l10, l20 = b / a, c / a
        d1, left = d - l10 * b, e - l10 * c
        l21 = left / d1
        d2 = f - l20 * c - l21 * left
        regular = a * d1 * d2 > 1e-13 * (a + d + f) ** 3  # of the cube of the trace: 0 to rounding
    return Factor(np.where(regular, a, np.nan), d1, np.where(regular, d2, np.nan), l10, l20, l21)


def solve(by: Factor, right: Array) -> Array:
    """(3, K) solutions of (3, K) right sides."""
    with np.errstate(divide="ignore", invalid="ignore"):
        y1 = right[1] - by.l10 * right[0]
        x2 = (right[2] - by.l20 * right[0] - by.l21 * y1) / by.d2
        x1 = y1 / by.d1 - by.l21 * x2
        return np.stack([right[0] / by.d0 - by.l10 * x1 - by.l20 * x2, x1, x2])


def inverse(by: Factor) -> Array:
    """(K, 3, 3) inverses."""
    with np.errstate(divide="ignore", invalid="ignore"):
        f = 1 / by.d2
        e = -by.l21 * f
        d = 1 / by.d1 - by.l21 * e
        up = by.l10 * by.l21 - by.l20
        c, b = up * f, up * e - by.l10 / by.d1
        a = 1 / by.d0 - by.l10 * b - by.l20 * c
    return np.stack([a, b, c, b, d, e, c, e, f], axis=-1).reshape(-1, 3, 3)


def squared_length(by: Factor, rows: Array) -> Array:
    """(..., K) r^T A^-1 r of rows (..., 3, K)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        y0 = rows[..., 0, :]
        y1 = rows[..., 1, :] - by.l10 * y0
        y2 = rows[..., 2, :] - by.l20 * y0 - by.l21 * y1
        return y0**2 / by.d0 + y1**2 / by.d1 + y2**2 / by.d2


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
