"""Markers apart: what one matrix of all markers gives, by a matrix for each."""

import numpy as np
import pytest
from mocap.datasets.rig import tunnel_cameras
from mocap.filters.ensemble import Gaussian, default_points, predict, smooth_step, update
from mocap.filters.motion.base import Step
from mocap.filters.motion.constant_velocity import ConstantVelocity, LastingAcceleration
from mocap.filters.observations import PixelObservations, PositionObservations, some_markers
from mocap.filters.track import smooth
from mocap.filters.velocities import RatePoints

from mocap.cameras import triangulate
from mocap.cameras.camera import project, stacked

T, M = 60, 4


def scene(kind: str) -> tuple[ConstantVelocity, PositionObservations | PixelObservations, np.ndarray]:
    """Four markers that swing, with gaps, a frame in which nothing is seen, outliers, and uneven times."""
    rng = np.random.default_rng(0)
    t_s = np.arange(T) / 100.0
    t_s[30:] += 0.013
    xyz = 0.05 * np.sin(t_s[:, None, None] * rng.uniform(5, 40, (M, 3)) + rng.uniform(0, 6, (M, 3)))
    xyz += rng.uniform(-0.1, 0.1, (M, 3))
    model = ConstantVelocity(
        start_m=np.zeros((M, 3)), start_sd_m=0.3, speed_sd_m_s=3.0, density=rng.uniform(5.0, 50.0, M)
    )
    lost = rng.random((T, M)) < 0.2
    lost[20:33, 1], lost[40], lost[:5, 2] = True, True, True
    if kind == "points":
        seen = np.where(lost[..., None], np.nan, xyz + 1e-3 * rng.standard_normal(xyz.shape))
        return model, PositionObservations(xyz_m=seen, sd_m=np.full((T, M), 1e-3)), t_s
    matrices = stacked(tunnel_cameras(3))
    uv = project(matrices, xyz) + rng.standard_normal((3, T, M, 2))
    uv[:, lost] = np.nan
    uv[0, 10:50, 0] = np.nan
    uv[2, rng.random((T, M)) < 0.3] = np.nan
    uv[1, ::9, 3] += 40.0
    sd = np.ones(uv.shape[:3])
    points, cov = triangulate.refine(matrices, uv, triangulate.linear(matrices, uv), sd_px=sd)
    dof = np.array([4.0, 8.0, np.inf])
    return model, PixelObservations(
        matrices=matrices, uv_px=uv, sd_px=sd, xyz_m=points, cov_m2=cov, wide_m=0.05, dof=dof
    ), t_s  # fmt: skip


def lasting(model: ConstantVelocity) -> LastingAcceleration:
    """The same start, with accelerations that last."""
    return LastingAcceleration(
        start_m=model.start_m,
        start_sd_m=model.start_sd_m,
        speed_sd_m_s=model.speed_sd_m_s,
        acceleration_m_s2=np.sqrt(10 * model.density),
        memory_s=0.05,
    )


def together(model, seen, t_s):
    """Means and covariances (T, n) and (T, n, n) of all markers as one state, by the unscented filter of any model."""
    start = model.initial()
    count, size = start.mean.shape

    def block(each):
        out = np.zeros((count, size, count, size))
        out[np.arange(count), :, np.arange(count)] = each
        return out.reshape(count * size, -1)

    state, points = Gaussian(start.mean.ravel(), np.sqrt(block(start.cov))), default_points(count * size)
    states, predictions = [], [None]
    for k in range(len(t_s)):
        if k:
            move = model.move(start, Step(k, t_s[k] - t_s[k - 1]))
            noise = np.linalg.cholesky(block(move.noise))
            ahead = predict(
                state,
                lambda x, move=move: move.forward(x.reshape(-1, count, size)).reshape(len(x), -1),
                noise,
                points,
            )
            predictions.append(ahead)
            state = ahead.state
        y, sd = seen.xyz_m[k], np.repeat(seen.sd_m[k][:, None], 3, axis=1)
        there = np.isfinite(y)
        state = update(
            state,
            lambda x, there=there: x.reshape(-1, count, size)[..., :3][:, there],
            y[there],
            sd[there],
            points,
        ).state
        states.append(state)
    smoothed = states[-1:]
    for k in range(len(t_s) - 2, -1, -1):
        smoothed.insert(0, smooth_step(states[k], predictions[k + 1], smoothed[0]))
    return np.array([s.mean for s in smoothed]), np.array([s.cov for s in smoothed])


@pytest.mark.parametrize("lasts", [False, True], ids=["velocity", "acceleration"])
def test_as_one_matrix_of_all(lasts):
    """A block-diagonal covariance stays one, so that both ways are the same algebra.

    1e-8 of a covariance is what rounding costs of factors whose condition is 1e4, squared.
    """
    model, seen, t_s = scene("points")
    model = lasting(model) if lasts else model
    found = smooth(model, seen, t_s, gate_sd=np.inf)
    mean, cov = together(model, seen, t_s)
    size = model.size // M
    mean, cov = mean.reshape(T, M, size)[..., :3], cov.reshape(T, M, size, M, size)[:, :, :3, :, :3]
    np.testing.assert_allclose(found.xyz_m, mean, atol=1e-10)
    np.testing.assert_allclose(
        found.cov_m2, cov[:, np.arange(M), :, np.arange(M)].swapaxes(0, 1), rtol=1e-8, atol=1e-16
    )
    assert not cov[:, 0, :, 1].any()


@pytest.mark.parametrize("kind", ["points", "rays"])
def test_a_marker_is_not_changed_by_others(kind):
    """Each marker alone is what it is among the others: positions, covariances, velocities."""
    model, seen, t_s = scene(kind)
    asked = RatePoints(names=("a", "b", "c", "d"))
    whole = smooth(model, seen, t_s, rate_points=asked)
    assert whole.rates is not None
    for m in range(M):
        alone = ConstantVelocity(
            start_m=model.start_m[[m]],
            start_sd_m=model.start_sd_m,
            speed_sd_m_s=model.speed_sd_m_s,
            density=model.density[[m]],
        )
        found = smooth(alone, some_markers(seen, np.array([m])), t_s, rate_points=RatePoints(names=("a",)))
        np.testing.assert_allclose(found.xyz_m[:, 0], whole.xyz_m[:, m], atol=1e-12)
        np.testing.assert_allclose(found.cov_m2[:, 0], whole.cov_m2[:, m], rtol=1e-7)
        assert found.rates is not None
        for name in ("velocity_m_s", "own", "kept"):
            ours, theirs = (getattr(one.rates, name) for one in (found, whole))
            np.testing.assert_allclose(ours[:, 0], theirs[:, m], rtol=1e-5, atol=1e-7)
