"""What the tracker sees of a frame, what it believes of it, and what it makes of both."""

import numpy as np
import pytest

from filters.ensemble import Gaussian, default_points, spread
from filters.motion.constant_velocity import ConstantVelocity
from filters.observations import WHOLE, PixelObservations, PositionObservations, Rows
from filters.track import gate_groups, marker_spread, smooth
from mocap.cameras import project, stacked
from mocap.triangulate import linear, refine
from tests.mocap.rigs import cloud, ring


def pixels(rng, *, n_cameras=3, n_frames=4, n_markers=5, sd=0.5, wide_m=0.2, still=False):
    """A rig's pixels of markers, as the tracker takes them."""
    matrices = stacked(ring(n_cameras))
    count = 1 if still else n_frames
    xyz = np.broadcast_to(cloud(rng, count * n_markers).reshape(count, n_markers, 3), (n_frames, n_markers, 3))
    uv = project(matrices, xyz) + rng.normal(0, sd, (n_cameras, n_frames, n_markers, 2))
    sds = rng.uniform(0.9, 1.1, uv.shape[:3]) * sd
    points, cov = refine(matrices, uv, linear(matrices, uv), sd_px=sds)
    seen = PixelObservations(matrices=matrices, uv_px=uv, sd_px=sds, xyz_m=points, cov_m2=cov, wide_m=wide_m)
    return seen, xyz


def hide(seen, mask):
    """The same observations without some rays; points follow from those that are left."""
    uv = np.where(mask[..., None], np.nan, seen.uv_px)
    points, cov = refine(seen.matrices, uv, linear(seen.matrices, uv), sd_px=seen.sd_px)
    return PixelObservations(
        matrices=seen.matrices, uv_px=uv, sd_px=seen.sd_px, xyz_m=points, cov_m2=cov, wide_m=seen.wide_m
    )


def test_pixel_rows_are_the_cameras_projection():
    """Each row is u or v of one camera and one marker, predicted as ``project`` does, with its own deviation."""
    rng = np.random.default_rng(1)
    seen, _ = pixels(rng)
    seen = hide(seen, rng.random(seen.uv_px.shape[:3]) < 0.3)
    states = rng.uniform(-0.3, 0.3, (7, 5, 3))
    for frame in range(seen.n_frames):
        rows = seen.rows(frame, np.full(5, 0.01))
        expected = project(seen.matrices, states)
        predicted = rows.h(states)
        assert predicted.shape == (7, len(rows.y))
        assert len(rows.y) == 2 * np.isfinite(seen.uv_px[:, frame, :, 0]).sum()
        for row, group in enumerate(rows.group):
            camera, marker = rows.where[group]
            axis = row - np.searchsorted(rows.group, group)
            np.testing.assert_allclose(predicted[:, row], expected[camera, :, marker, axis], atol=1e-9)
            assert rows.y[row] == seen.uv_px[camera, frame, marker, axis]
            assert rows.sd[row] == seen.sd_px[camera, frame, marker]


def test_a_vague_marker_is_observed_through_its_point():
    """Above ``wide_m`` three whitened rows stand for all rays: their squared miss is Mahalanobis' distance.

    A vague marker that a single camera sees says nothing; the others keep their pixels.
    """
    rng = np.random.default_rng(2)
    seen, _ = pixels(rng)
    mask = np.zeros(seen.uv_px.shape[:3], dtype=bool)
    mask[1:, :, 3] = True
    seen = hide(seen, mask)
    wide = np.array([0.01, 0.5, 0.01, 0.5, 0.01])
    rows = seen.rows(0, wide)
    assert set(map(tuple, rows.where)) == {(c, m) for c in range(3) for m in (0, 2, 4)} | {(WHOLE, 1)}
    group = int(np.flatnonzero(rows.where[:, 0] == WHOLE)[0])
    states = rng.uniform(-0.3, 0.3, (6, 5, 3))
    miss = (rows.y - rows.h(states))[:, rows.group == group] / rows.sd[rows.group == group]
    apart = states[:, 1] - seen.xyz_m[0, 1]
    expected = np.einsum("si,ij,sj->s", apart, np.linalg.inv(seen.cov_m2[0, 1]), apart)
    np.testing.assert_allclose(np.sum(miss**2, axis=1), expected, rtol=1e-9)


def test_position_rows_are_the_positions():
    """Three rows for each marker that is seen, none for the others."""
    rng = np.random.default_rng(3)
    xyz, sd = rng.normal(size=(2, 3, 3)), rng.uniform(1, 2, (2, 3))
    xyz[0, 1] = np.nan
    seen = PositionObservations(xyz_m=xyz, sd_m=sd)
    rows, states = seen.rows(0, np.ones(3)), rng.normal(size=(4, 3, 3))
    np.testing.assert_array_equal(rows.h(states), states[:, [0, 2]].reshape(4, -1))
    np.testing.assert_array_equal(rows.y, xyz[0, [0, 2]].ravel())
    np.testing.assert_array_equal(rows.sd, np.repeat(sd[0, [0, 2]], 3))
    np.testing.assert_array_equal(rows.where, [[WHOLE, 0], [WHOLE, 2]])


