"""Markers apart: what one matrix of all markers gives, by a matrix for each."""

import numpy as np
import pytest
from mocap.datasets.rig import tunnel_cameras
from mocap.filters.apart import smooth_apart
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.motion.singer import LastingAcceleration
from mocap.filters.observations import PixelObservations, PositionObservations
from mocap.filters.track import smooth_together
from mocap.filters.velocities import Asked

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


@pytest.mark.parametrize("lasts", [False, True], ids=["velocity", "acceleration"])
@pytest.mark.parametrize("kind", ["points", "rays"])
def test_as_one_matrix_of_all(kind, lasts):
    """A block-diagonal covariance stays one, so that both ways are the same algebra.

    1e-8 of a covariance is what rounding costs of factors whose condition is 1e4, squared.
    """
    model, seen, t_s = scene(kind)
    model = lasting(model) if lasts else model
    weights = (tuple(np.full(M, 1 / M)), (0.5, 0.5, 0.0, 0.0))
    asked = Asked(names=("a", "b", "c", "d", "mean", "ab"), weights=weights, pairs=((0, 1), (0, 4), (4, 5)))
    one = smooth_together(model, seen, t_s, asked=asked)
    apart = smooth_apart(model, seen, t_s, asked=asked)
    np.testing.assert_allclose(apart.xyz_m, one.xyz_m, atol=1e-10)
    np.testing.assert_allclose(apart.cov_m2, one.cov_m2, rtol=1e-8, atol=1e-16)
    np.testing.assert_allclose(apart.log_likelihood, one.log_likelihood, rtol=1e-8, atol=1e-8)
    for ours, theirs in zip(apart.observed, one.observed, strict=True):
        np.testing.assert_array_equal(ours.where, theirs.where)
        np.testing.assert_allclose(ours.weight, theirs.weight, rtol=1e-8)
        np.testing.assert_allclose([ours.nis, ours.n_rows], [theirs.nis, theirs.n_rows], rtol=1e-8)
    np.testing.assert_allclose(apart.rates.velocity_m_s, one.rates.velocity_m_s, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(apart.rates.own, one.rates.own, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(apart.rates.cross, one.rates.cross, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(apart.rates.kept, one.rates.kept, rtol=1e-6)


def test_a_marker_is_not_changed_by_others():
    """Each marker alone is what it is among the others."""
    model, seen, t_s = scene("points")
    whole = smooth_apart(model, seen, t_s)
    for m in range(M):
        alone = ConstantVelocity(
            start_m=model.start_m[[m]],
            start_sd_m=model.start_sd_m,
            speed_sd_m_s=model.speed_sd_m_s,
            density=model.density[[m]],
        )
        found = smooth_apart(alone, PositionObservations(xyz_m=seen.xyz_m[:, [m]], sd_m=seen.sd_m[:, [m]]), t_s)
        np.testing.assert_allclose(found.xyz_m[:, 0], whole.xyz_m[:, m], atol=1e-12)
