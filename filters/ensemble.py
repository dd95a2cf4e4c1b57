"""The unscented Kalman filter in centred ensemble coordinates.

The state's covariance is P = L L^T with L lower triangular. The scaled unscented transform (Julier 2002; van der Merwe
2004) with c = alpha^2 (n + kappa) takes x and x +- sqrt(c) L_j; with d = h(point) - h(x) its covariance is

    G^T G + E^T E + gamma b b^T,   G_j = (h_j+ - h_j-) / (2 sqrt c),   E_j = (h_j+ + h_j- - 2 h_0) / (2 sqrt c),
    b = sum d / (2 c),   gamma = beta - alpha^2,

a sum of squares for beta >= alpha^2, where the weights themselves have huge cancelling signs. The filter never
subtracts from a covariance, so none turns indefinite.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk, dtrsm, dtrsv  # type: ignore[attr-defined]  # made at run time
from scipy.linalg.lapack import dpotrf  # type: ignore[attr-defined]

from eal.arrays import Array

if TYPE_CHECKING:
    from filterpy.kalman import MerweScaledSigmaPoints


class SigmaPoints(Protocol):
    """The parameters of a scaled unscented transform; filterpy's ``MerweScaledSigmaPoints`` has them."""

    @property
    def n(self) -> int:
        """Size of the state."""
        ...

    @property
    def alpha(self) -> float:
        """Spread of the points."""
        ...

    @property
    def beta(self) -> float:
        """Weight of the fourth moment."""
        ...

    @property
    def kappa(self) -> float:
        """Secondary spread."""
        ...


