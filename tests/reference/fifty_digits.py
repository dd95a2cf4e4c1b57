"""An unscented Kalman filter by the letter, in fifty decimal digits: sigma points, weights, P - K S K^T."""

from decimal import Decimal, localcontext

import numpy as np

DIGITS = 50


def exact(values):
    """An array of decimals with the very value of each float."""
    values = np.asarray(values)
    return np.array([Decimal(float(v)) for v in values.ravel()], dtype=object).reshape(values.shape)


def cholesky(matrix):
    """Lower factor by the definition."""
    n = len(matrix)
    lower = np.full((n, n), Decimal(0), dtype=object)
    for j in range(n):
        lower[j, j] = (matrix[j, j] - lower[j, :j] @ lower[j, :j] if j else matrix[j, j]).sqrt()
        for i in range(j + 1, n):
            lower[i, j] = (matrix[i, j] - (lower[i, :j] @ lower[j, :j] if j else 0)) / lower[j, j]
    return lower


def solve(matrix, right):
    """Symmetric positive definite solve."""
    lower = cholesky(matrix)
    n = len(matrix)
    y = right.copy()
    for i in range(n):
        y[i] = (y[i] - (lower[i, :i] @ y[:i] if i else 0)) / lower[i, i]
    for i in range(n - 1, -1, -1):
        y[i] = (y[i] - (lower[i + 1 :, i] @ y[i + 1 :] if i < n - 1 else 0)) / lower[i, i]
    return y


def transform(mean, cov, function, alpha, beta, kappa):
    """Mean, covariance and cross-covariance of function(x) by van der Merwe's scaled sigma points and weights."""
    n = len(mean)
    c = alpha**2 * (n + kappa)
    steps = (c.sqrt() * cholesky(cov)).T
    points = np.concatenate([mean[None], mean + steps, mean - steps])
    w_mean = np.full(2 * n + 1, 1 / (2 * c), dtype=object)
    w_cov = w_mean.copy()
    w_mean[0] = (c - n) / c
    w_cov[0] = w_mean[0] + 1 - alpha**2 + beta
    values = np.stack([function(point) for point in points])
    out = w_mean @ values
    off = values - out
    return out, (off.T * w_cov) @ off, ((points - mean).T * w_cov) @ off


def filtered(mean, cov, frames, *, alpha, beta, kappa):
    """Filter frames.

    Args:
        mean: (n,) floats.
        cov: (n, n) floats.
        frames: Entries (step, noise_cov, h, y, sd); step and h take and return arrays of decimals.
        alpha: Sigma-point parameter, as are beta and kappa.
        beta: Another.
        kappa: A third.

    Returns:
        Means and covariances after each frame, as floats of numbers that were right to many more digits.
    """
    with localcontext() as context:
        context.prec = DIGITS
        mean, cov = exact(mean), exact(cov)
        alpha, beta, kappa = (Decimal(float(v)) for v in (alpha, beta, kappa))
        out = []
        for step, noise_cov, h, y, sd in frames:
            mean, cov, _ = transform(mean, cov, step, alpha, beta, kappa)
            cov = cov + exact(noise_cov)
            if len(y):
                predicted, inside, cross = transform(mean, cov, h, alpha, beta, kappa)
                inside = inside + np.diag(exact(sd) ** 2)
                gain = solve(inside, cross.T).T
                mean = mean + gain @ (exact(y) - predicted)
                cov = cov - gain @ inside @ gain.T
            out.append((mean.astype(float), cov.astype(float)))
        return out
