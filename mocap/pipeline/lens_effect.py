"""What a lens that was estimated, or is not corrected, leaves uncertain of positions."""

from dataclasses import replace

import numpy as np

from eal.arrays import Array
from mocap.calibration.lens_of_tracks import lens_covariance, moved_by_lens
from mocap.findings import Finding
from mocap.pipeline.recording import Recording
from mocap.pipeline.sentences import lens_left


def lens_uncertainty(film: Recording, audited: list[Finding], uv_px: Array) -> tuple[Array | None, list[Finding]]:
    """(T, M, 3, 3) covariance of points, and findings; None where lenses are given, or nothing speaks of one.

    Of a lens that was estimated it follows from the covariance of its coefficients. One that the audit sees and nobody
    corrected moves each point by d: it is counted as an error with the covariance d d^T, which no frame averages out.

    Args:
        film: With ideal pixels.
        audited: Findings, from which those of a lens are removed once it was estimated.
        uv_px: (C, T, M, 2) believed ideal pixels.
    """
    if film.lens is not None:
        audited[:] = [f for f in audited if not (f.kind == "distortion" and f.alarm)]
        bent = np.stack([_bent(film, c, uv) for c, uv in enumerate(uv_px)])
        return lens_covariance(film.cameras, film.lens, bent), []
    seen = [f for f in audited if f.kind == "distortion" and f.alarm and "k1" in f.numbers]
    if not seen:
        return None, []
    moved = moved_by_lens(film.cameras, uv_px, float(seen[0].numbers["k1"]))
    far = 1e3 * np.linalg.norm(moved, axis=-1)
    far = far[np.isfinite(far)]
    if not len(far):
        return None, []
    return moved[..., :, None] * moved[..., None, :], [lens_left(far)]


def _bent(film: Recording, camera: int, uv_px: Array) -> Array:
    """Pixels before the estimated lens was taken out."""
    assert film.lens is not None
    lens = replace(film.lens.lenses[camera], k=(float(film.lens.k1[camera]), 0.0, 0.0))
    return lens.distort(uv_px)


def filled(cov_m2: Array) -> Array:
    """A covariance (T, M, 3, 3) with that of a marker's sample of median variance where it is NaN; 0 without any."""
    out = cov_m2.copy()
    variance = np.trace(out, axis1=-2, axis2=-1)
    for marker in range(out.shape[1]):
        seen = np.flatnonzero(np.isfinite(variance[:, marker]))
        order = seen[np.argsort(variance[seen, marker])]  # a median of each entry need not be a covariance
        out[np.isnan(variance[:, marker]), marker] = out[order[len(order) // 2], marker] if len(order) else 0.0
    return out
