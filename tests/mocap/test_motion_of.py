"""Velocities and joint covariances of what was returned: errors that last move positions, and no velocity."""

from dataclasses import replace

import numpy as np
from mocap.filters.moving import Rates
from mocap.filters.velocities import RatePoints

from mocap.records import MarkerTracks, Status
from mocap.tracking.tracking import motion_of

FRAMES, NAMES = 6, ("a", "b")


def smoothed(rng):
    """Rates of two markers whose twelve numbers have one covariance in each frame."""
    root = rng.normal(size=(FRAMES, 12, 12))
    whole = (root @ np.swapaxes(root, 1, 2)).reshape(FRAMES, 2, 6, 2, 6)
    own = np.stack([whole[:, i, :, i] for i in range(2)], axis=1).astype(np.float32)
    cross = whole[:, 0, :, 1][:, None].astype(np.float32)
    asked = RatePoints(names=NAMES, pairs=((0, 1),))
    velocity = rng.normal(size=(FRAMES, 2, 3))
    return Rates(rate_points=asked, velocity_m_s=velocity, own=own, cross=cross, kept=np.ones((FRAMES, 2, 3)))


def returned(rates, added, *, left_m_s=0.0):
    """The motion where so much is added to the smoother's covariance of positions."""
    markers = MarkerTracks(
        names=NAMES,
        t_s=0.01 * np.arange(FRAMES),
        xyz_m=np.zeros((FRAMES, 2, 3)),
        cov_m2=rates.own[:, :2, :3, :3].astype(float) + added * np.eye(3),
        status=np.full((FRAMES, 2), Status.MEASURED),
    )
    return motion_of(markers, slice(0, FRAMES), rates, rates.rate_points, left_m_s=left_m_s)


def test_an_error_that_lasts_leaves_velocities_as_they_are():
    """A constant covariance added to positions is in their block; velocities, their mean included, keep theirs."""
    rates = smoothed(np.random.default_rng(0))
    motion = returned(rates, 25.0)
    np.testing.assert_allclose(motion.own[..., :3, :3], rates.own[..., :3, :3] + 25.0 * np.eye(3), rtol=1e-4)
    np.testing.assert_array_equal(motion.own[..., 3:, 3:], rates.own[..., 3:, 3:])
    np.testing.assert_array_equal(motion.cross[..., 3:, 3:], rates.cross[..., 3:, 3:])
    np.testing.assert_array_equal(motion.velocity_m_s, rates.velocity_m_s)


def test_what_is_returned_stays_a_covariance():
    """Positions and velocities of both markers together: no variance of any combination is negative."""
    rates = smoothed(np.random.default_rng(1))
    for added in (0.0, 25.0):
        joint, known = returned(rates, added).joint([0, 1])
        assert known
        assert np.linalg.eigvalsh(joint).min() > -1e-4


def test_nothing_added_changes_nothing():
    """The smoother's own covariance comes back, to the digits that are kept."""
    rates = smoothed(np.random.default_rng(2))
    motion = returned(rates, 0.0)
    np.testing.assert_allclose(motion.own, rates.own, atol=1e-4)
    np.testing.assert_allclose(motion.cross, rates.cross, atol=1e-4)


def test_covariances_are_symmetric_to_the_last_bit():
    """Whatever rounding left in the smoother's: flights of 1.005e-6 of the correlations could not be loaded again."""
    rates = smoothed(np.random.default_rng(1))
    own = rates.own * (1.0 + 3e-6 * np.triu(np.ones((6, 6), dtype=np.float32), 1))
    motion = returned(replace(rates, own=own.astype(np.float32)), 0.1)
    np.testing.assert_array_equal(motion.own, np.swapaxes(motion.own, -1, -2))


def test_a_velocity_covers_that_of_points_that_the_track_leaves():
    """As of two values of which either may be right: half of the square of the difference; of a mean by weights."""
    rates = smoothed(np.random.default_rng(3))
    mean = RatePoints(names=(*NAMES, "both"), weights=((0.25, 0.75),), pairs=((0, 1),))
    three = {name: getattr(rates, name)[:, [0, 1, 1]] for name in ("velocity_m_s", "own", "kept")}
    rates = replace(rates, rate_points=mean, **three)
    left = np.zeros((FRAMES, 2, 3))
    left[2, 0] = 0.3, 0.0, -0.4
    plain, wide = (returned(rates, 0.0, left_m_s=left_m_s) for left_m_s in (0.0, left))
    grown = (wide.own - plain.own)[..., 3:, 3:]
    expected = 0.5 * np.outer(left[2, 0], left[2, 0])
    np.testing.assert_allclose(grown[2], [expected, 0 * expected, expected / 16], atol=1e-5)
    np.testing.assert_array_equal(np.delete(grown, 2, axis=0), 0.0)
    np.testing.assert_array_equal(wide.own[..., :3, :], plain.own[..., :3, :])