def test_frames_without_anything_have_no_rows():
    """Nothing seen, or one vague ray: zero rows that still can be asked."""
    rng = np.random.default_rng(4)
    seen, _ = pixels(rng, n_markers=2)
    blank = hide(seen, np.ones(seen.uv_px.shape[:3], dtype=bool))
    for spread_m in (0.01, 10.0):
        rows = blank.rows(0, np.full(2, spread_m))
        assert len(rows.y) == len(rows.sd) == len(rows.group) == len(rows.where) == 0
        assert rows.h(np.zeros((3, 2, 3))).shape == (3, 0)


def groups(where, sizes):
    """Rows of no content, in groups of the given sizes."""
    group = np.repeat(np.arange(len(sizes)), sizes)
    return Rows(lambda _: None, np.zeros(len(group)), np.ones(len(group)), group, np.array(where))


@pytest.mark.parametrize(
    ("far", "believed"),
    [
        ([], [True, True, True, True, True, True, True]),
        ([0], [False, True, True, True, True, True, True]),  # a lone bad ray among two of its marker
        (
            [0, 1],
            [True, True, True, True, True, True, True],
        ),  # both rays of marker 0 say the same: the prediction was wrong
        ([2], [True, True, False, True, True, True, True]),  # the only ray of marker 1
        ([4, 5], [True, True, True, True, True, True, True]),  # two of three: the third looks along the way
        ([6], [True, True, True, True, True, True, False]),
        ([3], [True, True, True, True, True, True, True]),  # a position stands for all rays of its marker
        ([0, 2, 4], [False, True, False, True, False, True, True]),
    ],
)
def test_a_lone_ray_is_not_believed_agreeing_rays_are(far, believed):
    """The rule, case by case: groups are believed or not as a whole, by their worst row."""
    rows = groups([(0, 0), (1, 0), (0, 1), (WHOLE, 2), (2, 3), (0, 3), (1, 3)], [2, 2, 2, 3, 2, 2, 2])
    normalised = np.full(15, 0.1)
    for group in far:
        normalised[np.flatnonzero(rows.group == group)[-1]] = -7.0
    np.testing.assert_array_equal(gate_groups(normalised, rows, 6.0), np.array(believed)[rows.group])


def still(seen, **more):
    """Markers that hardly move, known to a few millimetres."""
    start = np.nan_to_num(seen.xyz_m[0])
    options = {"start_sd_m": 0.01, "speed_sd_m_s": 0.01, "density": np.full(start.shape[0], 1e-3)} | more
    return ConstantVelocity(start_m=start, **options)


def test_the_spread_of_a_marker_is_its_deviation():
    """Root mean square deviation of a marker's coordinates, from sigma points: exact where markers are linear."""
    rng = np.random.default_rng(5)
    factor = np.tril(rng.normal(size=(6, 6)))
    state = Gaussian(rng.normal(size=6), factor)
    found = marker_spread(spread(state, 3.0).reshape(13, 2, 3), 3.0)
    np.testing.assert_allclose(found, np.sqrt(np.diag(state.cov).reshape(2, 3).mean(axis=1)), rtol=1e-12)
    assert default_points(6).n == 6


def test_a_bad_ray_is_gated_and_its_marker_stays_right():
    """One ray 60 px off in one frame: it alone is not used, and the track is as good as without it."""
    rng = np.random.default_rng(6)
    seen, truth = pixels(rng, n_frames=12, still=True)
    seen.uv_px[1, 6, 2] += [60.0, 0.0]
    t = np.arange(12) * 0.01
    found = smooth(still(seen), seen, t)
    gated = [
        (k, *rows.where[rows.group[~used][0]])
        for k, (rows, used) in enumerate(zip(found.rows, found.used, strict=True))
        if not used.all()
    ]
    assert gated == [(6, 1, 2)]
    mask = np.zeros(seen.uv_px.shape[:3], dtype=bool)
    mask[1, 6, 2] = True
    without = smooth(still(seen), hide(seen, mask), t)
    np.testing.assert_allclose(found.xyz_m, without.xyz_m, atol=1e-9)
    np.testing.assert_allclose(found.cov_m2, without.cov_m2, atol=1e-12)
    error = np.linalg.norm(found.xyz_m - truth, axis=-1)
    assert error.max() < 5 * np.sqrt(np.trace(found.cov_m2, axis1=-2, axis2=-1)).max()