def default_points(n: int) -> "MerweScaledSigmaPoints":
    """Spread sqrt(3) standard deviations and gamma = 0: the best against Monte Carlo at n = 204 (kappa = 0)."""
    from filterpy.kalman import MerweScaledSigmaPoints  # half a second, for those who need it: it loads scipy.stats

    alpha2 = min(3.0 / n, 1.0)
    return MerweScaledSigmaPoints(n, alpha=np.sqrt(alpha2), beta=alpha2, kappa=0.0)


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Mean (n,) and lower triangular factor (n, n) of the covariance. Arrays are never written to."""

    mean: Array
    factor: Array

    @property
    def cov(self) -> Array:
        """(n, n) covariance."""
        return self.factor @ self.factor.T


def scale(points: SigmaPoints) -> tuple[float, float]:
    """The spread c = alpha^2 (n + kappa) and gamma = beta - alpha^2.

    Raises:
        ValueError: beta < alpha^2 or c <= 0, where the transform is not positive.
    """
    c = points.alpha**2 * (points.n + points.kappa)
    gamma = points.beta - points.alpha**2
    if gamma < -1e-12 or c <= 0:
        raise ValueError(
            f"sigma points need alpha^2 (n + kappa) > 0 and beta >= alpha^2, but alpha = {points.alpha:g}, "
            f"beta = {points.beta:g}, kappa = {points.kappa:g}: take default_points({points.n})"
        )
    return c, max(gamma, 0.0)


def spread(state: Gaussian, c: float, *, columns: int | None = None, rows: int | None = None) -> Array:
    """Sigma points x, x + sqrt(c) L_j, x - sqrt(c) L_j.

    Args:
        state: Mean and factor.
        c: Spread.
        columns: Only the first so many columns of L (those that move what is looked at); None: all.
        rows: Only the first so many components; None: all.

    Returns:
        (2 columns + 1, rows) points.
    """
    mean = state.mean[:rows]
    steps = np.sqrt(c) * state.factor[:rows, :columns].T
    return np.concatenate([mean[None], mean + steps, mean - steps])


def ensemble(values: Array, c: float, gamma: float, *, linear: bool = False) -> tuple[Array, Array]:
    """Mean (m,) and ensemble rows [G; E; sqrt(gamma) b] of transformed sigma points (2k + 1, m).

    With ``linear`` the rows E and b, zero but for rounding, are left out.
    """
    k = len(values) // 2
    centre, plus, minus = values[0], values[1 : k + 1], values[k + 1 :]
    half = 0.5 / np.sqrt(c)
    if linear:
        return centre, (plus - minus) * half
    rows = np.empty_like(values[1:], dtype=float)  # in the memory order of the values
    np.subtract(plus, minus, out=rows[:k])
    np.add(plus, minus, out=rows[k:])
    rows[k:] -= 2 * centre
    shift = rows[k:].sum(axis=0) / (2 * c)
    rows *= half
    if gamma > 0:
        rows = np.concatenate([rows, np.sqrt(gamma) * shift[None]])
    return centre + shift, rows


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


@dataclass(frozen=True, eq=False)
class Prediction:
    """A predicted state, and what the smoother needs of it.

    Attributes:
        state: Predicted mean and factor.
        rows: (k, n) ensemble rows of the transformed points.
        noise: (n, n) lower factor of the process noise.
    """

    state: Gaussian
    rows: Array
    noise: Array


def predict(
    state: Gaussian,
    step: Callable[[Array], Array],
    noise: Array,
    points: SigmaPoints,
    *,
    linear: bool = False,
    noise_cov: Array | None = None,
) -> Prediction:
    """Propagate a state.

    Args:
        state: Filtered state.
        step: (S, n) points to (S, n) points one frame later, all at once.
        noise: (n, n) lower factor of the process noise covariance.
        points: Sigma-point parameters.
        linear: Whether ``step`` is affine (the second-order rows vanish).
        noise_cov: (n, n) lower triangle of the process noise covariance, where it is at hand.
    """
    if linear:
        moved = step(np.concatenate([state.mean[None], state.mean + state.factor.T]))
        return predicted(moved[0], moved[1:] - moved[0], noise, noise_cov)
    c, gamma = scale(points)
    return predicted(*ensemble(step(spread(state, c)), c, gamma), noise, noise_cov)


def predicted(mean: Array, rows: Array, noise: Array, noise_cov: Array | None = None) -> Prediction:
    """The prediction of mean (n,), ensemble rows (k, n) and noise of lower factor (n, n)."""
    try:
        added = gram(noise) if noise_cov is None else noise_cov.copy(order="F")
        factor = cholesky(gram(rows.T, add=added))
    except np.linalg.LinAlgError:
        factor = triangular(np.concatenate([rows, noise.T]))
    return Prediction(Gaussian(mean, factor), rows, noise)


@dataclass(frozen=True, eq=False)
class Update:
    """A state after an observation.

    Attributes:
        state: Posterior.
        innovation: (m,) observed minus predicted, all rows.
        used: (m,) False for the rows that were gated.
        nis: Normalised innovation squared y^T S^-1 y of the used rows.
        log_likelihood: Log density of the used rows.
    """

    state: Gaussian
    innovation: Array
    used: NDArray[np.bool_]
    nis: float
    log_likelihood: float


def update(
    state: Gaussian,
    h: Callable[[Array], Array],
    y: Array,
    sd: Array,
    points: SigmaPoints,
    *,
    reads: int | None = None,
    gate: Callable[[Array], NDArray[np.bool_]] | None = None,
    linear: bool = False,
) -> Update:
    """Condition a state on observations with independent noise.

    No m x m matrix is formed: with whitened ensemble rows A, C = I + A A^T = U U^T (U upper), the posterior factor is
    L U11^-T, again lower triangular, and the posterior mean x + L+ (U^-1 A y).

    Args:
        state: Predicted state.
        h: (S, reads) points to (S, m) predicted observations, all at once.
        y: (m,) observations.
        sd: (m,) their standard deviations.
        points: Sigma-point parameters.
        reads: ``h`` reads only the first so many components of the state; None: all.
        gate: (m,) normalised innovations y / sqrt(S_ii) to a mask of rows to believe; None believes all.
        linear: Whether ``h`` is affine.

    Returns:
        The posterior; with no believed rows the state itself.
    """
    c, gamma = scale(points)
    reads = len(state.mean) if reads is None else reads
    predicted, rows = ensemble(h(spread(state, c, columns=reads, rows=reads)), c, gamma, linear=linear)
    innovation = y - predicted
    rows /= sd
    white, a = innovation / sd, rows
    used = np.ones(len(y), dtype=bool)
    if gate is not None and len(y):
        used = gate(white / np.sqrt(1 + np.einsum("ij,ij->j", a, a)))
        if not used.all():
            white, a = white[used], a[:, used]
    if not used.any():
        return Update(state, innovation, used, np.nan, 0.0)
    posterior, w, log_det = condition(state, a, white, reads)
    nis = float(white @ white - w @ w)
    log_likelihood = -0.5 * (len(white) * np.log(2 * np.pi) + 2 * np.log(sd[used]).sum() + log_det + nis)
    return Update(posterior, innovation, used, nis, float(log_likelihood))


def condition(state: Gaussian, a: Array, y: Array, k: int) -> tuple[Gaussian, Array, float]:
    """Condition on whitened rows: the step that every update shares.

    Args:
        state: Prior.
        a: (rows, m) whitened ensemble rows whose first k belong to the first k columns of the factor.
        y: (m,) whitened innovations.
        k: Number of columns of the factor that the observation sees.

    Returns:
        The posterior, w = U^-1 A y, and log det (I + A A^T).
    """
    c = gram(a, lower=False)
    c[np.diag_indices(len(a))] += 1
    reverse = cholesky(np.asfortranarray(c[::-1, ::-1]))  # U backwards
    w = dtrsv(reverse, (a @ y)[::-1], lower=1)[::-1]
    u11 = np.asfortranarray(reverse[::-1, ::-1][:k, :k])
    columns = dtrsm(1.0, u11, state.factor[:, :k], side=1, lower=0, trans_a=1)
    factor = state.factor.copy(order="F")
    factor[:, :k] = columns
    return Gaussian(state.mean + columns @ w[:k], factor), w, 2 * float(np.log(np.diag(reverse)).sum())
