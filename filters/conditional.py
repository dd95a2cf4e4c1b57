"""A Gaussian over poses with missing entries, by expectation maximisation, and what it says of those entries.

The standard imputation of missing markers by the covariance of all markers (for motion capture Liu & McMillan 2006 and
Tits, Tilmanne & Dutoit 2018; the algorithm is that of Little & Rubin 2002, section 11.2, with a ridge).
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv  # type: ignore[attr-defined]  # made at run time

from eal.arrays import Array


def patterns(seen: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.int64]]]:
    """Every way of seeing that occurs among (N, K) rows, with the rows where it does."""
    unique, inverse = np.unique(seen, axis=0, return_inverse=True)
    order = np.argsort(inverse.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(inverse.ravel(), minlength=len(unique)))
    yield from zip(unique, np.split(order, ends[:-1]), strict=True)


def expected(poses: Array, mean: Array, cov: Array) -> tuple[Array, Array]:
    """The E step: poses with what is missing of them as a Gaussian has it, given what each shows.

    Args:
        poses: (N, D) poses; NaN where not seen.
        mean: (D,) of the Gaussian.
        cov: (D, D) its covariance.

    Returns:
        (N, D) poses, and (D, D) sum of the covariances of what was missing.

    Raises:
        numpy.linalg.LinAlgError: the covariance is not positive definite.
    """
    filled, extra = poses.copy(), np.zeros_like(cov)
    for seen, rows in patterns(np.isfinite(poses)):
        cross = cov[np.ix_(seen, ~seen)]
        weights = regression(cov, seen, cross)
        filled[np.ix_(rows, ~seen)] = mean[~seen] + (poses[np.ix_(rows, seen)] - mean[seen]) @ weights
        extra[np.ix_(~seen, ~seen)] += len(rows) * (cov[np.ix_(~seen, ~seen)] - cross.T @ weights)
    return filled, extra


def regression(cov: Array, seen: NDArray[np.bool_], cross: Array) -> Array:
    """Weights (seen, k) of the regression of k entries on what is seen, from their covariance with it."""
    if not seen.any() or not cross.size:
        return cross
    _, weights, info = dposv(cov[np.ix_(seen, seen)], cross, lower=1, overwrite_a=1)
    if info != 0:
        raise np.linalg.LinAlgError(
            f"covariance of {int(seen.sum())} entries is not positive definite: raise the ridge"
        )
    return weights
