"""Accelerations that last: closed forms of a step, what it comes to at both ends, and what it is learned from."""

import numpy as np
import pytest
from mocap.filters.models.constant_velocity import learn_lasting
from mocap.filters.motion.constant_velocity import lasting_acceleration, white_acceleration


def test_two_half_steps_are_one():
    move, noise = lasting_acceleration(0.03, 0.02)
    half, half_noise = lasting_acceleration(0.03, 0.01)
    np.testing.assert_allclose(half @ half, move, atol=1e-14)
    np.testing.assert_allclose(half @ half_noise @ half.T + half_noise, noise, atol=1e-15)


@pytest.mark.parametrize("dt_s", [0.001, 0.05, 1.0])
def test_the_step_is_singer_s(dt_s):
    """His equations 9 and 10: with a = 1 / tau, and the variance 1 of the acceleration."""
    tau = 0.04
    a, t = 1 / tau, dt_s
    move, noise = lasting_acceleration(tau, dt_s)
    e = np.exp(-a * t)
    expected = [[1, t, (a * t - 1 + e) / a**2], [0, 1, (1 - e) / a], [0, 0, e]]
    np.testing.assert_allclose(move, expected, rtol=1e-9, atol=1e-18)
    q33 = 1 - e**2
    q23 = (e**2 + 1 - 2 * e) / a
    q22 = (4 * e - 3 - e**2 + 2 * a * t) / a**2
    np.testing.assert_allclose([noise[2, 2], noise[1, 2], noise[1, 1]], [q33, q23, q22], rtol=1e-5)


def test_short_memory_is_constant_velocity():
    """Tau -> 0 at the density 2 tau of the acceleration: white acceleration."""
    tau, dt_s = 1e-6, 0.01
    _, noise = lasting_acceleration(tau, dt_s)
    l11, l21, l22 = white_acceleration(np.array([2 * tau]), dt_s)
    factor = np.array([[l11[0], 0.0], [l21[0], l22[0]]])
    np.testing.assert_allclose(noise[:2, :2], factor @ factor.T, rtol=1e-3)


def test_long_memory_is_constant_acceleration():
    move, noise = lasting_acceleration(1e6, 0.01)
    np.testing.assert_allclose(move, [[1, 0.01, 5e-5], [0, 1, 0.01], [0, 0, 1]], atol=1e-9)
    assert np.abs(noise).max() < 1e-7


def test_an_oscillation_teaches_its_size_and_its_time():
    """A marker that swings by r at w: accelerations of r w^2 / sqrt 2, which last for one radian."""
    dt_s, w, r = 1 / 500, 2 * np.pi * 8, 0.02
    t_s = np.arange(600) * dt_s
    xyz = r * np.sin(w * t_s[:, None, None] + np.array([[0.0, 1.0, 2.0], [0.5, 1.5, 2.5]]))
    xyz[100:120, 0] = np.nan
    model = learn_lasting(xyz, dt_s=dt_s)
    np.testing.assert_allclose(model.acceleration_m_s2, r * w**2 / np.sqrt(2), rtol=0.1)
    assert model.memory_s == pytest.approx(1 / w, rel=0.1)
    never = np.full_like(xyz[:, :1], np.nan)
    assert np.isfinite(learn_lasting(np.concatenate([xyz, never], axis=1), dt_s=dt_s).acceleration_m_s2).all()
