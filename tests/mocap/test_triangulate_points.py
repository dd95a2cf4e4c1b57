"""Triangulation: exact without noise, optimal with it, honest about its error, and not fooled by one bad ray."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from mocap.cameras.camera import dlt_coefficients, project, stacked
from mocap.cameras.triangulate import linear, pixel_sd, refine, residual_px, robust
from tests.mocap.rigs import cloud, ring
from tests.reference import triangulation as reference

EXACT_M = 1e-11
"""Points of 0.3 m from pixels of 1e3 rounded at 1e-13, a metre being 600 px, and a condition of the rig below 1e3."""


def drop(uv, rng, share):
    """Pixels with a share of rays removed."""
    uv = uv.copy()
    uv[rng.random(uv.shape[:-1]) < share] = np.nan
    return uv


@given(n_cameras=st.integers(2, 8), seed=st.integers(0, 1000))
def test_noise_free_points_come_back(n_cameras, seed):
    """Points, projected and triangulated, come back exactly wherever two cameras see them, and nowhere else."""
    rng = np.random.default_rng(seed)
    matrices, points = stacked(ring(n_cameras)), cloud(rng, 20).reshape(5, 4, 3)
    uv = drop(project(matrices, points), rng, 0.3)
    known = np.isfinite(uv[..., 0]).sum(axis=0) >= 2
    found = linear(matrices, uv)
    np.testing.assert_array_equal(np.isfinite(found).all(axis=-1), known)
    np.testing.assert_allclose(found[known], points[known], rtol=0, atol=EXACT_M)
    assert np.nanmax(residual_px(matrices, uv, found), initial=0) < 1e-8


def test_linear_is_dltdvs_least_squares():
    """With noise of 3 px the batched solution is that of the DLT equations, a point at a time, by orthogonal factors.

    Both solve the same weighted problem; 1e-10 m is rounding (1e-16) times the squared condition of the equations.
    """
    rng = np.random.default_rng(1)
    cameras, points = ring(4), cloud(rng, 60)
    uv = project(stacked(cameras), points)
    uv = drop(uv + rng.normal(0, 3, uv.shape), rng, 0.25)
    coefficients = [dlt_coefficients(c) for c in cameras]
    expected = [reference.linear_point(coefficients, uv[:, i]) for i in range(len(points))]
    np.testing.assert_allclose(linear(stacked(cameras), uv), expected, rtol=0, atol=1e-10)


def test_the_answer_does_not_depend_on_the_scale_of_the_matrices():
    """Any scale of any projection gives the same points: the weights are those of the DLT coefficients."""
    rng = np.random.default_rng(2)
    matrices = stacked(ring(3))
    uv = project(matrices, cloud(rng, 10)) + rng.normal(0, 2, (3, 10, 2))
    other = matrices * np.array([-1.0, 7.0, 1e-3])[:, None, None]
    np.testing.assert_allclose(linear(other, uv), linear(matrices, uv), rtol=0, atol=1e-11)


def test_a_world_whose_origin_no_dlt_can_have():
    """A camera beside the world's origin has no DLT coefficients, and triangulates all the same."""
    shift = np.eye(4)
    cameras = ring(3)
    matrices = stacked(cameras)
    depth = matrices[0, 2]
    shift[:3, 3] = -depth[:3] * depth[3]  # the old origin moves into the plane of the first camera's centre
    matrices = matrices @ shift
    assert abs(matrices[0, 2, 3]) < 1e-12
    points = cloud(np.random.default_rng(3), 10) - shift[:3, 3]
    np.testing.assert_allclose(linear(matrices, project(matrices, points)), points, rtol=0, atol=1e-9)
    matrices[0, 2, 3] = 0.0
    np.testing.assert_allclose(linear(matrices, project(matrices, points)), points, rtol=0, atol=1e-9)


def test_refined_points_are_scipys_optimum():
    """Gauss-Newton over all points at once ends where SciPy's Levenberg-Marquardt ends, each point for itself.

    A minimum of a sum of squares is found to the root of rounding in the worst case, 1e-8 of a metre; its covariance
    to 1e-6, from the central differences of the reference.
    """
    rng = np.random.default_rng(4)
    matrices, points = stacked(ring(4)), cloud(rng, 25)
    sd = rng.uniform(0.5, 3, (4, 25))
    uv = project(matrices, points)
    uv = drop(uv + sd[..., None] * rng.normal(size=uv.shape), rng, 0.2)
    start = linear(matrices, uv)
    found, cov = refine(matrices, uv, start, sd_px=sd)
    known = np.flatnonzero(np.isfinite(start[:, 0]))
    assert len(known) > 20
    for i in known:
        expected, expected_cov = reference.optimal_point(matrices, uv[:, i], sd[:, i], start[i])
        np.testing.assert_allclose(found[i], expected, rtol=0, atol=1e-8)
        np.testing.assert_allclose(cov[i], expected_cov, rtol=1e-6, atol=1e-6 * np.abs(expected_cov).max())


