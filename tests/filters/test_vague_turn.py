"""A body whose turn is hardly known: errors are what is stated, whatever the turn was before it was seen."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.body_axes import BodyFrames
from mocap.filters.gaussian import Smoothed
from mocap.filters.motion import pose
from mocap.filters.motion.pose import BodyPath
from mocap.filters.observations import PositionObservations
from mocap.filters.track import filter_forward
from scipy.spatial.transform import Rotation

from tests.filters.test_body_path import MARKERS, RANK, model

NOISE_M = 2e-3


def seen_once(sd_rad, seed, seen):
    """What one frame that shows some of the markers makes of a pose that is drawn from the prior.

    Returns:
        (M, 3) markers as estimated, their covariance (M, 3, 3), and the true ones.
    """
    rng = np.random.default_rng(seed)
    frames = BodyFrames(rotation=Rotation.random(rng=rng).as_matrix()[None], position_m=rng.normal(size=(1, 3)))
    path = BodyPath(frames=frames, velocity_m_s=np.zeros((1, 3)), rate_rad_s=np.zeros((1, 3)))
    motion = replace(model(path), body_sd=np.repeat([0.1, sd_rad, 1.0, 1.0], 3), shape_sd=np.full(2 * RANK, 0.01))
    before = motion.initial()
    root = np.linalg.cholesky(before.cov + 1e-14 * np.eye(motion.size))
    true = motion.markers((before.mean + root @ rng.standard_normal(motion.size))[None], 0)[0]
    shown = np.full((1, MARKERS, 3), np.nan)
    shown[0, :seen] = true[:seen] + NOISE_M * rng.standard_normal((seen, 3))
    observed = PositionObservations(xyz_m=shown, sd_m=np.full((1, MARKERS), NOISE_M))
    state = next(iter(filter_forward(motion, observed, np.zeros(1)))).state
    found = Smoothed(state.mean, state.cov, np.zeros_like(state.cov))
    return *motion.shown(found, motion.view(state.mean, 0), 0), true


def over_stated(sd_rad, seen):
    """Root mean square of errors over stated deviations, of markers that are seen and of the others; 80 draws."""
    squares = []
    for seed in range(80):
        xyz, cov, true = seen_once(sd_rad, seed, seen)
        away = xyz - true
        squares.append(np.einsum("mi,mi->m", away, np.linalg.solve(cov, away[..., None])[..., 0]) / 3)
    found = np.array(squares)
    return np.sqrt([found[:, :seen].mean(), found[:, seen:].mean()])


@pytest.mark.rare
@pytest.mark.parametrize("seen", [3, 5])
@pytest.mark.parametrize("sd_rad", [0.05, 0.15, 0.3, 0.8])
def test_errors_are_as_stated_whatever_the_turn_was(sd_rad, seen):
    """Three markers and more show the turn: 1, within 10 % by 80 draws of three markers; it was 22 to 28 at 0.8 rad."""
    np.testing.assert_allclose(over_stated(sd_rad, seen), 1.0, atol=0.15)


@pytest.mark.parametrize("sd_rad", [0.3, 0.5])
def test_a_turn_that_stays_vague_is_stated(sd_rad):
    """Two markers leave the turn about their line: others are on an arc, whose mean and spread sigma points have."""
    assert np.all((over_stated(sd_rad, 2) > 0.7) & (over_stated(sd_rad, 2) < 1.4))


def test_a_turn_that_is_known_is_linear(monkeypatch):
    """Below ``VAGUE_RAD`` nothing is done again, to the last digit; above it what is found differs."""
    for sd_rad, same in ((0.09, True), (0.11, False)):
        found = seen_once(sd_rad, 3, 5)[0]
        with monkeypatch.context() as patch:
            patch.setattr(pose, "VAGUE_RAD", np.inf)
            assert np.array_equal(seen_once(sd_rad, 3, 5)[0], found) == same
