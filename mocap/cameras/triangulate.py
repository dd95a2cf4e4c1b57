"""Pixels and points of C cameras as plain arrays: projection, least squares, triangulation, rejection of outlying rays.

All functions work on ideal (undistorted) pixels and any number of points at once. Those of the least squares, three
unknowns a point and two equations a ray, have the points last, so that every step is a few operations on long runs of
memory: a tenth of the time of products of matrices that are as small as these.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.project import project

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Entries of a symmetric 3 x 3 matrix, in the order in which they are stored."""
MISSES = 5.0
"""Rays that miss each other by more standard deviations are wrong: of normal errors one in 1.7 million, of Student's t
with four degrees of freedom one in 470."""


class MatrixFactor(NamedTuple):
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


def factor(normal: Array) -> MatrixFactor:
    """Of (6, K) symmetric matrices that are not indefinite."""
    a, b, c, d, e, f = normal
    with np.errstate(divide="ignore", invalid="ignore"):
        l10, l20 = b / a, c / a
        d1, left = d - l10 * b, e - l10 * c
        l21 = left / d1
        d2 = f - l20 * c - l21 * left
        regular = a * d1 * d2 > 1e-13 * (a + d + f) ** 3  # of the cube of the trace: 0 to rounding
    return MatrixFactor(np.where(regular, a, np.nan), d1, np.where(regular, d2, np.nan), l10, l20, l21)


def solve(by: MatrixFactor, right: Array) -> Array:
    """(3, K) solutions of (3, K) right sides."""
    with np.errstate(divide="ignore", invalid="ignore"):
        y1 = right[1] - by.l10 * right[0]
        x2 = (right[2] - by.l20 * right[0] - by.l21 * y1) / by.d2
        x1 = y1 / by.d1 - by.l21 * x2
        return np.stack([right[0] / by.d0 - by.l10 * x1 - by.l20 * x2, x1, x2])


def inverse(by: MatrixFactor) -> Array:
    """(K, 3, 3) inverses."""
    with np.errstate(divide="ignore", invalid="ignore"):
        f = 1 / by.d2
        e = -by.l21 * f
        d = 1 / by.d1 - by.l21 * e
        up = by.l10 * by.l21 - by.l20
        c, b = up * f, up * e - by.l10 / by.d1
        a = 1 / by.d0 - by.l10 * b - by.l20 * c
    return np.stack([a, b, c, b, d, e, c, e, f], axis=-1).reshape(-1, 3, 3)


def squared_length(by: MatrixFactor, rows: Array) -> Array:
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
class PointFit:
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


def fit(problem: Linearised, weight: Array) -> PointFit:
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
    return PointFit(step, residual, redundancy)


def linear(matrices: Array, uv_px: Array, *, relative: Array | None = None) -> Array:
    """The linear least squares that DLTdv solves (Hedrick 2008, equations of Abdel-Aziz & Karara 1971).

    Each pixel (u, v) of camera P gives the rows (p1 - u p3) (x, 1) = 0 and (p2 - v p3) (x, 1) = 0, with P scaled so
    that its last entry is 1: the weights are those of the DLT coefficients (a camera that has none, because the world's
    origin projects to infinity, is scaled to depth). The 3 x 3 normal equations are followed by one step of iterative
    refinement, which brings them to the accuracy of an orthogonal factorisation.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, ..., 2) ideal pixels; NaN where not seen.
        relative: Deviations that rays are divided by, broadcastable to (C, ...); None: 1, as in DLTdv.

    Returns:
        (..., 3) points in metres; NaN where fewer than two cameras see it, or all from one side.
    """
    shape, n_cameras = uv_px.shape[1:-1], len(uv_px)
    seen = np.isfinite(uv_px).all(axis=-1).reshape(n_cameras, -1)
    points = np.flatnonzero(np.count_nonzero(seen, axis=0) >= 2)
    last, depth = matrices[:, 2:, 3:], np.linalg.norm(matrices[:, 2:, :3], axis=-1, keepdims=True)
    scaled = matrices / np.where(np.abs(last) > 1e-9 * depth, last, depth)
    flat = uv_px.reshape(n_cameras, -1, 2)
    scale = None if relative is None else np.broadcast_to(relative, uv_px.shape[:-1]).reshape(n_cameras, -1)
    out = np.full((seen.shape[1], 3), np.nan)
    for block in in_blocks(n_cameras, len(points)):
        some = points[block]
        there = seen[:, some]
        uv = np.where(there[:, None], points_last(flat[:, some]), 0.0)
        weight = there.astype(float) if scale is None else there / scale[:, some] ** 2
        rows = scaled[:, :2, :, None] - uv[:, :, None] * scaled[:, 2:, :, None]  # (C, 2, 4, K)
        normal, right = normal_equations(rows[:, :, :3], weight, -rows[:, :, 3])
        factored = factor(normal)
        x = solve(factored, right)
        left = rows[:, :, 3] + np.einsum("crik,ik->crk", rows[:, :, :3], x)
        out[some] = (x - solve(factored, towards(rows[:, :, :3], weight, left))).T
    return out.reshape(*shape, 3)


