"""Gaussian-process regression over trials: its covariance, posterior and likelihood against scikit-learn and scipy."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.gaussian_process import Apart, Covariance, Rows, fitted, predict
from scipy.stats import multivariate_normal
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, DotProduct, Matern, WhiteKernel

NOTHING = 1e-12
"""A parameter that may not be zero."""


def rows_of(rng, n=12, size=4, trials=3):
    """Rows of some trials, sorted by nothing."""
    trial = rng.integers(trials, size=n)
    return Rows(x=rng.normal(size=(n, size)) / np.sqrt(size), trial=trial, t=rng.uniform(0, 5, n))


def joined(a, b):
    """Both, one after the other."""
    return Rows(x=np.vstack([a.x, b.x]), trial=np.r_[a.trial, b.trial], t=np.r_[a.t, b.t])


@given(seed=st.integers(0, 1000))
def test_the_covariance_is_the_sum_of_its_parts(seed):
    """Against the kernels of scikit-learn, and a loop over the trials: to rounding. A variance is the diagonal."""
    rng = np.random.default_rng(seed)
    a, b = rows_of(rng), rows_of(rng, 7)
    law = Covariance(linear=0.7, curved=0.3, sharp=1.9, trial=0.2, slow=0.4, memory=0.8, own=0.15)
    bent = RBF(length_scale=1 / np.sqrt(2 * 1.9))(a.x, b.x)
    expected = 0.7 * DotProduct(sigma_0=0)(a.x, b.x) + 0.3 * bent
    slow = Matern(length_scale=0.8, nu=1.5)(a.t[:, None], b.t[:, None])
    for i, j in np.ndindex(*expected.shape):
        if a.trial[i] == b.trial[j]:
            expected[i, j] += 0.2 + 0.4 * slow[i, j] + 0.15 * bent[i, j]
    np.testing.assert_allclose(law(a, b), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(law.prior(a), np.diag(law(a, a)), rtol=0, atol=1e-12)


@given(seed=st.integers(0, 1000))
def test_slopes_of_the_covariance_are_those_of_differences(seed):
    """By each logarithm, summed with any weights, central differences of steps of 1e-5: to 1e-8.

    Without its noise it is the covariance.
    """
    rng = np.random.default_rng(seed)
    rows, logarithms = rows_of(rng), Covariance().logarithms + rng.normal(0, 0.5, 8)
    law, apart = Covariance.of(logarithms), Apart.of(rows, rows)
    square, along = law.gradient(apart)
    weights = rng.normal(size=(12, 12)) / 12
    np.testing.assert_allclose(square - law.noise * np.eye(12), law(rows, rows), rtol=0, atol=1e-12)
    for step, slope in zip(1e-5 * np.eye(8), along(weights), strict=True):
        above, below = (Covariance.of(logarithms + sign * step).gradient(apart)[0] for sign in (1, -1))
        np.testing.assert_allclose(slope, np.vdot(weights, above - below) / 2e-5, rtol=0, atol=1e-8)


@given(seed=st.integers(0, 1000))
def test_the_posterior_is_the_conditional_density(seed):
    """Means and variances against conditioning the joint normal density of known and asked values, to 1e-8.

    The scale is the one of highest likelihood: that of values a hundredth off it is lower.
    """
    rng = np.random.default_rng(seed)
    law, known, asked = Covariance(noise=0.05), rows_of(rng), rows_of(rng, 3)
    y = rng.normal(size=(12, 2)) * [1.0, 1e-3]
    mean, variance = predict(law, joined(known, asked), y)
    whole = law(joined(known, asked), joined(known, asked))
    whole[:12, :12] += 0.05 * np.eye(12)
    gain = np.linalg.solve(whole[:12, :12], whole[:12, 12:]).T
    np.testing.assert_allclose(mean, gain @ y, rtol=1e-8, atol=1e-8)
    left = np.diag(whole[12:, 12:] - gain @ whole[:12, 12:])
    for column in range(2):
        values = y[:, column]

        def log_density(scale2, values=values):
            return multivariate_normal(np.zeros(12), scale2 * whole[:12, :12]).logpdf(values)

        scale2 = variance[0, column] / left[0]
        assert scale2 > 0
        assert log_density(scale2) > max(log_density(1.01 * scale2), log_density(0.99 * scale2))
        np.testing.assert_allclose(variance[:, column], scale2 * left, rtol=1e-6)


@pytest.mark.rare
def test_amplitudes_are_those_of_the_highest_likelihood():
    """Drawn from a known process of 3 x 150 rows: found again; a linear world is not called curved, nor the reverse.

    The likelihood of what is found is that of scikit-learn's own search within one nat; it knows no trials, so that
    each row is a trial here, and then a trial's parts are noise to both.
    """
    rng = np.random.default_rng(3)
    rows = replace(rows_of(rng, 150), trial=np.arange(150))
    true = Covariance(linear=1.0, curved=0.5, sharp=1.0, trial=NOTHING, slow=NOTHING, own=NOTHING, noise=0.01)
    y = rng.multivariate_normal(np.zeros(150), true(rows, rows) + 0.01 * np.eye(150), size=3).T
    found = fitted([(rows, y)], steps=60)
    noise = found.noise + found.trial + found.slow + found.own
    assert found.curved / found.linear == pytest.approx(0.5, rel=1.0)
    assert noise / found.linear == pytest.approx(0.01, rel=1.0)
    kernel = ConstantKernel() * DotProduct(sigma_0=0, sigma_0_bounds="fixed") + ConstantKernel() * RBF() + WhiteKernel()
    peer = GaussianProcessRegressor(kernel, random_state=0, n_restarts_optimizer=1).fit(rows.x, y[:, 0])
    one = fitted([(rows, y[:, :1])], steps=60)
    square = one(rows, rows) + one.noise * np.eye(150)
    scale2 = y[:, 0] @ np.linalg.solve(square, y[:, 0]) / 150
    own = multivariate_normal(np.zeros(150), scale2 * square).logpdf(y[:, 0])
    assert own == pytest.approx(peer.log_marginal_likelihood_value_, abs=1.0)


@pytest.mark.rare
def test_a_bent_world_is_seen_as_bent():
    """A circle's other coordinate: a straight line explains nothing of y = x^2, the curved part nearly all."""
    rng = np.random.default_rng(4)
    x = rng.uniform(-1.7, 1.7, (120, 1))
    rows, y = Rows(x=x, trial=np.zeros(120, dtype=int), t=1e3 * np.arange(120.0)), x**2 - np.mean(x**2)
    asked = Rows(x=np.array([[0.0], [1.0]]), trial=np.ones(2, dtype=int), t=np.zeros(2))
    straight = Covariance(curved=NOTHING, own=NOTHING, noise=0.1)
    assert np.abs(predict(straight, joined(rows, asked), y)[0][0] + np.mean(x**2)) > 0.5
    said, left = predict(fitted([(rows, y)]), joined(rows, asked), y)
    np.testing.assert_allclose(said[:, 0] + np.mean(x**2), [0, 1], atol=0.05)
    assert np.sqrt(left).max() < 0.2


def test_nothing_to_learn_from_leaves_the_start():
    """No data set: the covariance that the search starts from."""
    np.testing.assert_allclose(fitted([]).logarithms, Covariance().logarithms, rtol=1e-12)
