"""A run of the gap benchmark from the command line: tables, a method that fails, resuming."""

import sys
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest

from benchmarks.gaps import __main__ as command
from benchmarks.gaps import cells
from benchmarks.gaps.method import Estimate, Trial
from benchmarks.gaps.table import TABLE

NAMES = ("root", "a", "b", "c", "d")


def make_trials():
    """Three short trials of two limbs."""
    rng = np.random.default_rng(0)
    return [
        Trial(
            name=f"t{k}",
            names=NAMES,
            t_s=np.arange(150) / 100,
            xyz_m=np.cumsum(rng.normal(size=(150, len(NAMES), 3)), axis=0) * 1e-3,
            sd_m=np.full(len(NAMES), 1e-4),
            trunk=("root",),
            limbs=(("a", "b"), ("c", "d")),
        )
        for k in range(3)
    ]


@dataclass(frozen=True)
class Zero:
    """Says that every marker is at the origin; fails while it learns if told to."""

    name: str
    fails: bool = False

    def learn(self, training):
        """Nothing to learn."""
        assert training
        if self.fails:
            raise ArithmeticError("no way")
        return lambda trial: Estimate(np.zeros(trial.xyz_m.shape), np.tile(np.eye(3), (*trial.xyz_m.shape[:2], 1, 1)))


@pytest.fixture
def benchmark(monkeypatch, tmp_path):
    """Runs the command on a small set with two methods; returns its table and what is in the folder."""
    monkeypatch.setattr(command, "size", lambda _: 3)
    monkeypatch.setattr(cells, "load", lambda *_: make_trials())
    cells.fold_trials.cache_clear()
    for module in (command, cells):
        monkeypatch.setattr(module, "methods", lambda: (Zero("zero"), Zero("broken", fails=True)))

    def go(*arguments):
        monkeypatch.setattr(sys, "argv", ["gaps", "--sets", "bat", "--jobs", "1", "--out", str(tmp_path), *arguments])
        assert command.main() == 0
        return pd.read_csv(tmp_path / "table.csv"), tmp_path

    return go


@pytest.mark.rare
def test_one_table_and_its_files(benchmark, capsys):
    """All kinds of gaps that 150 frames hold, ten draws; the method that fails has NaN there and a line on stderr."""
    table, folder = benchmark()
    assert list(table) == TABLE
    assert set(table["seed"]) == {*range(10)}
    assert set(table["gap"]) == {10, 25, 50, 100}
    assert set(table["scenario"]) == {"single", "pair", "limb", "all"}
    good, broken = (table[table["method"] == name] for name in ("zero", "broken"))
    assert good.notna().all(axis=None)
    assert broken["rmse_mm"].isna().all()
    assert len(good) == len(broken)
    assert {path.name for path in folder.iterdir()} == {
        *("folds.csv", "table.csv", "ratios.csv", "summary.csv", "draws.csv", "error.png", "coverage.png")
    }
    out, err = capsys.readouterr()
    assert [line.split()[0] for line in out.splitlines()[1:]] == ["method", "zero", "broken"]
    assert err.count("FAILED: ArithmeticError: no way") == 3


@pytest.mark.rare
def test_a_run_goes_on_where_it_was_cut(benchmark, capsys):
    """With ``--resume`` whole folds are kept, the last one, which may be cut, is run again; the table is the same."""
    before, folder = benchmark("--methods", "zero")
    lines = (folder / "folds.csv").read_text().splitlines(keepends=True)
    (folder / "folds.csv").write_text("".join(lines[:-20]))
    capsys.readouterr()
    after, _ = benchmark("--methods", "zero", "--resume")
    assert capsys.readouterr().err.count("zero: ") < 3
    columns = ["set", "scenario", "gap", "method", "seed", "rmse_mm", "coverage95", "nll"]
    pd.testing.assert_frame_equal(before[columns], after[columns])


@pytest.mark.rare
def test_more_draws_are_added(benchmark, monkeypatch):
    """With ``--resume`` and more draws only those that lack are made; all are as if they were made at once."""
    benchmark("--methods", "zero", "--seeds", "2")
    made, run = [], cells.run
    monkeypatch.setattr(cells, "run", lambda task: made.append(task.extent.seeds) or run(task))
    more, _ = benchmark("--methods", "zero", "--seeds", "4", "--resume")
    assert set(made) == {(2, 3), (1, 2, 3)}  # of the trial that was made last the last draw may have been cut
    whole, _ = benchmark("--methods", "zero", "--seeds", "4")
    columns = ["set", "scenario", "gap", "method", "seed", "rmse_mm"]
    more, whole = (one[columns].sort_values(columns[:-1], ignore_index=True) for one in (more, whole))
    pd.testing.assert_frame_equal(more, whole)


def test_quick_is_a_part(benchmark):
    """One fold, three draws, one scenario, two lengths."""
    table, folder = benchmark("--quick", "--methods", "zero")
    assert len(table) == 6
    assert pd.read_csv(folder / "draws.csv")["draws"].tolist() == [3]
    assert set(pd.read_csv(folder / "folds.csv")["trial"]) == {"t0"}


def test_wrong_usage_is_told(benchmark, capsys):
    """An unknown method is wrong usage (exit 2), and those that exist are named."""
    with pytest.raises(SystemExit) as caught:
        benchmark("--methods", "magic")
    assert caught.value.code == 2
    assert "no method magic; there are zero, broken" in capsys.readouterr().err
