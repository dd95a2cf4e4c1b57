"""What the tracker sees of a frame: rays, points and positions as linear functions of their markers."""

import numpy as np
import pytest
from mocap.filters.observations import WHOLE, PixelObservations, PositionObservations, linearised_pixels, seen_from

from mocap.cameras.camera import project
from tests.filters.filmed import hide, pixels


def known(mean, sd_m=1e-5):
    """Markers at (M, 3) known to ``sd_m``: over 10 um projections bend by f / depth^2 (10 um)^2 = 3e-8 px."""
    return mean, np.broadcast_to(sd_m**2 * np.eye(3), (len(mean), 3, 3))


def test_a_ray_is_the_cameras_projection():
    """A group is u and v of one camera and one marker, predicted as ``project`` does, with its own deviation."""
    rng = np.random.default_rng(1)
    seen, _ = pixels(rng)
    seen = hide(seen, rng.random(seen.uv_px.shape[:3]) < 0.3)
    mean = rng.uniform(-0.3, 0.3, (5, 3))
    for frame in range(seen.n_frames):
        sights = seen.sights(frame, *known(mean))
        camera, marker = sights.where.T
        expected = np.isfinite(seen.uv_px[:, frame, :, 0])
        assert sorted(map(tuple, sights.where)) == sorted(zip(*np.nonzero(expected), strict=True))
        np.testing.assert_array_equal(sights.size, 2)
        here = seen.uv_px[camera, frame, marker] - project(seen.matrices, mean)[camera, marker]
        np.testing.assert_allclose(sights.innovation[:, :2], here, atol=1e-7)
        sd = np.repeat(seen.sd_px[camera, frame, marker, None], 2, axis=1)
        np.testing.assert_allclose(sights.sd[:, :2], sd, rtol=1e-12)
        assert np.isinf(sights.dof).all()
        assert not sights.innovation[:, 2].any()
        assert not sights.slope[:, 2].any()
        np.testing.assert_array_equal(sights.sd[:, 2], 1)


def test_the_bend_of_a_ray_is_part_of_its_error():
    """Of a marker known to 10 cm the innovation is from the mean pixel, and what linearising leaves adds to sd^2."""
    rng = np.random.default_rng(8)
    seen, _ = pixels(rng)
    mean, cov = rng.uniform(-0.3, 0.3, (5, 3)), np.tile(0.01 * np.eye(3) + 0.005, (5, 1, 1))
    sights = seen.sights(0, mean, cov)
    camera, marker = sights.where.T
    pixel, slope, left = linearised_pixels(seen.matrices, mean, cov, camera, marker)
    np.testing.assert_array_equal(sights.innovation[:, :2], seen.uv_px[camera, 0, marker] - pixel)
    np.testing.assert_array_equal(sights.slope[:, :2], slope)
    np.testing.assert_allclose(sights.sd[:, :2] ** 2, seen.sd_px[camera, 0, marker, None] ** 2 + left, rtol=1e-12)
    assert left.max() > 1


def test_a_heavy_tailed_camera_says_so_of_its_rays():
    """Each ray has the degrees of freedom of its camera; a point, which triangulation has cleaned, is normal."""
    seen, _ = pixels(np.random.default_rng(6))
    heavy = PixelObservations(**{**vars(seen), "dof": np.array([3.0, 5.0, np.inf])})
    mean, cov = known(np.zeros((5, 3)))
    cov = cov.copy()
    cov[1] = np.eye(3)
    sights = heavy.sights(0, mean, cov)
    camera = sights.where[:, 0]
    np.testing.assert_array_equal(sights.dof, np.where(camera == WHOLE, np.inf, np.array([3.0, 5.0, np.inf])[camera]))


