"""Thresholds of what is learned, with a case just below and one just above each."""

from types import SimpleNamespace

import numpy as np
import pytest
from mocap.filters.first_poses import looks_like
from mocap.filters.motion.articulated import ArticulatedMotion
from mocap.filters.poses import MarkerTrial, known_shapes
from mocap.filters.size import size_factor

from mocap.cameras.camera import project, stacked
from tests.mocap.rigs import ring


@pytest.mark.parametrize(("larger", "counts"), [(1.016, False), (1.024, True)])
def test_animals_that_differ_by_two_percent_are_of_two_sizes(larger, counts):
    """Ten stiff markers, without noise: their size is known to 0.02 / sqrt(45 pairs)."""
    xyz = np.tile(np.random.default_rng(0).normal(size=(10, 3)), (50, 1, 1))
    small, large = (
        MarkerTrial(name="a", t_s=np.arange(50) / 100, xyz_m=size * xyz, sd_m=np.full((50, 10), 1e-4))
        for size in (1.0, larger)
    )
    assert size_factor(small, large) == pytest.approx(larger if counts else 1.0)


def test_poses_are_learned_from_where_four_fifths_are_known():
    """Of more than thirty."""
    known = np.append(np.full(40, 0.95), [0.75, 0.85])
    (learned,) = known_shapes(SimpleNamespace(certainty=[known]))
    assert learned.tolist() == [True] * 40 + [False, True]


@pytest.mark.parametrize(("seen", "found"), [(3, False), (4, True)])
def test_a_pose_is_looked_for_where_four_markers_are_seen(seen, found):
    """Three rays leave up to four poses."""
    matrices, place = stacked(ring(1)), np.random.default_rng(1).normal(0, 0.1, (6, 3))
    shown = np.arange(6)[None, None] < seen
    views = SimpleNamespace(seen=shown, matrices=matrices, uv_px=project(matrices, place[None]))
    prior = SimpleNamespace(shapes=np.zeros((1, 1)), mean=place.ravel(), basis=np.zeros((18, 1)))
    assert (looks_like(prior, views, 0, 0) is not None) == found


@pytest.mark.parametrize(
    ("turned_rad", "step_rad"), [(0.08, None), (0.12, 0.12), (0.45, 0.45), (0.55, 0.5), (2.0, 0.5)]
)
def test_an_update_is_iterated_where_joints_bend(turned_rad, step_rad):
    """From a tenth of a radian, in steps of half a radian at most."""
    motion = SimpleNamespace(angles=lambda states: states)
    further = ArticulatedMotion.further(motion, np.zeros(2), np.array([turned_rad, -turned_rad / 2]))
    if step_rad is None:
        assert further is None
    else:
        np.testing.assert_allclose(further, [step_rad, -step_rad / 2])
