"""Gap statistics against a walk along each marker, and the gaps that the twins must have."""

from itertools import groupby

import numpy as np
import pytest
from mocap.datasets import make_bat, make_lizard
from mocap.datasets.film import gap_statistics


def test_against_a_walk_along_each_marker():
    seen = np.random.default_rng(0).random((200, 7)) < 0.2
    seen[:, 3] = False
    gaps = []
    for m in range(seen.shape[1]):
        runs = [(value, len(list(run))) for value, run in groupby(seen[:, m])]
        gaps += [(m, length) for value, length in runs[1:-1] if not value]
    found, medium = gap_statistics(seen), [m for m, length in gaps if 10 <= length <= 60]
    assert medium
    assert found["interior_gaps"] == len(gaps)
    assert found["interior_gap_frames"] == sum(length for _, length in gaps)
    assert found["gaps_10_to_60_frames"] == len(medium)
    assert found["markers_with_gaps_10_to_60_frames"] == len(set(medium))
    assert found["gap_frames_max"] == max(length for _, length in gaps)


@pytest.mark.parametrize("seen", [np.zeros((5, 2), bool), np.ones((5, 2), bool), np.ones((1, 1), bool)])
def test_no_gaps(seen):
    assert gap_statistics(seen)["interior_gaps"] == 0


@pytest.mark.parametrize("seed", range(3))
def test_the_bat_has_gaps_to_fill(seed):
    """Interior gaps of 10 to 60 frames in 3D on half the markers or more, with every marker mostly seen."""
    card = make_bat(seed=seed).card
    assert card["in_3d"]["gaps_10_to_60_frames"] >= 25
    assert card["in_3d"]["markers_with_gaps_10_to_60_frames"] >= 17
    assert 0.8 < card["in_3d"]["share_seen"] < 0.97
    assert min(card["share_seen_by_two_or_more"].values()) > 0.4


@pytest.mark.parametrize("seed", range(3))
def test_the_lizard_is_mostly_in_view(seed):
    """As the paper says of the lizard: limbs consistently exposed; still some gaps to fill."""
    card = make_lizard(seed=seed).card
    assert card["in_3d"]["gaps_10_to_60_frames"] >= 3
    assert card["in_3d"]["share_seen"] > 0.93
    assert min(card["share_seen_by_two_or_more"].values()) > 0.7