def test_a_vague_marker_is_observed_through_its_point():
    """Above ``wide_m`` three whitened rows stand for all rays: their squared miss is Mahalanobis' distance.

    A vague marker that a single camera sees says nothing; the others keep their pixels.
    """
    rng = np.random.default_rng(2)
    seen, _ = pixels(rng)
    mask = np.zeros(seen.uv_px.shape[:3], dtype=bool)
    mask[1:, :, 3] = True
    seen = hide(seen, mask)
    mean, sd = rng.uniform(-0.3, 0.3, (5, 3)), np.array([0.01, 0.5, 0.01, 0.5, 0.01])
    sights = seen.sights(0, mean, sd[:, None, None] ** 2 * np.eye(3))
    assert set(map(tuple, sights.where)) == {(c, m) for c in range(3) for m in (0, 2, 4)} | {(WHOLE, 1)}
    group = int(np.flatnonzero(sights.where[:, 0] == WHOLE)[0])
    assert sights.size[group] == 3
    slope, miss = sights.slope[group] / sights.sd[group, :, None], sights.innovation[group] / sights.sd[group]
    information = np.linalg.inv(seen.cov_m2[0, 1])
    np.testing.assert_allclose(slope.T @ slope, information, rtol=1e-9)
    apart = seen.xyz_m[0, 1] - mean[1]
    np.testing.assert_allclose(slope.T @ miss, information @ apart, rtol=1e-9)
    assert miss @ miss == pytest.approx(apart @ information @ apart, rel=1e-9)


@pytest.mark.parametrize(
    ("sd", "whole"), [((0.19, 0.19, 0.19), False), ((0.21, 0.21, 0.21), True), ((0.3, 0.1, 0.1), False)]
)
def test_vague_is_the_root_mean_square_deviation(sd, whole):
    """``wide_m`` = 0.2 is the deviation of a coordinate, over all three."""
    seen, _ = pixels(np.random.default_rng(7), n_markers=1)
    sights = seen.sights(0, np.zeros((1, 3)), np.diag(np.square(sd))[None])
    assert (sights.where[:, 0] == WHOLE).all() == whole
    assert len(sights.where) == (1 if whole else 3)


def test_a_position_is_itself():
    """Three rows of slope one for each marker that is seen, none for the others."""
    rng = np.random.default_rng(3)
    xyz, sd = rng.normal(size=(2, 3, 3)), rng.uniform(1, 2, (2, 3))
    xyz[0, 1] = np.nan
    seen = PositionObservations(xyz_m=xyz, sd_m=sd)
    mean = rng.normal(size=(3, 3))
    sights = seen.sights(0, *known(mean))
    np.testing.assert_array_equal(sights.innovation, (xyz[0] - mean)[[0, 2]])
    np.testing.assert_array_equal(sights.slope, np.broadcast_to(np.eye(3), (2, 3, 3)))
    np.testing.assert_array_equal(sights.sd, np.repeat(sd[0, [0, 2], None], 3, axis=1))
    np.testing.assert_array_equal(sights.where, [[WHOLE, 0], [WHOLE, 2]])
    np.testing.assert_array_equal(sights.size, 3)


@pytest.mark.parametrize("sd_m", [0.01, 10.0])
def test_frames_without_anything_show_nothing(sd_m):
    """No ray, no position, or one ray of a vague marker: no groups."""
    rng = np.random.default_rng(4)
    seen, _ = pixels(rng, n_markers=2)
    blank = hide(seen, np.ones(seen.uv_px.shape[:3], dtype=bool))
    empty = PositionObservations(xyz_m=np.full((1, 2, 3), np.nan), sd_m=np.ones((1, 2)))
    for nothing in (blank, empty):
        sights = nothing.sights(0, *known(np.zeros((2, 3)), sd_m))
        assert not any(len(x) for x in vars(sights).values())
    single = np.ones(seen.uv_px.shape[:3], dtype=bool)
    single[0] = False
    assert len(hide(seen, single).sights(0, *known(np.zeros((2, 3)), sd_m)).where) == (0 if sd_m > 1 else 2)


def test_the_same_rows_from_elsewhere():
    """Rows y = slope (x - about) + e as innovations of another mean: conditioning on them gives the same marker."""
    rng = np.random.default_rng(4)
    seen, _ = pixels(rng, n_markers=3)
    mean, about = rng.uniform(-0.3, 0.3, (2, 3, 3))
    there = seen.sights(0, about, np.tile(1e-4 * np.eye(3), (3, 1, 1)))
    here = seen_from(there, about - mean)
    for g, (_, marker) in enumerate(there.where):
        expected = there.innovation[g] + there.slope[g] @ (about[marker] - mean[marker])
        np.testing.assert_allclose(here.innovation[g], expected, rtol=1e-12)
    for name in ("where", "slope", "sd", "size", "dof"):
        assert getattr(here, name) is getattr(there, name)
