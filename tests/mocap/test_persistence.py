"""Errors of clicks that last: their variance is found, and white errors have none."""

import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat

from mocap.cameras.camera import project, stacked
from mocap.cameras.triangulate import linear, refine
from mocap.cleaning.bias import LAG, UNSEEN, lasting_share, persistent_px, share_left


@pytest.fixture(scope="module")
def scene():
    """True points, exact pixels and projections of four cameras."""
    bat = make_bat(seed=2, n_frames=400, n_cameras=4, digitiser=PERFECT)
    matrices, xyz = stacked(bat.cameras), bat.truth.xyz_m
    return xyz, project(matrices, xyz), matrices


def lasting(rng, shape, frames):
    """Errors of deviation 1 whose autocorrelation falls to 1 / e in so many frames (first order autoregression)."""
    keep = np.exp(-1 / frames)
    out = rng.standard_normal(shape)
    for t in range(1, shape[1]):
        out[:, t] = keep * out[:, t - 1] + np.sqrt(1 - keep**2) * out[:, t]
    return out


@pytest.mark.parametrize("n_cameras", [2, 3, 4])
def test_the_variance_of_lasting_errors_is_found(scene, n_cameras):
    """Half white, half lasting for 60 frames: exp(-LAG / 60) of the lasting half's variance, for any number of cameras.

    34 markers, 400 frames, each 7 independent ones: 240 for two cameras, so 5 % of a deviation, and 15 % is three.
    """
    _, exact, matrices = scene
    rng = np.random.default_rng(1)
    exact, matrices = exact[:n_cameras], matrices[:n_cameras]
    slow = 1.2 * lasting(rng, exact.shape, 60)
    uv = exact + slow + 1.0 * rng.standard_normal(exact.shape)
    found = persistent_px(matrices, uv, linear(matrices, uv), relative=np.ones(uv.shape[:3]))
    expected = 1.2 * np.exp(-LAG / 60 / 2)
    assert np.sqrt(np.mean(found**2)) == pytest.approx(expected, rel=0.15)
    assert found.std() < 0.3  # of single markers: 1.2 / sqrt(2 x 14) = 0.23, less what they are shrunk by


def test_white_errors_do_not_last(scene):
    """Variances of 1 / sqrt(34 000) px^2 are left by chance: below 0.1 px."""
    _, exact, matrices = scene
    uv = exact + np.random.default_rng(2).standard_normal(exact.shape)
    found = persistent_px(matrices, uv, linear(matrices, uv), relative=np.ones(uv.shape[:3]))
    assert found.mean() < 0.1


def test_intervals_hold_for_averages_over_frames(scene):
    """Means over five frames of points with lasting errors: their stated variance holds them, the white one does not.

    The deviation of a mean over five frames is that of the lasting errors and a fifth of the white variance.
    """
    xyz, exact, matrices = scene
    rng = np.random.default_rng(3)
    uv = exact + lasting(rng, exact.shape, 60) + 0.5 * rng.standard_normal(exact.shape)
    points, cov = refine(matrices, uv, linear(matrices, uv), sd_px=1.0)
    found = persistent_px(matrices, uv, points, relative=np.ones(uv.shape[:3]))
    window = np.ones(5) / 5
    error = np.apply_along_axis(lambda column: np.convolve(column, window, mode="valid"), 0, points - xyz)
    variance = np.diagonal(cov, axis1=-2, axis2=-1)[2:-2]
    white = variance * (1.0 + 0.25) / 5  # all errors taken for white
    stated = variance * (found[:, None] ** 2 + 0.25 / 5)
    assert np.mean(np.abs(error) < 1.959964 * np.sqrt(stated)) == pytest.approx(0.95, abs=0.02)
    assert np.mean(np.abs(error) < 1.959964 * np.sqrt(white)) < 0.75


def test_few_frames_tell_nothing(scene):
    """A recording of as many frames as the lag has no residuals to compare."""
    _, exact, matrices = scene
    few = exact[:, :LAG]
    found = persistent_px(matrices, few, linear(matrices, few), relative=np.ones(few.shape[:3]))
    assert np.isnan(found).all()
    share = lasting_share(found, np.ones(len(found)), removed_px=2.0)
    np.testing.assert_allclose(1 + share, (1 + UNSEEN) * (1 + 2.0**2))


@pytest.mark.parametrize(("markers", "known"), [(28, False), (34, True)])
def test_thirty_errors_tell_something(scene, markers, known):
    """Two cameras leave one redundant error of a point, so that four frames show one of each marker, three apart."""
    _, exact, matrices = scene
    few = exact[:2, :4, :markers] + np.random.default_rng(5).standard_normal((2, 4, markers, 2))
    found = persistent_px(matrices[:2], few, linear(matrices[:2], few), relative=np.ones(few.shape[:3]))
    assert np.isfinite(found).all() == known


@pytest.mark.parametrize("frames", [8, 60])
def test_how_long_errors_last_is_found(scene, frames):
    """Half white, half lasting: exp(-1 / frames) is left a frame later; white errors last no longer than ``LAG``."""
    _, exact, matrices = scene
    rng = np.random.default_rng(4)
    white = exact + rng.standard_normal(exact.shape)
    uv = white + 1.2 * lasting(rng, exact.shape, frames)
    found = [share_left(matrices, px, linear(matrices, px), relative=np.ones(px.shape[:3])) for px in (uv, white)]
    assert -1 / np.log(found[0]) == pytest.approx(frames, rel=0.3)
    assert found[1] == 1 - 1 / LAG
    assert share_left(matrices, uv[:, :2], linear(matrices, uv[:, :2]), relative=np.ones(uv[:, :2].shape[:3])) < 1