def residual_px(matrices: Array, uv_px: Array, xyz_m: Array, *, relative: Array | None = None) -> Array:
    """DLTdv's residual sqrt(sum r^2 / (2 n - 3)) over the n cameras that see a point.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, ..., 2) ideal pixels.
        xyz_m: (..., 3) points in metres.
        relative: Deviations that misses are divided by, broadcastable to (C, ...); None: 1.

    Returns:
        (...) pixels; NaN without a point.
    """
    squares = np.sum((uv_px - project(matrices, xyz_m)) ** 2, axis=-1)
    if relative is not None:
        squares = squares / relative**2
    n = np.isfinite(squares).sum(axis=0)
    with np.errstate(invalid="ignore"):
        return np.where(n >= 2, np.sqrt(np.nansum(squares, axis=0) / np.maximum(2 * n - 3, 1)), np.nan)


def misses(matrices: Array, uv_px: Array) -> Array:
    """(K,) residuals of the linear triangulation of (C, ..., 2) ideal pixels, of those that give a point."""
    miss = residual_px(matrices, uv_px, linear(matrices, uv_px))
    return miss[np.isfinite(miss)]


def median_miss(matrices: Array, uv_px: Array) -> float:
    """The median of ``misses``; inf where no point is seen by two cameras."""
    miss = misses(matrices, uv_px)
    return float(np.median(miss)) if len(miss) else np.inf


def spread_points(uv_px: Array, most: int) -> Array:
    """(C, K, 2) pixels of at most so many points that two cameras or more see, spread over (C, ..., 2) of them."""
    uv = uv_px.reshape(len(uv_px), -1, 2)
    uv = uv[:, np.isfinite(uv[..., 0]).sum(axis=0) >= 2]
    return uv[:, np.linspace(0, max(uv.shape[1] - 1, 0), min(uv.shape[1], most)).astype(int)]


def refine(
    matrices: Array, uv_px: Array, xyz_m: Array, *, sd_px: Array | float, iterations: int = 10
) -> tuple[Array, Array]:
    """Gauss-Newton on the reprojection error, all points at once.

    Minimises sum |uv - project(x)|^2 / sd^2 from ``xyz_m``; a step that does not lower a point's error is not taken.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, ..., 2) ideal pixels; NaN where not seen.
        xyz_m: (..., 3) starting points; NaN stays NaN.
        sd_px: Standard deviation of a pixel coordinate: a number or broadcastable to (C, ...).
        iterations: At most so many steps.

    Returns:
        (..., 3) points and their (..., 3, 3) covariance (J^T J / sd^2)^-1 in square metres, NaN without a point.
    """
    shape, n_cameras = xyz_m.shape[:-1], len(uv_px)
    start = xyz_m.reshape(-1, 3)
    located = np.flatnonzero(np.isfinite(start[:, 0]))
    flat = uv_px.reshape(n_cameras, -1, 2)
    sd = np.broadcast_to(np.asarray(sd_px, dtype=float), uv_px.shape[:-1]).reshape(n_cameras, -1)
    points, cov = np.full_like(start, np.nan), np.full((len(start), 3, 3), np.nan)
    for block in in_blocks(n_cameras, len(located)):
        some = located[block]
        uv = points_last(flat[:, some])
        weight = np.where(np.isfinite(uv[:, 0]), 1 / sd[:, some] ** 2, 0.0)
        x, normal = _descended(matrices, np.nan_to_num(uv), weight, start[some].T.copy(), iterations)
        cov[some] = inverse(factor(normal))
        points[some] = np.where(np.isfinite(cov[some, :, 0]), x.T, np.nan)
    return points.reshape(*shape, 3), cov.reshape(*shape, 3, 3)


