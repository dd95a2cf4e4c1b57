"""Peers that look at one marker at a time: curves, filters, Kalman smoothers."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.signal import butter, sosfreqz

from benchmarks.gaps.peers.coordinates import World
from benchmarks.gaps.peers.interpolation import InterpolationFiller, low_pass
from benchmarks.gaps.peers.kalman import (
    KalmanFiller,
    filter_series,
    likeliest_density,
    smooth_series,
    transition,
    wide_prior,
)
from tests.benchmarks.gaps.peer_trials import hidden, make_trial


@pytest.mark.parametrize(("curve", "degree"), [("linear", 1), ("pchip", 1), ("cubic", 3)])
def test_a_curve_fills_polynomials_of_its_degree(curve, degree):
    """Exact but for rounding, of numbers of size 1 with four sums each."""
    t = np.linspace(-1, 1, 60)
    rng = np.random.default_rng(0)
    limbs = np.polynomial.polynomial.polyval(t, rng.normal(size=(degree + 1, 6, 3))).transpose(2, 0, 1)
    trial = make_trial(limbs)
    shown = replace(trial, xyz_m=hidden(trial, ("a", "d"), np.r_[5:9, 20:45]))
    filled = InterpolationFiller(World(), curve, None)(shown)
    np.testing.assert_allclose(filled.xyz_m, trial.xyz_m, atol=1e-11)


def test_a_curve_holds_the_ends_and_never_invents_a_marker():
    """Before its first sighting a marker stays there; one that is never seen stays unknown."""
    trial = make_trial(np.random.default_rng(0).normal(size=(40, 6, 3)))
    xyz = hidden(trial, ("a",), np.arange(10))
    xyz[:, trial.names.index("b")] = np.nan
    filled = InterpolationFiller(World(), "cubic", None)(replace(trial, xyz_m=xyz)).xyz_m
    a = filled[:, trial.names.index("a")]
    np.testing.assert_allclose(a[:10], np.repeat(a[10][None], 10, axis=0))
    assert np.isnan(filled[:, trial.names.index("b")]).all()


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_low_pass_has_the_gain_of_two_butterworth_filters(share):
    """A sine is scaled by |H|^2 and not delayed; the ends, where the filter swings in, are left out."""
    frequency = 0.8 * share
    wave = np.sin(np.pi * frequency * np.arange(2000))[:, None, None] * np.ones((1, 1, 3))
    _, response = sosfreqz(butter(2, share, output="sos"), worN=[np.pi * frequency])
    middle = slice(400, 1600)
    np.testing.assert_allclose(low_pass(wave, share)[middle], abs(response[0]) ** 2 * wave[middle], atol=1e-6)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_transition_is_a_semigroup(order):
    """Two steps are one step of double length: Q(2) = F Q F^T + Q, with Q(t) scaled by powers of t."""
    step, noise = transition(order)
    powers = np.arange(order)[::-1]
    double = noise * 2.0 ** (powers[:, None] + powers + 1)
    np.testing.assert_allclose(step @ noise @ step.T + noise, double, rtol=1e-13)


@pytest.mark.parametrize("order", [2, 3])
def test_smoother_equals_filterpy(order):
    """Means, covariances and likelihood of two series with gaps; rounding grows with the prior's condition, 1e6."""
    rng = np.random.default_rng(order)
    y = np.cumsum(rng.normal(size=(50, 2, 3)), axis=0)
    y[10:17, 0], y[30:33, 1] = np.nan, np.nan
    step, unit = transition(order)
    density, variance = np.array([0.5, 2.0]), np.array([0.1, 0.3])
    mean, cov = wide_prior(y, order)
    run = filter_series(y, variance, step, density[:, None, None] * unit, mean=mean, cov=cov)
    smoothed, spread = smooth_series(run, step)
    for b in range(2):
        total = 0.0
        for axis in range(3):
            peer = KalmanFilter(dim_x=order, dim_z=1)
            peer.F, peer.H, peer.Q = step, np.eye(1, order), density[b] * unit
            peer.R, peer.x, peer.P = variance[b : b + 1, None], mean[b, :, axis : axis + 1], cov[b]
            means, covs = [], []
            for t, value in enumerate(y[:, b, axis]):
                if t:
                    peer.predict()
                if np.isfinite(value):
                    peer.update(value)
                    total += peer.log_likelihood
                means.append(peer.x)
                covs.append(peer.P)
            expected, expected_cov, _, _ = peer.rts_smoother(np.array(means), np.array(covs))
            np.testing.assert_allclose(smoothed[:, b, :, axis], expected[..., 0], rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(spread[:, b], expected_cov, rtol=1e-7, atol=1e-8)
        assert run.log_likelihood[b] == pytest.approx(total, rel=1e-10)


def test_the_likeliest_density_is_the_true_one_and_intervals_hold():
    """Tracks drawn from the model: half a decade of the density (300 samples tell 10 %), 95 % inside 95 % intervals.

    Some 6 x 3 x 60 hidden coordinates in twelve gaps that err together: the share spreads by about 2 %.
    """
    rng = np.random.default_rng(3)
    step, unit = transition(2)
    density, sd = 1e-7, 1e-4
    noise = np.linalg.cholesky(density * unit)
    x = np.zeros((300, 2, 6, 3))
    for t in range(1, 300):
        x[t] = np.einsum("ij,jmk->imk", step, x[t - 1]) + np.einsum("ij,jmk->imk", noise, rng.normal(size=(2, 6, 3)))
    trial = make_trial(x[:, 0] + sd * rng.normal(size=(300, 6, 3)), sd_m=sd)
    limbs = trial.xyz_m[:, 4:]
    found = likeliest_density([limbs], np.full(6, sd), 2)
    assert np.abs(np.log10(found / density)).max() < 0.5

    frames = np.r_[40:60, 120:140, 200:220]
    shown = replace(trial, xyz_m=hidden(trial, trial.names[4:], frames))
    filled = KalmanFiller(World(), 2, np.full(10, density))(shown)
    error = (filled.xyz_m - trial.xyz_m)[frames][:, 4:]
    inside = np.abs(error) < 1.96 * np.sqrt(np.diagonal(filled.cov_m2[frames][:, 4:], axis1=-2, axis2=-1))
    assert 0.90 < inside.mean() < 0.99