@pytest.mark.parametrize("way", [(0, 0, 0.03), (0.03, 0, 0), (0, 0.03, 0), (0.02, 0.02, 0)])
def test_a_marker_that_really_moved_is_followed(way):
    """All rays of a marker jump by 3 cm, 30 deviations: they are believed, and the track goes there.

    Also where a camera looks along the jump and sees nothing of it: believing it alone would pull the track astray.
    What is left after six frames is an estimate from noisy pixels, within five of its deviations.
    """
    rng = np.random.default_rng(7)
    seen, truth = pixels(rng, n_frames=12, still=True)
    moved = truth.copy()
    moved[6:, 2] += way
    uv = project(seen.matrices, moved) + rng.normal(0, 0.5, seen.uv_px.shape)
    points, cov = refine(seen.matrices, uv, linear(seen.matrices, uv), sd_px=0.5)
    seen = PixelObservations(matrices=seen.matrices, uv_px=uv, sd_px=seen.sd_px, xyz_m=points, cov_m2=cov, wide_m=0.2)
    found = smooth(still(seen, density=np.full(5, 1.0)), seen, np.arange(12) * 0.01)
    assert all(used.all() for used in found.used[9:])
    assert np.linalg.norm(found.xyz_m[-1, 2] - moved[-1, 2]) < 5 * np.sqrt(np.trace(found.cov_m2[-1, 2]))


def test_one_camera_still_informs():
    """A marker that one camera sees for some frames is known better than one that none sees, across the ray.

    Along the ray the depth is left to the model: its deviation there is the larger one.
    """
    rng = np.random.default_rng(8)
    seen, truth = pixels(rng, n_frames=20, n_markers=2, still=True)
    mask = np.zeros(seen.uv_px.shape[:3], dtype=bool)
    mask[1:, 5:15, 0] = True
    mask[:, 5:15, 1] = True
    found = smooth(still(seen, density=np.full(2, 5.0)), hide(seen, mask), np.arange(20) * 0.01)
    sd = np.sqrt(np.trace(found.cov_m2, axis1=-2, axis2=-1))
    assert (sd[7:13, 0] < 0.85 * sd[7:13, 1]).all()
    centre = -np.linalg.solve(seen.matrices[0][:, :3], seen.matrices[0][:, 3])
    ray = truth[10, 0] - centre
    ray /= np.linalg.norm(ray)
    along = ray @ found.cov_m2[10, 0] @ ray
    assert along > 2 * (np.trace(found.cov_m2[10, 0]) - along) / 2
    error = found.xyz_m - truth
    whitened = np.linalg.solve(np.linalg.cholesky(found.cov_m2), error[..., None])[..., 0]
    assert np.sum(whitened**2, axis=-1).max() < 25  # chi2(3): once in 6e4


def test_pixels_and_points_agree_where_both_are_right():
    """Tracked by pixels or by triangulated points with their covariance, precise data give one answer.

    The difference is the curvature of the projection over the posterior's millimetre: far below its deviation.
    """
    rng = np.random.default_rng(9)
    seen, _ = pixels(rng, n_frames=10, still=True)
    t = np.arange(10) * 0.01
    by_pixels = smooth(still(seen), seen, t)
    whole = PixelObservations(
        matrices=seen.matrices, uv_px=seen.uv_px, sd_px=seen.sd_px, xyz_m=seen.xyz_m, cov_m2=seen.cov_m2, wide_m=0.0
    )
    by_points = smooth(still(seen), whole, t)
    sd = np.sqrt(np.diagonal(by_points.cov_m2, axis1=-2, axis2=-1))
    assert np.abs((by_pixels.xyz_m - by_points.xyz_m) / sd).max() < 0.1
    np.testing.assert_allclose(by_pixels.cov_m2, by_points.cov_m2, rtol=0.05, atol=0.02 * by_points.cov_m2.max())


def test_innovations_are_consistent():
    """Data drawn from the model itself: the mean NIS is its number of rows, to four of its deviations.

    NIS of m rows is chi2(m), variance 2 m: over all frames sqrt(2 sum m).
    """
    rng = np.random.default_rng(10)
    n_frames, n_markers, dt_s, density = 120, 4, 0.01, 50.0
    model = ConstantVelocity(
        start_m=np.zeros((n_markers, 3)), start_sd_m=0.1, speed_sd_m_s=1.0, density=np.full(n_markers, density)
    )
    start = model.initial()
    states = [start.mean + start.factor @ rng.normal(size=len(start.mean))]
    for _ in range(n_frames - 1):
        states.append(model.step(states[-1][None], dt_s)[0] + model.noise(dt_s) @ rng.normal(size=len(start.mean)))
    truth = np.array(states)[:, : 3 * n_markers].reshape(n_frames, n_markers, 3)
    sd = np.full((n_frames, n_markers), 2e-3)
    seen = PositionObservations(xyz_m=truth + 2e-3 * rng.normal(size=truth.shape), sd_m=sd)
    found = smooth(model, seen, np.arange(n_frames) * dt_s, gate_sd=np.inf)
    total = found.n_rows.sum()
    assert abs(found.nis.sum() - total) < 4 * np.sqrt(2 * total)
    z = (found.xyz_m - truth) / np.sqrt(np.diagonal(found.cov_m2, axis1=-2, axis2=-1))
    assert 0.9 < np.mean(np.abs(z) < 1.96) < 0.99  # 1440 coordinates, correlated over a few frames
