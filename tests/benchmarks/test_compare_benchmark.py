"""The benchmark of comparisons: what it draws is what its rows say."""

import sys

import numpy as np
import pandas as pd

from benchmarks.compare import ROWS, Group, main
from benchmarks.compare_peers import cycles, peers


def test_a_group_is_drawn_as_stated():
    """Twelve animals of six trials, half a second at 100 frames/s; three quarters of what is above 115 hidden."""
    rng = np.random.default_rng(1)
    trials, owners = Group(animals=12, trials=6, duration_s=0.5, fps=100.0, hidden=0.75).draw(rng, "b")
    assert len(trials) == len(owners) == 72
    assert len(set(owners)) == 12
    assert {len(trial) for trial in trials} == {50}
    seen = np.concatenate(trials)
    plain = np.concatenate(Group(animals=12, trials=6, duration_s=0.5, fps=100.0).draw(rng, "b")[0])
    above = (plain > 115.0).mean()
    assert abs(np.isnan(seen).mean() - 0.75 * above) < 0.05


def test_the_table_has_a_row_a_case(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["compare", "--draws", "2", "--rows", "4 v 12, SD", "--out", str(tmp_path)])
    main()
    table = pd.read_csv(tmp_path / "table.csv")
    assert table["row"].tolist() == [name for name in ROWS if "4 v 12, SD" in name]
    assert table[["p05", "band", "shift"]].notna().all().all()


def test_what_the_field_uses_sees_a_range_that_doubles():
    """Curves, paths and peaks of eight and eight swings of 20 and 40 degrees differ; those of one kind are cycles."""
    rng = np.random.default_rng(2)
    a, _ = Group(posture=0.5, reach=20.0).draw(rng, "a")
    b, _ = Group(posture=0.5, reach=40.0).draw(rng, "b")
    found = peers((a, b), (250.0, 250.0), None, 0)
    assert found["peaks_p01"] == found["procrustes_p01"] == 1.0
    assert found["spm1d_p01"] == 1.0 or np.isnan(found["spm1d_p01"])  # where it is not installed
    swing = cycles(b[0], 250.0)
    assert 1 <= len(swing) <= 3
    assert 120.0 < swing[0].max() < 135.0
    short, _ = Group(duration_s=0.15).draw(rng, "a")
    assert np.isnan(peers((short, b), (250.0, 250.0), None, 0)["procrustes_p05"])  # three quarters of a cycle


def test_draws_go_on_where_they_ended(tmp_path, monkeypatch):
    """Two draws and then three are three, the first two as they were."""
    for count in (2, 3):
        monkeypatch.setattr(
            sys, "argv", ["compare", "--draws", str(count), "--rows", "12 v 4", "--peers", "--out", str(tmp_path)]
        )
        main()
        draws = pd.read_csv(tmp_path / "peers_draws.csv")
        assert draws["draw"].tolist() == list(range(count))
    assert pd.read_csv(tmp_path / "peers.csv")["draws"].tolist() == [3]
