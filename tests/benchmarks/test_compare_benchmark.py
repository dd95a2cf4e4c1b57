"""The benchmark of comparisons: what it draws is what its rows say."""

import sys

import numpy as np
import pandas as pd

from benchmarks.compare import ROWS, Group, main


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
