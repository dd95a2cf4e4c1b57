"""What a command says while it works and at its end: lines in a log, and commands that can be pasted."""

import shlex
import sys
from pathlib import Path

import pytest

from mocap.cli import console


def test_a_log_gets_a_line_now_and_then(monkeypatch):
    """Nothing in the first seconds; then the stage, its share, and the time left by what the share took."""
    now, said = [0.0], []
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    tell = console._Lines(said.append, every_s=10.0)
    for second in range(0, 41):
        now[0] = float(second)
        tell("track", second / 80)
    assert said == [
        "10 s: track, 12% done, about 70 s left",
        "20 s: track, 25% done, about 60 s left",
        "30 s: track, 38% done, about 50 s left",
        "40 s: track, 50% done, about 40 s left",
    ]


def test_short_work_says_nothing():
    """Stages that end at once leave no line."""
    said = []
    tell = console._Lines(said.append)
    tell("read", 0.0)
    tell("read", 1.0)
    assert not said


@pytest.mark.skipif(sys.platform == "win32", reason="quotes of POSIX shells")
def test_what_is_to_be_typed_can_be_pasted():
    """A folder with spaces and quotes comes back as one word."""
    folder = Path("F5 track/it's")
    assert shlex.split(console.typed("mocap", "view", folder)) == ["mocap", "view", str(folder)]


@pytest.mark.parametrize(("model", "named"), [("articulated", True), ("lagrangian", True), ("mixture", False)])
def test_files_that_are_named_are_those_that_are_written(capsys, tmp_path, model, named):
    """Joint angles are a file where they are the filter's state."""
    console.finish({"model": {"name": model}, "joints": {}}, "", tmp_path, as_json=False)
    assert ("joint_angles.csv" in capsys.readouterr().err) == named
