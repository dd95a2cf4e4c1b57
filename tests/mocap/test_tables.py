"""The tables of a run, read back by pandas."""

import numpy as np
import pandas as pd

from mocap.records import MarkerTracks, Status
from mocap.results.tables import write_markers


def test_every_sample_has_its_origin_and_repaired_ones_are_marked(tmp_path):
    """Positions to the 0.1 um that are written; a name put right is told where the sample was measured, and only there.

    A sample that was rejected, or filled, is not one that was put right.
    """
    rng = np.random.default_rng(0)
    origin = rng.integers(0, len(Status), (40, 3))
    xyz = np.where((origin == Status.MISSING)[..., None], np.nan, rng.normal(size=(40, 3, 3)))
    repaired = rng.random((40, 3)) < 0.4
    cov = np.broadcast_to(1e-6 * np.eye(3), (40, 3, 3, 3))
    tracks = MarkerTracks(names=("a b", "c,d", "é"), t_s=np.arange(40) / 240, xyz_m=xyz, cov_m2=cov, status=origin)
    write_markers(tracks, repaired, tmp_path / "markers.csv")
    table = pd.read_csv(tmp_path / "markers.csv")
    for m, name in enumerate(tracks.names):
        np.testing.assert_allclose(table[[f"{name}_{k}" for k in "xyz"]], xyz[:, m], rtol=0, atol=0.51e-7)
        for t, word in enumerate(table[f"{name}_origin"]):
            true = Status(origin[t, m])
            assert word == ("repaired" if repaired[t, m] and true == Status.MEASURED else true.name.lower())
