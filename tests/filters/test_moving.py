"""Velocities and joint covariances that the smoother hands out."""

import numpy as np
import pytest
from mocap.filters.body_axes import BodyFrames
from mocap.filters.motion.base import Step
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.moving import rate_points_of
from mocap.filters.observations import PositionObservations
from mocap.filters.track import filter_forward, smooth, smooth_back
from mocap.filters.velocities import RatePoints

from tests.filters.test_motion_models import FRAMES, MARKERS, oscillating, pose

DT = 0.01


def dense(model, seen, sd, n_frames):
    """Mean and covariance of all states [x, v] of one marker's axes given all frames, as one Gaussian."""
    k = 3 * len(seen[0])
    n = 2 * k
    a = np.eye(n)
    a[:k, k:] = DT * np.eye(k)
    place = np.arange(n).reshape(2, -1, 3).swapaxes(0, 1).reshape(-1, 6)  # of each marker's [x, v] in all of them
    first, noise = model.initial(), model.move(model.initial(), Step(1, DT)).noise
    q, start = np.zeros((2, n, n))
    for each, one, driven in zip(place, first.cov, noise, strict=True):
        start[np.ix_(each, each)], q[np.ix_(each, each)] = one, driven
    mean, cov = [first.mean.reshape(-1, 2, 3).swapaxes(0, 1).ravel()], np.zeros((n_frames * n, n_frames * n))
    cov[:n, :n] = start
    for t in range(1, n_frames):
        mean.append(a @ mean[-1])
        here, before = slice(t * n, (t + 1) * n), slice((t - 1) * n, t * n)
        cov[here, : t * n] = a @ cov[before, : t * n]
        cov[: t * n, here] = cov[here, : t * n].T
        cov[here, here] = a @ cov[before, before] @ a.T + q
    mean = np.concatenate(mean)
    rows = np.concatenate([t * n + np.arange(k) for t in range(n_frames)])
    y = seen.reshape(n_frames * k)
    keep = np.isfinite(y)
    rows, y = rows[keep], y[keep]
    gain = cov[:, rows] @ np.linalg.inv(cov[np.ix_(rows, rows)] + sd**2 * np.eye(len(rows)))
    return (mean + gain @ (y - mean[rows])).reshape(n_frames, n), cov - gain @ cov[rows]


@pytest.mark.parametrize("most_bytes", [1e9, 1.0])
def test_velocities_and_their_change_are_those_of_the_whole_trajectory(most_bytes):
    """Velocity, its covariance with position and other points, and that of frames two apart; also in blocks."""
    rng = np.random.default_rng(0)
    n_frames, sd = 12, 0.02
    model = ConstantVelocity(
        start_m=rng.normal(size=(2, 3)), start_sd_m=0.3, speed_sd_m_s=2.0, density=np.array([3.0, 20.0])
    )
    xyz = model.start_m + np.cumsum(0.02 * rng.normal(size=(n_frames, 2, 3)), axis=0)
    xyz[4:8, 1] = np.nan
    asked = RatePoints(names=("a", "b", "mid"), weights=((0.5, 0.5),), pairs=((0, 1), (1, 2)))
    observations = PositionObservations(xyz_m=xyz, sd_m=np.full((n_frames, 2), sd))
    found = smooth(
        model, observations, DT * np.arange(n_frames), gate_sd=np.inf, rate_points=asked, most_bytes=most_bytes
    )
    assert found.rates is not None
    mean, cov = dense(model, xyz, sd, n_frames)
    cov = cov.reshape(n_frames, 12, n_frames, 12)
    np.testing.assert_allclose(found.rates.velocity_m_s[:, :2], mean[:, 6:].reshape(-1, 2, 3), atol=1e-8)
    np.testing.assert_allclose(found.rates.velocity_m_s[:, 2], mean[:, 6:].reshape(-1, 2, 3).mean(axis=1), atol=1e-8)
    six = [np.r_[3 * m : 3 * m + 3, 6 + 3 * m : 9 + 3 * m] for m in range(2)]
    for t in range(n_frames):
        own = [cov[t][:, t][np.ix_(s, s)] for s in six]
        np.testing.assert_allclose(found.rates.own[t, :2], own, rtol=1e-4, atol=1e-8)  # float32
        between = cov[t][:, t][np.ix_(six[0], six[1])]
        np.testing.assert_allclose(found.rates.cross[t, 0], between, rtol=1e-4, atol=1e-7)
        np.testing.assert_allclose(found.rates.cross[t, 1], (own[1] + between.T) / 2, rtol=1e-4, atol=1e-7)
        np.testing.assert_allclose(
            found.rates.own[t, 2], (own[0] + own[1] + between + between.T) / 4, rtol=1e-4, atol=1e-7
        )
    for t in (1, 9):  # where it is computed, not interpolated
        for marker in range(2):
            v = six[marker][3:]
            both = cov[t - 1][v][:, t - 1][:, v] + cov[t + 1][v][:, t + 1][:, v]
            shared = cov[t - 1][v][:, t + 1][:, v]
            change = np.diag(both - shared - shared.T) / np.diag(both)
            np.testing.assert_allclose(found.rates.kept[t, marker], change, rtol=1e-4)


