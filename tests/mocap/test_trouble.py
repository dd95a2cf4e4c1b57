"""Whatever goes wrong, a user gets one line that says what to do: no traceback, no word that acts on the terminal."""

import csv
import errno
import importlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mocap.datasets import make_bat, write_recording

from mocap.cli.console import visible
from mocap.cli.main import FAULT, STOPPED, TERMINATED, TROUBLE
from mocap.errors import MocapError
from mocap.records import marker_tracks
from mocap.trouble import ended_by_plugin, trouble_of

FPS = 240.0


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return write_recording(make_bat(seed=3, n_frames=40, n_cameras=4), tmp_path_factory.mktemp("bat"))


@pytest.fixture
def failing(mocap, files, tmp_path, monkeypatch):
    """The same of ``mocap triangulate`` with an error raised inside."""

    def run(error: BaseException, *options: str) -> tuple[int, str, str]:
        def fail(*_args: object, **_options: object):
            raise error

        monkeypatch.setattr("mocap.cleaning.triangulate_file.triangulate_file", fail)
        given = ["--dlt", files["coefficients"], "--out", tmp_path / "out.csv"]
        return mocap("triangulate", files["pixels"], *given, *options)

    return run


def with_kept(error: BaseException) -> BaseException:
    error.kept = "the earlier result is kept"  # type: ignore[attr-defined]
    return error


class Panic(BaseException):
    """As a library in Rust raises it."""


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (MocapError("a: mend it"), TROUBLE, "error: a: mend it"),
        (
            OSError(errno.ENOSPC, "No space left on device"),
            TROUBLE,
            "No space left on device; nothing there was changed",
        ),
        (OSError(errno.ENOSPC, "No space left on device", "/tmp/x"), TROUBLE, "error: the disk is full"),
        (OSError(errno.EDQUOT, "Disk quota exceeded"), TROUBLE, "Disk quota exceeded; nothing there was changed"),
        (RuntimeError(f"hdf5: {os.strerror(errno.ENOSPC)}"), TROUBLE, "error: the disk is full"),
        (MemoryError("Unable to allocate 31.6 GiB"), TROUBLE, "error: there is not enough memory"),
        (PermissionError(errno.EACCES, "Permission denied", "/a.csv"), TROUBLE, "error: /a.csv: Permission denied"),
        (OSError(errno.EROFS, "Read-only file system", "/a.csv"), TROUBLE, "error: /a.csv: Read-only file system"),
        (OSError(errno.EIO, "Input/output error"), TROUBLE, "Input/output error; nothing there was changed"),
        (np.linalg.LinAlgError("not positive definite"), TROUBLE, "error: LinAlgError at test_trouble.py:"),
        (csv.Error("field larger than field limit (131072)"), TROUBLE, "a table has a line that is no CSV"),
        (KeyError("x"), FAULT, "error: KeyError"),
        (Panic("rust"), FAULT, "error: Panic"),
        (KeyboardInterrupt(), STOPPED, "out.csv is as it was before"),
        (with_kept(KeyboardInterrupt()), STOPPED, "stopped: the earlier result is kept"),
        (with_kept(OSError(errno.ENOSPC, "full")), TROUBLE, "the earlier result is kept"),
        (ValueError("two\nlines \x1b[31m [red]"), FAULT, r"two lines \x1b[31m [red]"),
    ],
)
def test_every_error_is_one_line_and_a_code(failing, error, code, said):
    """Also those that nobody foresaw; what was kept of the output is said where the error knows it."""
    found, out, err = failing(error)
    assert (found, out) == (code, "")
    assert said in err
    assert len(err.splitlines()) == 1


PLUGIN = """
import sys, numpy
def raises(): raise ValueError("no header")
def ends(): sys.exit(3)
def asks(): numpy.linalg.inv(numpy.zeros((2, 2)))
def calls(work): work()
"""


