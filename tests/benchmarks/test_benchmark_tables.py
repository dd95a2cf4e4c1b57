"""Every benchmark takes ``--quick`` and ``--out``, and writes ``table.csv``."""

from importlib import import_module

import numpy as np
import pandas as pd
import pytest

import benchmarks.arena.__main__ as arena
from benchmarks import importers, tracker_speed
from benchmarks.arena.judge import Names

PACKAGES = ("gaps.__main__", "arena.__main__", "attack.__main__")
CONTRACT = (*PACKAGES, "one_camera", "deviations", "importers", "batch", "digitise", "tracker_speed", "single_points")
CONTRACT += ("mutants", "compare")


@pytest.mark.parametrize("name", CONTRACT)
def test_benchmarks_take_quick_and_a_folder(name, monkeypatch, capsys):
    """As the contract has it: ``python -m benchmarks.NAME [--quick] --out DIR``."""
    monkeypatch.setattr("sys.argv", [name, "--help"])
    with pytest.raises(SystemExit):
        import_module(f"benchmarks.{name}").main()
    told = capsys.readouterr().out
    assert "--quick" in told
    assert "--out" in told


def test_tracker_speed_writes_what_it_prints(tmp_path, monkeypatch, capsys):
    """Loops are processor seconds over those of the loop; parts that are not asked for are not run."""

    def part(quick):
        yield [tracker_speed.Row(what="a pass", frames=10 if quick else 30, cpu_s=3.0, wall_s=4.0)]
        yield [tracker_speed.Row(what="its memory", memory_mb=5.0)]

    monkeypatch.setattr(tracker_speed, "loop", lambda: 1.5)
    monkeypatch.setattr(tracker_speed, "PARTS", {"one": part, "other": None})
    tracker_speed.main(["one", "--quick", "--out", str(tmp_path / "new")])
    table = pd.read_csv(tmp_path / "new" / "table.csv")
    assert table.columns.tolist() == ["part", "what", "frames", "cpu_s", "loops", "wall_s", "memory_mb", "over"]
    assert table.loc[0].tolist()[:6] == ["one", "a pass", 10, 3.0, 2.0, 4.0]
    assert table["memory_mb"].tolist()[1] == 5.0
    assert np.isnan(table["cpu_s"].tolist()[1])
    assert "a pass" in capsys.readouterr().out


@pytest.mark.slow
def test_importers_write_both_readers(tmp_path, monkeypatch):
    """Frames and processor seconds of ours and of the loop, on few frames."""
    monkeypatch.setattr(importers, "make", lambda path, _frames, make=importers.make: make(path, 30))
    monkeypatch.setattr(importers, "peer", lambda path, _few, peer=importers.peer: peer(path, 30))
    importers.main(["--frames", "30", "--peer-frames", "30", "--out", str(tmp_path)])
    table = pd.read_csv(tmp_path / "table.csv")
    assert table["reader"].tolist() == ["ours", "per-frame loop"]
    assert table["frames"].tolist() == [30, 30]
    assert (table["cpu_s"] > 0).all()


def test_the_arena_writes_people_and_methods(tmp_path, monkeypatch, capsys):
    """``--quick`` reads one flight of one network; points 1 and 3 mm away have a median of 2 mm."""
    asked, names = [], Names(pairs=4, exchanged=1)

    def flights(_data, network, *, most):
        asked.append((network, most))
        return [arena_flight]

    class Flown:
        truth_m = None
        people_m = (None, None)

    arena_flight = Flown()
    found = arena.Errors(distance_m=np.array([0.001, 0.003]), inside=np.ones((2, 3), dtype=bool))
    monkeypatch.setattr(arena, "read_flights", flights)
    monkeypatch.setattr(arena, "errors", lambda *_given, **_more: found)
    monkeypatch.setattr(arena, "names", lambda *_given: names)
    for method in ("anipose", "kalman_smoother", "one_person"):
        monkeypatch.setattr(arena, method, lambda _flight: None)
    monkeypatch.setattr(arena, "one_person_tracked", lambda _flight: type("Outcome", (), {"cov_m2": None}))
    monkeypatch.setattr(arena, "METHODS", {})
    arena.main(["--quick", "--out", str(tmp_path)])
    table = pd.read_csv(tmp_path / "table.csv")
    assert asked == [(next(iter(arena.NETWORKS)), 1)]
    assert table["network"].tolist() == ["people"] * 3 + ["augmented"] * 2
    assert table["median_mm"].tolist() == pytest.approx([2.0] * 5)
    assert table["exchanged"].tolist()[3:] == [1, 1]
    assert "exchanged" in capsys.readouterr().out
