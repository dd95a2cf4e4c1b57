"""Gaussian filtering by the letter: covariances written out, in extended precision, and whole trajectories at once."""

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter


def filterpy_filter(points, state, *, step, noise_cov, frames, dt_s=1.0):
    """Run filterpy's unscented Kalman filter and smoother, one frame after the other.

    Args:
        points: A MerweScaledSigmaPoints.
        state: Mean and covariance before the first prediction.
        step: (n,) to (n,).
        noise_cov: (n, n).
        frames: A list of (h, y, sd), h from (n,) to (m,).
        dt_s: Passed through; ``step`` does not read it.

    Returns:
        Filtered means and covariances, log-likelihoods, smoothed means and covariances.
    """
    n = len(state[0])
    fresh = MerweScaledSigmaPoints(n, alpha=points.alpha, beta=points.beta, kappa=points.kappa)
    ukf = UnscentedKalmanFilter(n, 1, dt_s, hx=None, fx=lambda x, _dt: step(x), points=fresh)
    ukf.x, ukf.P, ukf.Q = state[0].copy(), state[1].copy(), noise_cov
    means, covs, log_likelihoods = [], [], []
    for h, y, sd in frames:
        ukf.predict()
        ukf.sigmas_f = fresh.sigma_points(ukf.x, ukf.P)  # as filterpy 2; 1.4.5 leaves out the process noise
        ukf.update(y, R=np.diag(sd**2), hx=h)
        means.append(ukf.x.copy())
        covs.append(ukf.P.copy())
        log_likelihoods.append(ukf.log_likelihood)
    smooth_means, smooth_covs, _ = ukf.rts_smoother(np.array(means), np.array(covs))
    return np.array(means), np.array(covs), np.array(log_likelihoods), smooth_means, smooth_covs


def cholesky(matrix):
    """Lower factor in the precision of the matrix, by the definition."""
    n = len(matrix)
    lower = np.zeros_like(matrix)
    for j in range(n):
        lower[j, j] = np.sqrt(matrix[j, j] - lower[j, :j] @ lower[j, :j])
        for i in range(j + 1, n):
            lower[i, j] = (matrix[i, j] - lower[i, :j] @ lower[j, :j]) / lower[j, j]
    return lower


def solve(matrix, right):
    """Symmetric positive definite solve in the precision of the matrix."""
    lower = cholesky(matrix)
    n = len(matrix)
    y = right.copy()
    for i in range(n):
        y[i] = (y[i] - lower[i, :i] @ y[:i]) / lower[i, i]
    for i in range(n - 1, -1, -1):
        y[i] = (y[i] - lower[i + 1 :, i] @ y[i + 1 :]) / lower[i, i]
    return y


def linear_update(mean, factor, rows, y, sd):
    """Condition a Gaussian (mean, lower factor) on y = rows x + noise, in 80-bit floats, in information form.

    Information only adds up, so that nothing cancels however vague the prior and however precise the data.
    """
    mean, factor, rows, y, sd = (np.asarray(a, dtype=np.longdouble) for a in (mean, factor, rows, y, sd))
    identity = np.eye(len(mean), dtype=np.longdouble)
    white = rows / sd[:, None]
    information = solve(factor @ factor.T, identity) + white.T @ white
    return mean + solve(information, white.T @ ((y - rows @ mean) / sd)), solve(information, identity)


def whole_trajectory(mean, cov, transitions, noises, frames):
    """Posterior of all states at once: one dense Gaussian over the stacked trajectory, conditioned on all rows.

    Args:
        mean: (n,) mean of the first state.
        cov: (n, n) its covariance.
        transitions: T - 1 matrices.
        noises: T - 1 covariances.
        frames: T entries (rows, y, sd) with rows (m, n); m may be 0.

    Returns:
        (T, n) means, (T, n, n) covariances, and the log density of all rows.
    """
    n, n_frames = len(mean), len(frames)
    means = [mean]
    whole = np.zeros((n_frames * n, n_frames * n))
    whole[:n, :n] = cov
    for k, (a, q) in enumerate(zip(transitions, noises, strict=True), start=1):
        means.append(a @ means[-1])
        before, here = slice(0, k * n), slice(k * n, (k + 1) * n)
        last = slice((k - 1) * n, k * n)
        whole[here, before] = a @ whole[last, before]
        whole[before, here] = whole[here, before].T
        whole[here, here] = a @ whole[last, last] @ a.T + q
    stacked = np.concatenate(means)
    count = sum(len(y) for _, y, _ in frames)
    rows, values, sds, at = np.zeros((count, len(stacked))), np.zeros(count), np.ones(count), 0
    for k, (h, y, sd) in enumerate(frames):
        rows[at : at + len(y), k * n : (k + 1) * n] = h
        values[at : at + len(y)], sds[at : at + len(y)] = y, sd
        at += len(y)
    innovation_cov = rows @ whole @ rows.T + np.diag(sds**2)
    miss = values - rows @ stacked
    gain = np.linalg.solve(innovation_cov, rows @ whole).T
    posterior = whole - gain @ rows @ whole
    density = -0.5 * (count * np.log(2 * np.pi) + np.linalg.slogdet(innovation_cov)[1])
    density -= 0.5 * miss @ np.linalg.solve(innovation_cov, miss)
    found = (stacked + gain @ miss).reshape(n_frames, n)
    blocks = np.stack([posterior[k * n : (k + 1) * n, k * n : (k + 1) * n] for k in range(n_frames)])
    return found, blocks, density
