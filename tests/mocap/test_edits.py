"""Corrections made by hand: a log that survives a kill, and that gives the same bytes when it is replayed."""

import errno
import json
import os
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pandas as pd
import pytest

import mocap
from mocap.cleaning.cleaning import clean
from mocap.cli.main import app
from mocap.errors import FormatError, MocapError
from mocap.io.manifest import current
from mocap.reading.edits import Edit, append_edit, edited, read_edits, read_log, samples_of, standing
from mocap.records import Status
from mocap.tracking.retrack import tracked_again
from tests.mocap.desk.filmed_trial import FPS, GAP, trial
from tests.mocap.digitising.filmed import NAMES

SIGNED = {"who": "test", "when": "2026-01-01T00:00:00+00:00"}
HAND = NAMES.index("hand")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return trial(tmp_path_factory.mktemp("edits"), videos=False)


def read(scene, **more):
    where = scene.folder
    stated = {"calibration": where / "calibration.toml", "skeleton": where / "skeleton.toml", "fps": FPS}
    return mocap.read(where / "flight_xypts.csv", **stated, **more)


def placed(scene, frame, marker, cameras=(0, 1)):
    """What a person places where the marker is."""
    return [
        Edit(
            what="place",
            frame=frame + 1,
            marker=NAMES[marker],
            camera=f"cam{c + 1}",
            uv_px=tuple(scene.uv_px[c, frame, marker].tolist()),
            **SIGNED,
        )
        for c in cameras
    ]


def test_a_log_keeps_what_was_added(scene, tmp_path):
    """Each edit is read as it was added; what was being written at a kill is left out, and the next line is whole."""
    path, edits = tmp_path / "new" / "edits.jsonl", placed(scene, 25, HAND)
    append_edit(path, edits[0])
    with path.open("ab") as stream:
        stream.write(edits[1].line()[:40])
    assert read_edits(path) == edits[:1]
    append_edit(path, edits[1])
    assert read_edits(path) == edits
    assert path.read_bytes() == b"".join(edit.line() for edit in edits)


def test_a_kill_loses_no_edit_that_was_acknowledged(tmp_path):
    """A process is killed while it adds edits as fast as it can: all that it had acknowledged are in the log."""
    path = tmp_path / "edits.jsonl"
    script = f"""
        from pathlib import Path
        from mocap.reading.edits import Edit, append_edit
        for n in range(1, 100000):
            append_edit(Path({str(path)!r}), Edit(what="delete", who="x", when="", frame=n, marker="a" * 200))
            print(n, flush=True)
    """
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        said = [run.stdout.readline() for _ in range(20)]
        os.kill(run.pid, signal.SIGKILL)
        said += run.stdout.read().splitlines(keepends=True)
    last = max(int(line) for line in said if line.endswith("\n"))
    assert [edit.frame for edit in read_edits(path)][:last] == list(range(1, last + 1))


@pytest.mark.parametrize(
    "line",
    [
        b"{}",
        b"[1]",
        b'{"what": "place", "who": "x", "when": "", "frame": 1, "marker": "nose", "camera": "cam1"}',
        b'{"what": "jump", "who": "x", "when": ""}',
        b'{"what": "delete", "who": "x", "when": "", "frame": "1", "marker": "nose"}',
        b'{"what": "delete", "who": "x", "when": "", "frame": true, "marker": "nose"}',
        b'{"what": "place", "who": "x", "when": "", "frame": 1, "marker": "m", "camera": "c", "uv_px": [1, "2"]}',
        b'{"what": "undo", "who": "x", "when": "", "more": 1}',
        b'{"what": "undo", "who": "x", "who": "y", "when": ""}',
        b'{"what": "exchange", "who": "x", "when": "", "frame": 1, "marker": "nose", "other": "nose"}',
        *(
            b'{"what": "place", "who": "x", "when": "", "frame": 1, "marker": "m", "camera": "c", "uv_px": [1, %s]}'
            % far
            for far in (b"true", b"1e300", b"-1e6", b"NaN", b"1" * 400)
        ),
        b'{"names": ["nose"], "cameras": [], "frames": "60", "samples": ["0"]}',
        b"not json",
    ],
)
def test_what_is_no_edit_is_named(tmp_path, line):
    """In one line, with its number."""
    path = tmp_path / "edits.jsonl"
    path.write_bytes(Edit(what="undo", **SIGNED).line() + line + b"\n")
    with pytest.raises(FormatError, match=r"edits\.jsonl: line 2 is no edit") as refused:
        read_edits(path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("ending", "kept"),
    [(b"", 2), (b"}", 2), (b"\xc3", 1), (b'"when": ""}', 1)],
)
def test_a_last_line_counts_where_it_is_whole(scene, tmp_path, ending, kept):
    """Without a line end, as editors leave it, or torn at a kill; the next edit comes after it, or in its place."""
    path, edits = tmp_path / "edits.jsonl", placed(scene, 25, HAND)
    last = edits[1].line().rstrip()
    torn = last if ending == b"" else last[:-1] + ending if ending == b"}" else last[:30] + ending
    path.write_bytes(edits[0].line() + torn)
    assert read_edits(path) == edits[:kept]
    append_edit(path, edits[0])
    assert read_edits(path) == [*edits[:kept], edits[0]]


