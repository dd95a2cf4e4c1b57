"""Shares, gaps and distances against counting by hand and laws of the Wasserstein distance."""

import numpy as np
import pytest

from datasets import PERFECT
from datasets.bats import make_bat_wind_tunnel
from datasets.visibility import distances, merged, pooled, visibility


def test_by_hand():
    """Two cameras and a blind one, two markers, frames 1 to 6 of 8: the first and the last show nothing."""
    seen = np.zeros((3, 8, 2), dtype=bool)
    seen[0, 1:7, 0] = [1, 1, 0, 0, 1, 1]
    seen[1, 1:7, 0] = [1, 1, 1, 1, 1, 1]
    seen[0, 1:7, 1] = [0, 1, 0, 1, 0, 1]
    found = visibility(seen, fps=3.0)
    np.testing.assert_allclose(found.view, [[4 / 6, 3 / 6], [1, 0], [0, 0]])
    np.testing.assert_allclose(found.solid, [4 / 6, 0])
    assert sorted(found.gaps) == [1, 1, 2]
    assert found.gaps_3d.tolist() == [2]
    assert found.marker_seconds == 2 * 6 / 3
    positions = visibility(seen[:1], fps=3.0)
    np.testing.assert_allclose(positions.solid, [4 / 6, 3 / 6])
    with pytest.raises(ValueError, match="nothing is seen"):
        visibility(np.zeros((1, 4, 2), dtype=bool), fps=1.0)


def test_distances_are_distances():
    """Zero to itself, symmetric, an octave where every gap is twice as long at half the rate."""
    rng = np.random.default_rng(0)
    seen = rng.random((3, 400, 5)) < 0.6
    twice = visibility(np.repeat(seen, 2, axis=1), fps=100.0)
    once, other = visibility(seen, fps=100.0), visibility(rng.random((3, 400, 5)) < 0.8, fps=100.0)
    assert all(abs(value) < 1e-12 for value in distances(once, once).values())
    there, back = distances(once, other), distances(other, once)
    assert there.pop("rate") == pytest.approx(-back.pop("rate"))
    assert there == pytest.approx(back)
    far = distances(once, twice)
    assert (far["gap"], far["gap3D"], far["rate"]) == pytest.approx((1, 1, -1))
    assert far["view"] == pytest.approx(0, abs=1e-12)
    assert len(pooled([once, other]).gaps) == len(merged([once, other]).gaps) == len(once.gaps) + len(other.gaps)


def test_the_wind_tunnel_twin_is_clicked_as_asked_and_hidden_by_geometry():
    """The far camera never sees the near shoulder; clicks and grazing only take away from what geometry shows."""
    clicked, exact = make_bat_wind_tunnel(seed=2), make_bat_wind_tunnel(seed=2, digitiser=PERFECT)
    assert not (clicked.pixels.seen & ~exact.pixels.seen).any()
    left = clicked.truth.names.index("shoulder_l")
    assert exact.pixels.seen[3, :, left].mean() < 0.05
    assert exact.pixels.seen[0, :, left].mean() > 0.95
    gaps = visibility(clicked.pixels.seen, fps=700).gaps
    # log-uniform between 2 and 60 frames has its median at 11; geometry's own are as long
    assert 7 < np.median(gaps) < 15
