"""Points that are never in a frame together are said to be: they may be of several animals."""

import numpy as np

from mocap.cleaning.sentences import never_together


def test_points_that_are_never_together_are_said_to_be():
    """Five that pass one after another; an animal of which each marker has gaps is not accused."""
    paths = np.random.default_rng(0).normal(size=(200, 5, 3)).cumsum(axis=0)
    assert never_together(np.where(np.arange(5)[:, None] == np.arange(200)[:, None, None] % 5, np.nan, paths)) == []
    for m in range(5):
        paths[: 40 * m, m] = paths[40 * m + 50 :, m] = np.nan
    (found,) = never_together(paths)
    assert found.alarm
    assert "more than 2 of the 5 points" in found.text
    assert never_together(paths[:, :3]) == []


def test_points_that_were_never_digitised_are_no_other_animals():
    """Four of ten points are there in every frame, the rest in none."""
    paths = np.full((50, 10, 3), np.nan)
    paths[:, :4] = 1.0
    assert never_together(paths) == []
