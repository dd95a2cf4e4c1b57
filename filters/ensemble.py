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
from typing import TYPE_CHECKING

import numpy as np
from mocap.filters.factors import cholesky, gram, triangular
from scipy.linalg.blas import dsyrk, dtrmm, dtrsm, dtrsv  # type: ignore[attr-defined]  # made at run time

from eal.arrays import Array

if TYPE_CHECKING:
    from filterpy.kalman import MerweScaledSigmaPoints


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


def scale(points: "MerweScaledSigmaPoints") -> tuple[float, float]:
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


def spread(state: Gaussian, c: float) -> Array:
    """(2n + 1, n) sigma points x, x + sqrt(c) L_j, x - sqrt(c) L_j."""
    steps = np.sqrt(c) * state.factor.T
    return np.concatenate([state.mean[None], state.mean + steps, state.mean - steps])


def ensemble(values: Array, c: float, gamma: float) -> tuple[Array, Array]:
    """Mean (m,) and ensemble rows [G; E; sqrt(gamma) b] of transformed sigma points (2n + 1, m)."""
    k = len(values) // 2
    centre, plus, minus = values[0], values[1 : k + 1], values[k + 1 :]
    rows = np.empty_like(values[1:], dtype=float)  # in the memory order of the values
    np.subtract(plus, minus, out=rows[:k])
    np.add(plus, minus, out=rows[k:])
    rows[k:] -= 2 * centre
    shift = rows[k:].sum(axis=0) / (2 * c)
    rows *= 0.5 / np.sqrt(c)
    if gamma > 0:
        rows = np.concatenate([rows, np.sqrt(gamma) * shift[None]])
    return centre + shift, rows


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
    state: Gaussian, step: Callable[[Array], Array], noise: Array, points: "MerweScaledSigmaPoints"
) -> Prediction:
    """Propagate a state.

    Args:
        state: Filtered state.
        step: (S, n) points to (S, n) points one frame later, all at once.
        noise: (n, n) lower factor of the process noise covariance.
        points: Sigma-point parameters.
    """
    c, gamma = scale(points)
    mean, rows = ensemble(step(spread(state, c)), c, gamma)
    try:
        factor = cholesky(gram(rows.T, add=gram(noise)))
    except np.linalg.LinAlgError:
        factor = triangular(np.concatenate([rows, noise.T]))
    return Prediction(Gaussian(mean, factor), rows, noise)


@dataclass(frozen=True, eq=False)
class EnsembleUpdate:
    """A state after an observation.

    Attributes:
        state: Posterior.
        innovation: (m,) observed minus predicted.
        nis: Normalised innovation squared y^T S^-1 y.
        log_likelihood: Log density of the rows.
    """

    state: Gaussian
    innovation: Array
    nis: float
    log_likelihood: float


def update(
    state: Gaussian, h: Callable[[Array], Array], y: Array, sd: Array, points: "MerweScaledSigmaPoints"
) -> EnsembleUpdate:
    """Condition a state on observations with independent noise.

    No m x m matrix is formed: with whitened ensemble rows A, C = 1 + A A^T = U U^T (U upper), the posterior factor is
    L U11^-T, again lower triangular, and the posterior mean x + L+ (U^-1 A y).

    Args:
        state: Predicted state.
        h: (S, n) points to (S, m) predicted observations, all at once.
        y: (m,) observations.
        sd: (m,) their standard deviations.
        points: Sigma-point parameters.

    Returns:
        The posterior; without rows the state itself.
    """
    c, gamma = scale(points)
    predicted, a = ensemble(h(spread(state, c)), c, gamma)
    innovation = y - predicted
    if not len(y):
        return EnsembleUpdate(state, innovation, np.nan, 0.0)
    a, white, n = a / sd, innovation / sd, len(state.mean)
    inside = gram(a, lower=False)
    inside[np.diag_indices(len(a))] += 1
    reverse = cholesky(np.asfortranarray(inside[::-1, ::-1]))  # U backwards
    w = dtrsv(reverse, (a @ white)[::-1], lower=1)[::-1]
    factor = dtrsm(1.0, np.asfortranarray(reverse[::-1, ::-1][:n, :n]), state.factor, side=1, lower=0, trans_a=1)
    log_det = 2 * float(np.log(np.diag(reverse)).sum())
    nis = float(white @ white - w @ w)
    log_likelihood = -0.5 * (len(y) * np.log(2 * np.pi) + 2 * np.log(sd).sum() + log_det + nis)
    return EnsembleUpdate(Gaussian(state.mean + factor @ w[:n], factor), innovation, nis, float(log_likelihood))


def smooth_step(filtered: Gaussian, prediction: Prediction, smoothed: Gaussian) -> Gaussian:
    """One Rauch-Tung-Striebel step backwards, in units of the filtered deviations, from what the prediction kept.

    With W = (L-)^-1 G^T, L- the factor of the prediction, the gain is K = L W^T (L-)^-1 and the smoothed covariance

        P + K (Ps - P-) K^T = L (I - W^T W + B^T B) L^T,   B = Ls^T (L-)^-T W,

    and L times the factor of the bracket is its factor. The bracket is 1 where nothing is learned; where it falls below
    1e-4 the subtraction has cost too many digits, and the same covariance is factored as the sum of squares
    D D^T + K Q K^T + K Ps K^T, D the part of the filtered deviations that the prediction does not explain.

    Args:
        filtered: State of this frame.
        prediction: Prediction from this frame to the next.
        smoothed: Smoothed state of the next frame.

    Raises:
        np.linalg.LinAlgError: the predicted covariance is singular.
    """
    rows, ahead, n = prediction.rows, prediction.state, len(filtered.mean)
    if not np.diag(ahead.factor).all():
        raise np.linalg.LinAlgError(f"predicted covariance of size {n} is singular: give every component process noise")
    w = dtrsm(1.0, ahead.factor, rows[:n].T, lower=1)
    b = dtrmm(1.0, dtrsm(1.0, ahead.factor, smoothed.factor, lower=1), w, lower=1, trans_a=1)
    change = dtrsv(ahead.factor, smoothed.mean - ahead.mean, lower=1)
    mean = filtered.mean + filtered.factor @ (change @ w)
    bracket = dsyrk(-1.0, w, trans=1, lower=1, beta=1.0, c=np.eye(n, order="F"), overwrite_c=1)
    try:
        shrink = cholesky(gram(b.T, add=bracket))
        if np.diag(shrink).min() < 1e-2:
            raise np.linalg.LinAlgError
        factor = dtrmm(1.0, filtered.factor, shrink, lower=1)
    except np.linalg.LinAlgError:
        gain = filtered.factor @ dtrsm(1.0, ahead.factor, w, lower=1, trans_a=1).T
        unexplained = -gain @ rows.T
        unexplained[:, :n] += filtered.factor
        factor = triangular(np.concatenate([unexplained, gain @ prediction.noise, gain @ smoothed.factor], axis=1).T)
    return Gaussian(mean, factor)
