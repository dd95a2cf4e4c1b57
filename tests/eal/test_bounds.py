"""Bounds at cases that come close to them, so that neither a smaller nor a much larger one passes."""

import numpy as np
import pytest

from eal import GaussianKernel, Projection, bounds, fit_potential
from eal.integrators import simulate
from eal.lagrangian import PenalisedModel
from eal.systems import free_joint


def test_theorem_2_without_a_gap_is_nearly_reached():
    """One sample of M far points, lambda = 1: V is 0 at it, in the limit 1 - 1/M: so much is sup |V_j - V_z|.

    The bound is sqrt(1 - 1/M): 1 / sqrt(1 - 1/M) times loose, 1.054 for ten points.
    """
    m = 10
    points = 100.0 * np.arange(m)[:, None]
    limit, one = (fit_potential(z, kernel=GaussianKernel(1.0), lam=1.0) for z in (points, points[:1]))
    apart = np.abs(limit.value(points) - one.value(points)).max()
    assert apart == pytest.approx(1.0 - 1.0 / m)
    bound = bounds.theorem2_gap_free(n=1, lam=1.0, norm2=1.0 / m)
    assert apart <= bound <= 1.06 * apart


def test_exponents_are_those_of_the_proof():
    """Theorem 1: N gap^2 eta^2 / 32 up to 8 / (sqrt(N) gap), where both branches are exp(-2); without a gap / 8."""
    n, gap = 400.0, 0.5
    knee = 8.0 / (np.sqrt(n) * gap)
    assert bounds.theorem1(knee, n=n, gap=gap) == pytest.approx(2.0 * np.exp(-2.0))
    assert bounds.theorem1(1.5 * knee, n=n, gap=gap) == pytest.approx(2.0 * np.exp(-3.0))
    assert bounds.theorem1_gaussian(0.75 * knee, n=n, gap=gap) == pytest.approx(2.0 * np.exp(-2.0 * 0.75**2))
    assert bounds.gap_free(0.8, n=100.0, lam=0.5) == pytest.approx(2.0 * np.exp(-100.0 * 0.16 / 8.0))
    assert bounds.theorem2(n=n, gap=gap) == pytest.approx(2.0 / (20.0 * gap))
    assert bounds.sharper(0.25, n=100.0, lam=1.0, norm2=0.75) == pytest.approx(np.exp(-4.0))  # (2.5 - 0.5)^2


def test_theorem_2_is_nearly_reached_by_one_point_among_many():
    """One point of probability 0.49 among 4000 others, four samples: the mean of sup |V_j - V_z| is 1 - 0.49^4 there.

    The bound is 2.2 times that: C = 0.5 and even C = 0.9 do not hold.
    """
    share, others, n = 0.49, 4000, 4
    rng, points = np.random.default_rng(3), 100.0 * np.arange(others + 1)[:, None]
    gap = share - (1.0 - share) / others
    lam = share - 0.5 * gap
    apart = []
    for _ in range(200):
        drawn = np.where(rng.random(n) < share, 0, rng.integers(1, others + 1, n))
        seen = np.unique(drawn)
        found = fit_potential(points[drawn], kernel=GaussianKernel(1.0), lam=lam, spectral_filter=Projection())
        apart.append(np.abs(found.value(points[seen]) - (seen != 0)).max())
    mean = float(np.mean(apart))
    assert mean == pytest.approx(1.0 - share**n, abs=3.0 * np.sqrt(share**n / 200))
    assert 0.9 / (np.sqrt(n) * gap) < mean < bounds.theorem2(n=n, gap=gap)


def test_theorem_3_is_reached_where_all_energy_goes_into_v():
    """A free particle thrown up the valley's side stops where V(q0) + eps^2 T0 is: no bound below it holds."""
    potential = fit_potential(np.zeros((1, 1)), kernel=GaussianKernel(1.0), lam=1e-3)
    system, start, speed, strength = free_joint(1), np.array([0.3]), np.array([0.5]), 1.0
    kinetic = float(system.kinetic(start, speed))
    model = PenalisedModel(system=system, penalty=potential, strength=strength)
    path = simulate(model, start, speed, duration_s=3.0, h_s=1e-3).q
    bound = float(
        bounds.theorem3(strength, value0=potential.value(start), kinetic0=kinetic, potential0=0.0, potential_min=0.0)
    )
    peak = float(potential.value(path).max())
    assert peak <= bound * (1.0 + 1e-9)
    assert peak >= 0.999 * bound
