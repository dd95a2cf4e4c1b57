"""Known cones of rotations: filled evenly, and their volume stated."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.mobility import cone, held, volume


@pytest.mark.parametrize(("alpha", "tau"), [(30.0, 30.0), (60.0, 90.0), (180.0, 180.0)])
def test_a_cone_has_the_volume_that_random_rotations_say(alpha, tau):
    """The share of uniform rotations whose swing and twist are within the cone."""
    rotations = Rotation.random(40_000, random_state=1)
    x, y, z, w = (rotations.as_quat() * np.sign(rotations.as_quat()[:, 3:])).T
    swing, twist = 2.0 * np.arctan2(np.hypot(x, y), np.hypot(z, w)), 2.0 * np.arctan2(z, w)
    inside = np.mean((swing <= np.radians(alpha)) & (np.abs(twist) <= np.radians(tau)))
    assert inside == pytest.approx(volume(alpha, tau), abs=0.006)


@pytest.mark.parametrize("step", [None, 0.1])
def test_poses_fill_their_cone(step):
    """All are inside, and as many within half of the swing as that has of the volume."""
    poses = cone(np.random.default_rng(2), 20_000, 60.0, 30.0, step)
    swing = np.degrees(np.arccos(poses[:, 2, 2]))
    assert swing.max() <= 60.0 + 1e-9
    assert np.mean(swing < 30.0) == pytest.approx(volume(30.0, 30.0) / volume(60.0, 30.0), abs=0.03)


@pytest.mark.rare
def test_a_row_says_how_often_the_cone_was_held():
    """Two draws of a small one: near its truth, with an interval on either side of the estimate."""
    row = held(30.0, 30.0, 5, 60, None, draws=2)
    assert 0.4 < row["low"] < row["ratio"] < row["high"] < 1.8
    assert row["held_cone"] in (0.0, 0.5, 1.0)
