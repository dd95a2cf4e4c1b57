"""What a lens that was estimated, or is not corrected, leaves uncertain of positions."""

from dataclasses import replace

import numpy as np

from mocap import audit
from mocap.arrays import Array
from mocap.calibration.lens_of_tracks import lens_covariance, lens_of_tracks, moved_by_lens
from mocap.errors import CalibrationError
from mocap.pipeline.recording import Filmed

_POINTS = 500
_LEAST_K1 = 0.02
_CERTAIN = 5.0
"""A lens that only a fit sees is spoken of from so many standard deviations on."""


def lens_uncertainty(filmed: Filmed, audited: list[audit.Finding], uv_px: Array) -> tuple[Array | None, list[str]]:
    """(T, M, 3, 3) covariance of points, and sentences; None where lenses are given, or nothing speaks of one.

    Of a lens that was estimated it follows from the covariance of its coefficients. One that the audit sees and nobody
    corrected moves each point by d: it is counted as an error with the covariance d d^T, which no frame averages out.

    Args:
        filmed: Pixels and cameras.
        audited: Findings, from which those of a lens are removed once it was estimated.
        uv_px: (C, T, M, 2) believed ideal pixels.
    """
    if filmed.lens is not None:
        audited[:] = [f for f in audited if not (f.kind == "distortion" and f.alarm)]
        bent = np.stack([_bent(filmed, c, uv) for c, uv in enumerate(uv_px)])
        return lens_covariance(filmed.cameras, filmed.lens, bent), []
    seen = [f for f in audited if f.kind == "distortion" and f.alarm and "k1" in f.numbers]
    told, k1 = [], float(seen[0].numbers["k1"]) if seen else 0.0
    if not seen and all(c.lens is None for c in filmed.cameras):
        k1, told = _faint(filmed, uv_px)
    if not k1:
        return None, []
    moved = moved_by_lens(filmed.cameras, uv_px, k1)
    far = 1e3 * np.linalg.norm(moved, axis=-1)
    far = far[np.isfinite(far)]
    if not len(far):
        return None, []
    said = (
        f"the lens that is not corrected moves positions by {np.median(far):.2f} mm (median), "
        f"{np.quantile(far, 0.9):.2f} mm (90 %); their standard deviations are widened by as much: give `profile`, or "
        "have it estimated with `fit_lens`"
    )
    return moved[..., :, None] * moved[..., None, :], [*told, said]


def _faint(filmed: Filmed, uv_px: Array) -> tuple[float, list[str]]:
    """k1 that the audit's coarser measure does not see, and a sentence; 0 where rays do not determine it either."""
    try:
        found = lens_of_tracks(filmed.cameras, uv_px, most_points=_POINTS, each=False)
    except CalibrationError:
        return 0.0, []
    if abs(found.k1[0]) < max(_LEAST_K1, _CERTAIN * found.sd[0]):
        return 0.0, []
    return float(found.k1[0]), [
        f"the pixels look slightly distorted, and no lens is given: {found.words}; median residual of stretches that "
        f"the fit did not see {found.before_px:.2f} px without it, {found.after_px:.2f} px with it"
    ]


def _bent(filmed: Filmed, camera: int, uv_px: Array) -> Array:
    """Pixels before the estimated lens was taken out."""
    assert filmed.lens is not None
    lens = replace(filmed.lens.lenses[camera], k=(float(filmed.lens.k1[camera]), 0.0, 0.0))
    return lens.distort(uv_px)


def filled(cov_m2: Array) -> Array:
    """A covariance (T, M, 3, 3) with that of a marker's median sample where it is NaN; 0 of markers without any."""
    out = cov_m2.copy()
    for marker in range(out.shape[1]):
        seen = np.isfinite(out[:, marker, 0, 0])
        out[~seen, marker] = np.median(out[seen, marker], axis=0) if seen.any() else 0.0
    return out
