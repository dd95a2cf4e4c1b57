"""Up, forward and left of a skeleton are evidence on the hand of the world."""

import numpy as np
import pytest

from mocap.audit.sides import side_findings
from mocap.measures import Measures

NAMES = ("tail", "head", "right", "left")
MEASURES = Measures(forward=("tail", "head"), left=("right", "left"))


def walk(*, mirrored=False, rolled=0.0):
    """An animal that turns about the vertical, x ahead, y to its left."""
    turn = np.linspace(0, 5, 60)[:, None]
    ahead = np.concatenate([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    side = np.concatenate([-np.sin(turn), np.cos(turn), 0 * turn], axis=1)
    side = np.cos(rolled) * side + np.sin(rolled) * np.array([0, 0, 1.0])
    xyz = np.stack([-ahead, ahead, -side, side], axis=1)
    return xyz * np.array([-1.0, 1, 1]) if mirrored else xyz


@pytest.mark.parametrize(
    ("xyz", "doubted", "told"),
    [
        (walk(), True, None),
        (walk(mirrored=True), True, True),
        (walk(mirrored=True), False, False),
        (walk(mirrored=True, rolled=np.pi / 2), True, None),
        (np.concatenate([walk(), walk(mirrored=True)]), True, None),
        (walk(mirrored=True)[:9], True, None),
    ],
)
def test_left_is_on_the_left(xyz, doubted, told):
    """An alarm where cameras leave the hand open, left open where there is nothing else, silent where it is unclear."""
    found = side_findings(xyz, NAMES, MEASURES, decided=False, doubted=doubted)
    assert [one.alarm for one in found] == ([] if told is None else [told])
    assert not side_findings(xyz, NAMES, MEASURES, decided=True, doubted=doubted)
    assert not side_findings(xyz, NAMES, Measures(), decided=False, doubted=doubted)