def test_what_a_plug_in_does_is_no_error_in_mocap(tmp_path, monkeypatch):
    """What its code, or a library that it calls, raises is its own, its end of the program too; ours stays ours."""
    (tmp_path / "otherfmt.py").write_text(PLUGIN)
    (tmp_path / "otherfmt-1.0.dist-info").mkdir()
    (tmp_path / "otherfmt-1.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: otherfmt\nVersion: 1.0\n"
    )
    (tmp_path / "otherfmt-1.0.dist-info" / "entry_points.txt").write_text("[mocap.formats]\nother = otherfmt:raises\n")
    monkeypatch.syspath_prepend(tmp_path)
    plugin = importlib.import_module("otherfmt")

    def ours():
        marker_tracks((), np.zeros(3), "no array")  # type: ignore[arg-type]

    for work in (plugin.raises, plugin.ends, plugin.asks):
        trouble = _trouble(work)
        assert not trouble.fault
        assert "the plug-in 'other' of the package 'otherfmt' did that" in trouble.text
    assert "otherfmt.py:3" in _trouble(plugin.raises).text
    for work in (ours, lambda: plugin.calls(ours)):
        assert _trouble(work).fault
    assert not _trouble(lambda: np.linalg.inv(np.zeros((2, 2)))).fault
    with pytest.raises(SystemExit) as end:
        sys.exit(0)
    assert not ended_by_plugin(end.value)


def _trouble(work):
    try:
        work()
    except BaseException as error:
        return trouble_of(error)
    raise AssertionError


def test_a_full_disk_that_was_taken_for_a_damaged_file(failing):
    """What an error came from counts: a reader that meets a full temporary folder must not blame the file."""
    damaged = MocapError("a.mat: the file is damaged")
    damaged.__context__ = OSError(errno.ENOSPC, "No space left on device")
    assert "the disk is full" in failing(damaged)[2]


def test_a_fault_shows_where_it_is_when_asked(failing, monkeypatch):
    """With --debug or MOCAP_DEBUG=1, the traceback before the line; trouble that a user can mend never has one."""
    assert "Traceback" not in failing(ValueError("x"))[2]
    assert "Traceback" in failing(ValueError("x"), "--debug")[2]
    monkeypatch.setenv("MOCAP_DEBUG", "1")
    assert "Traceback" in failing(ValueError("x"))[2]
    assert "Traceback" not in failing(MocapError("x"))[2]


def edited(files, tmp_path, change):
    """Coefficients, (11, C), changed."""
    table = np.loadtxt(files["coefficients"], delimiter=",")
    change(table)
    path = tmp_path / "coefficients.csv"
    np.savetxt(path, table, delimiter=",", fmt="%.17g")
    return path


def same(table):
    table[:, 2] = table[:, 1]


def all_same(table):
    table[:] = table[:, :1]


def zeros(table):
    table[:, 1] = 0


def all_zeros(table):
    table[:] = 0


def huge(table):
    table[0, 1] = 1e300


def all_huge(table):
    table[:] = 1e300


def far(table):
    table[3, 1] = 1e300


def tiny(table):
    table[:, 1] = 1e-300


def flat(table):
    table[4:8, 1] = table[:4, 1]


@pytest.mark.parametrize(
    ("command", "change"),
    [
        *(("triangulate", change) for change in (same, all_same, zeros, all_zeros, huge, all_huge, far, tiny, flat)),
        ("track", same),
        ("learn", same),
    ],
)
def test_cameras_that_no_rig_has(mocap, files, tmp_path, command, change):
    """The file and the camera are named, with what to do: also where the origin is stated."""
    dlt = edited(files, tmp_path, change)
    rate = [] if command == "triangulate" else ["--fps", FPS]
    for origin in ([], ["--origin", "upper-left"]):
        code, _, err = mocap(command, files["pixels"], "--dlt", dlt, "--out", tmp_path / "x.npz", *rate, *origin)
        assert code == TROUBLE
        assert "coefficients.csv: camera" in err or "coefficients.csv: line" in err
        assert "--origin" not in err
        assert len(err.splitlines()) == 1


@pytest.mark.parametrize("change", [same, zeros, huge, far, tiny, flat])
def test_such_cameras_alone(mocap, files, tmp_path, change):
    """Said by info, converted or refused: never a fault."""
    dlt = edited(files, tmp_path, change)
    for arguments in (
        ["info", dlt],
        ["info", files["pixels"], dlt],
        ["convert", dlt, tmp_path / "calibration.toml", "--to", "anipose-calibration"],
    ):
        assert mocap(*arguments)[0] in (0, TROUBLE)


ABSURD = ["0", "nan", "1e300"]


