"""Constant acceleration: its noise as filterpy and van Loan have it, and parabolas without error."""

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from filters.ensemble import Gaussian
from filters.learn_markers import jerk_moments, learn_constant_acceleration
from filters.motion.base import Step
from filters.motion.constant_acceleration import ConstantAcceleration, white_jerk
from filters.observations import PositionObservations
from filters.track import filter_forward, smooth

DT_S = 0.005


def model(n_markers=2, **more):
    rng = np.random.default_rng(1)
    options = {
        "start_m": rng.normal(size=(n_markers, 3)),
        "start_sd_m": 1.0,
        "speed_sd_m_s": 5.0,
        "acceleration_sd_m_s2": np.full(n_markers, 50.0),
        "density": rng.uniform(1e2, 1e4, n_markers),
    }
    return ConstantAcceleration(**(options | more))


@given(density=st.floats(1e-3, 1e6), dt_s=st.floats(1e-4, 0.5))
def test_white_jerk_is_filterpys_and_van_loans(density, dt_s):
    """Q of filterpy's continuous white noise of order 3, and the block of van Loan's matrix exponential (1978)."""
    factor = white_jerk(np.array([density]), dt_s)[0]
    assert not np.triu(factor, 1).any()
    found = factor @ factor.T
    np.testing.assert_allclose(found, Q_continuous_white_noise(dim=3, dt=dt_s, spectral_density=density), rtol=1e-9)
    unit = np.diag(dt_s ** np.array([2.0, 1.0, 0.0]))  # in units in which the exponential is of numbers near 1
    drift, drive = np.eye(3, k=1), np.zeros((3, 3))
    drive[2, 2] = density * dt_s
    loan = expm(np.block([[-drift, drive], [np.zeros((3, 3)), drift.T]]))
    np.testing.assert_allclose(found, unit @ loan[3:, 3:].T @ loan[:3, 3:] @ unit, rtol=1e-9)


@given(first=st.floats(1e-3, 0.05), second=st.floats(1e-3, 0.05))
def test_two_steps_are_one(first, second):
    """A step of dt1 and one of dt2 is one of dt1 + dt2, in transition and in noise."""
    (a1, q1), (a2, q2), (a, q) = (parts(model(), dt) for dt in (first, second, first + second))
    np.testing.assert_allclose(a2 @ a1, a, atol=1e-14)
    sd = np.sqrt(np.diag(q))
    np.testing.assert_allclose((a2 @ q1 @ a2.T + q2) / np.outer(sd, sd), q / np.outer(sd, sd), atol=1e-9)


def parts(own, dt_s):
    """Transition and noise covariance."""
    n, noise = own.points.n, own.noise(dt_s)
    return own.predict(Gaussian(np.zeros(n), np.eye(n)), Step(1, dt_s, noise)).rows.T, noise @ noise.T


def test_parabolas_are_exact():
    """Without noise in motion or measurements a parabola is followed and carried on to rounding.

    Observed with 1 um and jerks of 1e-6 m/s^3 for 0.25 s: 50 frames fix the acceleration to 1 um / 0.25^2 s^2 ~ 16
    um/s^2 times a few; 30 hidden frames after that (0.15 s) are off by that, and by the prior's share: below 1 um.
    """
    rng = np.random.default_rng(2)
    t_s = np.arange(80) * DT_S
    start, speed, pull = rng.normal(size=(3, 2, 3))
    truth = start + speed * t_s[:, None, None] + 0.5 * 9.81 * pull * t_s[:, None, None] ** 2
    shown = truth.copy()
    shown[50:] = np.nan
    shown[20:30, 0] = np.nan
    own = model(density=np.full(2, 1e-12))
    found = smooth(own, PositionObservations(xyz_m=shown, sd_m=np.full((80, 2), 1e-6)), t_s)
    assert np.abs(found.xyz_m - truth).max() < 1e-6


