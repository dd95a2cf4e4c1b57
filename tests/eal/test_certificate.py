"""Certificates: the theorems hold and the estimates are near, where the truth is known in closed form."""

import numpy as np
import pytest

from eal import GaussianKernel, Tail, circle, fit_potential
from eal.certificate import bootstrap_radius, certify, coverage, effective_sample_size


def draw(rng, n):
    angle = rng.uniform(0, 2 * np.pi, n)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_certificate_is_right_and_sharper_than_the_theorem(rng):
    """On the circle: sup |V_z - V_j| is below the theorem always, and below the bootstrap's 95 % quantile mostly.

    25 draws at 95 %: fewer than 20 inside has probability 0.1 %; the bootstrap of a supremum is a little low, so 18.
    """
    grid = np.linspace(0.5, 1.5, 11)[:, None, None] * draw(rng, 40)
    radii = np.linspace(0.5, 1.5, 11)
    inside = 0
    for _ in range(25):
        potential = fit_potential(draw(rng, 1000), kernel=GaussianKernel(1.0), lam=0.25)
        true = np.abs(potential.value(grid) - circle.value(radii, 1.0, Tail(), 0.25)[:, None]).max()
        found = certify(potential, rng=rng, ordered=False, resamples=40)
        assert true < found.radius_theorem < found.radius_hoeffding
        assert found.radius_bootstrap < 0.4 * found.radius_theorem
        inside += true < found.radius_bootstrap
    assert inside >= 18


def test_coverage_is_a_lower_limit(rng):
    """The share of 2000 new samples with V < level is above the stated coverage, at 95 % confidence, in 17 of 20."""
    holds = 0
    for _ in range(20):
        noise = 1 + 0.05 * rng.standard_normal((2300, 1))
        z = noise * draw(rng, 2300)
        potential = fit_potential(z[:300], kernel=GaussianKernel(3.0), lam=1e-2)
        stated = certify(potential, rng=rng, ordered=False, resamples=2, level=0.02).coverage
        holds += np.mean(potential.value(z[300:]) < 0.02) >= stated
        assert 0 < stated < 1
    assert holds >= 17


def test_a_block_with_a_stray_sample_is_not_inside(rng):
    """One sample in ten strays: nine tenths of single samples are inside, and no block of ten."""
    z = draw(rng, 400)
    z[::10] *= 3.0 + rng.uniform(0, 3, (40, 1))
    potential = fit_potential(z, kernel=GaussianKernel(3.0), lam=1e-2)
    settings = {"rng": rng, "confidence": 0.95, "level": 0.05}
    assert 0.8 < coverage(potential, **settings) < 0.95
    assert coverage(potential, **settings, block=10) == 0.0


def test_independent_samples_are_all_effective_and_repeated_ones_are_not(rng):
    """White samples: nearly N. Each sample held for 10: N/10 (correlation 1 - l/10 over lags l < 10 sums to 4.5)."""
    z = draw(rng, 1000)
    assert effective_sample_size(z, GaussianKernel(1.0)) > 600
    held = np.repeat(z[:200], 10, axis=0)
    assert effective_sample_size(held, GaussianKernel(1.0)) == pytest.approx(200, rel=0.35)


def test_blocks_widen_the_bootstrap(rng):
    """Held samples look ten times as many as they are; blocks of ten undo it."""
    held = np.repeat(draw(rng, 40), 10, axis=0)
    potential = fit_potential(held, kernel=GaussianKernel(1.0), lam=0.15)
    plain, blocked = (bootstrap_radius(potential, rng=rng, resamples=60, block=b) for b in (1, 10))
    assert blocked > 1.8 * plain


def test_too_few_samples_are_refused(rng):
    with pytest.raises(ValueError, match="at least 8 samples"):
        certify(fit_potential(draw(rng, 5), kernel=GaussianKernel(1.0), lam=0.1), rng=rng)
