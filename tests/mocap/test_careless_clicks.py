"""Student's t triangulation: what careless clicks do to a point, and what is claimed of it."""

import numpy as np
import pytest

from datasets import PERFECT, make_bat
from mocap.cameras import project, stacked
from mocap.careless import DOF, student_t
from mocap.triangulate import linear, refine


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
    mixing = rng.chisquare(DOF, uv.shape[:-1]) / DOF
    noisy = uv + scale * rng.standard_normal(uv.shape) / np.sqrt(mixing)[..., None]
    found, cov, ray_sd, _ = student_t(matrices, noisy, linear(matrices, noisy), sd_px=3 * scale * np.sqrt(2.0))
    error = found - xyz
    nees = np.einsum("tmi,tmij,tmj->tm", error, np.linalg.inv(cov), error)
    # 2040 points: the mean of chi-square with 3 degrees has deviation sqrt(6 / 2040) = 0.05; the asymptotic
    # information at 16 rows for 3 unknowns is off by about 3 / 16
    assert np.mean(nees) == pytest.approx(3, rel=0.2)
    least_squares, _ = refine(matrices, noisy, linear(matrices, noisy), sd_px=1.0)
    assert np.sqrt(np.mean(error**2)) < 0.9 * np.sqrt(np.mean((least_squares - xyz) ** 2))
    smallest = scale * np.sqrt((DOF + 4) / (DOF + 2)) / np.sqrt((DOF + 2) / DOF)
    assert ray_sd.min() == pytest.approx(smallest, rel=0.1)  # a ray without residual has weight (nu + 2) / nu


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
