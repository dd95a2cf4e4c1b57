"""Digitising noise of each camera and marker: scale and degrees of freedom of Student's t errors."""

from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.cameras.linearised import fit, linearise

USUAL_DOF = 4.0
"""Degrees of freedom that are assumed of a camera of which little is known: heavy tails with a variance."""
DOFS = np.geomspace(3.0, 60.0, 16)
"""Degrees of freedom that are tried. Small and large digitising errors are a mixture, whose most likely t has 2: points
are nearer to the truth with 3, intervals as good (0.677 mm, 95.6 % against 0.679 mm, 94.8 %; a bat, 8 cameras)."""
SURE = 0.5
"""Prior deviation of the logarithm of the degrees of freedom about the usual ones."""
SHRINK = 30.0
"""Redundant errors that the factors of a camera and of a marker are shrunk to 1 by."""
CAMERAS = 5
"""Degrees of freedom are estimated from points that so many cameras see: of fewer the reweighted point follows its best
rays so closely that tails look heavier than they are (3 for 10 with four cameras)."""


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
    the redundancy of the ray (``mocap.cameras.linearised.Fit``), which gives back what the three coordinates of each
    point took up; then in turn points, the common scale, cameras and markers from s^2 = sum w r^2 / sum rho (the
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
    known = np.isfinite(xyz_m[..., 0]) & (count >= 2)
    if not known.any():
        return None
    every = int(np.ceil(known.sum() / 4000))  # so many points, spread over the recording, are looked at
    known.ravel()[np.delete(np.flatnonzero(known), slice(None, None, every))] = False
    n_cameras, _, n_markers = uv_px.shape[:3]
    marker = np.nonzero(known)[1]
    worse = np.ones((n_cameras, len(marker))) if relative is None else relative[:, known]
    problem = linearise(matrices, uv_px[:, known], xyz_m[known])
    found = fit(problem, 1 / worse**2)
    rays = problem.seen > 0
    usual = rays & (worse <= 1.0)
    well = usual & (count[known] >= CAMERAS)
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
        likelihood -= 0.5 * (np.log(nu / USUAL_DOF) / SURE) ** 2
        best = float(nu[np.argmax(likelihood)])
        nu = np.geomspace(max(best / 1.2, DOFS[0]), best * 1.2, 21)
    return best
