"""The engine: equal to filterpy where filterpy is right, and right where it is not."""

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.ensemble import (
    Gaussian,
    cholesky,
    default_points,
    ensemble,
    predict,
    scale,
    smooth_step,
    spread,
    triangular,
    update,
)

from tests.reference import gaussian_filter as reference


def random_factor(rng, n, size=1.0):
    """Lower factor of a well-conditioned covariance."""
    factor = np.tril(rng.normal(0, 0.3 / np.sqrt(n), (n, n)))
    factor[np.diag_indices(n)] = rng.uniform(0.5, 1.5, n)
    return size * factor


def nonlinear(rng, n, m):
    """A transition and an observation that bend: batched over the first axis, and for single states."""
    a, b = rng.normal(0, 1 / np.sqrt(n), (n, n)), rng.normal(0, 1 / np.sqrt(n), (m, n))

    def step(x):
        return 0.9 * x + 0.1 * np.sin(x @ a.T)

    def h(x):
        return x @ b.T + 0.2 * np.cos(x @ b.T)

    return step, h


def run(points, state, step, noise, frames):
    """Our filter and smoother over frames (h, y, sd), a prediction before each."""
    predictions, updates = [], []
    for h, y, sd in frames:
        predictions.append(predict(state, step, noise, points))
        updates.append(update(predictions[-1].state, h, y, sd, points))
        state = updates[-1].state
    smoothed = [updates[-1].state]
    for k in range(len(frames) - 2, -1, -1):
        smoothed.insert(0, smooth_step(updates[k].state, predictions[k + 1], smoothed[0]))
    return updates, smoothed


def agree(ours, mean, cov, *, dx=1e-8, dp=1e-6):
    """Difference of the means in standard deviations, of the covariances in units of correlation."""
    sd = np.sqrt(np.diag(cov))
    assert np.abs((ours.mean - mean) / sd).max() < dx
    assert np.abs((ours.cov - cov) / np.outer(sd, sd)).max() < dp


@pytest.mark.parametrize(
    ("n", "m", "n_frames", "alpha", "beta"),
    [
        (12, 8, 12, 0.5, 2.0),
        (12, 8, 12, 0.1, 2.0),
        (12, 3, 12, None, None),
        (60, 40, 5, 0.2, 1.0),
        (204, 60, 3, None, None),
    ],
)
def test_filter_and_smoother_are_filterpys(n, m, n_frames, alpha, beta):
    """Bent dynamics and observations: states, log-likelihoods and smoothed states of filterpy, n = 12, 60, 204.

    Tolerances of its subtractions (measured against 80 bits for alpha >= 0.1): 1e-8 deviations, 1e-6 correlation.
    """
    rng = np.random.default_rng(n + m)
    step, h = nonlinear(rng, n, m)
    points = default_points(n) if alpha is None else MerweScaledSigmaPoints(n, alpha=alpha, beta=beta, kappa=0.0)
    start, noise = Gaussian(rng.normal(size=n), random_factor(rng, n)), random_factor(rng, n, 0.3)
    sd = rng.uniform(0.2, 1, m)
    frames = [(h, rng.normal(size=m), sd) for _ in range(n_frames)]
    updates, smoothed = run(points, start, step, noise, frames)
    means, covs, densities, smooth_means, smooth_covs = reference.filterpy_filter(
        points, (start.mean, start.cov), step=step, noise_cov=noise @ noise.T, frames=frames
    )
    for k in range(n_frames):
        agree(updates[k].state, means[k], covs[k])
        agree(smoothed[k], smooth_means[k], smooth_covs[k])
        assert updates[k].log_likelihood == pytest.approx(densities[k], rel=1e-9, abs=1e-6)
        factor = updates[k].state.factor
        assert not np.triu(factor, 1).any()
        assert (np.diag(factor) > 0).all()


def test_sigma_points_are_mervas_and_moments_filterpys():
    """Points lie where van der Merwe puts them; mean and covariance from the ensemble are the weighted sums.

    At alpha = 0.5 the weights are of order 10, their cancellation costs one digit of sixteen.
    """
    rng = np.random.default_rng(1)
    merwe = MerweScaledSigmaPoints(5, alpha=0.5, beta=2.0, kappa=0.5)
    state = Gaussian(rng.normal(size=5), random_factor(rng, 5))
    c, gamma = scale(merwe)
    ours = spread(state, c)
    np.testing.assert_allclose(ours, merwe.sigma_points(state.mean, state.cov), atol=1e-12)
    values = np.column_stack([np.exp(ours[:, 0]), ours[:, 1] * ours[:, 2], ours[:, 3]])
    mean, rows = ensemble(values, c, gamma)
    expected = merwe.Wm @ values
    np.testing.assert_allclose(mean, expected, atol=1e-12)
    np.testing.assert_allclose(rows.T @ rows, (values - expected).T * merwe.Wc @ (values - expected), atol=1e-11)


