"""Rates of residuals: those that made simulated ones; a marker left out is missed by what the others predict."""

import numpy as np
import pytest
from mocap.filters.motion.pose import STATIONARY, matern_flow, matern_noise
from mocap.filters.roughness import marker_rates, out_of_sample

DT_S, SD_M, NOISE_M = 1 / 240, 1e-3, 3e-4


def residuals(rate_hz, rng, n_frames=300, count=30):
    """(T, count) samples of a Matern-5/2 process with noise, drawn step by step."""
    step = np.array([rate_hz * DT_S])
    flow, kick = matern_flow(step)[..., 0], np.linalg.cholesky(matern_noise(step)[..., 0])
    state, out = np.linalg.cholesky(STATIONARY) @ rng.normal(size=(3, count)), []
    for _ in range(n_frames):
        out.append(SD_M * state[0])
        state = flow @ state + kick @ rng.normal(size=state.shape)
    return np.array(out) + NOISE_M * rng.normal(size=(n_frames, count))


@pytest.mark.parametrize("rate_hz", [20.0, 40.0, 80.0, 160.0])
def test_rates_are_those_that_made_the_residuals(rate_hz):
    """To the half step of the grid, 2^(1/4), with gaps; each marker by itself."""
    rng = np.random.default_rng(0)
    seen = residuals(rate_hz, rng)
    seen[100:130, :9] = np.nan
    found = marker_rates(seen, np.full(seen.shape, NOISE_M), DT_S, np.full(30, SD_M), 40.0)
    assert found.shape == (30,)
    np.testing.assert_allclose(np.log2(found / rate_hz), 0, atol=0.3)


def test_what_noise_hides_has_the_rate_of_all_markers():
    """A marker of noise alone, and one that was never seen: the likeliest rates by themselves are the lowest."""
    rng = np.random.default_rng(1)
    seen = residuals(20.0, rng)
    seen[:, :3], seen[:, 3:6] = NOISE_M * rng.normal(size=(300, 3)), np.nan
    found = marker_rates(seen, np.full(seen.shape, NOISE_M), DT_S, np.full(30, SD_M), 40.0)
    np.testing.assert_allclose(found[:6], found.min())
    assert found.min() == pytest.approx(20.0, rel=0.01)


def test_a_marker_of_careless_clicks_has_the_rate_of_all():
    """One marker is ten times as noisy as stated: it is likeliest at the highest rate of all, and was given that."""
    rng = np.random.default_rng(4)
    seen = residuals(40.0, rng)
    seen[:, :3] += 10 * NOISE_M * rng.normal(size=(300, 3))
    found = marker_rates(seen, np.full(seen.shape, NOISE_M), DT_S, np.full(30, SD_M), 40.0)
    np.testing.assert_allclose(found[:3], found.min())


@pytest.mark.parametrize("stated", [0.8, 1.25, 1.5])
def test_careless_clicks_are_not_taken_for_motion_nor_motion_for_noise(stated):
    """One sample in ten is five times as noisy: whatever size of noise is stated, the rate of all is the true one.

    Under normal errors it is a step of the grid higher where too little is stated, and one lower where too much is.
    """
    rng = np.random.default_rng(3)
    noise = 2 * NOISE_M * np.where(rng.random((300, 30)) < 0.1, 5.0, 1.0)
    seen = residuals(40.0, rng) + noise * rng.normal(size=(300, 30))
    rms = np.sqrt(np.mean(noise**2) + NOISE_M**2)
    found = marker_rates(seen, np.full(seen.shape, stated * rms), DT_S, np.full(30, SD_M), 40.0)
    assert found.min() == pytest.approx(40.0, rel=0.01)


def test_a_marker_is_missed_by_what_the_others_predict():
    """Residuals of a least squares fit without each marker, one by one, by NumPy."""
    rng = np.random.default_rng(2)
    basis = np.linalg.qr(rng.normal(size=(24, 3)))[0]
    y = rng.normal(size=(5, 24))
    found, noise = out_of_sample(y - y @ basis @ basis.T, np.ones((5, 8)), basis)
    for m in range(8):
        own = slice(3 * m, 3 * m + 3)
        rest = np.delete(np.arange(24), np.arange(24)[own])
        z = np.linalg.lstsq(basis[rest], y[:, rest].T, rcond=None)[0]
        np.testing.assert_allclose(found[:, own], y[:, own] - (basis[own] @ z).T, rtol=0.02, atol=0.01)
        expected = np.eye(3) + basis[own] @ np.linalg.inv(basis[rest].T @ basis[rest]) @ basis[own].T
        np.testing.assert_allclose(noise[0, own] ** 2, np.diag(expected), rtol=0.01)
