"""Snap-through: von Mises' shallow truss, pulled down at its apex through a spring."""

import numpy as np
import pytest
from scipy.optimize import brentq

from eal.joint_design import Truss, follow

HALF, RISE, STIFF = 1.0, 0.3, 1.0
BAR = np.hypot(HALF, RISE)


def von_mises(spring):
    """Two bars to the apex, which a spring of rest length 1 joins to the moving point below."""
    return Truss(
        fixed_m=np.array([[-HALF, 0.0], [HALF, 0.0]]),
        internal_m=np.array([[0.0, RISE]]),
        ends=np.array([[0, 3], [1, 3], [2, 3]]),
        rest_m=np.array([BAR, BAR, 1.0]),
        stiffness_n_m=np.array([STIFF, STIFF, spring]),
        laws=("linear",) * 3,
    )


def pull(y):
    """Force of the two bars on the apex at height y, upward: -dE/dy of 2 STIFF (sqrt(HALF^2 + y^2) - BAR)^2 / 2."""
    return 2.0 * STIFF * y * (BAR / np.sqrt(HALF**2 + y**2) - 1.0)


def slope(y):
    """Its derivative."""
    return 2.0 * STIFF * (BAR * HALF**2 / (HALF**2 + y**2) ** 1.5 - 1.0)


def energy(y):
    return STIFF * (np.sqrt(HALF**2 + y**2) - BAR) ** 2


def test_the_snap_is_where_the_closed_form_has_it_however_long_the_steps():
    """The branch ends at pull'(y) = spring, the point being at y - 1 - pull(y) / spring there.

    The place is bracketed to ten times 1e-7 of a segment; near a fold y goes as the root of that, hence the apex to
    sqrt(2e-6 / curvature), 1e-2. The energy released is that of the two equilibria, to the first order in the place.
    """
    spring, steps = 0.05, 4
    path = np.stack([np.zeros(steps + 1), np.linspace(RISE - 1.0, -4.0, steps + 1)], axis=1)
    led = follow(von_mises(spring), path)
    assert len(led.snaps) == 1
    fold = brentq(lambda y: slope(y) - spring, 1e-6, RISE)
    place = fold - 1.0 - pull(fold) / spring
    snap = led.snaps[0]
    assert snap.q_m[1] == pytest.approx(place, abs=20 * 1e-7 * 3.3)
    assert snap.before_m[0, 1] == pytest.approx(fold, abs=1e-2)
    after = brentq(lambda y: pull(y) - spring * (y - place - 1.0), -3.0, -0.1)
    assert snap.after_m[0, 1] == pytest.approx(after, abs=1e-4)
    stored = [energy(y) + spring / 2 * (y - place - 1.0) ** 2 for y in (fold, after)]
    assert snap.released_j == pytest.approx(stored[0] - stored[1], rel=1e-3)
    assert snap.released_j > 0


def test_the_way_back_snaps_elsewhere():
    """Led down and up again it snaps twice, at two places: hysteresis, each at its own fold."""
    spring = 0.05
    down = np.linspace(RISE - 1.0, -4.0, 30)
    path = np.stack([np.zeros(59), np.concatenate([down, np.linspace(-4.0, 2.0, 29)])], axis=1)
    led = follow(von_mises(spring), path)
    fold = brentq(lambda y: slope(y) - spring, -RISE, -1e-6)
    places = [snap.q_m[1] for snap in led.snaps]
    assert len(places) >= 2
    assert places[1] == pytest.approx(fold - 1.0 - pull(fold) / spring, abs=1e-4)
    assert led.states.found.all()


def test_a_stiff_spring_leads_it_through_without_a_snap():
    """Where the spring is stiffer than the bars ever give way, 2 k (BAR / HALF - 1) = 0.088, every height is stable."""
    path = np.stack([np.zeros(41), np.linspace(RISE - 1.0, -RISE - 1.0, 41)], axis=1)
    led = follow(von_mises(0.2), path)
    assert led.snaps == ()
    assert (led.states.stable > 0).all()
