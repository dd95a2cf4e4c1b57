"""From samples to the root B of an empirical potential: exact or by pivoted Cholesky."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.linalg import solve_triangular

from eal.arrays import Array
from eal.kernels import GaussianKernel, Kernel
from eal.spectral import Projection, SpectralFilter

ROUNDING = 32.0 * np.finfo(np.float64).eps
"""Residuals of K(x, x) = 1 below this are rounding: no pivot is taken there."""
RANK_ROUNDING = 1e-11
"""Far above the rounding of residuals and of sums of eigenvalues, 1e-13 for hundreds of samples."""


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
        # pivots of a small residual matrix, greedy, until its diagonal is below ``floor``; at least one
        floor = max(tolerance, 0.5 * top)
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


Method = Literal["auto", "exact", "cholesky"]


FEW = 500
"""Samples up to which eigenvalues are taken first: 35 ms, of which pivots that are in vain take half."""
WIDE = 500
"""Pivots above which the eigenvalues come from the product of the factor with itself. Chosen; not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Root:
    """V = 1 - |B^T k(q)|^2 on the centres.

    Attributes:
        centres: (m, d) samples whose kernels are evaluated.
        root: (m, r) B.
        eigenvalues: (r,) eigenvalues sigma of T_z, decreasing.
        missing: Trace of T_z that the factor leaves out, see ``truncation_bound``.
        method: How it was found.
    """

    centres: Array
    root: Array
    eigenvalues: Array
    missing: float
    method: str