def test_refinement_never_raises_the_error():
    """From a start 0.2 m off every point's squared error falls, to that of the best start.

    From metres off, among and behind the cameras, full steps overshoot: those are not taken.
    """
    rng = np.random.default_rng(5)
    matrices, points = stacked(ring(3)), cloud(rng, 50)
    uv = project(matrices, points) + rng.normal(0, 2, (3, 50, 2))
    far = points + rng.normal(0, 0.2, points.shape)

    def squares(xyz):
        return np.sum((uv - project(matrices, xyz)) ** 2, axis=(0, 2))

    found, _ = refine(matrices, uv, far, sd_px=2.0, iterations=30)
    best, _ = refine(matrices, uv, linear(matrices, uv), sd_px=2.0)
    one, _ = refine(matrices, uv, far, sd_px=2.0, iterations=1)
    assert (squares(one) <= squares(far)).all()
    np.testing.assert_allclose(squares(found), squares(best), rtol=1e-9)
    lost = points[rng.integers(0, 50, 50)] + rng.normal(0, 2, points.shape)
    for iterations in (1, 5):
        assert (squares(refine(matrices, uv, lost, sd_px=2.0, iterations=iterations)[0]) <= squares(lost)).all()


def test_the_covariance_is_that_of_the_errors():
    """Over 4000 noisy copies of a point, errors spread as the covariance says; their normalised squares are chi2(3).

    A sample variance of n draws has a relative deviation of sqrt(2 / n); four of them are allowed, 9 %.
    """
    rng = np.random.default_rng(6)
    matrices, copies = stacked(ring(3)), 4000
    point = np.broadcast_to([0.1, -0.2, 0.05], (copies, 3))
    sd = np.array([0.5, 1.0, 2.0])[:, None]
    uv = project(matrices, point) + sd[..., None] * rng.normal(size=(3, copies, 2))
    found, cov = refine(matrices, uv, linear(matrices, uv), sd_px=sd)
    error = found - point
    whitened = np.linalg.solve(np.linalg.cholesky(cov), error[..., None])[..., 0]
    spread = whitened.T @ whitened / copies
    np.testing.assert_allclose(spread, np.eye(3), atol=4 * np.sqrt(2 / copies))
    inside = np.mean(np.sum(whitened**2, axis=1) < chi2.ppf(0.95, 3))
    assert abs(inside - 0.95) < 4 * np.sqrt(0.95 * 0.05 / copies)
    mean = error.mean(axis=0) / error.std(axis=0) * np.sqrt(copies)
    assert np.abs(mean).max() < 5  # bias of the optimum is of second order: none to be seen here


def test_residuals_are_dltdvs():
    """sqrt(sum r^2 / (2 n - 3)) by hand: two cameras, each 3 and 4 px off, give sqrt(50 / 1)."""
    matrices = stacked(ring(2))
    point = np.array([[0.1, 0.1, 0.1]])
    uv = project(matrices, point) + np.array([3.0, 4.0])
    np.testing.assert_allclose(residual_px(matrices, uv, point), [np.sqrt(50.0)], rtol=1e-12)
    uv[1] = np.nan
    assert np.isnan(residual_px(matrices, uv, point)).all()
    assert np.isnan(residual_px(matrices, np.full_like(uv, np.nan), np.full_like(point, np.nan))).all()


@pytest.mark.parametrize("sd", [0.1, 2.5])
def test_the_noise_is_estimated_beside_outliers(sd):
    """White noise of sd px is found within 3 %, with 3 % of points 50 deviations off.

    3000 points of 4 cameras hold 15000 degrees of freedom: sqrt(1 / 30000) = 0.6 %, and the core of five deviations
    lets a few outliers in.
    """
    rng = np.random.default_rng(7)
    matrices, points = stacked(ring(4)), cloud(rng, 3000).reshape(1000, 3, 3)
    uv = project(matrices, points)
    uv += rng.normal(0, sd, uv.shape)
    uv[0][rng.random(uv.shape[1:3]) < 0.03] += 50 * sd
    residual = residual_px(matrices, uv, linear(matrices, uv))
    assert abs(pixel_sd(residual, np.full(residual.shape, 4)) / sd - 1) < 0.03


