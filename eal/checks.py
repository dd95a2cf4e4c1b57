"""What a fit asks of its input: samples, weights, labels and lambda that make sense."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from eal.arrays import Array, positive
from eal.spectral import Scaling, effective_lambda

MIN_LAMBDA = 1e-13
"""Below this V is rounding: it turned negative at 1e-14."""


def checked_samples(samples: ArrayLike) -> Array:
    """(N, d) finite samples, copied.

    Raises:
        ValueError: complex numbers, another shape, none, or rows that are not finite; the message counts them.
    """
    if np.iscomplexobj(samples):
        raise ValueError("samples must be real numbers, but are complex")
    z = np.array(samples, dtype=np.float64)
    if z.ndim != 2 or 0 in z.shape:
        raise ValueError(f"samples must have shape (N, d) with N and d at least 1, but have {z.shape}")
    bad = np.flatnonzero(~np.isfinite(z).all(axis=1))
    if len(bad):
        raise ValueError(
            f"samples must be finite, but {len(bad)} of {len(z)} rows are not, the first is row {bad[0]}: "
            "drop the rows where a coordinate was not seen"
        )
    return z


def checked_weights(weights: ArrayLike | None, n: int) -> Array:
    """(N,) positive weights; None: all 1.

    Raises:
        ValueError: another number of them, or one that is not a finite number above 0.
    """
    w = np.ones(n) if weights is None else np.array(weights, dtype=np.float64)
    if w.shape != (n,) or not (np.isfinite(w).all() and (w > 0.0).all()):
        raise ValueError(f"weights must be {n} finite numbers above 0, one a sample, but have shape {w.shape}")
    return w


def checked_covariances(covariances: ArrayLike, shape: tuple[int, ...]) -> Array:
    """(N, d, d) covariances of N samples of d coordinates; one for all is repeated.

    Raises:
        ValueError: another shape, or one that is not finite, symmetric and at least 0.
    """
    n, d = shape
    given = np.asarray(covariances, dtype=np.float64)
    if given.shape not in ((d, d), (n, d, d)):
        raise ValueError(f"covariances must have shape ({d}, {d}) or ({n}, {d}, {d}), but have {given.shape}")
    if not np.isfinite(given).all() or not np.allclose(given, given.swapaxes(-1, -2)):
        raise ValueError("covariances must be finite and symmetric")
    if np.linalg.eigvalsh(given).min() < -1e-12 * np.abs(given).max():
        raise ValueError("covariances must have no eigenvalue below 0")
    return np.broadcast_to(given, (n, d, d))


def checked_labels(
    names: Sequence[str] | None, units: Sequence[str] | None, d: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """D names, q0, q1, ... where None, and d units, 1 where None.

    Raises:
        ValueError: another number of them.
    """
    labels = tuple(f"q{j}" for j in range(d)) if names is None else tuple(names)
    measures = ("1",) * d if units is None else tuple(units)
    if not len(labels) == len(measures) == d:
        raise ValueError(f"{d} coordinates need as many names and units, but have {len(labels)} and {len(measures)}")
    return labels, measures


def checked_lambda(lam: float, total: float, scaling: Scaling) -> float:
    """Lambda in units of sigma, above rounding.

    Raises:
        ValueError: not positive, or below rounding.
    """
    sigma_lambda = effective_lambda(positive("lam", lam), total, scaling)
    if sigma_lambda < MIN_LAMBDA:
        raise ValueError(
            f"lam must be at least {MIN_LAMBDA:g} in units of the eigenvalues of K / N, but is {sigma_lambda:g}: "
            "V would be rounding; take a larger lam"
        )
    return sigma_lambda