@pytest.mark.parametrize("value", ABSURD)
@pytest.mark.parametrize("option", ["--fps", "--pixel-sd", "--image-height"])
def test_numbers_that_no_recording_has(mocap, files, tmp_path, option, value):
    """The option is named by every command that takes it, in one line, before anything is computed."""
    given = [option, value]
    dlt = ["--dlt", files["coefficients"]]
    commands = [
        ["track", files["pixels"], "--out", tmp_path / "run", *dlt],
        ["learn", files["pixels"], "--out", tmp_path / "model.npz", *dlt],
    ]
    if option == "--fps":
        commands += [["convert", files["pixels"], tmp_path / "a.parquet"]]
    else:
        commands += [["triangulate", files["pixels"], "--out", tmp_path / "a.csv", *dlt]]
    for command in commands:
        code, _, err = mocap(*command, *given)
        assert code == TROUBLE, command
        assert option in err
        assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_rate_that_a_file_states(mocap, tmp_path):
    """Times a picosecond apart are no frames."""
    table = tmp_path / "a.csv"
    rows = [f"{i},{i * 1e-12:.15g},{i},0,0,measured" for i in range(1, 40)]
    table.write_text("frame,t_s,a_x,a_y,a_z,a_origin\n" + "\n".join(rows) + "\n")
    code, _, err = mocap("track", table, "--out", tmp_path / "run")
    assert code == TROUBLE
    assert "a.csv: the frame rate is 1e+12; expected" in err


