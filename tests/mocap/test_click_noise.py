"""Scales and degrees of freedom of clicks: found again where they are known, and of use."""

import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat

from mocap.cameras.camera import project, stacked
from mocap.cameras.triangulate import linear
from mocap.cleaning.click_noise import DOFS, USUAL_DOF, click_noise, student_t

CAMERA = np.array([1.0, 2.0, 0.7, 1.0, 1.5, 1.0, 1.0, 0.8])
DOF = np.array([4.0, 3.0, 10.0, 3.0, 30.0, 4.0, 4.0, 4.0])
SCALE_PX = 0.5


@pytest.fixture(scope="module")
def scene():
    """Projections, true points and their exact pixels."""
    bat = make_bat(seed=1, n_frames=200, n_cameras=8, digitiser=PERFECT)
    matrices = stacked(bat.cameras)
    return matrices, bat.truth.xyz_m, project(matrices, bat.truth.xyz_m)


def clicked(exact, camera, marker, dof, seed=0):
    """Pixels with Student's t errors, a fifth of them missing."""
    rng = np.random.default_rng(seed)
    nu = np.broadcast_to(dof[:, None, None], exact.shape[:3])
    size = SCALE_PX * camera[:, None, None] * marker * np.sqrt(nu / rng.chisquare(nu))
    uv = exact + size[..., None] * rng.standard_normal(exact.shape)
    uv[rng.random(exact.shape[:3]) < 0.2] = np.nan
    return uv


@pytest.mark.parametrize("n_cameras", [5, 8])
def test_what_was_put_in_comes_out(scene, n_cameras):
    """Scales of cameras to 20 %, of markers to 5 % rms; degrees of freedom to a factor of 1.5 where tails are heavy.

    200 frames leave a marker 1000 redundant errors, or 4 % of statistics with these tails, and a camera 7000; residuals
    mix the errors of several rays, which are not of Student's t any more.
    """
    matrices, _, exact = scene
    marker = np.exp(np.random.default_rng(3).normal(0, 0.3, exact.shape[2]))
    uv = clicked(exact[:n_cameras], CAMERA[:n_cameras], marker, DOF[:n_cameras])
    found = click_noise(matrices[:n_cameras], uv, linear(matrices[:n_cameras], uv))
    assert found is not None
    typical = np.exp(np.mean(np.log(marker)))
    assert np.std(np.log(found.marker * typical / marker)) < 0.05
    scales = found.scale_px * found.camera / typical
    np.testing.assert_allclose(scales / (SCALE_PX * CAMERA[:n_cameras]), 1, atol=0.2)
    heavy = DOF[:n_cameras] <= 10
    ratio = found.dof[heavy] / DOF[:n_cameras][heavy]
    assert (ratio < 1.5).all()
    assert (ratio > 1 / 1.5).all()
    assert (found.dof[~heavy] > 8).all()


def test_few_cameras_keep_the_usual_tails(scene):
    """Of four cameras and fewer degrees of freedom are not known; scales of markers are, to 13 % rms.

    A marker has 300 to 600 redundant errors: 5 to 8 % of statistics, and up to 10 % of a factor is shrunk away.
    """
    matrices, _, exact = scene
    marker = np.exp(np.random.default_rng(4).normal(0, 0.3, exact.shape[2]))
    for n_cameras in (3, 4):
        uv = clicked(exact[:n_cameras], np.ones(n_cameras), marker, np.full(n_cameras, 4.0))
        found = click_noise(matrices[:n_cameras], uv, linear(matrices[:n_cameras], uv))
        np.testing.assert_allclose(found.dof, USUAL_DOF, rtol=0.05)
        assert np.std(np.log(found.marker / marker)) < 0.13
        np.testing.assert_allclose(found.camera, 1, atol=0.12)


def test_two_cameras_share_what_they_miss_by(scene):
    """Two cameras of which one is twice as noisy are told apart by nothing: both get one scale."""
    matrices, _, exact = scene
    uv = clicked(exact[:2], np.array([1.0, 2.0]), np.ones(exact.shape[2]), np.full(2, 4.0))
    found = click_noise(matrices[:2], uv, linear(matrices[:2], uv))
    np.testing.assert_allclose(found.camera, 1, atol=0.05)


def test_little_is_shrunk_to_one(scene):
    """Three frames of four cameras say little: factors stay within what their errors could show; nothing gives None."""
    matrices, _, exact = scene
    uv = clicked(exact[:4, :3], np.ones(4), np.ones(exact.shape[2]), np.full(4, 4.0))
    found = click_noise(matrices[:4], uv, linear(matrices[:4], uv))
    assert (np.abs(np.log(found.marker)) < 0.5).all()
    assert (found.dof >= DOFS[0]).all()
    assert click_noise(matrices[:4], np.full_like(uv, np.nan), np.full((3, exact.shape[2], 3), np.nan)) is None


def test_worse_frames_are_taken_as_such(scene):
    """A camera said to be five times worse from frame 100 on, and so it is: the same factors as without both."""
    matrices, _, exact = scene
    uv = clicked(exact[:5], np.ones(5), np.ones(exact.shape[2]), np.full(5, 4.0))
    worse = np.ones(uv.shape[:2])
    worse[1, 100:] = 5.0
    spoiled = exact[:5] + (uv - exact[:5]) * worse[..., None, None]
    found = click_noise(
        matrices[:5], spoiled, linear(matrices[:5], uv), relative=np.broadcast_to(worse[..., None], uv.shape[:3])
    )
    np.testing.assert_allclose(found.camera, 1, atol=0.08)


def test_known_scales_make_better_points(scene):
    """Cameras and markers of unlike quality: nearer to the truth than with one scale for all, in the median by 5 %."""
    matrices, xyz, exact = scene
    marker = np.exp(np.random.default_rng(5).normal(0, 0.5, exact.shape[2]))
    uv = clicked(exact, np.linspace(1, 3, 8), marker, np.full(8, 4.0))
    start = linear(matrices, uv)
    noise = click_noise(matrices, uv, start)
    median = {}
    for name, given in (("one", None), ("each", noise)):
        found, cov, _, _ = student_t(matrices, uv, start, sd_px=1.0, noise=given)
        error = (found - xyz)[np.isfinite(found[..., 0])]
        median[name] = np.median(np.linalg.norm(error, axis=-1))
        sd = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))[np.isfinite(found[..., 0])]
    assert 0.94 < np.mean(np.abs(error) < 1.959964 * sd) < 0.97
    assert median["each"] < 0.95 * median["one"]
