"""Our filter and filterpy's, as the benchmark times them, have the same states."""

from importlib.metadata import version

import numpy as np
import pytest
from mocap.filters.ensemble import Gaussian, default_points, predict, smooth_step

from benchmarks.ukf import DT_S, advance, compare, problem


@pytest.mark.parametrize("affine", [True, False])
@pytest.mark.parametrize(("n", "m"), [(12, 8), (60, 120)])
def test_states_agree_with_filterpy(n, m, affine):
    """Both programs compute the same transform, so they differ by rounding only.

    filterpy's weights are about 1 / alpha^2 = n / 3 and cancel: n / 3 times the condition of the covariance in units of
    deviations (1e3) times 1e-16, over 2 n points, is below 1e-9.
    """
    if version("filterpy").startswith("1."):
        pytest.skip("filterpy before 2 observes points without the process noise: another filter")
    rows = compare(problem(n, m, affine=affine), repeats=1, budget_s=0.0)
    assert [row.what for row in rows] == (["planar", "  smoother"] if affine else ["pixels"])
    for row in rows:
        assert row.off_mean < 1e-9
        assert row.off_cov < 1e-9


@pytest.mark.parametrize(("widen", "narrow"), [(1.0, 1.0), (1e3, 1.0), (1e3, 1e-2), (1e5, 1e-3)])
def test_smoother_keeps_its_digits_where_the_future_knows_much_more(widen, narrow):
    """D D^T + K Q K^T + K Ps K^T with D = L - K G^T in long double, also where the program may not subtract.

    A double has lost no more than n 2e-16 / 1e-4 where variances fall to 1e-4; below that nothing is subtracted.
    """
    case = problem(24, 8, affine=True)
    start = Gaussian(case.start.mean, widen * case.start.factor)
    prediction = predict(start, lambda x: advance(x, DT_S), case.noise, default_points(24))
    future = Gaussian(prediction.state.mean + 0.01, narrow * case.start.factor)
    ours = smooth_step(start, prediction, future)

    long = np.longdouble
    factor, rows, noise = (a.astype(long) for a in (start.factor, prediction.rows, prediction.noise))
    predicted = rows.T @ rows + noise @ noise.T
    gain = _solve(predicted, rows[:24].T @ factor.T).T
    unexplained = np.concatenate([factor, np.zeros((24, len(rows) - 24), dtype=long)], axis=1) - gain @ rows.T
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
