"""Metric, kernel, lambda and weight by the likelihood of what was left out."""

import numpy as np
import pytest

from eal import GaussianKernel, LinearKernel, choose, fit_potential, load_potential, usual_kernel
from eal.choice import LAMBDAS, WEIGHTS


def arc(rng, n, width=0.02):
    """A bend of 2 rad about the origin, noise across it."""
    angle = 1.5 + np.sin(np.linspace(0, 40, n))
    return (1.0 + width * rng.standard_normal(n))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def held_out(z, fold, kernel, lam, weights=(1.0,)):
    """Mean log density of each fold by the potential of the others for each weight, integrals by sums over a grid."""
    axis = np.linspace(-1.8, 1.8, 181)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    total, weights = np.zeros(len(weights)), np.array(weights)
    for one in np.unique(fold):
        v = fit_potential(z[fold != one], kernel=kernel, lam=lam, method="exact")
        integral = ((1.0 - v.value(grid)) ** weights[:, None]).sum(axis=1) * (axis[1] - axis[0]) ** 2
        total += weights * np.log(1.0 - v.value(z[fold == one])).sum() - (fold == one).sum() * np.log(integral)
    return total / len(z)


@pytest.mark.parametrize("scales", [(1.0, 1.0), (1.0, 0.4)])
def test_it_is_the_likelihood_by_brute_force(rng, scales):
    """The stated likelihood is that of potentials fitted to the other blocks; no neighbour on the grid has more."""
    z = arc(rng, 100, width=0.1) * scales
    fold = np.arange(100) * 5 // 100
    found = choose(z)
    by_weight = held_out(z, fold, found.kernel, found.lam, WEIGHTS)
    assert found.log_likelihood == pytest.approx(by_weight[WEIGHTS.index(1.0)], abs=0.01)
    beta = found.kernel.kernel.beta if isinstance(found.kernel, LinearKernel) else found.kernel.beta
    for factor in (0.5, 2.0):
        other = GaussianKernel(factor * beta)
        if isinstance(found.kernel, LinearKernel):
            other = LinearKernel(other, found.kernel.matrix)
        assert held_out(z, fold, other, found.lam) < found.log_likelihood
    assert held_out(z, fold, usual_kernel(z), 1e-3) < found.log_likelihood - 0.1
    assert max(by_weight) - by_weight[WEIGHTS.index(found.weight)] < 0.05  # what the draws know of the integral
    assert found.lam in LAMBDAS


def test_units_of_coordinates(rng):
    """Degrees beside metres are whitened; whatever the unit of all, the same V is chosen."""
    z = np.column_stack([arc(rng, 100)[:, 0], 60.0 * arc(rng, 100)[:, 0]])
    one, other = choose(z), choose(1000.0 * z)
    assert one.metric == other.metric == "whitened"
    assert (one.width, one.lam, one.weight) == (other.width, other.lam, other.weight)
    v = fit_potential(z, kernel=one.kernel, lam=one.lam).value(z[::7])
    again = fit_potential(1000.0 * z, kernel=other.kernel, lam=other.lam).value(1000.0 * z[::7])
    np.testing.assert_allclose(v, again, atol=1e-6)


def test_coordinates_in_units_of_their_noise(rng):
    """Four places on a square, and noise that is thirty times larger along one diagonal than across it."""
    turn = np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2.0)
    places = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]])[rng.integers(0, 4, 400)]
    root = turn.T * [0.3, 0.01]
    z = places + rng.standard_normal((400, 2)) @ root.T
    assert choose(z, covariances=root @ root.T).metric == "noise"


def test_noise_limits_the_width(rng):
    """No kernel whose deconvolution more than half of the samples would be too noisy for."""
    z = arc(rng, 200)
    known = 0.1**2 * np.eye(2)
    found = choose(z, covariances=known)
    assert 2.0 * found.kernel.curvature * 0.1**2 <= 0.5 < 2.0 * choose(z).kernel.curvature * 0.1**2
    fit_potential(z, kernel=found.kernel, lam=found.lam, covariances=known)


def test_whole_trials_are_left_out(rng):
    """Trials that differ by a shift want a kernel that spans it; samples of all of them do not."""
    shift = 0.3 * rng.standard_normal((8, 2))
    z = np.concatenate([arc(rng, 40) + s for s in shift])
    order = rng.permutation(len(z))
    by_trial = choose(z, trials=np.repeat(np.arange(8), 40).tolist())
    mixed = choose(z[order])
    assert by_trial.kernel.curvature < 0.3 * mixed.kernel.curvature


@pytest.mark.parametrize(
    ("trials", "message"),
    [(["a"] * 50, "one trial cannot be left out: give samples of two"), (["a"] * 3, "each of the 50 samples")],
)
def test_what_cannot_be_left_out_is_named(rng, trials, message):
    with pytest.raises(ValueError, match=message):
        choose(arc(rng, 50), trials=trials)


def test_another_metric_is_the_same_potential_of_other_coordinates(rng, tmp_path):
    """V, its gradient and Hessian by the chain rule, with covariances too, and back from a file."""
    z, a = arc(rng, 120), np.array([[2.0, 0.5], [0.0, 0.7]])
    kernel = LinearKernel(GaussianKernel(3.0), tuple(map(tuple, a.tolist())))
    q, noise = rng.normal(size=(9, 2)), 0.05**2 * np.eye(2)
    for covariances in (None, noise):
        other = None if covariances is None else a @ noise @ a.T
        one = fit_potential(z, kernel=kernel, lam=1e-2, covariances=covariances)
        two = fit_potential(z @ a.T, kernel=GaussianKernel(3.0), lam=1e-2, covariances=other)
        one.save(tmp_path / "v.npz")
        for v in (one, load_potential(tmp_path / "v.npz")):
            np.testing.assert_allclose(v.value(q), two.value(q @ a.T), atol=1e-9)
            np.testing.assert_allclose(v.gradient(q), two.gradient(q @ a.T) @ a, atol=1e-9)
            np.testing.assert_allclose(v.hessian(q), a.T @ two.hessian(q @ a.T) @ a, atol=1e-9)
    assert kernel.curvature == pytest.approx(6.0 * np.linalg.norm(a, 2) ** 2)
    with pytest.raises(ValueError, match="must be square and have an inverse"):
        LinearKernel(GaussianKernel(3.0), ((1.0, 1.0), (1.0, 1.0)))
