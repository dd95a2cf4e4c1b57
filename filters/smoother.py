"""The Rauch-Tung-Striebel smoother in ensemble coordinates: what the prediction kept is all that it needs."""

import numpy as np
from mocap.filters.ensemble import Gaussian, Prediction, cholesky, gram, triangular
from scipy.linalg.blas import dsyrk, dtrmm, dtrsm, dtrsv  # type: ignore[attr-defined]  # made at run time


def smooth_step(filtered: Gaussian, prediction: Prediction, smoothed: Gaussian) -> Gaussian:
    """One Rauch-Tung-Striebel step backwards, in units of the filtered deviations.

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
