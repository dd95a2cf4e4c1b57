"""V_z learned with the known noise of its samples: of the set without noise, which the closed form has."""

import numpy as np
import pytest

from eal import GaussianKernel, LaplaceKernel, Tail, fit_potential
from tests.reference import circle

RADII = np.linspace(0.0, 2.0, 21)
ANGLES = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
GRID = RADII[:, None, None] * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)
LAM = 1e-2


def noisy_circle(rng, n, sd):
    """Points of the unit circle with noise of a standard deviation each."""
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    noise = np.broadcast_to(sd, (n,))[:, None] * rng.standard_normal((n, 2))
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) + noise


def errors(z, covariances):
    """Sup over radii of |V - V_j|, V averaged over the directions, as taken and with the noise known."""
    truth = circle.value(RADII, 1.0, Tail(), LAM)
    kernel = GaussianKernel(1.0)
    found = [fit_potential(z, kernel=kernel, lam=LAM, covariances=c).value(GRID) for c in (None, covariances)]
    return [float(np.abs(v.mean(axis=1) - truth).max()) for v in found]


@pytest.mark.parametrize("sd", [0.1, 0.3])
def test_noise_that_is_known_does_not_widen_the_valley(rng, sd):
    """1500 points, noise of 0.1 and 0.3: at most a third of the error (0.25 and 0.50 as they are)."""
    plain, known = errors(noisy_circle(rng, 1500, sd), sd**2 * np.eye(2))
    assert known < plain / 3.0


def test_each_sample_has_its_own_noise(rng):
    """Half of the samples with noise of 0.05, half with 0.3: with one mean covariance for all it is worse."""
    sd = np.repeat([0.05, 0.3], 800)
    z = noisy_circle(rng, 1600, sd)
    own = errors(z, sd[:, None, None] ** 2 * np.eye(2))[1]
    assert own < 0.5 * errors(z, np.mean(sd) ** 2 * np.eye(2))[1]


def test_no_noise_is_an_ordinary_fit(rng):
    """Covariances of 0 give the same V as none, to 2 sqrt(1e-9 / lambda) of the coarser factor."""
    z = noisy_circle(rng, 200, 0.05)
    plain, known = (
        fit_potential(z, kernel=GaussianKernel(1.0), lam=LAM, covariances=c) for c in (None, np.zeros((2, 2)))
    )
    np.testing.assert_allclose(known.value(GRID), plain.value(GRID), atol=6e-4)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"covariances": 0.3 * np.eye(2)}, r"noise must be below 1 / sqrt\(4 beta\) = 0.5, but is up to 0.548"),
        ({"covariances": np.eye(3)}, r"must have shape \(2, 2\) or \(50, 2, 2\), but have \(3, 3\)"),
        ({"covariances": -np.eye(2)}, "no eigenvalue below 0"),
        ({"covariances": np.eye(2), "kernel": LaplaceKernel(1.0)}, "covariances need a GaussianKernel"),
    ],
)
def test_noise_that_cannot_be_taken_out_is_named(rng, settings, message):
    with pytest.raises(ValueError, match=message):
        fit_potential(noisy_circle(rng, 50, 0.1), **({"kernel": GaussianKernel(1.0), "lam": LAM} | settings))
