"""Fills of a gap for a look: where neighbours move with the marker, where they do not, and where there are none."""

import numpy as np
import pytest

from mocap.desk.fills import fills, neighbours_of
from mocap.skeleton import Skeleton

NAMES = ("a", "b", "c", "d")
N, GAP = 81, slice(35, 50)
T_S = np.arange(N) / 100
BODY = Skeleton(markers=NAMES, bodies={"hand": NAMES})
BONE = Skeleton(markers=NAMES, bones=[("a", "b"), ("b", "c")])


def swinging(seed=0):
    """(N, 4, 3) four markers of one body that turns and moves at 7 Hz, 15 frames a cycle."""
    rng = np.random.default_rng(seed)
    place = 0.05 * rng.normal(size=(4, 3))
    angle = 0.8 * np.sin(2 * np.pi * 7 * T_S)
    turn = np.zeros((N, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1], turn[:, 2, 2] = np.sin(angle), -np.sin(angle), 1
    shift = 0.1 * np.sin(2 * np.pi * 5 * T_S[:, None] + np.arange(3))
    return np.einsum("tij,mj->tmi", turn, place) + shift[:, None]


def measured(gap=GAP):
    out = np.ones((N, 4), dtype=bool)
    out[gap, 0] = False
    return out


@pytest.mark.parametrize("gap", [GAP, slice(66, N), slice(0, 12)])
def test_a_marker_of_a_body_is_carried_by_it(gap):
    """To rounding, over a gap in which the motion turns twice, and at both ends; there the spline has no other side."""
    xyz = swinging()
    found = fills(T_S, xyz, measured(gap), gap.start, 0, NAMES, BODY)
    np.testing.assert_allclose(found.neighbours_m[gap], xyz[gap, 0], atol=1e-12)
    assert found.said.startswith("b, c, d: hidden so at ")
    if gap is GAP:
        assert np.abs(found.spline_m[gap] - xyz[gap, 0]).max() > 0.02
    else:
        assert np.isnan(found.spline_m).all()


def test_a_neighbour_that_moves_as_it_does_is_a_pattern():
    """One that keeps its distance in the axes of the world, with a slow drift between the ends that is blended."""
    xyz = swinging()
    xyz[:, 0] = xyz[:, 1] + (0.02, 0.0, 0.01) + 0.001 * T_S[:, None]
    found = fills(T_S, xyz, measured(), 40, 0, NAMES, BONE)
    np.testing.assert_allclose(found.neighbours_m[GAP], xyz[GAP, 0], atol=1e-12)
    assert found.said.startswith("b: ")


def test_neighbours_that_do_not_move_with_it_carry_nothing():
    """One that stands still, or moves otherwise: no line, and a sentence that says so with both errors."""
    xyz = swinging()
    still = xyz.copy()
    still[:, 1:] = (0.1, 0.2, 0.3)
    against = xyz.copy()
    against[:, 1:] = -xyz[:, :1]
    for one in (still, against):
        found = fills(T_S, one, measured(), 40, 0, NAMES, BONE)
        assert np.isnan(found.neighbours_m).all()
        assert np.isfinite(found.spline_m[GAP]).all()
        assert "not moving as it does" in found.said


def test_what_cannot_be_told_is_said():
    """Neighbours hidden at one frame of the gap, no bone, no frame that shows both: the spline alone, and why."""
    xyz = swinging()
    hidden = measured()
    hidden[40, 1:] = False
    apart = measured()
    apart[: GAP.start - 1, 1:] = apart[GAP.stop + 1 :, 1:] = False
    for seen, skeleton, said in (
        (hidden, BODY, "none is seen all the time (b, c, d)"),
        (measured(), Skeleton(markers=NAMES, bones=[("b", "c")]), "the skeleton has no bone or body of a"),
        (apart, BODY, "no frames beside these show it with them"),
    ):
        found = fills(T_S, xyz, seen, 40, 0, NAMES, skeleton)
        assert said in found.said
        assert np.isnan(found.neighbours_m).all()
        assert np.isfinite(found.spline_m[GAP]).all()


def test_neighbours_are_of_the_body_and_one_or_two_bones_away():
    """Markers that were not recorded are none."""
    assert neighbours_of("a", NAMES, BODY) == [(1, 2, 3)]
    assert neighbours_of("a", NAMES, BONE) == [(1,), (1, 2)]
    assert neighbours_of("a", NAMES[:2], BONE) == [(1,)]
    assert neighbours_of("d", NAMES, BONE) == []
