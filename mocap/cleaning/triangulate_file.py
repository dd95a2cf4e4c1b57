"""Triangulation alone: as DLTdv computes it, or with a minimal reprojection error."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.audit.geometry import fit_findings
from mocap.cameras import triangulate
from mocap.cleaning import sentences
from mocap.cleaning.cleaning import audit_points
from mocap.errors import MocapError
from mocap.findings import Finding, alarms
from mocap.io import dltdv
from mocap.reading.ideal_pixels import with_rays, without_lens
from mocap.recording import Recording
from mocap.records import marker_tracks


@dataclass(frozen=True, kw_only=True)
class TriangulationSummary:
    """What was triangulated.

    Attributes:
        points: Number of points.
        samples: Frames times markers.
        residual_px: Median residual.
        findings: On origin and stored points.
    """

    points: int
    samples: int
    residual_px: float
    findings: tuple[Finding, ...]


def linear_in_blocks(matrices: Array, uv_px: Array, *, frames: int = 2000) -> tuple[Array, Array]:
    """``triangulate.linear`` and its residual, some frames at a time: little more memory than the arrays.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels.
        frames: So many at a time.

    Returns:
        (T, M, 3) points and (T, M) residuals in pixels.
    """
    xyz = np.empty((*uv_px.shape[1:3], 3))
    residual = np.empty(uv_px.shape[1:3])
    for start in range(0, uv_px.shape[1], frames):
        part = slice(start, start + frames)
        xyz[part] = triangulate.linear(matrices, uv_px[:, part])
        residual[part] = triangulate.residual_px(matrices, uv_px[:, part], xyz[part])
    return xyz, residual


def triangulate_file(source: Recording, out: Path, *, refine: bool) -> TriangulationSummary:
    """Write a DLTdv xyzpts file.

    Args:
        source: A recording with cameras.
        out: File to write, as ``mocap.io.output.result_file`` gives it.
        refine: False: DLTdv's linear least squares, with its three iterations of undistortion, nothing cleaned. True:
            the smallest reprojection error, rays that miss rejected, with columns ``<name>_sd``.

    Raises:
        MocapError: whatever makes that impossible.
    """
    if not source.filmed:
        raise MocapError(f"{source.where}: pixels need the calibration of their cameras: give `calibration`")
    film = with_rays(source)
    if refine:
        stated = source.source.pixel_sd
        found = triangulate.robust(film.matrices, film.ideal_px, least_px=stated)
        xyz, residual = found.xyz_m, found.residual_px
        cov = found.cov_m2 * ((stated or found.sd_px) / found.sd_px) ** 2
        contradicted = sentences.contradiction(stated, low_px=found.shown_px, high_px=found.shown_px)
    else:
        ideal = without_lens(film, film.data["pixels"].values, iterations=3)
        xyz, residual = linear_in_blocks(film.matrices, ideal)
        contradicted, cov = [], None
    tracks = marker_tracks(film.names, film.t_s, xyz, cov_m2=cov)
    _, findings = audit_points(film)
    dltdv.write_points(out, tracks, sd=refine)
    poor = alarms(fit_findings(film.cameras, film.ideal_px))
    return TriangulationSummary(
        points=int(tracks.seen.sum()),
        samples=tracks.seen.size,
        residual_px=float(np.median(residual[tracks.seen])),
        findings=(
            *poor,
            *contradicted,
            *film.findings,
            *findings,
        ),
    )
