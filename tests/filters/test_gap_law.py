"""The law that the tracker exists for: in gaps it beats what people use, and its intervals hold."""

import numpy as np
import pytest
from mocap.datasets import make_bat
from mocap.filters.body_axes import body_frames
from mocap.filters.models.constant_velocity import learn_constant_velocity
from mocap.filters.models.pose import PoseSettings, learn_pose
from mocap.filters.observations import PixelObservations
from mocap.filters.poses import pose_trial
from mocap.filters.track import smooth
from scipy.interpolate import CubicSpline

from mocap.cameras.camera import stacked, undistorted
from mocap.cameras.triangulate import linear, refine, robust
from mocap.cleaning.bias import ray_bias
from mocap.cleaning.positions import clean

SETTINGS = PoseSettings(ranks=(4, 6, 8, 11))


@pytest.fixture(scope="module")
def filled():
    """A bat of 1 s, 6 cameras, as a human digitised it, from its pixels to smoothed markers; both models."""
    recording = make_bat(seed=3, n_frames=240, n_cameras=6)
    matrices, t_s, names = stacked(recording.cameras), recording.truth.t_s, recording.truth.names
    dt_s = 1 / recording.fps
    uv = undistorted(recording.cameras, recording.pixels.uv_px)
    rays = robust(matrices, uv)
    sd_m = np.sqrt(np.trace(rays.cov_m2, axis1=-2, axis2=-1) / 3)
    bad = clean(rays.xyz_m, sd_m, t_s, recording.skeleton, names)
    uv[rays.rejected | bad.any] = np.nan
    found = ray_bias(matrices, uv, dt_s=dt_s)
    uv -= found.bias_px
    xyz, cov = refine(matrices, uv, linear(matrices, uv), sd_px=found.jitter_px)
    seen = PixelObservations(
        matrices=matrices,
        uv_px=uv,
        sd_px=np.full(uv.shape[:3], found.jitter_px),
        xyz_m=xyz,
        cov_m2=cov,
        wide_m=0.1,
    )
    trunk = [names.index(m) for m in recording.skeleton.trunk]
    frames = body_frames(xyz[:, trunk], dt_s=dt_s, cutoff_hz=3.0)
    models = {
        "eal": learn_pose([pose_trial(t_s, xyz, frames)], SETTINGS),
        "constant_velocity": learn_constant_velocity(xyz, dt_s=dt_s),
    }
    tracked = {name: smooth(model, seen, t_s) for name, model in models.items()}
    return recording.truth.xyz_m, t_s, xyz, tracked


def interior(xyz):
    """(T, M) True in gaps between a marker's first and last point."""
    seen = np.isfinite(xyz[..., 0])
    before, after = np.logical_or.accumulate(seen), np.logical_or.accumulate(seen[::-1])[::-1]
    return ~seen & before & after


def rmse_mm(xyz, truth, where):
    return 1e3 * np.sqrt(np.mean(np.sum((xyz - truth)[where] ** 2, axis=-1)))


def interpolated(xyz, t_s, make):
    out = np.full_like(xyz, np.nan)
    for marker in range(xyz.shape[1]):
        known = np.isfinite(xyz[:, marker, 0])
        out[:, marker] = make(t_s[known], xyz[known, marker])(t_s)
    return out


def straight(t, x):
    return lambda at: np.stack([np.interp(at, t, column) for column in x.T], axis=-1)


@pytest.mark.rare
def test_gaps_are_filled_better_than_people_do_today(filled):
    """In the recording's own gaps: under half the error of linear, cubic, and of constant velocity for each marker.

    Half is far from what is seen (a tenth or less), and far above what seeds change.
    """
    truth, t_s, xyz, tracked = filled
    where = interior(xyz)
    assert where.sum() > 200
    eal = rmse_mm(tracked["eal"].xyz_m, truth, where)
    assert eal < 0.5 * rmse_mm(interpolated(xyz, t_s, straight), truth, where)
    assert eal < 0.5 * rmse_mm(interpolated(xyz, t_s, CubicSpline), truth, where)
    assert eal < 0.5 * rmse_mm(tracked["constant_velocity"].xyz_m, truth, where)


def test_where_markers_were_seen_the_track_is_better_than_its_points(filled):
    """Smoothing does not pay for gaps with what was measured: it is nearer to the truth than triangulation."""
    truth, _, xyz, tracked = filled
    where = np.isfinite(xyz[..., 0])
    assert rmse_mm(tracked["eal"].xyz_m, truth, where) < rmse_mm(xyz, truth, where)


def test_intervals_hold(filled):
    """Of the coordinates 90 to 99 % lie within 1.96 deviations, in gaps and outside; every covariance is positive.

    Digitisers have heavy tails and neighbouring frames err alike, so that 95 is met to a few per cent.
    """
    truth, _, xyz, tracked = filled
    for model in tracked.values():
        assert (np.linalg.eigvalsh(model.cov_m2) > 0).all()
    found = tracked["eal"]
    inside = np.abs(found.xyz_m - truth) < 1.96 * np.sqrt(np.diagonal(found.cov_m2, axis1=-2, axis2=-1))
    assert 0.90 < inside[np.isfinite(xyz[..., 0])].mean() < 0.99
    assert 0.90 < inside[interior(xyz)].mean() < 0.99


def test_gaps_are_less_certain_than_what_was_seen(filled):
    """Uncertainty grows where nothing is seen: the median deviation in gaps exceeds that outside."""
    _, _, xyz, tracked = filled
    sd = np.sqrt(np.trace(tracked["eal"].cov_m2, axis1=-2, axis2=-1))
    assert np.median(sd[interior(xyz)]) > np.median(sd[np.isfinite(xyz[..., 0])])
