"""Sums over trials: the potential of all samples at once."""

import numpy as np
import pytest

from eal import GaussianKernel, fit_potential
from eal.sums import choose_landmarks, sums_of, total

RNG = np.random.default_rng(0)
TRIALS = [RNG.normal(size=(n, 2)) * [1.0, 0.3] + RNG.normal(size=2) for n in (120, 1, 333, 250)]
KERNEL = GaussianKernel(0.8)
MARKS = choose_landmarks(KERNEL, np.concatenate(TRIALS))
SUMS = [sums_of(MARKS, trial) for trial in TRIALS]
Q = RNG.normal(size=(200, 2)) * 2


def test_the_potential_of_all_at_once():
    """With landmarks of all samples both are pivoted Cholesky: 1e-5 is the accuracy that both were asked for."""
    both = np.concatenate(TRIALS)
    whole = fit_potential(both, kernel=KERNEL, method="cholesky")
    found = total(SUMS).potential()
    np.testing.assert_allclose(found.value(Q), whole.value(Q), atol=1e-9)
    np.testing.assert_allclose(found.gradient(Q), whole.gradient(Q), atol=1e-7)
    np.testing.assert_allclose(found.effective_rank, whole.effective_rank, rtol=1e-6)
    exact = fit_potential(both, kernel=KERNEL, method="exact")
    np.testing.assert_allclose(found.value(Q), exact.value(Q), atol=1e-5)


def test_in_any_order():
    """Sums of trials, in another order and with other borders, differ by rounding times the condition of C, 1e6."""
    mixed = total([sums_of(MARKS, np.concatenate([TRIALS[3], TRIALS[0][:50]])), sums_of(MARKS, TRIALS[0][50:])])
    other = SUMS[0] + SUMS[3]
    np.testing.assert_allclose(mixed.potential().value(Q), other.potential().value(Q), atol=1e-9)
    assert mixed.total == other.total == 370


def test_without_a_trial():
    """Taking a trial off leaves the potential of the others, and its mean at the trial's samples is what they have."""
    left = total(SUMS) - SUMS[2]
    others = fit_potential(np.concatenate([TRIALS[0], TRIALS[1], TRIALS[3]]), kernel=KERNEL, method="exact")
    found = left.potential()
    np.testing.assert_allclose(found.value(Q), others.value(Q), atol=1e-5)
    assert SUMS[2].mean_value(found) == pytest.approx(found.value(TRIALS[2]).mean(), abs=1e-10)
    assert SUMS[2].mean_value(found) > SUMS[2].mean_value(total(SUMS).potential())


def test_few_landmarks_tell_what_they_lack():
    """The bound on the error of V holds where landmarks were chosen from other samples."""
    marks = choose_landmarks(KERNEL, TRIALS[0][:20])
    found = sums_of(marks, TRIALS[3]).potential()
    exact = fit_potential(TRIALS[3], kernel=KERNEL, method="exact")
    assert np.abs(found.value(Q) - exact.value(Q)).max() <= found.error_bound


def test_what_cannot_be_added():
    """Other landmarks, or nothing."""
    with pytest.raises(ValueError, match="different landmarks"):
        _ = SUMS[0] + sums_of(choose_landmarks(KERNEL, TRIALS[0]), TRIALS[0])
    with pytest.raises(ValueError, match="needs samples"):
        (SUMS[0] - SUMS[0]).potential()
    with pytest.raises(ValueError, match="no sums"):
        total([])


def test_saved_and_read(tmp_path):
    """As any potential."""
    from eal import load_potential

    found = total(SUMS).potential(names=("a", "b"))
    found.save(tmp_path / "v.npz")
    np.testing.assert_array_equal(load_potential(tmp_path / "v.npz").value(Q), found.value(Q))