def test_no_point_no_noise():
    """Where no point is seen by two cameras the noise cannot be known, and the user is told what to give."""
    with pytest.raises(ValueError, match=r"seen by two cameras.*give `pixel_sd`"):
        pixel_sd(np.full((3, 2), np.nan), np.zeros((3, 2), dtype=int))
    with pytest.raises(ValueError, match="`pixel_sd`"):
        robust(stacked(ring(2)), np.full((2, 3, 1, 2), np.nan))
    found = robust(stacked(ring(2)), np.full((2, 3, 1, 2), np.nan), sd_px=1.0)
    assert np.isnan(found.xyz_m).all()
    assert not found.rejected.any()


def noisy_scene(n_cameras, rng, *, n_frames=60, n_markers=3, sd=0.5):
    matrices = stacked(ring(n_cameras))
    points = cloud(rng, n_frames * n_markers).reshape(n_frames, n_markers, 3)
    uv = project(matrices, points)
    return matrices, points, uv + rng.normal(0, sd, uv.shape)


@pytest.mark.parametrize("given", [0.5, None])
def test_the_bad_ray_is_dropped_and_counted(given):
    """One ray in ten points is displaced by 40 px: just those rays are rejected, and their points are good again.

    Among five cameras a displaced ray stands out by 80 deviations; a good ray is rejected by chance where the residual
    exceeds five deviations, which chi2(7) does once in 1e33.
    """
    rng = np.random.default_rng(8)
    matrices, points, uv = noisy_scene(5, rng)
    bad = np.zeros(uv.shape[:3], dtype=bool)
    t, m = np.nonzero(rng.random(points.shape[:2]) < 0.1)
    camera = rng.integers(0, 5, len(t))
    bad[camera, t, m] = True
    angle = rng.uniform(0, 2 * np.pi, len(t))
    uv[camera, t, m] += 40 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    found = robust(matrices, uv, sd_px=given)
    np.testing.assert_array_equal(found.rejected, bad)
    whitened = np.linalg.solve(np.linalg.cholesky(found.cov_m2), (found.xyz_m - points)[..., None])[..., 0]
    assert (np.sum(whitened**2, axis=-1) < chi2.ppf(1 - 1e-6, 3)).all()
    np.testing.assert_allclose(
        found.residual_px, residual_px(matrices, np.where(bad[..., None], np.nan, uv), found.xyz_m)
    )


def test_two_bad_rays_of_one_point_are_both_found():
    """Of six rays two are wrong by different amounts: worst first, both go, none else."""
    rng = np.random.default_rng(9)
    matrices, _, uv = noisy_scene(6, rng)
    bad = np.zeros(uv.shape[:3], dtype=bool)
    bad[1, ::5, 0] = bad[4, ::5, 0] = True
    uv[1, ::5, 0] += [60.0, 10.0]
    uv[4, ::5, 0] += [-15.0, 90.0]
    np.testing.assert_array_equal(robust(matrices, uv, sd_px=0.5).rejected, bad)


def test_clean_pixels_lose_no_ray():
    """Nothing is rejected where nothing is wrong: 1800 rays of white noise, and rays without any noise."""
    rng = np.random.default_rng(10)
    matrices, _, uv = noisy_scene(4, rng, n_frames=150)
    assert not robust(matrices, uv).rejected.any()
    matrices, points, uv = noisy_scene(4, rng, sd=0.0)
    found = robust(matrices, uv, sd_px=0.5)
    assert not found.rejected.any()
    np.testing.assert_allclose(found.xyz_m, points, rtol=0, atol=EXACT_M)


def test_exact_pixels_give_points_with_covariances():
    """Nothing is divided by a noise of 0: positions come back, and their covariances are as good as none."""
    matrices, xyz = stacked(ring(4)), cloud(np.random.default_rng(3), 20)[None]
    found = robust(matrices, project(matrices, xyz), sd_px=0.0)
    np.testing.assert_allclose(found.xyz_m, xyz, atol=1e-9)
    assert (np.trace(found.cov_m2, axis1=-2, axis2=-1) < 1e-20).all()


