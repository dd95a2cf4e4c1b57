"""The smoother beside the same formula in long double."""

import numpy as np
import pytest
from mocap.filters.ensemble import Gaussian, default_points, predict, smooth_step
from mocap.filters.motion.constant_velocity import white_acceleration

DT_S = 1 / 240


def advance(states):
    """(S, n) states of constant velocity a step later."""
    k = states.shape[1] // 2
    return np.concatenate([states[:, :k] + DT_S * states[:, k:], states[:, k:]], axis=1)


@pytest.mark.parametrize(("widen", "narrow"), [(1.0, 1.0), (1e3, 1.0), (1e3, 1e-2), (1e5, 1e-3)])
def test_smoother_keeps_its_digits_where_the_future_knows_much_more(widen, narrow):
    """D D^T + K Q K^T + K Ps K^T with D = L - K G^T in long double, also where the program may not subtract.

    A double has lost no more than n 2e-16 / 1e-4 where variances fall to 1e-4; below that nothing is subtracted.
    """
    rng, k = np.random.default_rng(0), 12
    l11, l21, l22 = white_acceleration(np.full(k, 30.0), DT_S)
    drive = np.block([[np.diag(l11), np.zeros((k, k))], [np.diag(l21), np.diag(l22)]])
    correlation = 0.5 * np.eye(2 * k) + 0.5 * np.corrcoef(rng.standard_normal((2 * k, 2 * k)))
    lower = np.repeat([3e-3, 0.3], k)[:, None] * np.linalg.cholesky(correlation)
    start = Gaussian(np.concatenate([rng.uniform(-0.15, 0.15, k), rng.standard_normal(k)]), widen * lower)
    prediction = predict(start, advance, drive, default_points(2 * k))
    future = Gaussian(prediction.state.mean + 0.01, narrow * lower)
    ours = smooth_step(start, prediction, future)

    long = np.longdouble
    factor, rows, noise = (a.astype(long) for a in (start.factor, prediction.rows, prediction.noise))
    predicted = rows.T @ rows + noise @ noise.T
    gain = _solve(predicted, rows[: 2 * k].T @ factor.T).T
    unexplained = np.concatenate([factor, np.zeros((2 * k, len(rows) - 2 * k), dtype=long)], axis=1) - gain @ rows.T
    parts = np.concatenate([unexplained, gain @ noise, gain @ future.factor.astype(long)], axis=1)
    cov = parts @ parts.T
    mean = start.mean + gain @ (future.mean.astype(long) - prediction.state.mean)
    sd = np.sqrt(np.diag(cov))
    tolerance = len(sd) * np.finfo(float).eps / 1e-4
    assert np.abs((ours.mean - mean) / sd).max() < tolerance * max(1.0, np.abs((mean - start.mean) / sd).max())
    assert np.abs((ours.cov - cov) / np.outer(sd, sd)).max() < tolerance
    assert not np.triu(ours.factor, 1).any()


def _solve(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Gaussian elimination of a positive definite system in the precision of its arguments."""
    a, b = a.copy(), b.copy()
    for i in range(len(a)):
        b[i], a[i] = b[i] / a[i, i], a[i] / a[i, i]
        for j in range(len(a)):
            if j != i:
                b[j], a[j] = b[j] - a[j, i] * b[i], a[j] - a[j, i] * a[i]
    return b
