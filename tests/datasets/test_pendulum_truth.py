"""The pendulums against Jacobi's elliptic functions, conservation laws and the distribution of their noise."""

import json

import numpy as np
import pytest
from mocap.datasets.pendulums import make_pendulum, write_pendulum
from scipy.special import ellipj, ellipk
from scipy.stats import kstest

from eal.systems import GRAVITY_M_S2
from mocap.io.csv_table import read_table


def test_the_planar_pendulum_is_jacobis():
    """sin(phi / 2) = k sn(K - sqrt(g) t), phi = theta + pi / 2 from straight down, released at rest at 120 degrees."""
    recording = make_pendulum("planar")
    k = np.sin(np.pi / 3)
    sn, _, _, _ = ellipj(ellipk(k**2) - np.sqrt(GRAVITY_M_S2) * recording.t_s, k**2)
    # 10 s of DOP853 at 1e-12: some 300 steps, errors of which phase keeps the sum
    np.testing.assert_allclose(recording.q[:, 1], 2 * np.arcsin(k * sn) - np.pi / 2, atol=1e-9)
    assert (recording.q[:, 0] == 1).all()


def test_the_spherical_pendulums_height_is_jacobis():
    """x3'^2 = 2 (E - g x3)(1 - x3^2) - L^2, so x3 = a + (b - a) sn^2(K + w t) with roots a < b < c of the right side.

    w^2 = g (c - a) / 2 and k^2 = (b - a) / (c - a); it starts level, at b, and falls.
    """
    recording = make_pendulum("spherical")
    height = -np.sqrt(0.5)
    energy, spin = 0.5 + GRAVITY_M_S2 * height, np.sqrt(0.5)
    a, b, c = np.sort(np.roots([2 * GRAVITY_M_S2, -2 * energy, -2 * GRAVITY_M_S2, 2 * energy - spin**2]).real)
    assert abs(b - height) < 1e-12
    m = (b - a) / (c - a)
    sn, _, _, _ = ellipj(ellipk(m) + np.sqrt(GRAVITY_M_S2 * (c - a) / 2) * recording.t_s, m)
    np.testing.assert_allclose(recording.q[:, 2], a + (b - a) * sn**2, atol=1e-9)


def test_the_spherical_pendulum_keeps_what_it_must():
    """Radius, energy and spin about the vertical; the multiplier is the radial part of the acceleration."""
    recording = make_pendulum("spherical")
    q, v = recording.q, recording.v
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1, atol=1e-10)
    np.testing.assert_allclose(np.sum(q * v, axis=1), 0, atol=1e-10)
    energy = np.sum(v**2, axis=1) / 2 + GRAVITY_M_S2 * q[:, 2]
    np.testing.assert_allclose(energy, 0.5 - GRAVITY_M_S2 * np.sqrt(0.5), atol=1e-9)
    np.testing.assert_allclose(q[:, 0] * v[:, 1] - q[:, 1] * v[:, 0], np.sqrt(0.5), atol=1e-10)
    fine = make_pendulum("spherical", n_samples=20_001, duration_s=2.0)
    h = fine.t_s[1]
    acceleration = (fine.v[2:] - fine.v[:-2]) / (2 * h)
    radial = np.sum(acceleration * fine.q[1:-1], axis=1) + GRAVITY_M_S2 * fine.q[1:-1, 2]
    # h^2 / 6 of the fourth derivative, below 500: 1e-6
    np.testing.assert_allclose(radial, fine.multiplier[1:-1], atol=2e-6)


@pytest.mark.parametrize("kind", ["planar", "spherical"])
def test_noise_is_uniform_and_of_the_radius_alone(kind):
    exact, noisy = make_pendulum(kind, n_samples=4000), make_pendulum(kind, n_samples=4000, noise_m=0.02, seed=3)
    np.testing.assert_array_equal(exact.samples, exact.q)
    if kind == "planar":
        radius = noisy.samples[:, 0]
        np.testing.assert_array_equal(noisy.samples[:, 1], exact.q[:, 1])
    else:
        radius = np.linalg.norm(noisy.samples, axis=1)
        np.testing.assert_allclose(noisy.samples, radius[:, None] * exact.q, atol=1e-9)
    # Kolmogorov and Smirnov: a right sample of this fixed seed passes, a normal or one of another width does not
    assert kstest(radius, "uniform", args=(0.99, 0.02)).pvalue > 0.01
    assert kstest(radius, "uniform", args=(0.989, 0.022)).pvalue < 1e-6


def test_files_hold_what_was_made(tmp_path):
    recording = make_pendulum("planar", noise_m=0.1, n_samples=50)
    write_pendulum(recording, tmp_path)
    titles, table = read_table(tmp_path / "samples.csv")
    assert titles == ["t_s", "r_m", "theta_rad"]
    np.testing.assert_allclose(table, np.column_stack([recording.t_s, recording.samples]), atol=5.1e-13)
    with np.load(tmp_path / "truth.npz") as truth:
        np.testing.assert_array_equal(truth["q"], recording.q)
    assert json.loads((tmp_path / "card.json").read_text())["radial_noise_width_m"] == 0.1


def test_wrong_wishes_are_named():
    with pytest.raises(ValueError, match="planar or spherical, but is 'double'"):
        make_pendulum("double")
    with pytest.raises(ValueError, match="n_samples must be 2 or more"):
        make_pendulum("planar", n_samples=1)
