"""Low-rank factors of the Gram matrix that never form it: pivoted Cholesky."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from eal.arrays import Array
from eal.kernels import Kernel

ROUNDING = 32.0 * np.finfo(np.float64).eps
"""Residuals of K(x, x) = 1 below this are rounding: no pivot is taken there."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CholeskyFactor:
    """K ~ F F^T with F = K[:, p] C^-T, C the Cholesky factor of K[p, p].

    Attributes:
        pivots: (m,) indices of the pivots among the samples.
        corner: (m, m) lower factor C.
        rows: (N, m) F: the samples in an orthonormal basis of the span of the pivots' kernels.
        residual: (N,) diagonal of K - F F^T, the squared distance of each K_z from that span.
    """

    pivots: np.ndarray
    corner: Array
    rows: Array
    residual: Array


def pivoted_cholesky(kernel: Kernel, z: Array, *, tolerance: float, max_rank: int, block: int = 32) -> CholeskyFactor:
    """Greedy partial Cholesky of the Gram matrix, several pivots a pass.

    A pass takes the ``block`` samples farthest from the span so far, keeps those that stay farther than half of the
    farthest once the others are in (Harbrecht, Peters and Schneider 2012, blocked), and updates with matrix products:
    O(N m) kernels and O(N m^2) operations.

    Args:
        kernel: Kernel with K(x, x) = 1.
        z: (N, d) samples.
        tolerance: Stop when every residual is below this, not under rounding.
        max_rank: Stop at this many pivots.
        block: Candidates a pass.

    Returns:
        The factor; its residual says how good it is.
    """
    n = len(z)
    tolerance = max(tolerance, ROUNDING)
    rows = np.empty((min(n, max_rank, 2 * block), n))
    residual, pivots, m = np.ones(n), np.empty(0, dtype=np.intp), 0
    while m < min(n, max_rank):
        size = min(block, n, max_rank - m)
        candidates = np.argpartition(-residual, size - 1)[:size]
        candidates = candidates[np.argsort(-residual[candidates], kind="stable")]
        if residual[candidates[0]] < tolerance:
            break
        corner = kernel.gram(z[candidates], z[candidates]) - rows[:m, candidates].T @ rows[:m, candidates]
        residual[candidates] = np.maximum(np.diag(corner), 0.0)  # afresh: the running sum has gathered rounding
        top = float(residual[candidates].max())
        if top < tolerance:
            continue
        chosen = _accepted(corner, floor=max(tolerance, 0.5 * top))
        new = candidates[chosen]
        lower = np.linalg.cholesky(corner[np.ix_(chosen, chosen)])
        part = kernel.gram(z[new], z) - rows[:m, new].T @ rows[:m]
        if m + len(new) > len(rows):
            rows = np.concatenate([rows[:m], np.empty((min(n, max_rank, 2 * len(rows)) - m, n))])
        rows[m : m + len(new)] = solve_triangular(lower, part, lower=True, overwrite_b=True, check_finite=False)
        residual -= np.einsum("mn,mn->n", rows[m : m + len(new)], rows[m : m + len(new)])
        residual[new] = 0.0
        np.maximum(residual, 0.0, out=residual)
        pivots, m = np.concatenate([pivots, new]), m + len(new)
    corner = np.tril(rows[:m, pivots].T)
    return CholeskyFactor(pivots=pivots, corner=corner, rows=rows[:m].T, residual=residual)


def _accepted(corner: Array, *, floor: float) -> list[int]:
    """Pivots of a small residual matrix, greedy, until its diagonal is below ``floor``; at least one."""
    rest = corner.copy()
    diagonal = np.diag(rest).copy()
    chosen: list[int] = []
    while len(chosen) < len(diagonal):
        best = int(np.argmax(diagonal))
        if chosen and diagonal[best] < floor:
            break
        chosen.append(best)
        column = rest[:, best] / np.sqrt(diagonal[best])
        rest -= np.outer(column, column)
        diagonal = np.diag(rest).copy()
        diagonal[chosen] = -np.inf
    return chosen
