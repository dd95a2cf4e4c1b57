"""Mechanics and offsets that a pose model learns from recorded trials."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.body_axes import BodyFrames
from mocap.filters.models.pose import PoseSettings, learn_pose, recorded_motion
from mocap.filters.motion.shape import linear_shape
from mocap.filters.poses import MATERN_3_2_HALF, MATERN_HALF, pose_trial, residual_memory_s, shapes_of

from tests.filters.test_learned_models import DT_S, flapping

SETTINGS = PoseSettings(ranks=(2,), potential="none")


def trial_of(xyz):
    """A trial in a frame that moves as the animal does."""
    n_frames = len(xyz)
    centre = xyz[:, :4].mean(axis=1)
    frames = BodyFrames(rotation=np.repeat(np.eye(3)[None], n_frames, axis=0), position_m=centre)
    return pose_trial(np.arange(n_frames) * DT_S, xyz, frames)


@pytest.fixture(scope="module")
def two():
    """Two trials of one animal, whose markers were placed 1 cm apart, with noise of 0.1 mm."""
    rng = np.random.default_rng(2)
    trials = []
    for _ in range(2):
        xyz = flapping(np.random.default_rng(1), n_frames=280)  # 280 frames: 12.6 beats
        placed = np.zeros((8, 3))
        placed[4:] = 0.01 * rng.normal(size=(4, 3))
        trials.append(trial_of(xyz + placed + rng.normal(0, 1e-4, xyz.shape)))
    return trials, shapes_of(trials, ranks=SETTINGS.ranks)


def test_learned_mechanics_carry_a_beat_on(two):
    """A beat (22 frames) after a recorded state the shape is where it was recorded; flying on it would be far off.

    Each difference of a step costs (w dt)^2 / 6 = 1.3 % of a velocity, two of an acceleration: 1.3 % of the frequency,
    8 % of a radian in a beat, and as much again for the smoothing at 30 Hz.
    """
    trials, shapes = two
    motion = recorded_motion(trials, shapes)
    states = np.column_stack([motion.z, motion.rate])
    learned = linear_shape(motion, ridge=1e-3)
    transition, shift = learned.flow(DT_S)
    miss, on = [], []
    for frame in range(40, 200, 16):
        state = np.append(states[frame], np.zeros(2))  # no force but the learned one
        on.append(state[:2] + 22 * DT_S * state[2:4] - motion.z[frame + 22])
        for _ in range(22):
            state = transition @ state + shift
        miss.append(state[:2] - motion.z[frame + 22])
    beat, flying = (np.sqrt(np.mean(np.square(x))) / motion.z.std() for x in (miss, on))
    assert beat < 0.2
    assert flying > 1


def test_each_trial_is_tracked_about_its_own_mean(two):
    """The model of either trial puts its markers where that trial has them, to the noise, not where the other has."""
    trials, shapes = two
    for target in (0, 1):
        order = [1 - target, target]
        lists = ("z", "rate", "acceleration", "certainty", "residual")
        own = replace(
            shapes,
            offset=shapes.offset[order],
            offset_sd=shapes.offset_sd[order],
            **{name: [getattr(shapes, name)[k] for k in order] for name in lists},
        )
        model = learn_pose([trials[k] for k in order], SETTINGS, shapes=own)
        errors = []
        for other in (target, 1 - target):
            states = np.zeros((len(trials[0].y), model.size))
            states[:, :2] = shapes.z[other]
            frames = range(0, len(states), 20)
            found = np.array([model.markers(states[f : f + 1], f)[0] for f in frames])
            xyz = trials[other].frames.position_m[:, None] + trials[other].y.reshape(len(states), -1, 3)
            errors.append(np.sqrt(np.mean((found - xyz[::20]) ** 2)))
        assert errors[0] < 2e-4
        assert errors[1] > 2e-3


def test_motion_is_recorded_where_poses_are_known(two):
    """Poses known less than the limit are left out, and what is on either side of them are stretches of their own."""
    trials, shapes = two
    known = [part.copy() for part in shapes.certainty]
    known[0][:] = known[1][:] = 0.95
    known[0][100:120] = known[1][:5] = 0.5
    motion = recorded_motion(trials, replace(shapes, certainty=known))
    np.testing.assert_array_equal(motion.trial, np.repeat([0, 1, 2], [100, 160, 275]))
    first, second = shapes.z
    np.testing.assert_array_equal(motion.z, np.concatenate([first[:100], first[120:], second[5:]]))
    np.testing.assert_array_equal(motion.rate[100:260], shapes.rate[0][120:])
    np.testing.assert_array_equal(motion.acceleration[260:], shapes.acceleration[1][5:])


@pytest.mark.parametrize("noise", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("rate_hz", [10.0, 40.0])
def test_the_residuals_rate_is_told_from_its_noise(rate_hz, noise):
    """Matern-3/2 processes of a known rate, with gaps and with white noise of up to twice their deviation.

    Lags are a fifth apart, those of a few frames more; the parabola at the beginning is a tenth of the variance off.
    """
    rng = np.random.default_rng(4)
    a = rate_hz * DT_S
    transition = np.exp(-a) * np.array([[1 + a, 1], [-(a**2), 1 - a]])  # of e and of its change in a step
    stationary = np.diag([1, a**2])
    kick = np.linalg.cholesky(stationary - transition @ stationary @ transition.T)
    state, residual = np.array([[1.0], [a]]) * rng.normal(size=(2, 24)), []
    for _ in range(2000):
        state = transition @ state + kick @ rng.normal(size=(2, 24))
        residual.append(state[0] + noise * rng.normal(size=24))
    residual = np.array(residual)
    residual[rng.random(residual.shape) < 0.2] = np.nan
    assert residual_memory_s([residual[:800], residual[800:]], DT_S, 1.0) == pytest.approx(1.678 / rate_hz, rel=0.35)


def test_matern_processes_lose_half_of_their_correlation():
    """Rasmussen & Williams 2006, equations 4.17 of unit rates; slopes there are -0.3, constants have five digits."""
    s, r = MATERN_3_2_HALF, MATERN_HALF
    np.testing.assert_allclose([(1 + s) * np.exp(-s), (1 + r + r**2 / 3) * np.exp(-r)], 0.5, atol=2e-5)


def test_where_noise_hides_the_residual_it_follows_the_motion():
    """White noise alone shows no memory: 0.42 of a radian's time, not the shortest that frames can show."""
    noise = np.random.default_rng(6).normal(size=(120, 72))
    assert residual_memory_s([noise], DT_S, 0.04) == pytest.approx(0.0168)