def _descended(matrices: Array, uv: Array, weight: Array, x: Array, iterations: int) -> tuple[Array, Array]:
    """Points (3, K) after Gauss-Newton steps, and the normal equations (6, K) there."""

    def at(x: Array, which: slice | NDArray[np.int64]) -> tuple[Array, Array, Array]:
        there, slope = projected(matrices, x)
        error = uv[:, :, which] - there
        cost = np.einsum("crk,ck->k", error**2, weight[:, which])
        return cost, *normal_equations(slope, weight[:, which], error)

    cost, normal, right = at(x, slice(None))
    active = np.arange(x.shape[1])
    for _ in range(iterations):
        if not len(active):
            break
        every = len(active) == x.shape[1]
        which = slice(None) if every else active
        step = solve(factor(normal[:, which]), right[:, which])
        trial = x[:, which] + step
        new_cost, new_normal, new_right = at(trial, which)
        better = new_cost < cost[which]
        moved = active[better]
        if every and len(moved) == len(active):
            x, cost, normal, right = trial, new_cost, new_normal, new_right
        else:
            x[:, moved], cost[moved] = trial[:, better], new_cost[better]
            normal[:, moved], right[:, moved] = new_normal[:, better], new_right[:, better]
        scale = np.abs(x[:, moved]).max(axis=0, initial=0.0) + 1e-3
        active = moved[np.abs(step[:, better]).max(axis=0, initial=0.0) > 1e-12 * scale]
    return x, normal


@dataclass(frozen=True, eq=False, kw_only=True)
class Triangulation:
    """Points from pixels, and which observations were accepted.

    Attributes:
        xyz_m: (T, M, 3) points; NaN where fewer than two believed rays meet.
        cov_m2: (T, M, 3, 3) covariance.
        residual_px: (T, M) sqrt(sum r^2 / (2 n - 3)).
        rejected: (C, T, M) True for rays that miss.
        sd_px: Standard deviation of a pixel coordinate, given or estimated from the residuals.
        shown_px: The estimate from the residuals of all rays; NaN where it was given.
    """

    xyz_m: Array
    cov_m2: Array
    residual_px: Array
    rejected: NDArray[np.bool_]
    sd_px: float
    shown_px: float


def pixel_sd(residual: Array, n_cameras: NDArray[np.int64]) -> float:
    """Standard deviation of a pixel coordinate from the residuals of triangulated points, without those that miss.

    A residual squared is sd^2 chi2(2n - 3) / (2n - 3); the median over points of its ratio to the chi-square median
    does not feel the points that miss. Digitising errors have heavy tails, which that median does not feel either: the
    result is the root mean square of the residuals within ``MISSES`` such standard deviations.

    Args:
        residual: (T, M) residuals in pixels; NaN without a point.
        n_cameras: (T, M) cameras that see each point.

    Raises:
        ValueError: there is no point.
    """
    from scipy.special import chdtri

    ok = np.isfinite(residual) & (n_cameras >= 2)
    if not ok.any():
        raise ValueError("no point is seen by two cameras: the pixel noise cannot be estimated; give `pixel_sd`")
    dof = 2 * n_cameras[ok] - 3
    core = np.median(residual[ok] ** 2 * dof / chdtri(dof, 0.5))
    near = residual[ok] ** 2 <= MISSES**2 * core
    return float(np.sqrt(np.sum(residual[ok][near] ** 2 * dof[near]) / np.sum(dof[near])))


