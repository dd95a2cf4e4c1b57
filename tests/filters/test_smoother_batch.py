"""The smoother against the whole trajectory solved at once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mocap.filters.ensemble import Gaussian, default_points, predict, smooth_step, update
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.observations import PositionObservations
from mocap.filters.track import smooth

from tests.reference import gaussian_filter as reference


def linear_problem(rng, n, n_frames):
    """Random stable dynamics and observations of random rows, none in some frames."""
    a = np.linalg.qr(rng.normal(size=(n, n)))[0] * 0.95
    noise = np.tril(rng.normal(0, 0.1, (n, n)))
    noise[np.diag_indices(n)] = rng.uniform(0.1, 0.4, n)
    frames = []
    for k in range(n_frames):
        m = 0 if k % 4 == 2 else int(rng.integers(1, n + 2))
        frames.append((rng.normal(size=(m, n)), rng.normal(size=m), rng.uniform(0.1, 1, m)))
    return a, noise, frames


@given(seed=st.integers(0, 500), n=st.integers(1, 6), n_frames=st.integers(1, 9))
def test_the_smoothed_states_are_the_posterior_of_the_trajectory(seed, n, n_frames):
    """Linear and Gaussian: states of every frame and the summed log-likelihood of the dense problem."""
    rng = np.random.default_rng(seed)
    a, noise, frames = linear_problem(rng, n, n_frames)
    points = default_points(n)
    state = start = Gaussian(rng.normal(size=n), np.diag(rng.uniform(0.5, 3, n)))
    predictions, states, density = [], [], 0.0
    for k, (rows, y, sd) in enumerate(frames):
        if k:
            predictions.append(predict(state, lambda x: x @ a.T, noise, points))
            state = predictions[-1].state
        result = update(state, lambda x, rows=rows: x @ rows.T, y, sd, points)
        state, density = result.state, density + result.log_likelihood
        states.append(state)
    smoothed = [states[-1]]
    for k in range(n_frames - 2, -1, -1):
        smoothed.insert(0, smooth_step(states[k], predictions[k], smoothed[0]))
    means, covs, expected = reference.whole_trajectory(
        start.mean, start.cov, [a] * (n_frames - 1), [noise @ noise.T] * (n_frames - 1), frames
    )
    assert density == pytest.approx(expected, rel=1e-9, abs=1e-9)
    for ours, mean, cov in zip(smoothed, means, covs, strict=True):
        np.testing.assert_allclose(ours.mean, mean, atol=1e-9)
        np.testing.assert_allclose(ours.cov, cov, atol=1e-9)
        assert not np.triu(ours.factor, 1).any()


@pytest.mark.parametrize(("q", "r"), [(1e-6, 3e-6), (1e-3, 1e-3), (0.5, 2.0)])
def test_hindsight_may_sharpen_a_state_a_million_times(q, r):
    """For x' = A x + q w, A orthogonal, x' seen to r: of x is left q^2 + r^2 in parallel with 1, digit by digit.

    1 - (1 - 1e-11) would keep five digits; a sum of squares keeps the factor to 1e-16 of 1, which is 1e-10 of 1e-6.
    """
    rng = np.random.default_rng(2)
    n = 6
    a = np.linalg.qr(rng.normal(size=(n, n)))[0]
    start, points = Gaussian(np.zeros(n), np.eye(n)), default_points(n)
    prediction = predict(start, lambda x: x @ a.T, q * np.eye(n), points)
    y = rng.normal(size=n)
    after = update(prediction.state, lambda x: x, y, np.full(n, r), points).state
    found = smooth_step(start, prediction, after)
    left = (q**2 + r**2) / (1 + q**2 + r**2)
    np.testing.assert_allclose(found.cov / left, np.eye(n), atol=1e-7)
    np.testing.assert_allclose(found.mean, a.T @ y / (1 + q**2 + r**2), atol=1e-7 * np.sqrt(left) + 1e-13)


@pytest.mark.parametrize("even", [True, False])
def test_tracked_positions_are_the_posterior_of_the_trajectory(even):
    """The tracker from end to end, constant velocity, gaps, a marker never seen, uneven times: the dense posterior.

    State and data of about a metre, deviations down to a millimetre: 1e-16 x (1e3)^2 of slack, and as much again for
    the dense solve.
    """
    rng = np.random.default_rng(1)
    n_frames, n_markers = 12, 3
    steps = np.full(n_frames, 0.01) if even else rng.uniform(0.002, 0.05, n_frames)
    t = np.cumsum(steps)
    xyz = rng.normal(0, 0.1, (n_frames, n_markers, 3))
    xyz[rng.random((n_frames, n_markers)) < 0.4] = np.nan
    xyz[5] = np.nan
    xyz[:, 2] = np.nan
    sd = rng.uniform(1e-3, 5e-3, (n_frames, n_markers))
    density = rng.uniform(50, 500, n_markers)
    model = ConstantVelocity(
        start_m=rng.normal(0, 0.1, (n_markers, 3)), start_sd_m=0.2, speed_sd_m_s=3.0, density=density
    )
    observations = PositionObservations(xyz_m=xyz, sd_m=sd)
    found = smooth(model, observations, t, gate_sd=np.inf)
    k = 3 * n_markers
    transitions, noises, frames = [], [], []
    for dt in np.diff(t):
        transitions.append(np.block([[np.eye(k), dt * np.eye(k)], [np.zeros((k, k)), np.eye(k)]]))
        s = np.diag(np.repeat(density, 3))
        noises.append(np.block([[dt**3 / 3 * s, dt**2 / 2 * s], [dt**2 / 2 * s, dt * s]]))
    for frame in range(n_frames):
        rows = np.flatnonzero(np.isfinite(xyz[frame].ravel()))
        frames.append((np.eye(2 * k)[rows], xyz[frame].ravel()[rows], np.repeat(sd[frame], 3)[rows]))
    start = model.initial()
    sd = np.sqrt(np.einsum("mii->mi", start.cov)).reshape(-1, 2, 3).swapaxes(0, 1).ravel()  # positions, then velocities
    first = start.mean.reshape(-1, 2, 3).swapaxes(0, 1).ravel()
    means, covs, density = reference.whole_trajectory(first, np.diag(sd**2), transitions, noises, frames)
    np.testing.assert_allclose(found.xyz_m.reshape(n_frames, k), means[:, :k], atol=1e-9)
    for marker in range(n_markers):
        here = slice(3 * marker, 3 * marker + 3)
        np.testing.assert_allclose(found.cov_m2[:, marker], covs[:, here, here], atol=1e-9, rtol=1e-6)
    assert found.log_likelihood.sum() == pytest.approx(density, rel=1e-9)
    n_rows = np.array([seen.n_rows for seen in found.observed])
    np.testing.assert_array_equal(n_rows, [len(y) for _, y, _ in frames])
    np.testing.assert_array_equal(np.isnan([seen.nis for seen in found.observed]), n_rows == 0)


def test_one_frame_and_no_data():
    """A single frame is an update; without any data the tracker returns its prior, growing in time."""
    model = ConstantVelocity(start_m=np.zeros((1, 3)), start_sd_m=0.5, speed_sd_m_s=1.0, density=np.array([2.0]))
    t = np.arange(4) * 0.1
    blank = smooth(model, PositionObservations(xyz_m=np.full((4, 1, 3), np.nan), sd_m=np.ones((4, 1))), t)
    variance = 0.5**2 + t**2 + 2.0 * t**3 / 3
    np.testing.assert_allclose(blank.cov_m2[:, 0], variance[:, None, None] * np.eye(3), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(blank.xyz_m, 0, atol=1e-15)
    one = smooth(model, PositionObservations(xyz_m=np.ones((1, 1, 3)), sd_m=np.full((1, 1), 0.5)), t[:1])
    np.testing.assert_allclose(one.xyz_m, 0.5)
    np.testing.assert_allclose(one.cov_m2[0, 0], 0.125 * np.eye(3), atol=1e-12)
