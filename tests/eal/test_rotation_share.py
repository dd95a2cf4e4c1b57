"""Mobility: the share of all rotations that a joint visits, in whatever axes, with an interval over trials."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eal import Tikhonov, fit_potential
from eal.kernels import LaplaceKernel
from eal.rotation_share import LAM, _Field, mobility


def cone(rng, n, *, swing_deg, twist_deg):
    """(n, 3, 3) rotations, uniform over those that tilt z and turn about it by at most so much."""
    u = rng.random((n, 3))
    tilt = np.arccos(1.0 - (1.0 - np.cos(np.radians(swing_deg))) * u[:, 0])
    about = 2.0 * np.pi * u[:, 1]
    twist = np.radians(twist_deg) * (2.0 * u[:, 2] - 1.0)
    swing = Rotation.from_rotvec(tilt[:, None] * np.stack([np.cos(about), np.sin(about), 0 * about], axis=1))
    return (swing * Rotation.from_rotvec(twist[:, None] * [0.0, 0.0, 1.0])).as_matrix()


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(5)
    return [cone(rng, 80, swing_deg=50.0, twist_deg=40.0) for _ in range(8)]


@pytest.fixture(scope="module")
def found(trials):
    return mobility(trials)


def test_a_known_cone_has_its_volume(found):
    """Haar's measure is that of the sphere times that of the turn: (1 - cos 50) / 2 times 40 / 180."""
    low, high = found.interval
    assert low <= 0.5 * (1.0 - np.cos(np.radians(50.0))) * 40.0 / 180.0 <= high
    assert high / low < 1.6


@pytest.mark.parametrize("how", ["other axes of parent and child", "mirrored", "from parent to child"])
def test_axes_change_nothing(how, trials, found):
    """The measure and the chord are those of the group; tolerance: rounding of poses near the limit."""
    left, right = Rotation.random(2, rng=np.random.default_rng(1)).as_matrix()
    mirror = np.diag([1.0, 1.0, -1.0])
    turn = {
        "other axes of parent and child": lambda r: left @ r @ right,
        "mirrored": lambda r: mirror @ r @ mirror,
        "from parent to child": lambda r: np.swapaxes(r, 1, 2),
    }[how]
    again = mobility([turn(one) for one in trials])
    assert again.share == pytest.approx(found.share, rel=1e-6)
    np.testing.assert_allclose(again.interval, found.interval, rtol=1e-6)


def test_wider_cones_are_larger_and_what_is_visited_lies_in_them(found):
    """Poses of the set tilt z by 50 degrees and the width of what eight trials leave open."""
    rng = np.random.default_rng(6)
    wide = mobility([cone(rng, 80, swing_deg=100.0, twist_deg=40.0) for _ in range(8)])
    assert wide.interval[0] > found.interval[1]
    tilt = np.degrees(np.arccos(found.visited[:, 2, 2]))
    assert np.quantile(tilt, 0.95) < 60.0
    assert found.rotations.shape == (640, 3, 3)


def test_v_is_that_of_tikhonovs_filter(rng):
    """Of all trials, and at each trial that of the others, as learned without it; to rounding."""
    z, owner = rng.normal(size=(30, 3)), np.repeat([0, 1, 2], 10)
    whole = fit_potential(z, kernel=LaplaceKernel(1.0), lam=LAM, spectral_filter=Tikhonov())
    at = rng.normal(size=(7, 3))
    one = _Field.of(z, owner, 0.5)
    np.testing.assert_allclose(one.values(at), whole.value(at), atol=1e-9)
    lam = LAM * 30 / 20  # of the others there are 20, and N lambda stays
    left = [
        fit_potential(z[owner != t], kernel=LaplaceKernel(1.0), lam=lam, spectral_filter=Tikhonov()).value(
            z[owner == t]
        )
        for t in range(3)
    ]
    assert one.limit == pytest.approx(np.sort(np.concatenate(left))[14], abs=1e-9)


def test_hidden_frames_count_and_are_told(trials, found):
    """Where the smoother alone knows all that tilts beyond 30 degrees, measured frames alone visit less."""
    seen = [one[:, 2, 2] > np.cos(np.radians(30.0)) for one in trials]
    hidden = mobility(trials, measured=seen)
    assert hidden.share == found.share
    assert hidden.share_measured < 0.6 * found.share
    assert hidden.hidden == pytest.approx(1.0 - np.mean(seen))
    assert "of its frames were hidden, without them" in hidden.line()


def test_translations_are_a_share_of_a_ball(trials):
    """The ball of 4 has eight times the volume of that of 2, and both hold all translations; other axes: the same."""
    rng = np.random.default_rng(7)
    trials = [one[:30] for one in trials[:4]]
    shifts = [rng.uniform(-0.5, 0.5, (len(one), 3)) for one in trials]
    small, large = (mobility(trials, translations=shifts, within=radius) for radius in (2.0, 4.0))
    assert small.share / large.share == pytest.approx(8.0)
    turn = Rotation.random(rng=np.random.default_rng(2)).as_matrix()
    moved = mobility([turn @ one for one in trials], translations=[x @ turn.T + 3.0 for x in shifts], within=2.0)
    assert moved.share == pytest.approx(small.share, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"trials": [np.eye(3)[None].repeat(9, 0)] * 3}, "needs 4 trials at least, but there are 3"),
        ({"trials": [np.ones((9, 2))] * 4}, r"must be rotations \(N, 3, 3\), but has shape \(9, 2\)"),
        ({"trials": [2.0 * np.eye(3)[None].repeat(9, 0)] * 4}, "R R\\^T differs from 1 by 3"),
        ({"trials": [np.full((9, 3, 3), np.nan)] * 4}, "has 0 known poses and needs 5"),
        ({"trials": [np.eye(3)[None].repeat(9, 0)] * 4, "within": 1.0}, "translations need `within`"),
        ({"trials": [np.eye(3)[None].repeat(9, 0)] * 4, "cover": 1.0}, "cover must be between 0 and 1"),
    ],
)
def test_what_has_no_mobility_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        mobility(**arguments)


def test_a_joint_that_stays_visits_nothing():
    """Identical poses: the share is below any that could be measured."""
    assert mobility([np.eye(3)[None].repeat(9, 0)] * 4).share < 1e-12


def test_the_projection_keeps_areas(found):
    """Two axes of matplotlib, each with the child's three axes in its half of the sphere, inside the circle."""
    axes = found.plot()
    for ax in axes:
        points = np.concatenate([line.get_xydata() for line in ax.lines])
        assert (np.hypot(*points.T) <= 1.0 + 1e-9).all()
        assert len(ax.lines) >= 7
