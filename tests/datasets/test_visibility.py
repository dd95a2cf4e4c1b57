"""The wind-tunnel twin shows what its cameras could see, with gaps as its clicks leave them."""

import numpy as np
from mocap.datasets import PERFECT
from mocap.datasets.bats import make_bat_wind_tunnel


def gaps(seen):
    """Lengths of all gaps between two frames in which a camera saw a marker."""
    lengths = [np.diff(np.flatnonzero(track)) - 1 for track in np.moveaxis(seen, 1, -1).reshape(-1, seen.shape[1])]
    lengths = np.concatenate(lengths)
    return lengths[lengths > 0]


def test_the_wind_tunnel_twin_is_clicked_as_asked_and_hidden_by_geometry():
    """The far camera never sees the near shoulder; clicks and grazing only take away from what geometry shows."""
    clicked, exact = make_bat_wind_tunnel(seed=2), make_bat_wind_tunnel(seed=2, digitiser=PERFECT)
    assert not (clicked.pixels.seen & ~exact.pixels.seen).any()
    left = clicked.truth.names.index("shoulder_l")
    assert exact.pixels.seen[3, :, left].mean() < 0.05
    assert exact.pixels.seen[0, :, left].mean() > 0.95
    found = gaps(clicked.pixels.seen)
    # log-uniform between 2 and 60 frames has its median at 11; geometry's own are as long
    assert 7 < np.median(found) < 15
