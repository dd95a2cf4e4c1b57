"""What the tracker believes of what it sees, and what it makes of that."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.ensemble import Gaussian
from mocap.filters.gaussian import Markers, Moments, View
from mocap.filters.motion.base import Step
from mocap.filters.motion.constant_velocity import ConstantVelocity
from mocap.filters.observations import WHOLE, PixelObservations, PositionObservations, Sights
from mocap.filters.observe import gate_groups, observe
from mocap.filters.track import smooth

from mocap.cameras.camera import project
from mocap.cameras.triangulate import linear, refine
from tests.filters.filmed import hide, pixels, still

CASES = [(0, 0), (1, 0), (0, 1), (WHOLE, 2), (2, 3), (0, 3), (1, 3)]
"""Camera and marker of the groups that the gate is tried on."""


@pytest.mark.parametrize(
    ("far", "refused"),
    [
        ([], []),
        ([0], [0]),  # a lone bad ray among two of its marker
        ([0, 1], []),  # both rays of marker 0 say the same: the prediction was wrong
        ([2], [2]),  # the only ray of marker 1
        ([4, 5], []),  # two of three: the third looks along the way
        ([6], [6]),
        ([3], []),  # a position stands for all rays of its marker
        ([0, 2, 4], [0, 2, 4]),
    ],
)
def test_a_lone_ray_is_not_believed_agreeing_rays_are(far, refused):
    """The rule, case by case."""
    mask, apart = np.isin(np.arange(7), far), np.zeros(7, dtype=bool)
    believed = gate_groups(mask.astype(float), mask, np.array(CASES), apart)
    np.testing.assert_array_equal(believed, ~np.isin(np.arange(7), refused))


@pytest.mark.parametrize(
    ("squared", "far", "refused"),
    [
        ([1.0, 3.0], [], [1]),  # neither is far: the nearer one
        ([40.0, 3.0], [0], [0]),
        ([50.0, 40.0], [0, 1], [0, 1]),  # what does not meet does not agree
    ],
)
def test_of_rays_that_do_not_meet_one_is_believed_at_most(squared, far, refused):
    """Those of marker 0 do not meet, all others are near and stay."""
    apart = np.isin(np.arange(7), [0, 1])
    distance = np.concatenate([squared, np.full(5, 5.0)])
    believed = gate_groups(distance, np.isin(np.arange(7), far), np.array(CASES), apart)
    np.testing.assert_array_equal(believed, ~np.isin(np.arange(7), refused))


def test_of_two_clicks_on_two_markers_the_right_one_is_followed():
    """One of three cameras is left and another clicks 300 px off: the track is that of the right one alone."""
    rng = np.random.default_rng(8)
    seen, truth = pixels(rng, n_frames=12, still=True)
    gone = np.zeros(seen.uv_px.shape[:3], dtype=bool)
    gone[1:, 4:, 2] = True
    alone = hide(seen, gone)
    wrong = alone.uv_px.copy()
    wrong[1, 4:, 2] = seen.uv_px[1, 4:, 2] + 300.0
    both = replace(alone, uv_px=wrong)
    model, t_s = still(seen), np.arange(12) / 100
    expected, found = smooth(model, alone, t_s), smooth(model, both, t_s)
    np.testing.assert_allclose(found.xyz_m, expected.xyz_m, atol=1e-9)
    assert np.abs(found.xyz_m - truth).max() < 0.02


def test_groups_are_believed_as_a_whole_by_their_worst_row():
    """A group whose last row alone is far takes no part at all; the others are conditioned on as if it were not there.

    Four unit states read by rows of slope 1 and deviation 1: a row is far above gate_sd sqrt(2).
    """
    size = np.array([2, 2, 2, 3, 2, 2, 2])
    slope = np.where(np.arange(3)[:, None] < size[:, None, None], np.eye(3), 0.0)
    state = Gaussian(np.zeros(12), np.eye(12))
    view = View(np.zeros((4, 3)), np.eye(12))
    inside, outside = 3.9 * np.sqrt(2), 4.1 * np.sqrt(2)

    def condition(keep, innovation):
        sights = Sights(
            where=np.array(CASES)[keep],
            size=size[keep],
            innovation=innovation[keep],
            slope=slope[keep],
            sd=np.ones((keep.sum(), 3)),
            dof=np.full(keep.sum(), np.inf),
            apart=np.zeros(keep.sum(), dtype=bool),
        )
        found, _, seen = observe(Markers(state, view), sights, gate_sd=4.0)
        return found, seen

    for bad in (0, 2, 5):
        innovation = np.where(np.arange(3) < size[:, None], 0.1, 0.0)
        innovation[:, 0] = inside
        innovation[bad, 1] = outside
        keep = np.arange(7) != bad
        found, seen = condition(np.ones(7, dtype=bool), innovation)
        expected, short = condition(keep, innovation)
        np.testing.assert_array_equal(seen.weight, keep)
        np.testing.assert_array_equal(found.mean, expected.mean)
        np.testing.assert_array_equal(found.cov, expected.cov)
        assert seen.n_rows == short.n_rows == size[keep].sum()
        assert (seen.nis, seen.log_likelihood) == (short.nis, short.log_likelihood)


def test_covariances_of_markers_are_those_of_the_state():
    """Exactly, where markers are linear; rates are not read."""
    rng = np.random.default_rng(5)
    model = ConstantVelocity(start_m=np.zeros((2, 3)), start_sd_m=1.0, speed_sd_m_s=1.0, density=np.ones(2))
    mean, root = rng.normal(size=(2, 6)), rng.normal(size=(2, 6, 6))
    state = Moments(mean, root @ np.swapaxes(root, 1, 2))
    markers = Markers(state, model.view(mean, 0))
    np.testing.assert_array_equal(markers.view.mean, mean[:, :3])
    np.testing.assert_allclose(markers.cov, state.cov[:, :3, :3], atol=1e-12)


def test_a_bad_ray_is_gated_and_its_marker_stays_right():
    """One ray 60 px off in one frame: it alone is not used, and the track is as good as without it."""
    rng = np.random.default_rng(6)
    seen, truth = pixels(rng, n_frames=12, still=True)
    seen.uv_px[1, 6, 2] += [60.0, 0.0]
    t = np.arange(12) * 0.01
    found = smooth(still(seen), seen, t)
    gated = [(k, *where) for k, o in enumerate(found.observed) for where in o.where[o.weight == 0]]
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
    assert all((o.weight == 1).all() for o in found.observed[9:])
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

    def drawn(cov):
        return np.einsum("mij,mj->mi", np.linalg.cholesky(cov), rng.normal(size=cov.shape[:2]))

    states = [start.mean + drawn(start.cov)]
    for _ in range(n_frames - 1):
        move = model.move(start, Step(1, dt_s))
        states.append(move.forward(states[-1]) + drawn(move.noise))
    truth = np.array(states)[..., :3]
    sd = np.full((n_frames, n_markers), 2e-3)
    seen = PositionObservations(xyz_m=truth + 2e-3 * rng.normal(size=truth.shape), sd_m=sd)
    found = smooth(model, seen, np.arange(n_frames) * dt_s, gate_sd=np.inf)
    total = sum(seen.n_rows for seen in found.observed)
    assert total == truth.size
    assert abs(sum(seen.nis for seen in found.observed) - total) < 4 * np.sqrt(2 * total)
    z = (found.xyz_m - truth) / np.sqrt(np.diagonal(found.cov_m2, axis1=-2, axis2=-1))
    assert 0.9 < np.mean(np.abs(z) < 1.96) < 0.99  # 1440 coordinates, correlated over a few frames


def test_what_a_person_states_is_believed_wherever_it_is():
    """A ray 20 deviations from its prediction is refused, unless a person placed it: then with all its weight."""
    sights = Sights(
        where=np.array([[0, 0]]),
        size=np.array([2]),
        innovation=np.array([[20.0, 0.0, 0.0]]),
        slope=np.where(np.arange(3)[:, None] < 2, np.eye(3), 0.0)[None],
        sd=np.ones((1, 3)),
        dof=np.array([np.inf]),
        apart=np.array([False]),
    )
    markers = Markers(Gaussian(np.zeros(3), 0.5 * np.eye(3)), View(np.zeros((1, 3)), np.eye(3)))
    refused, _, seen = observe(markers, sights)
    assert (seen.weight == 0).all()
    assert not refused.mean.any()
    found, _, seen = observe(markers, replace(sights, by_hand=np.array([True])))
    assert (seen.weight == 1).all()
    np.testing.assert_allclose(found.mean, [20.0 * 0.25 / 1.25, 0.0, 0.0])  # of variances