def test_the_mean_of_a_square_is_exact():
    """E x^2 = mean^2 + variance for a Gaussian: the transform integrates parabolas exactly, at any spread."""
    state = Gaussian(np.array([2.0, -1.0]), np.array([[0.5, 0], [0.3, 0.7]]))
    for alpha in (0.1, 0.7, 1.0):
        points = MerweScaledSigmaPoints(2, alpha=alpha, beta=2.0, kappa=0.0)
        c, gamma = scale(points)
        mean, _ = ensemble(spread(state, c) ** 2, c, gamma)
        np.testing.assert_allclose(mean, state.mean**2 + np.diag(state.cov), atol=1e-12)


@given(seed=st.integers(0, 1000), n=st.integers(1, 10), m=st.integers(1, 15))
def test_linear_updates_are_exact(seed, n, m):
    """For linear observations the posterior is that of the textbook in extended precision, to rounding."""
    rng = np.random.default_rng(seed)
    state, rows = Gaussian(rng.normal(size=n), random_factor(rng, n)), rng.normal(size=(m, n))
    y, sd = rng.normal(size=m), rng.uniform(0.1, 2, m)
    mean, cov = reference.linear_update(state.mean, state.factor, rows, y, sd)
    found = update(state, lambda x: x @ rows.T, y, sd, default_points(n))
    agree(found.state, mean.astype(float), cov.astype(float), dx=1e-12, dp=1e-12)
    inside = rows @ state.cov @ rows.T + np.diag(sd**2)
    miss = y - rows @ state.mean
    nis = miss @ np.linalg.solve(inside, miss)
    assert found.nis == pytest.approx(nis, rel=1e-9)
    density = -0.5 * (m * np.log(2 * np.pi) + np.linalg.slogdet(inside)[1] + nis)
    assert found.log_likelihood == pytest.approx(density, rel=1e-9, abs=1e-9)


def test_a_vague_prior_meets_precise_data():
    """Prior 1e3, data 1e-6, 12 states of which 8 are seen twice: the 80-bit posterior, where P - K S K^T fails.

    The spread of 1e9 in deviation is 1e18 in variance: the subtraction has no digit left and turns indefinite. Here the
    mean moves by 1e3, whose rounding 1e-13 is 1e-7 deviations; sums of 16 and a condition of 1e2 leave 1e-4.
    """
    rng = np.random.default_rng(2)
    n, m = 12, 16
    state = Gaussian(rng.normal(size=n), random_factor(rng, n, 1e3))
    rows, sd = np.zeros((m, n)), np.full(m, 1e-6)
    rows[:, :8] = np.concatenate([np.eye(8), np.eye(8) + 0.3 * rng.normal(size=(8, 8))])
    y = rows @ (state.factor @ rng.normal(size=n)) + sd * rng.normal(size=m)
    mean, cov = reference.linear_update(state.mean, state.factor, rows, y, sd)
    found = update(state, lambda x: x @ rows.T, y, sd, default_points(n)).state
    agree(found, mean.astype(float), cov.astype(float), dx=1e-4, dp=1e-10)
    assert np.linalg.eigvalsh(found.cov / np.outer(*(np.sqrt(np.diag(found.cov)),) * 2)).min() > 0
    naive = state.cov - (state.cov @ rows.T) @ np.linalg.solve(
        rows @ state.cov @ rows.T + np.diag(sd**2), rows @ state.cov
    )
    assert np.linalg.eigvalsh(naive).min() < 0


def test_no_rows_change_nothing():
    """A frame without rows leaves the prediction as it is and adds no likelihood."""
    rng = np.random.default_rng(3)
    state = Gaussian(rng.normal(size=4), random_factor(rng, 4))
    found = update(state, lambda x: x[:, :0], np.zeros(0), np.zeros(0), default_points(4))
    assert found.state is state
    assert found.log_likelihood == 0.0
    assert np.isnan(found.nis)