def test_filterpys_filter_agrees():
    """One marker, one coordinate: means and covariances of filterpy's linear Kalman filter, which costs it 1e-9."""
    rng = np.random.default_rng(3)
    own, n = model(1), 40
    t_s, xyz, sd = np.arange(n) * DT_S, rng.normal(size=(n, 1, 3)), np.full((n, 1), 0.01)
    peer = KalmanFilter(dim_x=3, dim_z=1)
    peer.x = np.array([own.start_m[0, 0], 0, 0])[:, None]
    peer.P = np.diag([1.0, 5.0, 50.0]) ** 2
    peer.F = np.array([[1, DT_S, DT_S**2 / 2], [0, 1, DT_S], [0, 0, 1]])
    peer.Q = Q_continuous_white_noise(dim=3, dt=DT_S, spectral_density=own.density[0])
    peer.H, peer.R = np.array([[1.0, 0, 0]]), np.array([[1e-4]])
    observations = PositionObservations(xyz_m=xyz, sd_m=sd)
    for frame, state in enumerate(filter_forward(own, observations, t_s, gate_sd=1e9).states):
        if frame:
            peer.predict()
        peer.update(xyz[frame, 0, 0])
        scale = np.sqrt(np.diag(peer.P))
        np.testing.assert_allclose(state.mean[[0, 3, 6]] / scale, peer.x[:, 0] / scale, rtol=1e-8, atol=1e-7)
        at = np.ix_([0, 3, 6], [0, 3, 6])
        np.testing.assert_allclose(state.cov[at] / np.outer(scale, scale), peer.P / np.outer(scale, scale), atol=1e-7)


@pytest.mark.parametrize(("a", "hz"), [(1.0, 2.0), (0.3, 8.0)])
def test_the_jerk_of_an_oscillation(a, hz):
    """For a sine of variance v at w: acceleration sd sqrt(v) w^2, density 2 v w^5, to smoothing and differences.

    Half amplitude at 30 Hz costs (8/30)^4 = 0.5 % at 8 Hz; each of three central differences 1 - sin(w dt)/(w dt) = 1
    %, and it is five of them in the density.
    """
    t = np.arange(2000) * DT_S
    sine = a * np.sqrt(2) * np.sin(2 * np.pi * hz * t)[:, None]
    sd, density = jerk_moments(sine, dt_s=DT_S, cutoff_hz=30.0)
    assert sd[0] == pytest.approx(a * (2 * np.pi * hz) ** 2, rel=0.04)
    assert density[0] == pytest.approx(2 * a**2 * (2 * np.pi * hz) ** 5, rel=0.08)


def test_learned_from_a_recording():
    """Markers that swing faster have more jerk; one that rests, one hardly seen and one never seen have some."""
    t = np.arange(400) * DT_S
    xyz = np.zeros((400, 5, 3))
    for marker, hz in enumerate((2.0, 6.0)):
        xyz[:, marker] = 0.1 * np.sin(2 * np.pi * hz * t[:, None] + np.arange(3))
    xyz[5:, 3], xyz[:, 4] = np.nan, np.nan
    found = learn_constant_acceleration(xyz, dt_s=DT_S)
    assert found.density[1] > 100 * found.density[0]
    assert found.density[3] == pytest.approx(found.density[4]) == pytest.approx(np.median(found.density[:3]))
    start = found.initial()
    assert np.isfinite(start.mean).all()
    assert (np.diag(start.factor) > 0).all()
    assert (np.diag(found.noise(DT_S)) > 0).all()
    seen = PositionObservations(xyz_m=xyz, sd_m=np.full((400, 5), 1e-3))
    error = smooth(found, seen, t).xyz_m[:, :3] - xyz[:, :3]
    assert np.sqrt(np.mean(error**2)) < 1e-3  # the data have no noise, the model does not know


@pytest.mark.parametrize("n_frames", [1, 2, 5])
def test_few_frames(n_frames):
    """A recording of a frame or two has a model, with numbers."""
    found = learn_constant_acceleration(np.random.default_rng(4).normal(size=(n_frames, 3, 3)), dt_s=DT_S)
    assert np.isfinite(found.initial().mean).all()
    assert (found.density > 0).all()
    assert (np.diag(found.noise(DT_S)) > 0).all()