def test_memory_does_not_grow_with_the_rate():
    """Body frames at the fastest rate take what the frames take: a moving average is no wider than a constant."""
    import tracemalloc

    from mocap.filters.body_axes import body_frames

    xyz = np.random.default_rng(0).normal(size=(30, 5, 3))
    tracemalloc.start()
    body_frames(xyz, dt_s=1e-9, cutoff_hz=8.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6  # a window of 2^20 frames to either side, some times over


def test_no_locale_stops_a_command(tmp_path):
    """Names of markers and files that ASCII lacks are written as they are, and said as escapes."""
    positions, folder = tmp_path / "fledermäuse.csv", tmp_path / "läufe"
    rows = [f"{i},{i / 100},{np.sin(i / 5)},{i / 50},0,measured" for i in range(1, 30)]
    header = "frame,t_s,Schnäuzchen_x,Schnäuzchen_y,Schnäuzchen_z,Schnäuzchen_origin"
    positions.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    script = (
        "import sys\nfrom mocap.cli.main import main\nwords, second = sys.argv[1:], sys.argv.index('convert')\n"
        "for sys.argv in (sys.argv[:second], ['mocap', *words[second - 1 :]]):\n"
        "    try:\n        main()\n    except SystemExit as stopped:\n        assert not stopped.code"
    )
    words = ["track", positions, "--out", folder, "--no-validate", "convert", folder / "markers.csv"]
    program = [sys.executable, "-c", script, *map(str, words), str(tmp_path / "ä.long.csv")]
    done = subprocess.run(program, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert b"l\\xe4ufe/" in done.stdout + done.stderr
    assert rb"\xe4.long.csv" in done.stdout + done.stderr
    assert "Schnäuzchen_x" in (folder / "markers.csv").read_text(encoding="utf-8")
    assert "Schnäuzchen" in (tmp_path / "ä.long.csv").read_text(encoding="utf-8")


def test_what_acts_on_a_terminal_is_shown(mocap, tmp_path):
    """Escapes, C1 controls and turns of the writing direction in names; markup and emoji codes stay text."""
    hostile = "[red]a\x1b[31m\x9b32m\u202eb:smile:"
    path = tmp_path / f"{hostile}.csv"
    path.write_text("frame,t_s,a_x,a_y,a_z,a_origin\n1,0,1,2,3,measured\n2,0.1,1,2,3,measured\n", encoding="utf-8")
    shown = r"[red]a\x1b[31m\x9b32m\u202eb:smile:"
    for arguments in (
        ["info", path],
        ["info", tmp_path / "none" / hostile],
        ["track", path, "--out", tmp_path / hostile, "--no-validate"],
        ["convert", path, tmp_path / f"{hostile}.parquet"],
        ["view", tmp_path / f"none{hostile}"],
        ["convert", path, tmp_path / f"{hostile}.long.csv", "--force"],
        ["triangulate", path, "--out", tmp_path / "x", f"--{hostile}"],
    ):
        _, out, err = mocap(*arguments)
        said = "".join((out + err).split())  # tables and Markdown break lines
        assert "\x1b" not in said
        assert "\x9b" not in said
        assert "\u202e" not in said
        assert shown in said, (arguments, said)


def test_ordinary_text_stays():
    """Letters of every script, lines and tabs are text."""
    text = "Bär, 猫, קול\tµm\n"
    assert visible(text) == text
    assert visible(os.fsdecode(b"b\xe4r")) == r"b\xe4r"


def test_what_is_not_there_is_said_to_be_missing(tmp_path, monkeypatch):
    """No file or folder that is not there is called damaged or of another kind; names like its are told."""
    import mocap
    from mocap.io.registry import read as read_file
    from mocap.rerun.stored import recording_file
    from mocap.tracking.track_part import existing_model

    monkeypatch.chdir(tmp_path)
    (tmp_path / "trial7").mkdir()
    for name in ("trial7.csv", "model.npz"):
        (tmp_path / name).write_text("1\n")
    for call, path, said in (
        (mocap.load, "nothing", "nothing: there is no such folder: give"),
        (mocap.load, "trail7", r"trail7: there is no such folder \(its folder has .*trial7.*\): give"),
        (mocap.load, "trial7.csv", r"trial7\.csv: is a file: give a folder"),
        (mocap.load, "no/trial7", r"no/trial7: there is no such folder \(there is no folder no\): give"),
        (mocap.load_model, "none", "none: there is no such file: give"),
        (mocap.load_model, "modle.npz", r"there is no such file \(its folder has model\.npz\): give"),
        (mocap.load_model, "model.npz", "model.npz: not a model that mocap learn wrote"),
        (lambda name: read_file(Path(name)), "trail7.csv", r"No such file or directory \(its folder has trial7"),
        (lambda name: read_file(Path(name)), "ab.csv", "No such file or directory$"),
        (lambda name: recording_file(Path(name)), "trail7", r"no such file or folder \(its folder has .*trial7"),
        (existing_model, "modle.npz", r"no such file \(its folder has model\.npz\): give auto"),
        (existing_model, "lagrangain", r"no such model \(lagrangian is one\): give auto"),
        (existing_model, "trial7", "is a folder: give auto"),
    ):
        with pytest.raises(MocapError, match=said):
            call(path)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("number", "code", "when"), [("SIGTERM", TERMINATED, "before"), ("SIGINT", STOPPED, "while it is put in place")]
)
def test_a_request_to_end_leaves_nothing_half(tmp_path, number, code, when):
    """A scheduler's SIGTERM is heard as Ctrl-C is: what was begun goes, what is being put in its place comes whole."""
    (tmp_path / "a.csv").write_text("p_x,p_y,p_z\n1,2,3\n4,5,6\n")
    target = "mocap.io.together.write" if when == "before" else "mocap.io.output.write_manifest"
    start = (
        "import os, signal\nfrom unittest import mock\nfrom mocap.cli.main import main\n"
        "import mocap.io.together, mocap.io.output\n"
        f"signal.signal(signal.SIGINT, signal.default_int_handler)\nreal = {target}\n"
        f"def call(*a, **k):\n    os.kill(os.getpid(), signal.{number})\n    return real(*a, **k)\n"
        f"with mock.patch('{target}', call):\n    main()\n"
    )
    command = [sys.executable, "-c", start, "convert", "a.csv", "b.trc", "--fps", "100", "--unit", "m"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, len(done.stderr.splitlines())) == (code, 1), done.stderr
    assert done.stderr.startswith("stopped: ")
    left = {path.name for path in tmp_path.iterdir() if path.name not in (".mocap-manifest.json", ".mocap-lock")}
    assert left == ({"a.csv"} if when == "before" else {"a.csv", "b.trc"})


@pytest.mark.skipif(os.name != "posix", reason="any user makes links")
def test_a_link_that_leads_to_itself_is_no_error_in_mocap(mocap, files, tmp_path):
    """As the place of a result, a folder on the way to it, or a file that is read; a link to a folder is one."""
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there")
    for place, code in (("loop", 1), ("loop/t.csv", 1), ("link/t.csv", 0)):
        words = ["triangulate", files["pixels"], "--dlt", files["coefficients"], "--out", tmp_path / place]
        found = mocap(*words)
        assert found[0] == code, found
        assert "error in mocap" not in found[2]
    assert (tmp_path / "there" / "t.csv").is_file()
    assert mocap("info", tmp_path / "loop")[0] == 1
