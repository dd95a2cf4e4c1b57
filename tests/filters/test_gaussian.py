"""One Gaussian filter: what observations say of the state before them is what they made of it."""

import numpy as np
import pytest
from mocap.filters.gaussian import Adjoint, Moments, condition


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
