"""Peers that look at one marker at a time: curves, filters, Kalman smoothers."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from benchmarks.gaps.peers.coordinates import World
from benchmarks.gaps.peers.interpolation import InterpolationFiller
from benchmarks.gaps.peers.kalman import (
    filter_series,
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
