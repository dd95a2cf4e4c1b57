"""Student's t triangulation: what careless clicks do to a point, and what is claimed of it."""

import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat

from mocap.cameras.camera import project, stacked
from mocap.cameras.triangulate import linear, refine
from mocap.cleaning.click_noise import USUAL_DOF, student_t


@pytest.fixture(scope="module")
def scene():
    """True points, their exact ideal pixels in eight cameras, and the projections."""
    bat = make_bat(seed=1, n_frames=60, n_cameras=8, digitiser=PERFECT)
    matrices, xyz = stacked(bat.cameras), bat.truth.xyz_m
    return xyz, project(matrices, xyz), matrices


def test_exact_pixels_give_the_truth(scene):
    """Without errors the weights do not matter."""
    xyz, uv, matrices = scene
    found, _, _, _ = student_t(matrices, uv, linear(matrices, uv), sd_px=1.0)
    np.testing.assert_allclose(found, xyz, atol=1e-9)  # linear itself reaches 1e-11 m; six rounds of rounding


def test_covariance_and_ray_deviations_hold_for_student_errors(scene):
    """Errors over the claimed covariance have mean square 3, and the scale is found from a start 3 times too large."""
    xyz, uv, matrices = scene
    rng = np.random.default_rng(0)
    scale = 0.5
    mixing = rng.chisquare(USUAL_DOF, uv.shape[:-1]) / USUAL_DOF
    noisy = uv + scale * rng.standard_normal(uv.shape) / np.sqrt(mixing)[..., None]
    found, cov, ray_sd, _ = student_t(matrices, noisy, linear(matrices, noisy), sd_px=3 * scale * np.sqrt(2.0))
    error = found - xyz
    nees = np.einsum("tmi,tmij,tmj->tm", error, np.linalg.inv(cov), error)
    # 2040 points: the mean of chi-square with 3 degrees has deviation sqrt(6 / 2040) = 0.05; the asymptotic
    # information at 16 rows for 3 unknowns is off by about 3 / 16
    assert np.mean(nees) == pytest.approx(3, rel=0.2)
    least_squares, _ = refine(matrices, noisy, linear(matrices, noisy), sd_px=1.0)
    assert np.sqrt(np.mean(error**2)) < 0.9 * np.sqrt(np.mean((least_squares - xyz) ** 2))
    smallest = scale * np.sqrt((USUAL_DOF + 4) / (USUAL_DOF + 2)) / np.sqrt((USUAL_DOF + 2) / USUAL_DOF)
    assert ray_sd.min() == pytest.approx(smallest, rel=0.1)  # a ray without residual has weight (nu + 2) / nu


@pytest.mark.parametrize("n_cameras", [2, 3, 4, 8])
def test_the_scale_is_that_of_the_errors_and_not_of_what_points_leave_of_them(scene, n_cameras):
    """Any number of cameras finds the scale of Student's errors to 10 %, and intervals of points that hold.

    2040 redundant errors or more are 3 % of statistics; the residual of a ray mixes the errors of all rays of its
    point, which are not of Student's t any more (4 to 7 %). With residuals in place of errors four cameras find it 18 %
    too large, two 38 %. The tails of two rays do not show, so that there fewer than 95 % are inside.
    """
    xyz, exact, matrices = scene
    rng = np.random.default_rng(2)
    scale, uv = 0.5, exact[:n_cameras]
    noisy = (
        uv
        + scale
        * rng.standard_normal(uv.shape)
        / np.sqrt(rng.chisquare(USUAL_DOF, uv.shape[:-1]) / USUAL_DOF)[..., None]
    )
    start = linear(matrices[:n_cameras], noisy)
    found, cov, _, spread = student_t(matrices[:n_cameras], noisy, start, sd_px=0.7)
    assert spread[np.isfinite(spread)] == pytest.approx(scale, rel=0.1)
    inside = np.abs(found - xyz) <= 1.959964 * np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
    assert 0.9 < inside.mean() < 0.98


def test_a_careless_ray_is_trusted_less(scene):
    """One ray 30 px off moves a point less than least squares by a factor of 10, and its own deviation says so."""
    xyz, uv, matrices = scene
    rng = np.random.default_rng(1)
    noisy = uv + 0.5 * rng.standard_normal(uv.shape)
    noisy[2, :, 5] += 30.0
    found, _, ray_sd, _ = student_t(matrices, noisy, linear(matrices, noisy), sd_px=1.0)
    plain, _ = refine(matrices, noisy, linear(matrices, noisy), sd_px=1.0)
    off, plain_off = (np.linalg.norm(p[:, 5] - xyz[:, 5], axis=-1) for p in (found, plain))
    assert np.median(off) < 0.1 * np.median(plain_off)
    assert np.median(ray_sd[2, :, 5]) > 10 * np.median(ray_sd[1, :, 5])


def test_rays_without_a_point_keep_the_deviation_of_all(scene):
    """A single ray has no residual to be judged by; all NaN is all NaN."""
    _, uv, matrices = scene
    few = np.full_like(uv, np.nan)
    few[0] = uv[0]
    found, cov, ray_sd, _ = student_t(matrices, few, linear(matrices, few), sd_px=0.7)
    assert np.isnan(found).all()
    assert np.isnan(cov).all()
    assert (ray_sd == 0.7).all()
