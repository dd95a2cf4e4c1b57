"""Each option is stated once, in a record, and every entrance has it from there."""

import inspect
from dataclasses import fields

import pytest
import typer
from typer.testing import CliRunner

import mocap
from mocap.batches.trial import STATED, Options
from mocap.cli.main import app
from mocap.entrances import UNASKED
from mocap.options import FilmedOptions, ReadOptions, TrackOptions, flags_of, options_of

READ, TRACK = options_of(ReadOptions), options_of(TrackOptions)


def defaults(function):
    return {name: one.default for name, one in inspect.signature(function).parameters.items()}


@pytest.mark.parametrize(
    ("function", "record"),
    [
        (mocap.read, ReadOptions),
        (mocap.from_pixels, FilmedOptions),
        (mocap.track, TrackOptions),
        (mocap.batch, TrackOptions),
    ],
)
def test_python_takes_every_option_with_its_default(function, record):
    """By name; its help says of ``read`` and ``from_pixels`` what the record says."""
    taken = defaults(function)
    assert {one.name: one.default for one in fields(record)}.items() <= taken.items()
    if record is not TrackOptions:
        words = " ".join(function.__doc__.split())
        assert all(f"{name}: {one.help}" in words for name, one in options_of(record).items())


@pytest.mark.parametrize("command", ["info", "track", "learn", "batch", "desk", "skeleton", "triangulate"])
def test_commands_that_read_take_every_option_of_a_recording(command):
    """Under the names and with the help of the record."""
    found = {flag: one for one in typer.main.get_command(app).commands[command].params for flag in one.opts}
    for name, option in READ.items():
        for flag in flags_of(name, option) if option.of is not None else ():
            assert found[flag].help == option.help


@pytest.mark.parametrize("command", UNASKED)
def test_what_a_command_does_not_take_is_refused_with_the_reason(command):
    """Each option of a recording is one of the command's, or typed ends with why not."""
    group = typer.main.get_command(app)
    found = {flag: one for one in group.commands[command].params for flag in one.opts}
    for name, option in READ.items():
        for flag in flags_of(name, option) if option.of is not None else ():
            assert found[flag].help == option.help
            if why := UNASKED[command].get(name):
                value = [] if option.of is bool else ["1"]
                ended = CliRunner().invoke(app, [command, "a.csv", "b.csv", flag, *value])
                assert ended.exit_code == 2
                assert why.split(":")[0] in " ".join(ended.output.replace("│", " ").split())


@pytest.mark.parametrize("command", ["track", "desk", "batch"])
def test_commands_that_track_take_every_option_of_tracking(command):
    """By name, with the defaults of the record; its help begins as the record says."""
    found = {one.name: one for one in typer.main.get_command(app).commands[command].params}
    assert {one.name: one.default for one in fields(TrackOptions)} == {name: found[name].default for name in TRACK}
    assert all(found[name].help.startswith(TRACK[name].help) for name in ("model", "seed"))


def test_a_batch_takes_every_option_in_its_manifest_and_in_its_record():
    assert list(STATED) == [name for name, one in READ.items() if one.of is not None]
    assert TRACK.items() <= options_of(Options).items()
