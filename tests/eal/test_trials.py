"""Merging trials."""

import numpy as np
import pytest

from eal import GaussianKernel, fit_potential
from eal.trials import merge_trials


def test_a_trial_repeated_is_a_trial_weighted(rng):
    """By samples, a trial three times as long counts three times; by trials, its repeats change nothing."""
    a, b = rng.standard_normal((2, 30, 2))
    q = rng.standard_normal((20, 2))

    def v(trials, share):
        z, weights = merge_trials(trials, share=share)
        return fit_potential(z, kernel=GaussianKernel(1.0), lam=1e-3, weights=weights, method="exact").value(q)

    long = np.concatenate([a, a, a])
    np.testing.assert_allclose(v([long, b], "trials"), v([a, b], "trials"), atol=1e-9)
    np.testing.assert_allclose(v([long, b], "samples"), v([a, a, a, b], "samples"), atol=1e-9)
    assert np.abs(v([long, b], "samples") - v([a, b], "samples")).max() > 1e-4


def test_unseen_rows_are_dropped_and_weights_keep_their_sum():
    trials = [np.array([[0.0, 1.0], [np.nan, 1.0], [2.0, 3.0]]), np.array([[4.0, 5.0]])]
    z, weights = merge_trials(trials, share="trials")
    assert z.tolist() == [[0, 1], [2, 3], [4, 5]]
    assert weights.tolist() == [0.75, 0.75, 1.5]


@pytest.mark.parametrize(
    ("trials", "share", "message"),
    [
        ([], "samples", "no trial"),
        ([np.zeros((3, 2)), np.zeros((3, 3))], "samples", r"trial 1 must be \(N, 2\)"),
        ([np.zeros((3, 2)), np.full((3, 2), np.nan)], "samples", "trial 1 has no row"),
        ([np.zeros((3, 2))], "frames", "share must be one of"),
    ],
)
def test_what_cannot_be_merged_is_named(trials, share, message):
    with pytest.raises(ValueError, match=message):
        merge_trials(trials, share=share)
