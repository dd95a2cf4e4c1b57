"""Rays that are left in gaps: what is shown, and peers that use them, against laws that we did not write."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets.rig import tank_cameras

from benchmarks.gaps.hide import hide
from benchmarks.gaps.method import Estimate, Film, Trial
from benchmarks.gaps.peers.anipose_3d import PointOptimiser
from benchmarks.gaps.peers.kalman import filter_series, smooth_series, transition
from benchmarks.gaps.peers.rays import Rays, filter_rays
from benchmarks.gaps.protocol import evaluate
from benchmarks.gaps.rays import CLICK_PX, with_rays, wrong_clicks
from mocap.cameras.camera import project, record
from mocap.records import PixelTracks

NAMES = ("root", "a", "b", "c", "d")
CAMERAS = tank_cameras(3, slope_rad=0.0)


def make_trial(n_frames=80, seed=0):
    """Markers that swing about a root, seen without noise by three cameras."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(n_frames) / 100
    place, size = rng.uniform(-0.02, 0.02, (len(NAMES), 3)), rng.uniform(0.004, 0.01, (len(NAMES), 3))
    xyz = place + size * np.sin(2 * np.pi * (2 * t_s[:, None, None] + rng.random((len(NAMES), 3))))
    pixels = PixelTracks(names=NAMES, cameras=tuple(c.name for c in CAMERAS), t_s=t_s, uv_px=record(CAMERAS, xyz))
    return Trial(
        name="swing",
        names=NAMES,
        t_s=t_s,
        xyz_m=xyz,
        sd_m=np.full(len(NAMES), 1e-4),
        trunk=("root",),
        limbs=(("a", "b"), ("c", "d")),
        film=Film(pixels=pixels, cameras=CAMERAS, pixel_origin="upper-left", calibration_origin="upper-left"),
    )


def test_as_many_rays_are_left_as_it_says():
    """In gaps no camera, one, or two see a hidden marker; the first is the same; elsewhere every click is as it was.

    The second of two has the click of the marker that is nearest to the right one in its picture, to click noise.
    """
    trial = make_trial()
    (copy, *_) = hide(trial, [("limb", 25), ("single", 10)], np.random.default_rng(0))
    shown = [with_rays(copy, rays, np.random.default_rng(1)) for rays in (0, 1, 2)]
    clicked = trial.film.pixels.uv_px
    hidden = np.zeros(trial.xyz_m.shape[:2], dtype=bool)
    for gap in copy.gaps:
        hidden[gap.frames] |= gap.hidden
    for rays, part in enumerate(shown):
        uv = part.shown.film.pixels.uv_px
        np.testing.assert_array_equal(uv[:, ~hidden], clicked[:, ~hidden])
        assert (np.isfinite(uv[..., 0]).sum(axis=0)[hidden] == rays).all()
        np.testing.assert_array_equal(np.isnan(part.shown.xyz_m[..., 0]), hidden)
    for gap, (right, wrong) in zip(copy.gaps, shown[2].cameras, strict=True):
        for part in shown[1:]:
            left = part.shown.film.pixels.uv_px[right, gap.frames][:, gap.hidden]
            np.testing.assert_array_equal(left, clicked[right, gap.frames][:, gap.hidden])
        found = shown[2].shown.film.pixels.uv_px[wrong, gap.start]
        for m in np.flatnonzero(gap.hidden):
            away = np.linalg.norm(clicked[wrong, gap.start] - clicked[wrong, gap.start, m], axis=1)
            np.testing.assert_allclose(found[m], clicked[wrong, gap.start, np.argsort(away)[1]], atol=5 * CLICK_PX)


def test_a_marker_that_is_alone_in_a_picture_has_no_wrong_click():
    """With one marker seen there is no other to click; NaN means not clicked."""
    uv_px = np.array([[[1.0, 2.0], [np.nan, np.nan]]])
    assert np.isnan(wrong_clicks(uv_px)).all()


def test_methods_that_read_no_rays_fill_once():
    """The same answer stands for every number of rays that is left, and its time is taken once."""
    trial, calls = make_trial(), []
    copies = hide(trial, [("single", 10)], np.random.default_rng(0))
    shown = [with_rays(copy, rays, np.random.default_rng(1)) for rays in (0, 1, 2) for copy in copies]

    def fill(given):
        calls.append(given)
        return Estimate(np.nan_to_num(given.xyz_m), None)

    outcome = evaluate(fill, shown, by_rays=False)
    assert len(calls) == len(copies)
    assert outcome.frames == len(copies) * len(trial.t_s)
    assert {score.rays for score in outcome.scores} == {0, 1, 2}
    assert len({score.rmse_mm for score in outcome.scores}) == 1