def test_the_covariance_stays_positive_for_two_thousand_frames():
    """Random rows in random frames, noise from 1e-4 to 1: the factor stays lower, finite, with a positive diagonal."""
    rng = np.random.default_rng(6)
    n, m = 12, 10
    step, h = nonlinear(rng, n, m)
    points, noise = default_points(n), random_factor(rng, n, 0.05)
    state = Gaussian(np.zeros(n), random_factor(rng, n, 10.0))
    for _ in range(2000):
        state = predict(state, step, noise, points).state
        keep = np.flatnonzero(rng.random(m) < rng.choice([0, 0.1, 0.9]))
        sd = 10.0 ** rng.uniform(-4, 0, len(keep))
        state = update(state, lambda x, keep=keep: h(x)[:, keep], rng.normal(size=len(keep)), sd, points).state
        assert not np.triu(state.factor, 1).any()
        assert np.isfinite(state.factor).all()
        assert np.diag(state.factor).min() > 0


@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(1.0, 0.5, 0.0), (0.5, 0.2, 0.0), (1.0, 2.0, -4.0)])
def test_transforms_that_are_not_positive_are_refused(alpha, beta, kappa):
    """A beta below alpha^2 or a spread of zero or less is an error that names the numbers and a remedy."""
    points = MerweScaledSigmaPoints(3, alpha=alpha, beta=beta, kappa=kappa)
    with pytest.raises(ValueError, match=r"beta >= alpha\^2, but alpha = .*take default_points\(3\)"):
        scale(points)


@pytest.mark.parametrize("n", [1, 2, 3, 12, 204])
def test_default_points_are_legal_everywhere(n):
    """The default has gamma = 0 and a spread of three variances, or n where that is less."""
    c, gamma = scale(default_points(n))
    assert c == pytest.approx(min(3, n))
    assert gamma == pytest.approx(0, abs=1e-15)


def test_predictions_without_noise_or_rank_still_have_a_factor():
    """A transition that forgets a component leaves a singular covariance: its factor comes from an orthogonal one."""
    rng = np.random.default_rng(7)
    state = Gaussian(rng.normal(size=3), random_factor(rng, 3))
    keep = np.diag([1.0, 1.0, 0.0])
    found = predict(state, lambda x: x @ keep, np.zeros((3, 3)), default_points(3))
    np.testing.assert_allclose(found.state.cov, keep @ state.cov @ keep, atol=1e-12)


def test_linear_predictions_are_exact():
    """A P A^T + Q: the second-order rows vanish."""
    rng = np.random.default_rng(8)
    state, a, noise = (
        Gaussian(rng.normal(size=5), random_factor(rng, 5)),
        rng.normal(size=(5, 5)),
        random_factor(rng, 5),
    )
    found = predict(state, lambda x: x @ a.T + 1, noise, default_points(5)).state
    np.testing.assert_allclose(found.mean, a @ state.mean + 1, atol=1e-12)
    np.testing.assert_allclose(found.cov, a @ state.cov @ a.T + noise @ noise.T, atol=1e-11)


def test_factors_by_definition():
    """``triangular`` factors rows^T rows, of any rank; ``cholesky`` says which minor fails."""
    rng = np.random.default_rng(9)
    for k in (2, 5, 9):
        rows = rng.normal(size=(k, 5))
        factor = triangular(rows)
        assert not np.triu(factor, 1).any()
        np.testing.assert_allclose(factor @ factor.T, rows.T @ rows, atol=1e-12)
    with pytest.raises(np.linalg.LinAlgError, match="size 3 is not positive definite"):
        cholesky(np.diag([1.0, -1.0, 1.0]))


def test_nothing_given_is_written_to():
    """States are shared between filter and smoother: no function writes into what it was given."""
    rng = np.random.default_rng(10)
    n = 6
    state, noise = Gaussian(rng.normal(size=n), random_factor(rng, n)), random_factor(rng, n)
    y, sd = rng.normal(size=n), np.ones(n)
    prediction = predict(state, np.sin, noise, default_points(n))
    kept = [state.mean, state.factor, noise, y, sd, prediction.rows, prediction.state.mean, prediction.state.factor]
    before = [x.copy() for x in kept]
    for x in kept:
        x.flags.writeable = False
    update(state, np.cos, y, sd, default_points(n))
    smooth_step(state, prediction, prediction.state)
    predict(state, np.sin, noise, default_points(n))
    for x, y in zip(kept, before, strict=True):
        np.testing.assert_array_equal(x, y)
