"""Careless clicks: digitising errors have heavy tails, and least squares follows the tail."""

import numpy as np

from mocap.arrays import Array
from mocap.cameras import project
from mocap.click_noise import USUAL_DOF, ClickNoise
from mocap.triangulate import refine

DOF = USUAL_DOF
"""Degrees of freedom of the errors of a ray where they are not estimated: heavy tails with a variance."""


def student_t(
    matrices: Array,
    uv_px: Array,
    xyz_m: Array,
    *,
    sd_px: float,
    rounds: int = 6,
    relative: Array | None = None,
    noise: ClickNoise | None = None,
) -> tuple[Array, Array, Array, Array]:
    """Points under errors that follow Student's t distribution, by iteratively reweighted least squares.

    Each ray has the weight w = (nu + 2) / (nu + r^2 / s^2), r its residual and s the scale of the distribution (Lange,
    Little & Taylor 1989); s^2 is the weighted mean square of the residuals by their degrees of freedom, over all rays,
    each divided by its factors. The expected information of such a ray is (nu + 2) / (nu + 4) / s^2 in each coordinate,
    which the deviations below are set to.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        xyz_m: (T, M, 3) starting points; NaN stays NaN.
        sd_px: Standard deviation of a pixel coordinate over all rays, to start from.
        rounds: Rounds of reweighting.
        relative: (C, T) scales of rays relative to s; None: 1.
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
    spread = np.ones(seen.shape) if relative is None else np.broadcast_to(relative[..., None], seen.shape)
    nu = np.full((len(matrices), 1, 1), DOF)
    if noise is not None:
        nu, spread = noise.dof[:, None, None], spread * noise.factors
    scale = sd_px * np.sqrt((DOF - 2) / DOF)
    weight = np.ones(seen.shape)
    xyz, cov = xyz_m, np.full((*xyz_m.shape, 3), np.nan)
    own = np.sqrt((nu + 4) / (nu + 2)) * spread
    for _ in range(rounds):
        xyz, cov = refine(matrices, uv_px, xyz, sd_px=own * scale / np.sqrt(weight), iterations=2)
        squares = np.sum((uv_px - project(matrices, xyz)) ** 2, axis=-1) / spread**2
        inside = seen & np.isfinite(squares)
        weight = np.where(inside, (nu + 2) / (nu + np.nan_to_num(squares) / scale**2), 1.0)
        if free:
            scale = max(float(np.sqrt(np.sum((weight * squares)[inside]) / free)), 1e-9)
    return xyz, cov, np.where(seen & has_point, own * scale / np.sqrt(weight), sd_px * spread), scale * spread