@pytest.mark.parametrize("before", [0, 1])
@pytest.mark.parametrize("fails", ["fsync", "write"])
def test_what_cannot_be_saved_is_not_in_the_log(scene, tmp_path, monkeypatch, before, fails):
    """The disk refuses an edit, in the middle of it or when it is to be kept: the log is as it was, and is named."""
    path, edits, real = tmp_path / "edits.jsonl", placed(scene, 25, HAND), os.write
    for edit in edits[:before]:
        append_edit(path, edit, samples_of(read(scene)))
    log = path.read_bytes() if before else None

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:

        def half(handle, data):
            patch.setattr(os, "write", full)
            return real(handle, data[:20])

        patch.setattr(os, fails, full if fails == "fsync" else half)
        with pytest.raises(OSError, match=str(path)):
            append_edit(path, edits[1], samples_of(read(scene)))
    assert (path.read_bytes() if path.exists() else None) == log
    append_edit(path, edits[1])
    assert read_edits(path) == edits[1 - before :]


def rewritten(scene, folder, change=lambda table: table, **how):
    """The same recording as another program saves it, or with a change."""
    folder.mkdir()
    for name in ("calibration.toml", "skeleton.toml"):
        (folder / name).write_bytes((scene.folder / name).read_bytes())
    table = pd.read_csv(scene.folder / "flight_xypts.csv")
    change(table).to_csv(folder / "flight_xypts.csv", index=False, **how)
    return folder


def read_in(folder, **more):
    stated = {"calibration": folder / "calibration.toml", "skeleton": folder / "skeleton.toml", "fps": FPS}
    return mocap.read(folder / "flight_xypts.csv", **stated, **more)


@pytest.fixture
def log(scene, tmp_path):
    """Corrections of the hand, that say of which recording they are."""
    for edit in placed(scene, 25, HAND):
        append_edit(tmp_path / "edits.jsonl", edit, samples_of(read(scene)))
    return tmp_path / "edits.jsonl"


def redigitised(table):
    table.iloc[3, 0] += 0.01
    return table


def names_exchanged(table):
    other = {"nose": "hand", "hand": "nose"}
    return table.rename(columns=lambda title: other.get(name := title.split("_")[0], name) + title[len(name) :])


def of_another_order(table):
    """Markers in the reverse order, each with its columns."""
    each = table.shape[1] // len(NAMES)
    return table.iloc[:, [m * each + i for m in reversed(range(len(NAMES))) for i in range(each)]]


@pytest.mark.parametrize(
    ("change", "how"),
    [
        (lambda table: table, {}),
        (lambda table: table, {"float_format": "%.15g", "lineterminator": "\r\n", "na_rep": "NaN"}),
        (of_another_order, {}),
    ],
)
def test_corrections_are_of_samples_not_of_bytes(scene, tmp_path, log, change, how):
    """The recording saved again by another program is the same: its log is replayed without a word."""
    folder = rewritten(scene, tmp_path / "again", change, **how)
    assert (folder / "flight_xypts.csv").read_bytes() != (scene.folder / "flight_xypts.csv").read_bytes()
    found, one = read_in(folder, edits=log), read(scene, edits=log)
    assert not [f for f in found.findings if f.kind == "corrections"]
    at = [found.names.index(name) for name in one.names]
    np.testing.assert_array_equal(found.pixels.uv_px[:, :, at], one.pixels.uv_px)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda table: table.iloc[10:], "made on 60 frames of 3 cameras, and here are 50 frames of 3 cameras"),
        (redigitised, "the samples of nose have changed"),
        (names_exchanged, "hand is the name of another marker here"),
    ],
)
def test_corrections_of_another_recording_are_asked_about(scene, tmp_path, log, change, told):
    """Frames cut, a sample digitised again, names exchanged: refused with what differs; replayed if asked, and said."""
    folder = rewritten(scene, tmp_path / "again", change)
    with pytest.raises(FormatError, match=told) as refused:
        read_in(folder, edits=log)
    assert "`edits_anyway`" in str(refused.value)
    found = read_in(folder, edits=log, edits_anyway=True)
    (one,) = [f for f in found.findings if f.kind == "corrections"]
    assert one.alarm
    assert told in one.text
    assert found.edited.sum() == 1


