"""The bootstrap of V_z on samples that are correlated in time."""

import numpy as np
import pytest

from eal import GaussianKernel, Projection, Tail, Tikhonov, fit_potential
from eal.radius import resampled_values, value_deviation, value_interval
from tests.reference import circle
from tests.swings import draw

RADII = np.array([0.5, 0.8, 1.0, 1.2, 1.5])
ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)
GRID = (RADII[:, None, None] * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)).reshape(-1, 2)
LAM = 1e-2


def walk(rng, n, step):
    """A random walk round the unit circle, stationary and uniform: V_j is a closed form."""
    angle = np.cumsum(np.concatenate([rng.uniform(0, 2 * np.pi, 1), step * rng.standard_normal(n - 1)]))
    return fit_potential(np.stack([np.cos(angle), np.sin(angle)], axis=1), kernel=GaussianKernel(1.0), lam=LAM)


def test_it_holds_the_truth_on_trajectories_and_single_samples_do_not():
    """60 walks of 400 samples worth about 50: blocks hold V_j in 95 % of them or more (88 % within 2.5 errors).

    Single samples as if independent held 59 % of 400 walks: at most 80 % of 60, within three.
    """
    rng = np.random.default_rng(3)
    truth = np.repeat(circle.value(RADII, 1.0, Tail(), LAM), len(ANGLES))
    held = np.zeros(2)
    for _ in range(60):
        potential = walk(rng, 400, 0.5)
        error = np.abs(potential.value(GRID) - truth).max()
        for i, block in enumerate((None, 1)):
            middle, values = resampled_values(potential, GRID, rng=rng, block=block, resamples=60)
            held[i] += error <= np.quantile(np.abs(values - middle).max(axis=1), 0.95)
    assert held[0] >= 0.88 * 60
    assert held[1] <= 0.80 * 60


def test_resampled_potential_is_a_fit_with_weights(rng):
    """With a block of all samples every resample is a turn of the same samples: what differs is rounding."""
    middle, values = resampled_values(walk(rng, 200, 3.0), GRID, rng=rng, block=200, resamples=5)
    assert np.abs(values - middle).max() < 1e-9


@pytest.mark.parametrize("spectral_filter", [Tail(), Projection(), Tikhonov()], ids=lambda f: f.name)
def test_all_samples_give_the_potential_itself(spectral_filter, rng):
    """For filters with one gain at small eigenvalues, none and any: to 2 sqrt(1e-4), as pivots stop at 1e-4 lambda."""
    z = 0.3 * rng.standard_normal((150, 2)) + 1.0
    potential = fit_potential(z, kernel=GaussianKernel(1.0), lam=LAM, spectral_filter=spectral_filter)
    middle, _ = resampled_values(potential, GRID, rng=rng, block=1, resamples=1)
    assert np.abs(middle - potential.value(GRID)).max() < 0.02
    assert potential.value(GRID).max() > 0.5


def test_the_deviation_at_a_point_is_that_of_repeated_recordings():
    """SD of V_z over 120 recordings of five trials, and what each states of it: within a factor of 1.5 at each radius.

    Whole trials are drawn; as if their 40 samples were independent it would be less than half of that.
    """
    rng = np.random.default_rng(4)
    at = np.stack([[0.6, 1.0, 1.4], np.zeros(3)], axis=1)
    found, stated, single = [], [], []
    for _ in range(120):
        angle = rng.uniform(0, 2 * np.pi, 5)[:, None] + 0.3 * rng.standard_normal((5, 40))
        z = np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(-1, 2)
        potential = fit_potential(z, kernel=GaussianKernel(1.0), lam=0.1)
        found.append(potential.value(at))
        stated.append(value_deviation(potential, at, rng=rng, trials=[40] * 5))
        single.append(value_deviation(potential, at, rng=rng, block=1))
    truth = np.std(found, axis=0)
    assert (np.abs(np.log(np.sqrt(np.mean(np.square(stated), axis=0)) / truth)) < np.log(1.5)).all()
    assert (np.sqrt(np.mean(np.square(single), axis=0)) < 0.5 * truth).all()


def test_trials_must_be_those_of_the_samples(rng):
    with pytest.raises(ValueError, match="trials must have 400 samples together, as the potential, but have 399"):
        value_deviation(walk(rng, 400, 3.0), GRID, rng=rng, trials=[200, 199])


def test_a_block_must_fit_the_samples(rng):
    with pytest.raises(ValueError, match="block must be 1 to 400"):
        value_deviation(walk(rng, 400, 3.0), GRID, rng=rng, block=0)


@pytest.mark.parametrize("n", [4, 6])
def test_the_interval_of_few_trials_holds_the_mean(n):
    """Mean V of 60 recordings of n swings lies in 95 % of their intervals, within three standard errors: 86 % and more.

    1.96 standard deviations of the bootstrap alone held 74 to 82 %.
    """
    rng, at = np.random.default_rng(6), np.array([[60.0], [90.0], [130.0]])
    middle, ends = [], []
    for _ in range(60):
        trials = draw(rng, n, posture=(90.0, 4.0), reach=(40.0, 0.0), frames=60)
        potential = fit_potential(np.concatenate(trials), kernel=GaussianKernel(4 / 40**2), lam=LAM)
        middle.append(potential.value(at))
        ends.append(value_interval(potential, at, trials=[60] * n, rng=rng))
    low, high = np.swapaxes(ends, 0, 1)
    mean = np.mean(middle, axis=0)
    assert np.mean((low <= mean) & (mean <= high)) >= 0.86


def test_one_trial_has_no_interval(rng):
    with pytest.raises(ValueError, match="needs two at least, but there are 1"):
        value_interval(walk(rng, 400, 3.0), GRID, rng=rng, trials=[400])