def affine_rays(xyz, sd_px):
    """Three cameras that look along the axes from so far away that rays are parallel: 1000 px a metre."""
    far = 1e6
    turns = [np.eye(3), np.eye(3)[[1, 2, 0]], np.eye(3)[[2, 0, 1]]]
    matrices = np.stack([np.column_stack([np.diag([1e3 * far, 1e3 * far, 1.0]) @ r, [0, 0, far]]) for r in turns])
    uv = project(matrices, xyz)
    sd = np.full(uv.shape[:3], sd_px)
    cov = np.tile(0.5 * (1e-3 * sd_px) ** 2 * np.eye(3), (*xyz.shape[:2], 1, 1))
    return Rays(matrices=matrices, uv_px=uv, sd_px=sd, xyz_m=xyz, cov_m2=cov)


@pytest.mark.parametrize("order", [1, 2])
def test_on_parallel_rays_it_is_the_kalman_smoother_of_positions(order):
    """The smoother of single markers, each coordinate measured once with half of a ray's variance, is the answer.

    Each is seen by two cameras, but for a gap in all of them. Of one marker the points are known, of the other the rays
    alone.
    """
    rng = np.random.default_rng(0)
    xyz = np.cumsum(rng.normal(0, 1e-3, (40, 2, 3)), axis=0)
    rays = affine_rays(np.array(xyz), 2.0)
    rays.xyz_m[:, 1] = np.nan
    rays.uv_px[:, 15:22] = np.nan
    rays.xyz_m[15:22] = np.nan
    y = np.where(np.isnan(rays.uv_px[0, ..., :1]), np.nan, xyz)
    step, unit = transition(order)
    cov = np.tile(np.diag([1e-2, 1e-4][:order]), (2, 1, 1))
    noise = np.tile(1e-6 * unit, (2, 1, 1))
    plain = filter_series(y, np.full(2, 2e-6), step, noise, mean=np.zeros((2, order, 3)), cov=cov)
    expected, spread = smooth_series(plain, step)
    wide = np.kron(step, np.eye(3))
    run = filter_rays(rays, wide, np.kron(noise, np.eye(3)), mean=np.zeros((2, 3 * order)), cov=np.kron(cov, np.eye(3)))
    mean, found = smooth_series(run, wide)
    np.testing.assert_allclose(mean[:, :, :3, 0], expected[:, :, 0], atol=1e-7)  # parallel to 1e-6 of a metre
    np.testing.assert_allclose(found[:, :, 0, 0], spread[:, :, 0, 0], rtol=1e-4)


def test_a_ray_that_misses_is_left_out_where_rays_do_not_meet():
    """A click 500 px off in one of three cameras, where the product believes no point, changes nothing else."""
    xyz = np.zeros((20, 1, 3))
    right, wrong = affine_rays(xyz, 1.0), affine_rays(xyz, 1.0)
    right.uv_px[2, 10, 0] = np.nan
    wrong.uv_px[2, 10, 0] += 500.0
    wrong = replace(wrong, xyz_m=np.where(np.arange(20)[:, None, None] == 10, np.nan, xyz))
    found = [
        filter_rays(rays, np.eye(3), 1e-8 * np.eye(3)[None], mean=np.zeros((1, 3)), cov=1e-4 * np.eye(3)[None])
        for rays in (right, wrong)
    ]
    np.testing.assert_allclose(found[1].mean, found[0].mean, atol=1e-12)


def test_smooth_points_are_on_the_rays_that_are_left():
    """Without noise a slight penalty leaves the truth where rays meet; in a gap the ray that is left is met, too."""
    trial = make_trial()
    copy = hide(trial, [("single", 10)], np.random.default_rng(0))[0]
    misses = {0: [], 1: []}
    for rays in (0, 1):
        shown = with_rays(copy, rays, np.random.default_rng(1))
        found = PointOptimiser(1.0, ())(shown.shown)
        seen = np.isfinite(shown.shown.xyz_m[..., 0])
        assert np.abs((found.xyz_m - trial.xyz_m)[seen]).max() < 1e-4
        missed_px = np.linalg.norm(record(CAMERAS, found.xyz_m) - trial.film.pixels.uv_px, axis=-1)
        for gap, (camera, _) in zip(shown.gaps, shown.cameras, strict=True):
            misses[rays].append(missed_px[camera, gap.frames][:, gap.hidden].max())
    assert max(misses[1]) < 0.1 * min(misses[0])
