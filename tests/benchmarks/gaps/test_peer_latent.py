"""Latent-variable peers: derivatives, published behaviour of GPLVM and GPDM, regression, tracking on a cycle."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from benchmarks.gaps.peers import intervals
from benchmarks.gaps.peers.gpdm import between, stride
from benchmarks.gaps.peers.gpdm import peers as process_peers
from benchmarks.gaps.peers.gplvm import _dynamics, _reconstruction, fit_latent
from benchmarks.gaps.peers.latent import regress
from benchmarks.gaps.peers.manifold import peers as embedding_peers
from tests.benchmarks.gaps.peer_trials import hidden, make_trial


def cycle(rng, n_frames, period, *, noise, width=20, mix=None):
    """Poses (T, width) of a cyclic motion with a second harmonic."""
    phase = 2 * np.pi * np.arange(n_frames)[:, None] / period
    waves = np.concatenate([np.cos(phase), np.sin(phase), 0.3 * np.cos(2 * phase), 0.3 * np.sin(2 * phase)], axis=1)
    mix = rng.normal(size=(4, width)) if mix is None else mix
    return waves @ mix + noise * rng.normal(size=(n_frames, width))


def test_derivatives_are_those_of_the_objectives():
    """Forward differences of step 1e-7 of functions of size 100: 1e-4."""
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(10, 2)), rng.normal(size=(10, 5))
    before = np.r_[0:4, 5:9]
    hyper = np.array([0.2, 0.1, 2.0]), np.array([0.2, 0.1, -1.0, 2.0])

    def reconstruction(theta):
        return _reconstruction(theta[:20].reshape(10, 2), y @ y.T, 5, theta[20:])

    def dynamics(theta):
        return _dynamics(theta[:20].reshape(10, 2), before, theta[20:])

    for part, values in zip((reconstruction, dynamics), hyper, strict=True):
        theta = np.r_[x.ravel(), values]
        _, by_points, by_hyper = part(theta)
        numeric = approx_fprime(theta, lambda v, part=part: part(v)[0], 1e-7)
        np.testing.assert_allclose(np.r_[by_points.ravel(), by_hyper], numeric, atol=1e-4 * np.abs(numeric).max())


def test_cyclic_motion_becomes_a_ring_rounder_and_smoother_with_dynamics():
    """Wang, Fleet & Hertzmann 2008, figures 3 and 4: GPDM's latent walk is a smooth ring where GPLVM's jumps.

    Four noisy recordings of five cycles. Smooth: second differences, in units of the walk's size, are less than half as
    large in each. Round: radii vary less on average.
    """
    roundness, roughness = {}, {}
    for name, weight in (("gplvm", None), ("gpdm", 1.0)):
        for seed in range(4):
            poses = cycle(np.random.default_rng(seed), 120, 24, noise=0.3)
            points = fit_latent([poses[:60], poses[60:]], 2, dynamics=weight).points
            radius = np.linalg.norm(points - points.mean(axis=0), axis=1)
            bend = np.linalg.norm(np.diff(points[:60], 2, axis=0), axis=1).mean() / points.std()
            roundness.setdefault(name, []).append(radius.std() / radius.mean())
            roughness.setdefault(name, []).append(bend)
    assert (np.array(roughness["gpdm"]) < 0.5 * np.array(roughness["gplvm"])).all()
    assert np.mean(roundness["gpdm"]) < np.mean(roundness["gplvm"])


def test_left_out_residuals_are_those_of_fits_without_the_sample():
    """Equation 5.12 of Rasmussen & Williams against twelve regressions of eleven samples, same kernel and noise."""
    rng = np.random.default_rng(1)
    inputs = rng.normal(size=(12, 2))
    outputs = np.sin(inputs) + 0.05 * rng.normal(size=(12, 2))
    found = regress(inputs, outputs, lengths=np.array([1.0]))
    kernel = np.exp(-0.5 * ((inputs[:, None] - inputs) ** 2).sum(axis=-1))
    centred = outputs - outputs.mean(axis=0)
    noise = np.linalg.lstsq(found.weights.ravel()[:, None], (centred - kernel @ found.weights).ravel(), rcond=None)[0][
        0
    ]
    left = []
    for k in range(12):
        rest = np.delete(np.arange(12), k)
        weights = np.linalg.solve(kernel[np.ix_(rest, rest)] + noise * np.eye(11), centred[rest])
        left.append(centred[k] - kernel[k, rest] @ weights)
    np.testing.assert_allclose(found.noise_sd, np.sqrt(np.mean(np.square(left), axis=0)), rtol=1e-6)


def test_stride_of_a_sine():
    """Mean squared change 2 s^2 (1 - cos w k) reaches a tenth of 2 s^2 at k = acos(0.9) / w."""
    wave = np.column_stack([np.sin(0.05 * np.arange(1257)), np.cos(0.05 * np.arange(1257))])
    assert stride([wave]) == int(np.ceil(np.arccos(0.9) / 0.05))


def test_between_goes_through_the_latent_points():
    """Splines at every frame hit the points every ``step`` frames."""
    points = np.random.default_rng(2).normal(size=(11, 3))
    first, second = between(points, [6, 5], 4)
    np.testing.assert_allclose(first[::4], points[:6])
    np.testing.assert_allclose(second[::4], points[6:])


@pytest.mark.parametrize("method", [*embedding_peers(), *process_peers()], ids=lambda method: method.name)
def test_a_hidden_limb_of_a_cycle_is_tracked(monkeypatch, method):
    """All markers of a limb for two and a half cycles: less than a tenth of the motion is lost, which no curve can."""
    monkeypatch.setattr(intervals, "choose", lambda candidates, *_: candidates[0])
    monkeypatch.setattr(intervals, "validation", lambda _: [])
    rng = np.random.default_rng(3)
    mix = 0.02 * rng.normal(size=(4, 18))
    limbs = [cycle(rng, 240, 40, noise=2e-4, width=18, mix=mix).reshape(-1, 6, 3) for _ in range(3)]
    trials = [make_trial(x[7 * k :], sd_m=2e-4, name=f"t{k}") for k, x in enumerate(limbs)]
    frames = np.arange(80, 180)
    shown = replace(trials[2], xyz_m=hidden(trials[2], ("a", "b", "c"), frames))
    error = (method.learn(trials[:2])(shown).xyz_m - trials[2].xyz_m)[frames, 4:7]
    assert np.sqrt(np.mean(error**2)) < 0.1 * trials[2].xyz_m[:, 4:7].std(axis=0).mean()