def solve(
    kernel: Kernel,
    z: Array,
    weights: Array,
    lam: float,
    spectral_filter: SpectralFilter,
    *,
    method: Method,
    accuracy: float,
    max_rank: int,
) -> Root:
    """The root of V_z, equation 14 with T_z = (1/W) sum_i w_i K_zi (x) K_zi, W the sum of the weights.

    ``auto`` takes the pivoted Cholesky factor, which costs O(N m^2); where it needs more than half of the samples
    as pivots (noise in many dimensions) and the Gram matrix fits, the exact eigendecomposition is as cheap to
    evaluate and has no error.

    Raises:
        ValueError: unknown method.
    """
    if method not in get_args(Method):
        raise ValueError(f"method must be one of {', '.join(get_args(Method))}, but is {method!r}")
    if method == "exact":
        return _exact(kernel, z, weights, lam, spectral_filter)
    limited = method == "auto" and len(z) <= 4000  # 0.1 GiB, some 10 s
    cap = min(max_rank, len(z) // 2) if limited else max_rank
    tolerance = lam * (0.5 * accuracy) ** 2
    found = _exact(kernel, z, weights, lam, spectral_filter) if limited and cap > 0 and len(z) <= FEW else None
    # the trace off m pivots is at least that off the first m eigenvectors: cap - 1 of them cannot be enough
    if found is not None and found.eigenvalues[cap - 1 :].sum() > 2.0 * tolerance + RANK_ROUNDING:
        return found
    factor = pivoted_cholesky(kernel, z, tolerance=tolerance, max_rank=max(cap, 1))
    if limited and len(factor.pivots) == cap:
        return _exact(kernel, z, weights, lam, spectral_filter) if found is None else found
    # B = C^-T R diag(r)^1/2 with R, sigma from the SVD of the samples in the basis of the pivots
    total = weights.sum()
    sigma, vectors = _principal_axes(factor.rows, weights / total)
    columns = vectors * np.sqrt(spectral_filter.response(sigma, lam))
    root = solve_triangular(factor.corner, columns, lower=True, trans=1, check_finite=False)
    missing = max(float(weights @ factor.residual / total), float(np.finfo(np.float64).eps))
    return Root(centres=z[factor.pivots], root=root, eigenvalues=sigma, missing=missing, method="cholesky")


def _exact(kernel: Kernel, z: Array, weights: Array, lam: float, spectral_filter: SpectralFilter) -> Root:
    """B = D U diag(g / W)^1/2 with D K D = U diag(s) U^T, D = diag(w)^1/2: every sample is a centre."""
    total = weights.sum()
    scale = np.sqrt(weights)
    s, vectors = np.linalg.eigh(scale[:, None] * kernel.gram(z, z) * scale)
    sigma, vectors = s[::-1] / total, vectors[:, ::-1]
    root = scale[:, None] * vectors * np.sqrt(spectral_filter.gain(sigma, lam) / total)
    return Root(centres=z, root=root, eigenvalues=sigma, missing=0.0, method="exact")


def deconvolved(
    kernel: GaussianKernel,
    z: Array,
    covariances: Array,
    weights: Array,
    lam: float,
    spectral_filter: SpectralFilter,
    *,
    accuracy: float,
    max_rank: int,
) -> Root:
    """The root of V_z of what the samples would be without their noise: T_z is replaced by an unbiased estimate.

    (T K_p, K_q) is the mean of K(x, p) K(x, q) = exp(-beta |p - q|^2 / 2) exp(-2 beta |x - m|^2), m between p and q.
    Noise of covariance S makes a Gaussian about m wider, and the mean over noise of

        |I - 4 beta S|^(-1/2) exp(-2 beta (z - m)^T (I - 4 beta S)^(-1) (z - m))

    is that of x. An estimate need not be positive: what comes out below 0 counts as 0.

    Args:
        kernel: The Gaussian kernel.
        z: (N, d) samples.
        covariances: (N, d, d) of their noise; each that differs costs a product of matrices.
        weights: (N,).
        lam: As in ``solve``.
        spectral_filter: See there.
        accuracy: See there.
        max_rank: See there.

    Raises:
        ValueError: noise as wide as the kernel itself, 1 / sqrt(4 beta), in some direction.
    """
    kinds, member = np.unique(covariances, axis=0, return_inverse=True)
    left, vectors = np.linalg.eigh(np.eye(z.shape[1]) - 4.0 * kernel.beta * kinds)
    member = member.reshape(-1)  # NumPy 2.0 alone gave it further axes
    if left.min() <= 0.0:
        worst = np.sqrt((1.0 - left.min()) / (4.0 * kernel.beta))
        raise ValueError(
            f"noise must be below 1 / sqrt(4 beta) = {0.5 / np.sqrt(kernel.beta):.3g}, but is up to {worst:.3g}: take "
            "a wider kernel (a smaller beta)"
        )
    tolerance = max(lam * (0.5 * accuracy) ** 2, 1e-9)  # rounding of products is divided by it
    factor = pivoted_cholesky(kernel, z, tolerance=tolerance, max_rank=max_rank)
    p, m = z[factor.pivots], len(factor.pivots)
    products = np.zeros((m, m))
    for level in range(len(kinds)):  # exp(-2 beta |z - m|_C^2) = K_C(z, p) K_C(z, q) exp(beta |p - q|_C^2 / 2)
        sharp, own = vectors[level] / np.sqrt(left[level]), member == level
        near = kernel.gram(z[own] @ sharp, p @ sharp) * np.sqrt(weights[own] / np.sqrt(left[level].prod()))[:, None]
        apart = kernel.log_gram(p @ sharp, p @ sharp) - kernel.log_gram(p, p)
        products += near.T @ near * np.exp(np.minimum(-0.5 * apart, 300.0))  # beyond it the product is 0
    products /= weights.sum()
    half = solve_triangular(factor.corner, products, lower=True)
    sigma, axes = np.linalg.eigh(solve_triangular(factor.corner, half.T, lower=True))
    sigma, axes = np.maximum(sigma[::-1], 0.0), axes[:, ::-1]
    columns = axes * np.sqrt(spectral_filter.response(sigma, lam))
    root = solve_triangular(factor.corner, columns, lower=True, trans=1)
    return Root(centres=p, root=root, eigenvalues=sigma, missing=float(factor.residual.mean()), method="cholesky")


def _principal_axes(rows: Array, shares: Array) -> tuple[Array, Array]:
    """Eigenvalues, decreasing, and eigenvectors of rows^T diag(shares) rows.

    By QR and SVD, which keep small eigenvalues; for many columns from the product itself, a third of the work, whose
    rounding of 1e-16 is small beside the lambda that noisy samples are given.
    """
    if rows.shape[1] > WIDE:
        sigma, vectors = np.linalg.eigh((rows * shares[:, None]).T @ rows)
        return np.maximum(sigma[::-1], 0.0), vectors[:, ::-1]
    triangle = np.linalg.qr(rows * np.sqrt(shares)[:, None], mode="r")
    _, singular, right = np.linalg.svd(triangle)
    sigma = np.zeros(rows.shape[1])
    sigma[: len(singular)] = singular**2
    return sigma, right.T


def truncation_bound(spectral_filter: SpectralFilter, sigma: Array, lam: float, missing: float) -> float:
    """Bound on sup |V_z - V| when T_z is replaced by P T_z P and the trace lost is ``missing``.

    With A^* K_q = v + w, v in the span, |w|^2 <= missing, and the divided differences of g = 1/max(s, lambda) (or
    1/(s + lambda)) bounded by g(s) g(t): |v'g v - u'g' u| <= 2e + 2e^2 + e^3, e = sqrt(missing / lambda).
    For the projection, |P - P'| <= |dT| / (gap - |dT|) with |dT| <= 2 sqrt(missing) (Davis and Kahan), where no
    eigenvalue can cross lambda; else 1.

    Args:
        spectral_filter: The filter.
        sigma: (r,) eigenvalues kept, decreasing.
        lam: lambda in units of sigma.
        missing: Trace of T_z minus that of what is kept, at least 0.

    Returns:
        The bound, at most 1.
    """
    if isinstance(spectral_filter, Projection):
        moved = 2.0 * np.sqrt(missing)
        above, below = sigma[sigma > lam], np.append(sigma[sigma <= lam], 0.0)
        if len(above) == 0 or min(above[-1] - lam, lam - below[0]) <= moved:
            return 1.0
        return min(float(moved / (above[-1] - below[0] - moved)), 1.0)
    e = float(np.sqrt(missing / lam))
    return min(2.0 * e + 2.0 * e**2 + e**3, 1.0)