def test_a_log_of_positions_does_not_depend_on_their_unit(scene):
    """Millimetres or metres stated later, and names given by a skeleton: the samples are the same; others are not."""
    of = [
        samples_of(mocap.from_arrays(xyz, names=names, fps=FPS, unit=unit))
        for xyz, names, unit in (
            (scene.xyz_m, NAMES, "m"),
            (scene.xyz_m, [*NAMES[:-1], "tip"], "mm"),
            (scene.xyz_m + np.array([0, 0, 1e-3]), NAMES, "m"),
        )
    ]
    edits = [Edit(what="delete", frame=1, marker="nose", **SIGNED)]
    assert of[0].difference(of[1], edits) == ""
    assert "have changed" in of[0].difference(of[2], edits)


def test_a_log_of_before_is_read_with_a_finding(scene, tmp_path):
    """It does not say what it corrects; one that has no edits says nothing."""
    path, edits = tmp_path / "edits.jsonl", placed(scene, 25, HAND)
    path.write_bytes(b"")
    assert not [f for f in read(scene, edits=path).findings if f.kind == "corrections"]
    for edit in edits:
        append_edit(path, edit)
    (one,) = [f for f in read(scene, edits=path).findings if f.kind == "corrections"]
    assert "does not say which recording" in one.text
    assert not one.alarm


def test_an_edit_that_cannot_be_is_refused_with_its_line(scene, tmp_path):
    """A place more than an image off, a frame that is not there: by the number of the line in the file."""
    first, _ = placed(scene, 25, HAND)
    for wrong, told in (({"uv_px": [5000.0, 3.0]}, "far out of the image"), ({"frame": 61}, "frames from 1 to 60")):
        path = tmp_path / f"{told[:3]}.jsonl"
        append_edit(path, first, samples_of(read(scene)))
        last = json.loads(first.line()) | wrong
        path.write_bytes(path.read_bytes() + json.dumps(last).encode())
        assert len(read_log(path).edits) == 2
        with pytest.raises(FormatError, match=f"line 3: place of hand.*{told}"):
            read(scene, edits=path)


def test_edits_do_what_they_say(scene):
    """Places, names and deletions, each in its frames and cameras alone; an undo takes the last one back."""
    raw = read(scene)
    uv = raw.pixels.uv_px
    edits = [
        *placed(scene, 25, HAND),
        Edit(what="exchange", frame=46, last=50, marker="left", other="right", **SIGNED),
        Edit(what="delete", frame=3, last=4, marker="nose", **SIGNED),
        Edit(what="unseen", frame=9, marker="hip", camera="cam2", **SIGNED),
        Edit(what="delete", frame=1, last=60, marker="tail", **SIGNED),
        Edit(what="undo", **SIGNED),
    ]
    expected = uv.copy()
    expected[:2, 25, HAND] = scene.uv_px[:2, 25, HAND]
    expected[:, 45:50, [3, 4]] = uv[:, 45:50, [4, 3]]
    expected[:, 2:4, 0] = np.nan
    expected[1, 8, 2] = np.nan
    found = edited(raw, edits)
    np.testing.assert_array_equal(found.pixels.uv_px, expected)
    changed = ~((uv == expected) | np.isnan(uv) & np.isnan(expected)).all(axis=(0, -1))
    np.testing.assert_array_equal(found.data["edited"].values, changed)
    assert edited(raw, [*edits[:1], Edit(what="undo", **SIGNED)]) is raw
    assert standing([Edit(what="undo", **SIGNED)]) == []


@pytest.mark.parametrize("correct_lag", [False, True])
def test_edits_after_reading_are_as_those_read_with_it(scene, tmp_path, correct_lag):
    """Exchanges, deletions and places on a recording that was decided: ideal pixels are those of ``read(edits=)``."""
    exchange = Edit(what="exchange", frame=10, last=14, marker=NAMES[0], other=NAMES[1], **SIGNED)
    delete = Edit(what="delete", frame=20, marker=NAMES[2], **SIGNED)
    edits = [exchange, delete, *placed(scene, 25, HAND)]
    for edit in edits:
        append_edit(tmp_path / "edits.jsonl", edit)
    one = read(scene, edits=tmp_path / "edits.jsonl", correct_lag=correct_lag)
    other = edited(read(scene, correct_lag=correct_lag), edits)
    assert one.data.identical(other.data)


