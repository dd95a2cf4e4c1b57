"""A Gaussian over poses with missing entries, by expectation maximisation, and what it says of those entries.

The standard imputation of missing markers by the covariance of all markers (for motion capture Liu & McMillan 2006 and
Tits, Tilmanne & Dutoit 2018; the algorithm is that of Little & Rubin 2002, section 11.2, with a ridge).
"""

from collections.abc import Iterator
from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class Moments:
    """Weighted sums over poses.

    Attributes:
        count: Total weight.
        first: (D,) sum.
        second: (D, D) sum of outer products.
    """

    count: float
    first: Array
    second: Array

    def __add__(self, other: "Moments") -> "Moments":
        """Moments of both sets."""
        return Moments(self.count + other.count, self.first + other.first, self.second + other.second)

    def part(self, columns: NDArray[np.int64]) -> "Moments":
        """Of some columns alone."""
        return Moments(self.count, self.first[columns], self.second[np.ix_(columns, columns)])

    def normal(self, ridge: Array) -> "Normal":
        """The Gaussian of these moments; (D,) ``ridge`` is added to the variances."""
        mean = self.first / self.count
        cov = self.second / self.count - np.outer(mean, mean)
        return Normal(mean, 0.5 * (cov + cov.T) + np.diag(ridge))


@dataclass(frozen=True, eq=False)
class Normal:
    """A Gaussian over poses: mean (D,), covariance (D, D)."""

    mean: Array
    cov: Array

    def part(self, columns: NDArray[np.int64]) -> "Normal":
        """Of some columns alone."""
        return Normal(self.mean[columns], self.cov[np.ix_(columns, columns)])

    def condition(self, poses: Array, columns: NDArray[np.int64]) -> tuple[Array, Array]:
        """Some columns of (N, D) poses completed, and the covariance of what was missing of each of their markers.

        Args:
            poses: (N, D) poses; NaN where not seen.
            columns: (3 M,) columns that are asked for, three a marker.

        Returns:
            (N, M, 3) positions and (N, M, 3, 3) covariances, zero where seen.
        """
        seen = np.isfinite(poses)
        out = np.where(seen, poses, self.mean)[:, columns].reshape(len(poses), -1, 3)
        spread = np.zeros((*out.shape, 3))
        for pattern, rows in patterns(seen):
            wanted = columns[~pattern[columns]]
            marker = np.flatnonzero(~pattern[columns[::3]])
            cross = self.cov[np.ix_(pattern, wanted)]
            weights = self.regression(pattern, cross)
            left = self.cov[np.ix_(wanted, wanted)] - cross.T @ weights
            values = poses[np.ix_(rows, np.flatnonzero(pattern))] - self.mean[pattern]
            out[np.ix_(rows, marker)] = (self.mean[wanted] + values @ weights).reshape(len(rows), -1, 3)
            spread[np.ix_(rows, marker)] = marker_blocks(0.5 * (left + left.T)[None])
        return out, spread

    def regression(self, seen: NDArray[np.bool_], cross: Array) -> Array:
        """Weights (seen, k) of the regression of k entries on what is seen, from their covariance with it."""
        if not seen.any():
            return cross
        _, weights, info = dposv(self.cov[np.ix_(seen, seen)], cross, lower=1, overwrite_a=1)
        if info != 0:
            raise np.linalg.LinAlgError(
                f"covariance of {int(seen.sum())} entries is not positive definite: raise the ridge"
            )
        return weights


def moments(poses: Array, weight: float, normal: Normal | None = None) -> Moments:
    """Expected moments of (N, D) poses under a Gaussian where they have NaN (the E step)."""
    extra = np.zeros((poses.shape[1],) * 2)
    if normal is not None and not np.isfinite(poses).all():
        filled = np.empty_like(poses)
        for seen, rows in patterns(np.isfinite(poses)):
            cross = normal.cov[np.ix_(seen, ~seen)]
            weights = normal.regression(seen, cross)
            left = normal.cov[np.ix_(~seen, ~seen)] - cross.T @ weights
            values = poses[np.ix_(rows, seen)]
            filled[np.ix_(rows, seen)] = values
            filled[np.ix_(rows, ~seen)] = normal.mean[~seen] + (values - normal.mean[seen]) @ weights
            extra[np.ix_(~seen, ~seen)] += len(rows) * left
        poses = filled
    return Moments(weight * len(poses), weight * poses.sum(axis=0), weight * (poses.T @ poses + extra))


def marker_blocks(cov: Array) -> Array:
    """(N, M, 3, 3) covariances of markers from those of poses (N, 3 M, 3 M)."""
    n, d, _ = cov.shape
    grid = cov.reshape(n, d // 3, 3, d // 3, 3)
    return np.moveaxis(np.diagonal(grid, axis1=1, axis2=3), -1, 1).copy()
