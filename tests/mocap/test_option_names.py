"""Errors of the library name its arguments, those of the command line its options; options come as records."""

import inspect
import re
import sys

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import mocap
from mocap.cli.console import option_names
from mocap.cli.main import app, main
from mocap.cli.options import RecordingOptions, with_records
from mocap.reading.reading import OPTIONS
from mocap.text import with_options
from mocap.tracking.report_part import Report

ROWS = "a_x,a_y,a_z\n" + "\n".join(f"{i},{i},{i}" for i in range(9)) + "\n"


@pytest.fixture
def positions(tmp_path):
    path = tmp_path / "a_xyzpts.csv"
    path.write_text(ROWS)
    return path


@pytest.mark.parametrize(
    ("stated", "argument", "option"),
    [
        ({}, "give `fps`", "give --fps"),
        ({"fps": 1e9}, "`fps` must be", "--fps must be"),
        ({"fps": 100, "origin": "upper-left"}, "give `calibration`", "give --calibration"),
        ({"fps": 100, "image_height_px": -1.0}, "`image_height_px` must", "--image-height must"),
    ],
)
def test_each_side_is_told_in_its_own_words(positions, monkeypatch, capsys, stated, argument, option):
    """The same mistake, as an argument of mocap.read and as an option of mocap track."""
    with pytest.raises(mocap.MocapError) as refused:
        mocap.read(positions, **stated)
    assert argument in str(refused.value)
    words = [w for k, v in stated.items() for w in (f"--{k.removesuffix('_px').replace('_', '-')}", str(v))]
    monkeypatch.setattr(sys, "argv", ["mocap", "track", str(positions), "--out", str(positions.parent / "o"), *words])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 1
    assert option in capsys.readouterr().err


def test_what_is_no_option_stays_as_it_is():
    """Names of programs and files in backquotes are not touched."""
    text = "run `rerun` or `pip install x`, or give `fps`"
    assert with_options(text, option_names(typer.main.get_command(app))) == text.replace("`fps`", "--fps")


def test_arguments_of_read_are_options_of_the_commands():
    """What files and pages of results call them is what the commands take."""
    taken = {o for p in typer.main.get_command(app).commands["track"].params for o in p.opts}
    assert set(OPTIONS.values()) <= taken


def test_files_of_a_result_name_options(tmp_path):
    """report.md and report.html: what to do is said as a command takes it; in Python it stays an argument."""
    xyz = np.cumsum(np.random.default_rng(0).normal(size=(30, 2, 3)), axis=0) * 1e-3
    result = mocap.track(mocap.from_arrays(xyz, names=["a", "b"], fps=100), model="constant_velocity", validate=False)
    said = "cam2 is late: not corrected; `correct_lag` does; `rerun` shows it"
    report = {**result.report, "wrong": [said], "findings": [said]}
    result = result.with_part(Report(numbers=report, text=result.report_text)).with_report(f"\n- {said}\n")
    result.save(tmp_path / "out")
    assert "`correct_lag`" in result.report_text
    for page in ("report.md", "report.html"):
        text = (tmp_path / "out" / page).read_text(encoding="utf-8")
        assert "--correct-lag" in text
        assert "correct_lag" not in text
        assert "rerun" in text


def test_every_option_of_a_record_reaches_the_command():
    """Typer shows the fields of both records and the command's own; the command gets the records."""
    got = {}
    program = typer.Typer()

    @program.command()
    @with_records
    def command(stated: RecordingOptions, more: int = 1) -> None:
        got.update(stated=stated, more=more)

    done = CliRunner().invoke(program, ["--dlt", "c.csv", "--fps", "50", "--more", "3"])
    assert done.exit_code == 0, done.output
    assert got["more"] == 3
    assert got["stated"].fps == 50
    assert str(got["stated"].calibration) == "c.csv"
    names = {*inspect.signature(command).parameters}
    assert {"calibration", "fps", "skeleton", "more"} <= names
    assert "stated" not in names


def test_earlier_names_of_options_still_work():
    """--dlt, --dlt-origin, --in-step and --video-straight, as scripts have them."""
    found = {o for c in typer.main.get_command(app).commands.values() for p in c.params for o in p.opts}
    assert {"--dlt", "--dlt-origin", "--in-step", "--video-straight"} <= found
    assert {"--calibration", "--calibration-origin", "--correct-lag", "--video-undistorted"} <= found


def test_help_of_a_switch_tells_what_the_name_that_is_shown_does():
    """--no-X is shown of a switch that is on, and told as such; of one without a default both names are shown."""
    found = 0
    for name, command in typer.main.get_command(app).commands.items():
        switches = [p for p in command.params if getattr(p, "secondary_opts", [])]
        page = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "200"}).output if switches else ""
        for one in switches:
            hidden = {True: one.opts, False: one.secondary_opts, None: []}[one.default]
            shown = {*one.opts, *one.secondary_opts} - {*hidden}
            assert {o for o in (*one.opts, *one.secondary_opts) if f" {o} " in page} == shown, name
            assert one.default is not True or re.search(r"\b([Nn]o|not)\b", one.help), (name, one.opts)
            found += 1
        assert "[default: True]" not in page, name
    assert found > 3
