"""What a proposed skeleton says of cycles: strokes, feet and spans of limbs that move so, none of others."""

import numpy as np
import pytest

from mocap.cli.main import main
from mocap.proposing.propose_measures import cycle_frames, stands
from mocap.skeleton_files import read_skeleton

RNG = np.random.default_rng(2)
NAMES = ("left", "right", "top", "tip_l", "tip_r")


@pytest.mark.parametrize("period", [12.0, 33.3, 60.0])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_the_cycle_of_a_sine(period, noise):
    """The lag of the autocorrelation's peak is the period to a frame (two with noise), with a trend and gaps."""
    t = np.arange(240)
    y = (
        np.sin(2 * np.pi * t / period) + 0.01 * t + RNG.normal(0, noise, len(t))
        if noise
        else np.sin(2 * np.pi * t / period)
    )
    y[RNG.random(len(t)) < 0.2] = np.nan
    assert abs(cycle_frames(y) - period) <= (0.1 * period if noise else 1)


def test_what_does_not_repeat():
    """White noise, a walk, a single swing and a constant have no cycle."""
    t = np.linspace(0, 1, 300)
    for y in (RNG.normal(size=300), np.cumsum(RNG.normal(size=300)), np.sin(2 * np.pi * t), np.ones(300)):
        assert cycle_frames(y) == 0


def test_feet_stand_and_wings_do_not():
    """A foot that stands for 60 % of each cycle, and a tip that moves as a sine with the body."""
    phase = np.arange(300) % 50
    x = np.cumsum(np.where(phase < 30, 0.0, 1.0))
    noise = RNG.normal(0, 0.02, (300, 3))
    assert stands(np.column_stack([x, 0 * x, 0 * x]) + noise, 50)
    wing = np.column_stack([0.4 * np.arange(300), 0 * x, 5 * np.sin(2 * np.pi * phase / 50)])
    assert not stands(wing + noise, 50)


def flight(folder, *, beats: float):
    """A body of three markers with two wings that beat so often, without a frame rate, in a plain table."""
    t = np.arange(200)
    body = np.array([[0.0, 0.03, 0.0], [0.0, -0.03, 0.0], [0.05, 0.0, 0.02]])
    angle = 0.8 * np.sin(2 * np.pi * beats * t / len(t))
    wing = 0.1 * np.column_stack([0 * t, np.cos(angle), np.sin(angle)])
    mirrored = wing * [1, -1, 1]
    way = 0.001 * t[:, None] * [1, 0, 0]
    xyz = np.stack([*(way + b for b in body), way + body[0] + wing, way + body[1] + mirrored], axis=1)
    xyz += RNG.normal(0, 1e-4, xyz.shape)
    titles = ["frame", *(f"pt{m + 1}_{a}" for m in range(5) for a in "xyz")]
    rows = [",".join([str(i), *(f"{v:.6f}" for v in row)]) for i, row in enumerate(xyz.reshape(len(t), -1))]
    (folder / "a.csv").write_text("\n".join([",".join(titles), *rows]) + "\n", encoding="utf-8")
    (folder / "pointnames.txt").write_text("\n".join(NAMES) + "\n", encoding="utf-8")


def skeleton(folder, monkeypatch, capsys, *words):
    monkeypatch.setattr("sys.argv", ["mocap", "skeleton", str(folder / "a.csv"), "--unit", "m", *map(str, words)])
    try:
        main()
        code = 0
    except SystemExit as error:
        code = error.code
    return code, capsys.readouterr().err


def test_wings_without_a_frame_rate_with_names(tmp_path, monkeypatch, capsys):
    """No rate is asked for; DLTdv's list names the points; the wings are strokes and their tips a span."""
    flight(tmp_path, beats=8)
    out = tmp_path / "s.toml"
    code, _ = skeleton(tmp_path, monkeypatch, capsys, "--out", out, "--names", tmp_path / "pointnames.txt")
    assert code in (0, None)
    found = read_skeleton(out)
    assert found.markers == NAMES
    assert found.aliases["pt4"] == "tip_l"
    assert {line[1] for line in found.measures.strokes.values()} == {"tip_l", "tip_r"}
    assert set(found.measures.distances["span"]) == {"tip_l", "tip_r"}
    assert not found.measures.feet


def test_names_of_another_number_are_refused(tmp_path, monkeypatch, capsys):
    """Four names for five points: one line that says both."""
    flight(tmp_path, beats=8)
    (tmp_path / "n.txt").write_text("a\nb\nc\nd\n", encoding="utf-8")
    code, said = skeleton(tmp_path, monkeypatch, capsys, "--names", tmp_path / "n.txt")
    assert code == 1
    assert "4 names for 5 points" in " ".join(said.split())


def test_no_cycles_are_said(tmp_path, monkeypatch, capsys):
    """Wings that move once have no cycle: a line says that cycles.csv stays empty, and what would fill it."""
    flight(tmp_path, beats=0.5)
    code, said = skeleton(tmp_path, monkeypatch, capsys, "--out", tmp_path / "s.toml")
    assert code in (0, None)
    assert "cycles.csv stays empty" in " ".join(said.split())
    assert not read_skeleton(tmp_path / "s.toml").measures.strokes
