"""Gap statistics against a walk along each marker, and the gaps that the twins must have."""

from itertools import groupby

import numpy as np
import pytest
from mocap.datasets import make_bat, make_lizard
from mocap.datasets.gaps import gap_statistics, interior_gaps


def test_against_a_walk_along_each_marker():
    seen = np.random.default_rng(0).random((200, 7)) < 0.7
    seen[:, 3] = False
    expected = []
    for m in range(seen.shape[1]):
        at = 0
        runs = []
        for value, run in groupby(seen[:, m]):
            runs.append((value, at, length := len(list(run))))
            at += length
        expected += [[m, start, length] for value, start, length in runs[1:-1] if not value]
    np.testing.assert_array_equal(interior_gaps(seen), expected)


@pytest.mark.parametrize("seen", [np.zeros((5, 2), bool), np.ones((5, 2), bool), np.ones((1, 1), bool)])
def test_no_gaps(seen):
    assert interior_gaps(seen).shape == (0, 3)
    assert gap_statistics(seen)["interior_gaps"] == 0


@pytest.mark.parametrize("seed", range(5))
def test_the_bat_has_gaps_to_fill(seed):
    """Interior gaps of 10 to 60 frames in 3D on half the markers or more, with every marker mostly seen."""
    card = make_bat(seed=seed).card
    assert card["in_3d"]["gaps_10_to_60_frames"] >= 25
    assert card["in_3d"]["markers_with_gaps_10_to_60_frames"] >= 17
    assert 0.8 < card["in_3d"]["share_seen"] < 0.97
    assert min(card["share_seen_by_two_or_more"].values()) > 0.4


@pytest.mark.parametrize("seed", range(5))
def test_the_lizard_is_mostly_in_view(seed):
    """As the paper says of the lizard: limbs consistently exposed; still some gaps to fill."""
    card = make_lizard(seed=seed).card
    assert card["in_3d"]["gaps_10_to_60_frames"] >= 3
    assert card["in_3d"]["share_seen"] > 0.93
    assert min(card["share_seen_by_two_or_more"].values()) > 0.7