def test_rounding_errors_have_no_rate_of_their_own():
    """A subspace that holds poses whole leaves a slow residual of 1e-12: its memory is that of the motion."""
    slow = 1e-12 * np.sin(np.linspace(0, 20, 500))[:, None] * np.ones(6)
    assert residual_memory_s([slow], DT_S, 0.04, hidden_sd=np.ones(6)) == pytest.approx(0.0168)
    assert residual_memory_s([slow], DT_S, 0.04) > 0.034


def test_a_rate_is_found_between_lags():
    """Sines of nearly one frequency cross half their variance within a lag: their rates follow without a step."""
    t = DT_S * np.arange(2000)[:, None]
    rates = np.array(
        [1 / residual_memory_s([np.sin(w * t + np.arange(6))], DT_S, 1.0) for w in np.linspace(60, 80, 21)]
    )
    assert (np.diff(rates) > 0).all()
    assert np.diff(rates).max() < 0.05 * rates.mean()


@pytest.mark.parametrize("n_frames", [1, 2, 3])
def test_residuals_of_few_frames_have_a_rate(n_frames):
    """A positive number, whatever is seen."""
    rng = np.random.default_rng(5)
    assert 0 < residual_memory_s([rng.normal(size=(n_frames, 6))], DT_S, 1.0) < np.inf
    assert 0 < residual_memory_s([np.zeros((n_frames, 6))], DT_S, 1.0) < np.inf
