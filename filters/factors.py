"""Triangular factors of covariances, and their triangles, by LAPACK and in place."""

import numpy as np
from scipy.linalg.blas import dsyrk  # type: ignore[attr-defined]  # made at run time
from scipy.linalg.lapack import dpotrf, dtpttr, dtrttp  # type: ignore[attr-defined]

from eal.arrays import Array


def gram(a: Array, *, add: Array | None = None, lower: bool = True) -> Array:
    """One triangle of A A^T (+ ``add``, which is overwritten), zeros in the other: half the work of a product."""
    more = {} if add is None else {"beta": 1.0, "c": add, "overwrite_c": 1}
    if a.flags.f_contiguous:
        return dsyrk(1.0, a, lower=lower, **more)
    return dsyrk(1.0, a.T, trans=1, lower=lower, **more)


def cholesky(triangle: Array) -> Array:
    """Lower Cholesky factor of a symmetric matrix, given its lower triangle with zeros above, which is overwritten.

    Raises:
        np.linalg.LinAlgError: the matrix is not positive definite.
    """
    factor, info = dpotrf(triangle, lower=1, clean=0, overwrite_a=1)
    if info != 0:
        size = len(triangle)
        raise np.linalg.LinAlgError(f"covariance of size {size} is not positive definite (leading minor {info})")
    return factor


def triangular(rows: Array) -> Array:
    """Lower triangular L with L L^T = rows^T rows, also where that is singular (QR)."""
    r = np.asarray(np.linalg.qr(rows, mode="r"))
    factor = np.zeros((rows.shape[1],) * 2)
    factor[:, : len(r)] = (r * np.where(np.diag(r) < 0, -1.0, 1.0)[:, None]).T
    return factor


def triangle_of(matrix: Array) -> Array:
    """(n (n + 1) / 2,) one triangle of a symmetric matrix (n, n)."""
    return dtrttp(matrix.T, uplo="U")[0]


def symmetric(triangle: Array, n: int) -> Array:
    """(n, n) the symmetric matrix of a triangle by ``triangle_of``."""
    out = dtpttr(n, triangle, uplo="U")[0]  # zeros below
    for start in range(0, n, 64):  # by blocks that the cache holds
        stop = start + 64
        out[stop:, start:stop] = out[start:stop, stop:].T
        block = out[start:stop, start:stop]
        block += np.triu(block, 1).T
    return out.T
