"""Errors that last, which no filter averages out: those of rays, and of positions where the track leaves them."""

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cleaning.bias import LAG, lasting_share
from mocap.cleaning.cleaned import cleaned
from mocap.recording import Recording

Mask = NDArray[np.bool_]

FAR = 3.0
"""A sample is not called measured if it lies more than so many standard deviations from where it was measured."""
MANY = 0.03
"""As many of a marker's samples beyond ``FAR`` mean that the deviation is wrong, not the samples: of normal errors at
most this share of (three-dimensional) residuals is, and of sound recordings 0 to 0.026 (gliding snakes)."""
AWAY = 5.0
"""Residuals above so many times the root mean square of a marker's others are mistakes; chosen, as in
``mocap.cleaning.positions.position_sd``."""


def beyond(off_m: Array, cov_m2: Array) -> Mask:
    """(T, M) residuals (T, M, 3) longer than ``FAR`` of their deviations; False where there is none."""
    with np.errstate(invalid="ignore"):
        return np.linalg.norm(off_m, axis=-1) > FAR * np.sqrt(np.trace(cov_m2, axis1=-2, axis2=-1) / 3)


def departures(off_m: Array, cov_m2: Array) -> tuple[Array, Mask]:
    """What a track that leaves measured positions errs by, and the (T, M) samples that are not refused for it.

    Positions without cameras have no rays that miss: their fourth differences show white noise, micrometres of optical
    and X-ray data, and nothing of errors that last (soft tissue, a body that bends, a stiff model) or are rare. Where
    ``MANY`` of a marker's residuals are beyond ``FAR`` the deviation is wrong, not the samples, and it is enlarged from
    them. What lasts is shown by the neighbours in time: the median d of the residuals within ``LAG`` frames, the
    sample's own left out, is an error with the covariance d d^T. What is left, with the variance of its coordinates
    above that of the noise, is white. Only mistakes are still refused, which are far from the rest of either.

    Args:
        off_m: (T, M, 3) track minus measured position; NaN where none was believed.
        cov_m2: (T, M, 3, 3) covariance of both together.

    Returns:
        (T, M, 3, 3) covariance to add to that of the track, 0 where the deviation was right; and the samples.
    """
    seen, far = np.isfinite(off_m[..., 0]), beyond(off_m, cov_m2)
    many = far.sum(axis=0) >= MANY * np.maximum(seen.sum(axis=0), 1)
    out, kept = np.zeros_like(cov_m2), np.zeros_like(seen)
    for marker in np.flatnonzero(many):
        here, variance = seen[:, marker], np.trace(cov_m2[:, marker], axis1=-2, axis2=-1) / 3
        d = _lasting(off_m[:, marker])
        rest = np.linalg.norm(off_m[:, marker] - d, axis=1)
        kept[:, marker] = near = here & ~_mistakes(rest, here)
        white = max(0.0, float(np.mean(rest[near] ** 2 / 3 - variance[near])))
        out[:, marker] = d[:, :, None] * d[:, None] + white * near[:, None, None] * np.eye(3)
    return out, kept


def _lasting(off_m: Array) -> Array:
    """(T, 3) medians of the residuals of the frames around, 0 where too few are known, or they are mistakes."""
    n_frames, seen = len(off_m), np.isfinite(off_m[:, 0])
    padded = np.pad(off_m, ((LAG, LAG), (0, 0)), constant_values=np.nan)
    near = np.stack([padded[i : i + n_frames] for i in range(2 * LAG + 1) if i != LAG])
    known = seen & (np.isfinite(near[..., 0]).sum(axis=0) >= LAG)
    d = np.zeros((n_frames, 3))
    d[known] = np.nanmedian(near[:, known], axis=0)
    d[_mistakes(np.linalg.norm(d, axis=1), known)] = 0.0
    return d


def root_mean_square(cov_m2: Array, where: Mask) -> Array:
    """(M,) root mean square of the lengths of errors with (T, M, 3, 3) covariance, over (T, M) samples; 0 of none."""
    total = np.sum(np.trace(cov_m2, axis1=-2, axis2=-1) * where, axis=0)
    return np.sqrt(total / np.maximum(where.sum(axis=0), 1))


def _mistakes(size: Array, known: Mask) -> Mask:
    """(T,) sizes that are above ``AWAY`` times the rest's, which are found by starting from those below the median."""
    if not known.any():
        return ~known
    near = size[known] <= np.median(size[known])
    for _ in range(len(near)):
        wider = size[known] <= AWAY * np.sqrt(np.mean(size[known][near] ** 2))
        if (wider == near).all():
            break
        near = wider
    out = np.zeros(len(size), dtype=bool)
    out[known] = ~near
    return out


def lasting_cov(recording: Recording) -> Array:
    """(T, M, 3, 3) covariance of a point from ray errors that last, which no filter can average out.

    The jitter's covariance scaled to the variance of the lasting errors of each marker and of what all cameras share
    (``mocap.cleaning.bias``), and that of a lens which was estimated or is not corrected; where a marker is not
    seen, that of the sample of median variance.
    """
    if not recording.cameras:
        return np.zeros_like(recording.cov_m2)
    found = cleaned(recording)
    usual = found.jitter_px * (np.ones(len(recording.names)) if found.noise is None else found.noise.marker)
    lasting = np.asarray(recording.data.get("persistent", np.zeros(len(usual))))
    cov = _filled(recording.cov_m2 * lasting_share(lasting, usual, removed_px=found.bias_px)[:, None, None])
    lens = recording.data.get("lens_covariance")
    return cov if lens is None else cov + _filled(lens.values)


def _filled(cov_m2: Array) -> Array:
    """A covariance (T, M, 3, 3) with that of a marker's sample of median variance where it is NaN; 0 without any."""
    out = cov_m2.copy()
    variance = np.trace(out, axis1=-2, axis2=-1)
    for marker in range(out.shape[1]):
        seen = np.flatnonzero(np.isfinite(variance[:, marker]))
        order = seen[np.argsort(variance[seen, marker])]  # a median of each entry need not be a covariance
        out[np.isnan(variance[:, marker]), marker] = out[order[len(order) // 2], marker] if len(order) else 0.0
    return out
