"""The relative bound of the Tikhonov filter, on the circle where leverage and dimension are closed forms."""

import numpy as np
import pytest

from eal import GaussianKernel, Tail, Tikhonov, bounds, circle, fit_potential
from eal.relative import accuracy, certify_relative, exceedance

LAM = 1e-3
LAMBDAS = circle.eigenvalues(1.0)
DIMENSION = float((LAMBDAS / (LAMBDAS + LAM)).sum())
TOP = float(LAMBDAS[0] / (LAMBDAS[0] + LAM))


def draw(rng, n):
    angle = rng.uniform(0, 2 * np.pi, n)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def fit(z, spectral_filter=None):
    return fit_potential(z, kernel=GaussianKernel(1.0), lam=LAM, spectral_filter=spectral_filter or Tikhonov())


def test_leverage_on_the_circle_is_the_dimension(rng):
    """By symmetry (A^-1 K_x, K_x) = V_j / lambda is one number on the circle, and its mean is the trace D."""
    assert circle.value(np.array(1.0), 1.0, Tikhonov(), LAM) / LAM == pytest.approx(DIMENSION, rel=1e-9)
    certificate = certify_relative(fit(draw(rng, 4000)))
    assert certificate.leverage == pytest.approx(DIMENSION, rel=0.25)
    assert certificate.dimension == pytest.approx(DIMENSION, rel=0.05)


def test_relative_bound_holds_everywhere_and_says_something(rng):
    """V_j/(1+eps) <= V_z <= V_j/(1-eps) at radii 0 to 2, in 40 draws of N = 2000 at 95 %: the Lipschitz bound is 60."""
    n, radii = 2000, np.linspace(0.0, 2.0, 21)
    grid = radii[:, None, None] * draw(rng, 60)
    truth = circle.value(radii, 1.0, Tikhonov(), LAM)[:, None]
    eps = accuracy(n=n, leverage=DIMENSION, dimension=DIMENSION, top=TOP)
    assert 0.1 < eps < 0.4
    assert bounds.radius(n=n, lam=LAM) > 50
    worst = []
    for _ in range(40):
        ratio = fit(draw(rng, n)).value(grid) / truth
        worst.append(max(float((1 / ratio).max()) - 1, 1 - float((1 / ratio).min())))
    assert max(worst) < eps
    assert max(worst) > eps / 8


def test_bound_holds_for_the_operator_itself(rng):
    """|A^-1/2 (T_z - T) A^-1/2| in the Fourier basis, 60 draws at several N: beyond eps no more often than stated."""
    for n in (200, 1000):
        norms = []
        for _ in range(60):
            angle = rng.uniform(0, 2 * np.pi, n)
            waves = [np.ones(n)] + [np.sqrt(2) * f(k * angle) for k in range(1, 15) for f in (np.cos, np.sin)]
            scaled = np.sqrt(LAMBDAS[:29] / (LAMBDAS[:29] + LAM))[:, None] * np.array(waves)
            norms.append(np.linalg.norm(scaled @ scaled.T / n - np.diag(LAMBDAS[:29] / (LAMBDAS[:29] + LAM)), 2))
        for eps in np.linspace(0.05, 0.95, 19):
            stated = exceedance(eps, n=n, leverage=DIMENSION, dimension=DIMENSION, top=TOP)
            assert np.mean(np.array(norms) > eps) <= stated


def test_accuracy_inverts_the_exceedance():
    eps = accuracy(n=5000, leverage=9.0, dimension=8.0, confidence=0.9, top=0.99)
    assert exceedance(eps, n=5000, leverage=9.0, dimension=8.0, top=0.99) == pytest.approx(0.1)
    assert accuracy(n=10, leverage=9.0, dimension=8.0) == np.inf


def test_distribution_free_theorem_needs_one_over_lambda(rng):
    """R, D <= 1/lambda: at N = 400/lambda it says something, where the Lipschitz bound needs 7.5/lambda^2."""
    assert accuracy(n=400 / LAM, leverage=1 / LAM, dimension=1 / LAM) < 0.5
    certificate = certify_relative(fit(draw(rng, 2000)))
    assert certificate.eps_theorem == np.inf
    assert certificate.eps_estimate < 0.5


def test_relative_certificate_is_for_tikhonov(rng):
    with pytest.raises(ValueError, match="not for tail"):
        certify_relative(fit(draw(rng, 50), Tail()))
    with pytest.raises(ValueError, match="confidence must lie"):
        accuracy(n=10, leverage=9.0, dimension=8.0, confidence=0.0)
