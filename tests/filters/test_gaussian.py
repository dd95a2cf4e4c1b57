"""One Gaussian filter: what observations say of the state before them is what they made of it."""

import numpy as np
import pytest
from mocap.filters.factors import symmetric, triangle_of
from mocap.filters.gaussian import Adjoint, Moments, View, condition


@pytest.mark.parametrize("noise", [1.0, 0.02])
def test_going_back_over_observations_gives_the_posterior(noise):
    """Nothing moves between them: smoothed, the state before two observations is the one after both.

    With a noise of 0.02 variances fall by more than 1e4, where covariances are sums of squares; four digits are lost.
    """
    rng = np.random.default_rng(0)
    factor = np.tril(rng.normal(size=(4, 4))) + 2 * np.eye(4)
    before = state = Moments(rng.normal(size=4), factor @ factor.T)
    updates = []
    for _ in range(2):
        rows = rng.normal(size=(2, 3)) / noise  # of the first three components
        state, update = condition(state, rows, rows @ state.cov[:3], rng.normal(size=2) / noise)
        updates.append(update)
    assert (updates[0].left is None) == (noise == 1.0)
    adjoint = Adjoint(np.zeros(4), np.zeros((4, 4)))
    for update in reversed(updates):
        adjoint = update.back(adjoint)
    found = adjoint.smoothed(before)
    np.testing.assert_allclose(found.mean, state.mean, atol=1e-7)
    np.testing.assert_allclose(found.cov, state.cov, atol=1e-7)


@pytest.mark.parametrize("chains", [None, 5])
def test_rows_of_single_markers_are_those_of_all_with_zeros_for_the_others(chains):
    rng, which = np.random.default_rng(0), np.array([3, 1])
    view = View(rng.normal(size=(4, 3)), rng.normal(size=(12, 5)), chains)
    along = rng.normal(size=(2, 3, 3))
    every = np.zeros((2, 3, 4, 3))
    every[[0, 1], :, which] = along
    np.testing.assert_allclose(view.of_markers(along, which), view.combined(every.reshape(2, 3, 12)), atol=1e-15)
    np.testing.assert_allclose(
        view.of_markers(along[[0, 0, 1, 1]], slice(None))[2], view.of_markers(along[1:], np.array([2]))[0]
    )


@pytest.mark.parametrize("n", [1, 63, 64, 130])
def test_a_covariance_is_folded_and_unfolded_to_the_last_digit(n):
    root = np.random.default_rng(n).normal(size=(n, n))
    cov = root @ root.T
    triangle = triangle_of(cov)
    assert triangle.shape == (n * (n + 1) // 2,)
    np.testing.assert_array_equal(symmetric(triangle, n), cov)
