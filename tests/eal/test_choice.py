"""Choice of beta and lambda: closed-form normaliser, the V of the balance, likelihood that finds the truth."""

import numpy as np
import pytest

from eal import GaussianKernel, LaplaceKernel, fit_potential
from eal.choice import by_balance, by_likelihood, log_normaliser, median_beta
from eal.circle import eigenvalues


def arc(rng, n, noise):
    angle = rng.uniform(0, 2, n)
    radius = 1 + noise * rng.standard_normal(n)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def test_normaliser_is_the_integral(rng):
    """Log of the integral of 1 - V on a grid whose spacing is far below the kernel's width."""
    potential = fit_potential(arc(rng, 50, 0.05), kernel=GaussianKernel(3.0), lam=1e-3)
    axis = np.linspace(-3, 4, 281)
    inside = 1 - potential.value(np.stack(np.meshgrid(axis, axis), axis=-1))
    assert log_normaliser(potential) == pytest.approx(np.log(inside.sum() * (axis[1] - axis[0]) ** 2), abs=1e-8)


def test_normaliser_of_one_sample_in_any_dimension():
    """1 - V = exp(-2 beta r^2): Z = (pi / 2 beta)^(d/2)."""
    for d in (1, 3, 10):
        potential = fit_potential(np.zeros((1, d)), kernel=GaussianKernel(2.0), lam=1e-6)
        assert log_normaliser(potential) == pytest.approx(0.5 * d * np.log(np.pi / 4.0), rel=1e-12)


def test_median_beta_scales_with_the_unit(rng):
    """In millimetres beta is a million times smaller than in metres."""
    z = arc(rng, 300, 0.05)
    assert median_beta(1000 * z) == pytest.approx(1e-6 * median_beta(z))
    squared = ((z[:, None] - z) ** 2).sum(axis=2)[np.triu_indices(300, 1)]
    assert median_beta(z) == pytest.approx(1 / np.median(squared))


def test_balance_shows_the_v(rng):
    """Bias rises with lambda, the bound on the variance is |T_z - T| / lambda, and the sum has its least inside."""
    lams = np.logspace(-4, 0, 15)
    choice = by_balance(arc(rng, 90, 0.05), lams.tolist(), kernel=GaussianKernel(3.0), rng=rng)
    bias, variance = choice.parts["bias"][0], choice.parts["variance"][0]
    assert (np.diff(bias) > 0).all()
    assert lams[0] < choice.lam < lams[-1]
    assert choice.score.min() < 0.7 * min(choice.score[0, 0], choice.score[0, -1])
    assert (choice.parts["measured"][0] < np.maximum(variance, 0.1)).all()


def test_balance_measures_the_operator_error(rng):
    """On the circle lambda x variance is |T_z - T_rho|_HS, sqrt((1 - |T|^2)/N) on average: within 15 % of it."""
    angle = rng.uniform(0, 2 * np.pi, 300)
    z = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    choice = by_balance(z, [1.0], kernel=GaussianKernel(1.0), rng=rng, repeats=20)
    expected = np.sqrt((1 - (eigenvalues(1.0) ** 2).sum()) / 300)
    assert choice.parts["variance"][0, 0] == pytest.approx(expected, rel=0.15)


def test_likelihood_prefers_the_width_of_the_noise(rng):
    """Held-out likelihood: less noise asks for a larger beta, and both extremes of beta lose."""
    betas, lams = np.logspace(-0.5, 4, 10), np.logspace(-5, -1, 5)
    found = [by_likelihood(arc(rng, 200, noise), betas.tolist(), lams.tolist()) for noise in (0.2, 0.02)]
    assert found[0].beta < found[1].beta
    for choice in found:
        best = choice.score.min(axis=1)
        assert best.min() < min(best[0], best[-1])


@pytest.mark.parametrize(
    ("run", "message"),
    [
        (lambda rng: by_balance(np.zeros((4, 2)), [0.1], kernel=GaussianKernel(1.0), rng=rng), "at least 12"),
        (lambda rng: by_likelihood(rng.normal(size=(9, 2)), [1.0], [0.1]), "need 10 samples"),
        (lambda rng: median_beta(np.zeros((9, 2)) + 0 * rng.normal()), "half of them coincide"),
        (
            lambda rng: log_normaliser(fit_potential(rng.normal(size=(9, 2)), kernel=LaplaceKernel(1.0), lam=0.1)),
            "Gaussian kernel",
        ),
    ],
)
def test_what_cannot_be_chosen_is_named(run, message, rng):
    with pytest.raises(ValueError, match=message):
        run(rng)