def apparent_sd(matrices: Array, uv_px: Array) -> float:
    """Standard deviation of a pixel coordinate that (C, T, M, 2) ideal pixels show by how they miss (``pixel_sd``).

    Raises:
        ValueError: no point is seen by two cameras.
    """
    residual = residual_px(matrices, uv_px, linear(matrices, uv_px))
    return pixel_sd(residual, np.isfinite(uv_px[..., 0]).sum(axis=0))


def robust(
    matrices: Array,
    uv_px: Array,
    *,
    sd_px: float | None = None,
    least_px: float | None = None,
    relative: Array | None = None,
    certain: NDArray[np.bool_] | None = None,
) -> Triangulation:
    """Triangulate, rejecting rays that miss, the worst first.

    A point whose residual exceeds ``MISSES`` standard deviations loses the ray whose removal lowers its squared error
    most, until it agrees or two rays are left. With two rays left that disagree nothing tells which is wrong: both are
    rejected and the point is lost.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels.
        sd_px: Standard deviation of a pixel coordinate; None estimates it (``pixel_sd``).
        least_px: The estimate is no smaller than that; None: of any size.
        relative: Deviations of rays relative to ``sd_px``, broadcastable to (C, T, M); residuals are divided by them.
            None: 1.
        certain: (C, T, M) rays that are never rejected; where they contradict each other the point is between them.
            None: none.
    """
    uv = uv_px.copy()
    seen = np.isfinite(uv[..., 0])
    fixed = np.zeros(seen.shape, dtype=bool) if certain is None else certain
    scale = np.broadcast_to(1.0 if relative is None else relative, seen.shape)
    xyz = linear(matrices, uv, relative=scale)
    residual = residual_px(matrices, uv, xyz, relative=scale)
    shown = pixel_sd(residual, seen.sum(axis=0)) if sd_px is None else np.nan
    sd = max(max(least_px or 0.0, shown) if sd_px is None else sd_px, 1e-9)  # pixels may be exact
    limit = MISSES * sd
    for _ in range(len(matrices)):
        t, m = np.nonzero((residual > limit) & (np.isfinite(uv[..., 0]) & ~fixed).any(axis=0))
        if not len(t):
            break
        trial = uv[:, t, m]  # (C, K, 2)
        count = np.isfinite(trial[..., 0]).sum(axis=0)
        drop_all = count <= 2
        lost = t[drop_all], m[drop_all]
        uv[:, *lost] = np.where(fixed[:, *lost, None], uv[:, *lost], np.nan)
        xyz[lost], residual[lost] = np.nan, np.nan
        t, m, trial = t[~drop_all], m[~drop_all], trial[:, ~drop_all]
        without = np.repeat(trial[None], len(matrices), axis=0)  # (dropped camera, C, K, 2)
        without[np.arange(len(matrices)), np.arange(len(matrices))] = np.nan
        without, spread = np.moveaxis(without, 1, 0), scale[:, None, t, m]
        points = linear(matrices, without, relative=spread)
        misses = (without - project(matrices, points)) / spread[..., None]
        squares = np.nansum(misses**2, axis=(0, -1))  # (dropped, K)
        squares[~np.isfinite(trial[..., 0]) | fixed[:, t, m]] = np.inf
        worst = np.argmin(squares, axis=0)
        uv[worst, t, m] = np.nan
        xyz[t, m] = linear(matrices, uv[:, t, m], relative=scale[:, t, m])
        residual[t, m] = residual_px(matrices, uv[:, t, m], xyz[t, m], relative=scale[:, t, m])
    refined, cov = refine(matrices, uv, xyz, sd_px=sd * scale)
    return Triangulation(
        xyz_m=refined,
        cov_m2=cov,
        residual_px=residual_px(matrices, uv, refined, relative=scale),
        rejected=seen & ~np.isfinite(uv[..., 0]),
        sd_px=sd,
        shown_px=shown,
    )