def test_two_rays_that_disagree_are_no_point():
    """Nothing tells which of two is wrong: both are rejected, the point is lost, the others stay."""
    rng = np.random.default_rng(11)
    matrices, points, uv = noisy_scene(2, rng)
    # off its epipolar line: the sides of the triangle of both centres and the point are horizontal
    uv[1, 7, 1, 1] += 60
    found = robust(matrices, uv, sd_px=0.5)
    assert found.rejected[:, 7, 1].all()
    assert found.rejected.sum() == 2
    assert np.isnan(found.xyz_m[7, 1]).all()
    assert np.isnan(found.cov_m2[7, 1]).all()
    assert np.isfinite(found.xyz_m).all(axis=-1).sum() == points[..., 0].size - 1


def test_rejection_is_the_same_in_any_order():
    """Points are solved for themselves: alone, or among others, or with the cameras in another order."""
    rng = np.random.default_rng(12)
    matrices, _, uv = noisy_scene(5, rng, n_frames=20)
    uv[2, ::4, 1] += 30
    uv = drop(uv, rng, 0.2)
    whole = robust(matrices, uv, sd_px=0.5)
    part = robust(matrices, uv[:, 4:9], sd_px=0.5)
    turned = robust(matrices[::-1], uv[::-1], sd_px=0.5)
    np.testing.assert_array_equal(part.rejected, whole.rejected[:, 4:9])
    np.testing.assert_allclose(part.xyz_m, whole.xyz_m[4:9], rtol=0, atol=EXACT_M)
    np.testing.assert_array_equal(turned.rejected, whole.rejected[::-1])
    np.testing.assert_allclose(turned.xyz_m, whole.xyz_m, rtol=0, atol=1e-8)


def test_two_cameras_on_one_ray_see_no_depth():
    """The same camera twice cannot triangulate: no point, exactly and with noise, in both solvers."""
    camera = ring(1)[0]
    matrices = stacked([camera, camera])
    uv = project(matrices, np.array([[[0.1, 0.0, 0.0]]]))
    for noise in (0.0, 0.1):
        found = robust(matrices, uv + noise * np.random.default_rng(14).normal(size=uv.shape), sd_px=0.5)
        assert np.isnan(found.xyz_m).all()
        assert np.isnan(found.cov_m2).all()
    points, cov = refine(matrices, uv, np.array([[[0.1, 0.0, 0.0]]]), sd_px=1.0)
    assert np.isnan(points).all()
    assert np.isnan(cov).all()


def test_a_narrow_base_is_not_a_singular_one():
    """Two cameras 2 mm apart, seen from 2 m, triangulate exact pixels: depth is weak, by 1e3, but not unknown.

    Rounding of pixels, 1e-16, costs the condition of 1e3 and the 1e2 of a picture's 600 px a metre; normal equations
    without their refinement would cost it squared: 1e-9.
    """
    near = ring(1)[0]
    shift = np.eye(4)
    shift[:3, 3] = [0.002, 0.0, 0.0]
    matrices = np.stack([stacked([near])[0], stacked([near])[0] @ shift])
    points = cloud(np.random.default_rng(15), 10)
    np.testing.assert_allclose(linear(matrices, project(matrices, points)), points, rtol=0, atol=1e-11)


def test_no_point_at_all():
    """Empty recordings, and single cameras, go through: no frame, no marker, nothing seen twice."""
    matrices = stacked(ring(3))
    for shape in ((0, 2), (4, 0)):
        uv = np.full((3, *shape, 2), np.nan)
        assert linear(matrices, uv).shape == (*shape, 3)
        points, cov = refine(matrices, uv, linear(matrices, uv), sd_px=1.0)
        assert points.shape == (*shape, 3)
        assert cov.shape == (*shape, 3, 3)
    one = np.full((3, 1, 1, 2), np.nan)
    one[0] = 500.0
    assert np.isnan(linear(matrices, one)).all()
    found = robust(matrices, one, sd_px=1.0)
    assert np.isnan(found.xyz_m).all()
    assert not found.rejected.any()


def test_the_caller_keeps_its_pixels():
    """Rejection works on a copy."""
    rng = np.random.default_rng(13)
    matrices, _, uv = noisy_scene(4, rng, n_frames=10)
    uv[0, 3, 0] += 100
    before = uv.copy()
    robust(matrices, uv)
    np.testing.assert_array_equal(uv, before)