def test_edits_of_positions(scene):
    """A recording without pixels: names are exchanged and ranges deleted; there is no camera to place a marker in."""
    raw = mocap.from_arrays(scene.xyz_m, names=NAMES, fps=FPS, unit="m")
    swap = Edit(what="exchange", frame=1, last=5, marker="nose", other="tail", **SIGNED)
    gone = Edit(what="delete", frame=7, marker="hip", **SIGNED)
    found = edited(raw, [swap, gone])
    np.testing.assert_array_equal(found.points.xyz_m[:5, [0, 6]], scene.xyz_m[:5, [6, 0]])
    assert found.points.status[6, 2] == Status.MISSING
    assert np.isfinite(clean(found).cov_m2[:5, 0]).all()
    with pytest.raises(FormatError, match="positions and no cameras"):
        edited(raw, placed(scene, 1, 0))


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"marker": "ear"}, "no marker 'ear'"),
        ({"frame": 61}, "frames from 1 to 60"),
        ({"frame": 5, "last": 4}, "frames from 1 to 60"),
        ({"camera": "cam9"}, "no camera 'cam9'"),
    ],
)
def test_an_edit_of_another_recording_is_refused(scene, wrong, told):
    """What it names and is not there, and what there is."""
    edit = Edit(**{"what": "delete", "frame": 1, "marker": "nose", **SIGNED, **wrong})
    with pytest.raises(FormatError, match=told):
        edited(read(scene), [edit])
    with pytest.raises(MocapError, match="as it was read"):
        edited(clean(read(scene)), [])


def test_a_click_settles_what_it_touches(scene):
    """A marker placed in a gap: the frames around are known better, and where it was placed it is where it is."""
    raw = read(scene)
    before = clean(raw).points
    frame = GAP[5]
    sd = {}
    for name, edits in {"before": [], "after": placed(scene, frame, HAND)}.items():
        window, found = tracked_again(edited(raw, edits), before, sd_px=0.3, markers=[HAND], first=frame, last=frame)
        at = frame - window.start
        sd[name] = found.sd_m[:, 0]
        assert found.status[at, 0] == (Status.SMOOTHED if name == "before" else Status.MEASURED)
        off = np.linalg.norm(found.xyz_m[at, 0] - scene.xyz_m[frame, HAND])
        assert off < 4 * sd[name][at]
    inside = [t - window.start for t in GAP]
    assert (sd["after"][inside] < sd["before"][inside]).all()
    assert sd["after"][at] < 0.5 * sd["before"][at]


def test_a_replay_gives_the_same_bytes(scene, tmp_path, monkeypatch):
    """The library and the command track the raw files with a log: the same tables, in which edited samples say so."""
    log = tmp_path / "edits.jsonl"
    for edit in [
        *placed(scene, 25, HAND, cameras=(0, 1)),
        Edit(what="exchange", frame=46, last=50, marker="left", other="right", **SIGNED),
    ]:
        append_edit(log, edit)
    mocap.track(read(scene, edits=log), model="constant_velocity", validate=False).save(tmp_path / "library")
    words = ["track", "flight_xypts.csv", "--calibration", "calibration.toml", "--skeleton", "skeleton.toml"]
    words += ["--fps", f"{FPS:g}", "--edits", str(log), "--out", str(tmp_path / "command")]
    monkeypatch.chdir(scene.folder)
    app([*words, "--model", "constant_velocity", "--no-validate"], standalone_mode=False)
    for name in ("markers.csv", "kinematics.csv", "markers.nc"):
        one, other = (current(tmp_path / folder, name).read_bytes() for folder in ("library", "command"))
        assert one == other, name
    table = (tmp_path / "library" / "markers.csv").read_text().splitlines()
    origin = table[0].split(",").index("hand_origin")
    assert table[26].split(",")[origin] == "edited"
    back = mocap.load(tmp_path / "library")
    assert back.repaired[25, HAND] == 2
    again = mocap.read(tmp_path / "library" / "markers.csv")
    assert again.points.status[25, HAND] == Status.MEASURED
    assert back.report["repaired"]["counts"]["edited"] == 11
