"""Triangulation that is robust against large digitising errors, whose distribution has heavy tails."""

import numpy as np

from eal.arrays import Array
from mocap.cameras.linearised import linearise
from mocap.cameras.normal_equations import PAIRS
from mocap.cameras.triangulate import refine
from mocap.cleaning.click_noise import USUAL_DOF, ClickNoise

DOF = USUAL_DOF
"""Degrees of freedom of the errors of a ray where they are not estimated: heavy tails with a variance."""
LEAST_PX = 0.01
"""No pixel is known better than that, not even where pixels were simulated without noise."""


def student_t(
    matrices: Array,
    uv_px: Array,
    xyz_m: Array,
    *,
    sd_px: float,
    relative: Array | None = None,
    noise: ClickNoise | None = None,
) -> tuple[Array, Array, Array, Array]:
    """Points under errors that follow Student's t distribution, by iteratively reweighted least squares.

    Each ray has the weight w = (nu + 2) / (nu + E r^2 / s^2), r its error, of which the residual and the variance of
    its own point make up the expected square (Lange, Little & Taylor 1989; the variance as in Roth et al. 2013): a
    point of two rays bends to both, and what it leaves of them does not make them good. The expected information of
    such a ray is (nu + 2) / (nu + 4) / s^2 in each coordinate, which the deviations below are set to.

    The scale follows from s^2 = sum v r^2 / sum rho over all rays, each divided by its factors, with
    v = (nu + d) / (nu + d r^2 / (rho s^2)), rho the redundancy of a ray (``mocap.cameras.linearised.Fit``) and d
    the number of its errors that are left in its residual: 2, or 1 of two rays, which show how far they pass each other
    and no more.
    Residuals in place of errors in v would make it 9 % too large with eight cameras, 18 % with four, 38 % with two.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        xyz_m: (T, M, 3) starting points; NaN stays NaN.
        sd_px: Standard deviation of a pixel coordinate over all rays, to start from.
        relative: (C, T, M) scales of rays relative to s; None: 1.
        noise: Factors of cameras and markers, and degrees of freedom; None: 1, and ``DOF``.

    Returns:
        (T, M, 3) points, their (T, M, 3, 3) covariance; (C, T, M) the standard deviation of a pixel coordinate of each
        ray, ``sd_px`` times its factors for rays whose marker has no point; and (C, T, M) the scale s of each ray
        before it was weighed.
    """
    seen = np.isfinite(uv_px[..., 0])
    count = seen.sum(axis=0)
    has_point = np.isfinite(xyz_m[..., 0])
    free = np.where(has_point, np.maximum(2 * count - 3, 0), 0).sum()
    spread = np.ones(seen.shape) if relative is None else relative
    nu = np.full((len(matrices), 1, 1), DOF)
    if noise is not None:
        nu, spread = noise.dof[:, None, None], spread * noise.factors
    scale = sd_px * np.sqrt((DOF - 2) / DOF)
    weight = np.ones(seen.shape)
    xyz, cov = xyz_m, np.full((*xyz_m.shape, 3), np.nan)
    rows = np.where(count == 2, 1, 2)  # of two rays only the distance from each other is left
    own = np.sqrt((nu + 4) / (nu + 2)) * spread
    for _ in range(6):  # rounds of reweighting
        ray_sd = own * scale / np.sqrt(weight)
        xyz, cov = refine(matrices, uv_px, xyz, sd_px=ray_sd, iterations=2)
        squares, taken = (part / spread**2 for part in _misses(matrices, uv_px, xyz, cov))
        weight = np.where(seen & has_point, (nu + 2) / (nu + (squares + taken) / scale**2), 1.0)
        if free:
            redundancy = np.clip(2 - taken * (spread / ray_sd) ** 2, 0.05, 2.0)
            error = rows * squares / redundancy
            scale = max(float(np.sqrt(np.sum((nu + rows) / (nu + error / scale**2) * squares) / free)), LEAST_PX)
    return xyz, cov, np.where(seen & has_point, own * scale / np.sqrt(weight), sd_px * spread), scale * spread


def _misses(matrices: Array, uv_px: Array, xyz_m: Array, cov_m2: Array) -> tuple[Array, Array]:
    """(C, T, M) squared residuals of rays, and the variance of their points across them, in px^2; 0 where unseen.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels.
        xyz_m: (T, M, 3) points.
        cov_m2: (T, M, 3, 3) their covariance.
    """
    shape = uv_px.shape[:-1]
    problem = linearise(matrices, uv_px.reshape(len(uv_px), -1, 2), xyz_m.reshape(-1, 3))
    cov = np.moveaxis(np.nan_to_num(cov_m2.reshape(-1, 3, 3)), 0, -1)
    variance = np.zeros(problem.seen.shape)
    for i, j in PAIRS:
        both = np.einsum("crk,crk->ck", problem.slope[:, :, i], problem.slope[:, :, j])
        variance += (1 if i == j else 2) * cov[i, j] * both
    return problem.squares.reshape(shape), variance.reshape(shape)
