"""What a command says while it works and at its end: lines in a log, and commands that can be pasted."""

import itertools
import re
import shlex
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mocap.cli import console
from mocap.cli.closing import closing
from mocap.cli.main import app
from mocap.cli.options import PANELS


def test_a_log_gets_a_line_now_and_then(monkeypatch):
    """Nothing in the first seconds; then the stage, its share, and the time left, at intervals that double at first."""
    now, said = [0.0], []
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    tell = console._Lines(said.append, every_s=10.0)
    for second in range(0, 80):
        now[0] = float(second)
        tell("track", second / 80)
    assert said == [
        "10 s: track, 12% done, about 70 s left",
        "30 s: track, 38% done, about 50 s left",
        "70 s: track, 88% done, about 10 s left",
    ]


def test_no_minute_of_a_log_is_silent(monkeypatch):
    """Intervals grow to a minute: of an hour of one stage each minute has its line."""
    now, said = [0.0], []
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    tell = console._Lines(lambda _: said.append(now[0]))
    for second in range(3600):
        now[0] = float(second)
        tell("track", second / 3600)
    assert max(later - earlier for earlier, later in itertools.pairwise(said)) <= 60
    assert len(said) <= 65


@pytest.mark.skipif(sys.platform == "win32", reason="quotes of POSIX shells")
def test_what_is_to_be_typed_can_be_pasted():
    """A folder with spaces and quotes comes back as one word."""
    folder = Path("F5 track/it's")
    assert shlex.split(console.typed("mocap", "view", folder)) == ["mocap", "view", str(folder)]


@pytest.mark.parametrize(
    ("prefix", "words"),
    [
        ("/home/a/.cache/uv/archive-v0/Xs3", ("uvx", "eal-mocap")),
        ("/home/a/.local/pipx/.cache/3f2", ("pipx", "run", "eal-mocap")),
        ("/home/a/clone/.venv", ("/home/a/clone/.venv/bin/mocap",)),
    ],
)
def test_the_program_is_named_as_it_can_be_called_again(monkeypatch, prefix, words):
    """What uvx and pipx run lies in a folder that they take away again."""
    monkeypatch.setattr("sys.prefix", prefix)
    monkeypatch.setattr("sys.argv", [f"{prefix}/bin/mocap"])
    monkeypatch.setattr("shutil.which", lambda _: None)
    assert console.program() == words


REPORT = {
    "name": "trial 7",
    "frames": 540,
    "markers": ["wrist", "elbow"],
    "cameras": ["a", "b"],
    "model": {"name": "eal"},
    "gap_samples": 40,
    "gaps": {
        "eal": {"rmse_mm": 0.8341, "coverage95": 94.6},
        "cubic": {"rmse_mm": 80.1, "coverage95": None},
        "conditional_gaussian": {"rmse_mm": 1.01, "coverage95": None},
        "articulated": {"rmse_mm": 0.7, "coverage95": 95.0},
    },
    "sd_mm": {"filled": {"50%": 0.5}},
    "length_m": 0.2413,
    "wrong": [f"camera {k} has moved: calibrate it again, its residual is {k} px in all frames" for k in range(30)],
    "findings": [],
}


def test_a_result_is_told_in_25_lines(tmp_path):
    """Where it is, how to look, the worst first and how many are left, three numbers of the error, the length."""
    lines = closing({**REPORT, "findings": [*REPORT["wrong"], "pixel origin upper-left"]}, tmp_path)
    text = " ".join(" ".join(lines).split())
    order = ["Result:", "Look:", "1. camera 0", "2. camera 1", "more and notes (1)", "Error to expect", "Animal"]
    places = [text.index(part) for part in order]
    assert places == sorted(places)
    assert len(lines) <= 25
    assert max(map(len, lines)) <= max(80, len(str(tmp_path)) + 40)
    assert "0.834 mm RMS error of 40 filled points" in text
    assert "94.6 % of their 95 % intervals" in text
    assert "± 0.98 mm" in text  # 1.96 standard deviations of 0.5 mm
    assert "conditional Gaussian 1.01, cubic splines 80.1 mm" in text
    assert "241 mm" in text


def test_the_worst_is_named_where_it_does_not_fit(tmp_path):
    """In one line, without its middle: what to do stays; the others are counted."""
    lines = closing({**REPORT, "wrong": [f"{'one word and another ' * 60}: give the rate", "next"]}, tmp_path)
    assert len(lines) <= 25
    (told,) = [line for line in lines if line.startswith("  1. one word")]
    assert " ... " in told
    assert told.endswith(": give the rate")
    assert len(told) <= 80
    assert "  1 more: report.html, or --verbose" in lines


def test_a_better_model_than_the_one_used_is_told(tmp_path):
    """Not only that another had the smaller error: what to type for it. Without one nothing is wrong."""

    def told(rmse):
        gaps = {**REPORT["gaps"], "articulated": {**REPORT["gaps"]["articulated"], "rmse_mm": rmse}}
        return " ".join(" ".join(closing({**REPORT, "wrong": [], "gaps": gaps}, tmp_path)).split())

    assert "--model articulated fills the hidden points better (0.5 mm)" in told(0.5)
    assert "Nothing is wrong" in told(0.7)  # of 40 points: two standard deviations are a third of the error


def test_help_has_panels_and_words_of_the_field(monkeypatch):
    """Ten or eleven options before those of experts; no type of Python, no cut name, an example; under 100 lines."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERMINAL_WIDTH", "80")
    text = CliRunner().invoke(app, ["track", "--help"]).output
    panels = [text.index(f"─ {panel} ─") for panel in PANELS]
    assert panels == sorted(panels)
    assert "Example: mocap track" in text[: panels[0]]
    assert 10 <= text[: panels[-1]].count(" --") - text[: panels[0]].count(" --") <= 12
    assert not re.search(r"<|…|\[Path\]|\bstr\b", text)
    assert text.count("\n") < 120
    for command in ("learn", "batch", "kinematics", "digitise", "view"):
        assert not re.search(r"<(int|str|float|bool|path|list)", CliRunner().invoke(app, [command, "--help"]).output), (
            command
        )


def test_the_last_lines_have_the_frequency_or_why_there_is_none():
    """Beside the animal's length; a sentence that is left open is whole where there is room, else in one line."""
    report = {"name": "a", "frames": 9, "markers": ["m"], "cameras": [], "length_m": 0.2, "model": {"name": "mixture"}}
    report |= {"open": [f"no unit is stated: {'so that it is long ' * 8}end of it"]}
    told = "\n".join(closing(report, Path("out"), cycles=["8.25 ± 0.1 Hz: wing beat frequency"]))
    assert "  8.25 ± 0.1 Hz: wing beat frequency" in told.partition("\nAnimal\n")[2]
    assert "end of it" in told
    crowded = report | {"wrong": [f"{number} is wrong: {'as it is ' * 30}" for number in range(3)]}
    lines = closing(crowded, Path("out"), cycles=["none of the 5 cycles counts"])
    assert len(lines) <= 25
    assert any("none of the 5 cycles" in line for line in lines)
