"""Whittaker's smoother of series: missing samples are bridged, slow motion stays."""

from collections.abc import Callable

import numpy as np

from eal.arrays import Array

FASTEST_HZ = 30.0
"""Faster motion is taken for noise. Chosen, not measured: three times the wing beat of a bat."""


def fastest_hz(dt_s: float) -> float:
    """``FASTEST_HZ``, or a fifth of the frame rate where that is lower: clicks jitter from frame to frame."""
    return min(FASTEST_HZ, 0.2 / dt_s)


def smooth_series(y: Array, weight: Array, *, dt_s: float, cutoff_hz: float) -> Array:
    """Whittaker's smoother: minimise sum w (x - y)^2 + p sum (second difference of x)^2.

    p = (2 pi cutoff dt)^-4, so that a sine of ``cutoff_hz`` is halved; samples of weight 0 are bridged by cubics, and
    continued by straight lines before the first and after the last. p is at most 1e12
    times the greatest weight (a cutoff of 0.0001 of the frame rate): double precision solves nothing stiffer.

    Args:
        y: (T, K) series; values of weight 0 are not read.
        weight: (T,) weights, at least two positive.
        dt_s: Time step.
        cutoff_hz: Frequency of half amplitude.

    Returns:
        (T, K) smoothed series.
    """
    n = len(y)
    if n < 3 or np.count_nonzero(weight) < 2:
        mean = np.average(np.nan_to_num(y), axis=0, weights=weight)
        return np.repeat(mean[None], n, axis=0)
    from scipy.linalg import solveh_banded

    bands = _whittaker(weight, dt_s=dt_s, cutoff_hz=cutoff_hz)
    return solveh_banded(bands, weight[:, None] * np.where(weight[:, None] > 0, y, 0.0))


def smoother(weight: Array, *, dt_s: float, cutoff_hz: float) -> Callable[[Array], Array]:
    """``smooth_series`` of many series at once, solved once for all values that they may take.

    Args:
        weight: (S, T) weights of each series, T of 3 or more, at least two of each positive.
        dt_s: Time step.
        cutoff_hz: Frequency of half amplitude.

    Returns:
        From (S, T, K) values to (S, T, K) smoothed ones.
    """
    from scipy.linalg import cho_solve_banded, cholesky_banded

    bands = np.stack([_whittaker(one, dt_s=dt_s, cutoff_hz=cutoff_hz) for one in weight], axis=1)
    solved = cholesky_banded(bands.reshape(3, -1), overwrite_ab=True, check_finite=False)

    def smooth(y: Array) -> Array:
        right = np.where(weight[..., None] > 0, weight[..., None] * y, 0.0)
        return cho_solve_banded((solved, False), right.reshape(-1, y.shape[-1]), check_finite=False).reshape(y.shape)

    return smooth


def _whittaker(weight: Array, *, dt_s: float, cutoff_hz: float) -> Array:
    """(3, T) upper bands of the equations of ``smooth_series``; nothing reaches beyond the ends."""
    n = len(weight)
    penalty = min((2 * np.pi * cutoff_hz * dt_s) ** -4, 1e12 * float(weight.max()))
    bands = np.zeros((3, n))
    bands[2] = weight
    for offset, factor in ((0, penalty), (1, 4 * penalty), (2, penalty)):
        bands[2, offset : n - 2 + offset] += factor
    bands[1, 1 : n - 1] -= 2 * penalty
    bands[1, 2:] -= 2 * penalty
    bands[0, 2:] = penalty
    return bands
