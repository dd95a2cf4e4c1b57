"""The most probable trajectory and its covariance."""

import numpy as np
import pytest
from mocap.filters.trajectory import Quadratic, covariance, factor, most_probable

from tests.reference.circle_posterior import SEEN, Circle, drawn, exact, potential


@pytest.mark.rare
@pytest.mark.parametrize(("walk", "weight", "gap"), [(0.06, 300, 30), (0.15, 30, 20), (0.06, 300, 60)])
def test_deviations_in_a_long_curved_gap_are_the_exact_ones(walk, weight, gap):
    """An exact posterior on a grid: deviations agree to 15 %, means to half a deviation.

    The filter that is linearised once states 0.58 to 0.75 of the exact deviation in these rows.
    """
    v = potential()
    problem = Circle(v, drawn(v, walk, weight, gap, np.random.default_rng(0)))
    mean, sd = exact(v, problem.walk)
    costs: list[float] = []
    found = most_probable(problem, problem.start(), tell=costs.append)
    stated = np.sqrt(np.einsum("tii->ti", covariance(factor(problem.quadratic(found)))[0]))
    hidden = slice(SEEN, SEEN + gap)
    ratio = np.sqrt(np.mean(stated[hidden] ** 2) / np.mean(sd[hidden] ** 2))
    assert 0.85 < ratio < 1.15
    assert np.sqrt(np.mean(((found - mean) / sd)[hidden] ** 2)) < 0.5
    assert (np.diff(costs) <= 0).all()


def test_the_end_does_not_move_by_a_twentieth_of_a_deviation():
    """From the end and from elsewhere on the valley the search comes to the same place."""
    v = potential()
    problem = Circle(v, drawn(v, 0.06, 300, 30, np.random.default_rng(1)))
    found = most_probable(problem, problem.start())
    sd = np.sqrt(np.einsum("tii->ti", covariance(factor(problem.quadratic(found)))[0]))
    other = most_probable(problem, 0.7 * problem.start())
    assert (np.abs(found - other) < 0.1 * sd).all()  # each end is within 0.05 of where the steps would go


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_covariances_are_blocks_of_the_dense_inverse(steps):
    """Of a random positive definite banded matrix, by NumPy's inverse; 1e-10 is rounding at this condition."""
    rng, n, lags = np.random.default_rng(0), 3, 2
    root = np.zeros((steps * n, steps * n))
    for t in range(steps):
        for lag in range(min(lags, steps - 1 - t) + 1):
            root[(t + lag) * n : (t + lag + 1) * n, t * n : (t + 1) * n] = rng.normal(size=(n, n))
    dense = root @ root.T + np.eye(len(root))
    blocks = dense.reshape(steps, n, steps, n)
    band = tuple(
        np.array([blocks[t + lag, :, t] for t in range(steps - lag)]).reshape(-1, n, n) for lag in range(lags + 1)
    )
    form = Quadratic(gradient=rng.normal(size=(steps, n)), band=band)
    found = factor(form)
    inverse = np.linalg.inv(dense)
    assert np.allclose(found.solve(form.gradient).ravel(), inverse @ form.gradient.ravel(), atol=1e-10)
    for lag, part in enumerate(covariance(found)):
        wanted = [inverse.reshape(steps, n, steps, n)[t + lag, :, t] for t in range(steps - lag)]
        assert np.allclose(part, wanted, atol=1e-10)