def test_rates_of_a_pose_are_the_slopes_of_its_markers():
    """Positions and velocities depend on the state as central differences of ``markers`` along its own rates say."""
    rng = np.random.default_rng(5)
    model = pose(oscillating)
    still = model.path
    path = type(still)(
        frames=BodyFrames(rotation=still.frames.rotation, position_m=still.frames.position_m),
        velocity_m_s=rng.normal(size=(FRAMES, 3)),
        rate_rad_s=rng.normal(size=(FRAMES, 3)),
    )
    model = pose(oscillating, path=path)
    n = model.size
    _, g, _, g_rate, _ = model.parts
    mean = rng.normal(0, 0.1, n)
    mean[g] = 0.0  # velocities are to first order in the body's turn from its path
    velocity, jacobian = model.rates(mean, 2)
    jacobian = jacobian.reshape(MARKERS, 6, n)
    step = 1e-6
    markers = [model.markers((mean + s * step * np.eye(n)), 2) for s in (1, -1)]
    np.testing.assert_allclose(jacobian[:, :3], np.moveaxis(markers[0] - markers[1], 0, -1) / (2 * step), atol=1e-8)
    speeds = [np.array([model.rates(mean + s * step * row, 2)[0] for row in np.eye(n)]) for s in (1, -1)]
    np.testing.assert_allclose(jacobian[:, 3:], np.moveaxis(speeds[0] - speeds[1], 0, -1) / (2 * step), atol=1e-6)
    along = np.zeros(n)
    r = model.rank
    along[:r], along[g] = mean[r : 2 * r], mean[g_rate]
    e, e1 = model.parts[2], model.parts[4]
    along[e] = mean[e1] - model.residual_rate_hz * mean[e]
    along[g.start + 3 : g.stop] += path.rate_rad_s[2]
    moved = [model.markers((mean + s * step * along)[None], 2)[0] for s in (1, -1)]
    np.testing.assert_allclose(velocity, (moved[0] - moved[1]) / (2 * step) + path.velocity_m_s[2], atol=1e-7)
    assert velocity.shape == (MARKERS, 3)


def test_what_a_part_of_the_markers_cannot_give_is_left_out():
    """A mean that has lost half of its weight and pairs with it are left out; weights of the rest are 1 again."""
    asked = RatePoints(
        names=("a", "b", "c", "most", "half"),
        weights=((0.4, 0.4, 0.2), (0.5, 0.0, 0.5)),
        pairs=((0, 2), (3, 0), (4, 0)),
    )
    found = rate_points_of(("b", "a"), asked)
    assert found.names == ("b", "a", "most")
    np.testing.assert_allclose(found.all_weights, [[1, 0], [0, 1], [0.5, 0.5]])
    assert found.pairs == ((2, 1),)


def test_covariances_are_of_the_smoothed_state():
    """Position blocks are the covariances that the estimate states."""
    rng = np.random.default_rng(1)
    model = ConstantVelocity(start_m=np.zeros((1, 3)), start_sd_m=1.0, speed_sd_m_s=1.0, density=np.array([2.0]))
    xyz = rng.normal(0, 0.1, (9, 1, 3))
    found = smooth(
        model,
        PositionObservations(xyz_m=xyz, sd_m=np.full((9, 1), 0.1)),
        DT * np.arange(9),
        rate_points=RatePoints(names=("a",)),
    )
    assert found.rates is not None
    np.testing.assert_allclose(found.rates.own[:, :, :3, :3], found.cov_m2, rtol=1e-5, atol=1e-9)


def test_rates_of_a_pose_have_its_smoothed_covariance():
    """J P_s J^T with P_s = P - P Lambda P written out, of each point, a mean of two, and pairs; float32 keeps 1e-7."""
    rng = np.random.default_rng(8)
    model = pose(oscillating)
    seen = PositionObservations(xyz_m=rng.normal(size=(FRAMES, MARKERS, 3)), sd_m=np.full((FRAMES, MARKERS), 0.1))
    weights = ((0.5, 0.0, 0.5, 0.0),)
    asked = RatePoints(names=("a", "b", "c", "d", "ac"), weights=weights, pairs=((0, 1), (3, 4)))
    found = smooth(model, seen, DT * np.arange(FRAMES), gate_sd=np.inf, rate_points=asked)
    assert found.rates is not None
    frames = list(filter_forward(model, seen, DT * np.arange(FRAMES), gate_sd=np.inf))
    for frame, (_, state, _) in zip(range(FRAMES - 1, -1, -1), smooth_back(reversed(frames)), strict=True):
        _, jacobian = model.rates(state.mean, frame)
        rows = np.tensordot(asked.all_weights, jacobian.reshape(MARKERS, 6, -1), 1).reshape(30, -1)
        cov = (rows @ state.cov @ rows.T).reshape(5, 6, 5, 6)
        size = np.abs(cov).max()
        for k in range(5):
            np.testing.assert_allclose(found.rates.own[frame, k], cov[k, :, k], atol=1e-6 * size)
        for k, (a, b) in enumerate(asked.pairs):
            np.testing.assert_allclose(found.rates.cross[frame, k], cov[a, :, b], atol=1e-6 * size)
