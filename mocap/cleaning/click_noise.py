"""Digitising errors follow Student's t: its scale and degrees of freedom by camera and marker, and points under it."""

from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.cameras.triangulate import PAIRS, fit, linearise, refine

USUAL_DOF = 4.0
"""Degrees of freedom that are assumed of a camera of which little is known: heavy tails with a variance. Chosen; what
is learned of cameras is drawn to it (``DOFS``)."""
DOFS = np.geomspace(3.0, 60.0, 16)
"""Degrees of freedom that are tried. Small and large digitising errors are a mixture, whose most likely t has 2: points
are nearer to the truth with 3, intervals as good (0.677 mm, 95.6 % against 0.679 mm, 94.8 %; a bat, 8 cameras)."""
LOG_DOF_SD = 0.5
"""Prior deviation of log nu about the usual: of 19 cameras in 20 nu is between 1.5 and 11. Chosen."""
SHRINK = 30.0
"""Redundant errors that the factors of a camera and of a marker are shrunk to 1 by. Chosen: so many show a scale to
1 / sqrt(2 * 30) = 13 %."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClickNoise:
    """Errors of a ray of camera c to marker m: Student's t with ``dof[c]`` and scale ``scale_px camera[c] marker[m]``.

    Attributes:
        scale_px: Scale of a pixel coordinate of the typical camera and marker.
        camera: (C,) factors of cameras, 1 where nothing is known.
        marker: (M,) factors of markers, 1 where nothing is known.
        dof: (C,) degrees of freedom.
    """

    scale_px: float
    camera: Array
    marker: Array
    dof: Array

    @property
    def factors(self) -> Array:
        """(C, 1, M) scales of rays over that of the typical one."""
        return self.camera[:, None, None] * self.marker


def click_noise(
    matrices: Array,
    uv_px: Array,
    xyz_m: Array,
    *,
    relative: Array | None = None,
) -> ClickNoise | None:
    """Estimate scales and degrees of freedom from residuals of triangulation.

    ECME (Liu & Rubin 1995, Biometrika 81): weights w = (nu + 2) / (nu + d^2) with d^2 = 2 r^2 / (rho s^2), where rho is
    the redundancy of the ray (``mocap.cameras.triangulate.PointFit``), which gives back what the three coordinates of
    each point took up; then in turn points, the common scale, cameras and markers from s^2 = sum w r^2 / sum rho (the
    factors with ``SHRINK`` more errors of factor 1), and nu where the density of d^2 itself,
    prod (1 + d^2 / nu)^-(nu + 2)/2 / (2 pi), times its prior, is greatest.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        xyz_m: (T, M, 3) points near which to linearise; NaN where unknown.
        relative: (C, T, M) scales of rays relative to what is estimated; None: 1. Where above 1 rays say nothing of it.

    Returns:
        The noise; None where no point is seen by two cameras.
    """
    count = np.isfinite(uv_px[..., 0]).sum(axis=0)
    finite = np.isfinite(xyz_m[..., 0]) & (count >= 2)
    if not finite.any():
        return None
    every = int(np.ceil(finite.sum() / 4000))  # so many points, spread over the recording, are looked at
    finite.ravel()[np.delete(np.flatnonzero(finite), slice(None, None, every))] = False
    n_cameras, _, n_markers = uv_px.shape[:3]
    marker = np.nonzero(finite)[1]
    worse = np.ones((n_cameras, len(marker))) if relative is None else relative[:, finite]
    problem = linearise(matrices, uv_px[:, finite], xyz_m[finite])
    found = fit(problem, 1 / worse**2)
    rays = problem.seen > 0
    usual = rays & (worse <= 1.0)
    # of fewer cameras the reweighted point follows its best rays so closely that tails look heavier than they are
    # (3 for 10 with four cameras)
    well = usual & (count[finite] >= 5)
    camera_factor, marker_factor = np.ones(n_cameras), np.ones(n_markers)
    dof = np.full(n_cameras, USUAL_DOF)
    squares = np.sum(found.residual**2, axis=-1) / worse**2
    typical = np.median(squares[rays] / np.maximum(found.redundancy[rays], 0.1))
    scale = max(float(np.sqrt(typical)), 1e-9)
    for _ in range(20):  # rounds of ECME
        spread = scale * camera_factor[:, None] * marker_factor[marker] * worse
        distance = 2 * np.sum(found.residual**2, axis=-1) / (np.maximum(found.redundancy, 0.05) * spread**2)
        weight = np.where(rays, (dof[:, None] + 2) / (dof[:, None] + distance), 0.0)
        found = fit(problem, weight / spread**2)
        squares = usual * weight * np.sum(found.residual**2, axis=-1) / spread**2
        redundancy = usual * found.redundancy
        scale = max(scale * float(np.sqrt(squares.sum() / max(redundancy.sum(), 1e-9))), 1e-9)
        camera_factor = _shrunk(camera_factor, squares.sum(axis=1), redundancy.sum(axis=1))
        marker_factor = _shrunk(
            marker_factor,
            np.bincount(marker, squares.sum(axis=0), n_markers).astype(np.float64),
            np.bincount(marker, redundancy.sum(axis=0), n_markers).astype(np.float64),
        )
        spread = scale * camera_factor[:, None] * marker_factor[marker] * worse
        distance = 2 * np.sum(found.residual**2, axis=-1) / (np.maximum(found.redundancy, 0.05) * spread**2)
        dof = np.array([_most_likely_dof(distance[c, well[c]]) for c in range(n_cameras)])
    typical_camera, typical_marker = (float(np.exp(np.mean(np.log(f)))) for f in (camera_factor, marker_factor))
    return ClickNoise(
        scale_px=scale * typical_camera * typical_marker,
        camera=camera_factor / typical_camera,
        marker=marker_factor / typical_marker,
        dof=dof,
    )


def _shrunk(factor: Array, squares: Array, redundancy: Array) -> Array:
    """Factors times sqrt((squares + shrink / factor^2) / (redundancy + shrink)): the posterior mode of a variance."""
    return factor * np.sqrt((squares + SHRINK / factor**2) / (redundancy + SHRINK))


def _most_likely_dof(distance: Array) -> float:
    """The most likely degrees of freedom of squared distances, from a coarse grid and then between its points."""
    nu = DOFS
    fours = np.concatenate([distance, np.zeros(-len(distance) % 4)]).reshape(4, -1, 1)
    for _ in range(2):
        grown = 1 + fours / nu
        likelihood = -0.5 * (nu + 2) * np.log(grown[0] * grown[1] * grown[2] * grown[3]).sum(axis=0)
        likelihood -= 0.5 * (np.log(nu / USUAL_DOF) / LOG_DOF_SD) ** 2
        best = float(nu[np.argmax(likelihood)])
        nu = np.geomspace(max(best / 1.2, DOFS[0]), best * 1.2, 21)
    return best


LEAST_PX = 0.01
"""No pixel is known better than that, not even where pixels were simulated without noise. Chosen."""


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
    v = (nu + d) / (nu + d r^2 / (rho s^2)), rho the redundancy of a ray (``mocap.cameras.triangulate.PointFit``) and d
    the number of its errors that are left in its residual: 2, or 1 of two rays, which show how far they pass each other
    and no more.
    Residuals in place of errors in v would make it 9 % too large with eight cameras, 18 % with four, 38 % with two.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        xyz_m: (T, M, 3) starting points; NaN stays NaN.
        sd_px: Standard deviation of a pixel coordinate over all rays, to start from.
        relative: (C, T, M) scales of rays relative to s; None: 1.
        noise: Factors of cameras and markers, and degrees of freedom; None: 1, and ``USUAL_DOF``.

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
    nu = np.full((len(matrices), 1, 1), USUAL_DOF)
    if noise is not None:
        nu, spread = noise.dof[:, None, None], spread * noise.factors
    scale = sd_px * np.sqrt((USUAL_DOF - 2) / USUAL_DOF)
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
