"""Numbers that no recording holds, cells too many, and files that would fill the memory: refused with their place."""

import os
import subprocess
import sys
import tracemalloc
import zipfile
import zlib
from contextlib import contextmanager
from dataclasses import replace

import h5py
import numpy as np
import pytest

from eal import archive
from mocap.errors import FormatError
from mocap.io.apart import LEAST
from mocap.io.contents import point_recording
from mocap.io.lines import frame_numbers, number
from mocap.io.plausible import plausible
from mocap.io.registry import read, write
from mocap.records import MarkerTracks
from mocap.tracking.model_file import load_model

VICON = "Trajectories\n100\n,,A:tip,,,A:root,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n"
DAMAGED = True
"""Files are, which are therefore read in processes of their own."""
TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n100\t100\t3\t2\tmm\n"
    "Frame#\tTime\ta\t\t\tb\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
)
QUALISYS = (
    "NO_OF_FRAMES\t3\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nMARKER_NAMES\ta\tb\nFrame\tTime\ta X\ta Y\ta Z\tb X\tb Y\tb Z\n"
)
DLC = "scorer,s,s,s\nbodyparts,a,a,a\ncoords,x,y,likelihood\n"
ROWS = {
    "vicon.csv": (VICON, ["{f},0,1,2,3,4,5,", "{f},0,1,2,3,4,5,6", "{f},0,1,2,3,,,"], 1),
    "a.trc": (TRC, ["{f}\t0.0{f}\t1\t2\t3\t4\t5\t", "{f}\t0.0{f}\t1\t2\t3\t4\t5\t6", "{f}\t0.0{f}\t1\t2\t3\t\t\t"], 1),
    "q.tsv": (
        QUALISYS,
        ["{f}\t0.0{e}\t1\t2\t3\t4\t5\t", "{f}\t0.0{e}\t1\t2\t3\t4\t5\t6", "{f}\t0.0{e}\t1\t2\t3\t\t\t"],
        1,
    ),
    "dlc.csv": (DLC, ["{f},1,2,", "{f},1,2,0.5", "{f},,,"], 1),
}
"""Head, rows of three frames (the last cell of the first and of the third is missing), and the first frame."""


def text_of(name):
    head, rows, first = ROWS[name]
    return head, [row.format(f=first + i, e=first + i - 1) for i, row in enumerate(rows)]


@pytest.mark.parametrize("name", ROWS)
@pytest.mark.parametrize("row", [0, 1, 2])
@pytest.mark.parametrize("surplus", ["", "7.5"])
def test_a_cell_too_many_is_refused_with_its_line(tmp_path, name, row, surplus):
    """Wherever it stands and whatever it holds, also where the row's last cell is empty as that of a lost marker."""
    head, rows = text_of(name)
    mark = "\t" if "\t" in rows[0] else ","
    (tmp_path / name).write_text("\n".join([head + rows[0], *rows[1:], ""]))
    read(tmp_path / name)
    cells = rows[row].split(mark)
    for place in range(1, len(cells)):
        changed = [*rows]
        changed[row] = mark.join([*cells[:place], surplus, *cells[place:]])
        (tmp_path / name).write_text("\n".join([head + changed[0], *changed[1:], ""]))
        with pytest.raises(FormatError, match=rf"line {head.count(chr(10)) + 1 + row} has \d+ cells, expected"):
            read(tmp_path / name)


def test_rows_that_all_end_in_a_separator_are_whole(tmp_path):
    """Qualisys ends each row with a tab, spreadsheets with some commas: none of these is a cell too many."""
    head, rows = text_of("vicon.csv")
    for end in ("", ",", ",,,"):
        (tmp_path / "v.csv").write_text(head + "".join(f"{row}{end}\n" for row in rows))
        xyz = read(tmp_path / "v.csv").points.xyz_m
        np.testing.assert_array_equal(xyz[1], [[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])


def test_frames_after_an_empty_line_are_not_lost(tmp_path):
    """An empty line ends the section; frames that go on after it were lost in silence. Another section may follow."""
    head, rows = text_of("vicon.csv")
    (tmp_path / "v.csv").write_text(head + "\n".join([*rows[:2], "", rows[2], ""]))
    with pytest.raises(FormatError, match="line 9: frames go on after the empty line 8"):
        read(tmp_path / "v.csv")
    (tmp_path / "v.csv").write_text(head + "\n".join([*rows, "", "Devices", "1000", "Frame,Sub Frame,V", "1,0,5", ""]))
    assert len(read(tmp_path / "v.csv").frames) == 3


@pytest.mark.parametrize("value", ["-1e30", "1_000", "\uff11\uff12", "inf"])
@pytest.mark.parametrize("name", ["vicon.csv", "a.trc", "q.tsv", "dlc.csv", "p_xypts.csv", "w.csv", "w_long.csv"])
def test_a_number_that_nobody_measured(tmp_path, name, value):
    """Python's float reads most of these; a table refuses each, with its line."""
    if name in ROWS:
        head, rows = text_of(name)
        sound = head + "\n".join([*rows, ""])
        mark, line = "\t" if "\t" in rows[1] else ",", head.count("\n") + 2
        cells = rows[1].split(mark)
        text = sound.replace(rows[1], mark.join([*cells[:2], value, *cells[3:]]))
    else:
        xyz = np.arange(18.0).reshape(3, 2, 3) + 0.5
        recording = point_recording(tmp_path / "m", "made", names=["a", "b"], xyz=xyz, unit="m", fps=100.0)
        (tmp_path / name).write_text("pt1_cam1_X,pt1_cam1_Y\n0.5,6.5\n")
        if name.startswith("w"):
            write(recording, tmp_path / name)
        sound = (tmp_path / name).read_text()
        text = sound.replace("6.5", value, 1)
        line = sound[: sound.index("6.5")].count("\n") + 1
    assert text != sound
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(FormatError) as caught:
        read(tmp_path / name)
    assert f"line {line}" in str(caught.value)


@pytest.mark.parametrize("frame", ["1000000000", "9223372036854775808", "1.5", "x", "\u00b2"])
@pytest.mark.parametrize("name", ["vicon.csv", "a.trc", "dlc.csv"])
def test_a_number_of_a_frame_that_is_none(tmp_path, name, frame):
    """Never cast to something else: refused with the line."""
    head, rows = text_of(name)
    mark = "\t" if "\t" in rows[0] else ","
    changed = [*rows[:2], mark.join([frame, *rows[2].split(mark)[1:]])]
    (tmp_path / name).write_text("\n".join([head + changed[0], *changed[1:], ""]), encoding="utf-8")
    with pytest.raises(FormatError, match=rf"line {head.count(chr(10)) + 3}"):
        read(tmp_path / name)


def test_frames_from_below_zero_and_frames_that_jump_are_told(tmp_path):
    """Cameras with a trigger count so; a damaged number looks the same."""
    head, rows = text_of("vicon.csv")
    (tmp_path / "v.csv").write_text(head + "\n".join(["-81" + rows[0][1:], *rows[1:], ""]))
    findings = " ".join(read(tmp_path / "v.csv").findings)
    assert "the first frame number is -81" in findings
    assert "jump 1 times; the largest jump is from -81 to 2" in findings
    np.testing.assert_array_equal(frame_numbers(tmp_path, [-2.0, -1.0, 0.0], first_line=1), [-2, -1, 0])


def test_numbers_are_those_that_programs_write():
    """The law: what ``repr`` and ``%g`` write is read to the last bit, nothing else is."""
    for value in (0.1, -1e-300, 12345678.9, 5e300):
        assert number(f" {value!r} ") == value
    for text in ("1_0", "\u0661", "nan", "inf", "0x1", "1e", "", "1 2"):
        assert np.isnan(number(text))


@pytest.mark.parametrize("unit", ["m", None])
def test_positions_beyond_the_earth(tmp_path, unit):
    """1e12 m is farther than 1e8 m, eight times the width of the earth: refused with marker and frame; 1e7 m is not."""
    for value, wrong in ((1e7, False), (1e12, True), (np.inf, True)):
        xyz = np.zeros((3, 2, 3))
        xyz[2, 1, 0] = value
        recording = point_recording(tmp_path / "a.nc", "made", names=["a", "b"], xyz=xyz, unit=unit, fps=1.0)
        if wrong:
            with pytest.raises(FormatError, match=r"a\.nc: marker 'b' is at .* in frame 3 \(row 3 of the tracks\)"):
                plausible(recording)
        else:
            assert plausible(recording) is not None


@pytest.mark.parametrize(
    ("covariance", "definite"),
    [
        (np.eye(3), True),
        (np.zeros((3, 3)), True),
        (np.diag([1.0, 1.0, -1.0]), False),
        (np.array([[1, 2, 0], [2, 1, 0], [0, 0, 1.0]]), False),  # eigenvalue 1 - 2
        (np.array([[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]]), False),  # 1 - 2 x 0.9, all 2 x 2 minors above 0
        (np.array([[1, 0.5, 0], [0.4, 1, 0], [0, 0, 1.0]]), False),
    ],
)
def test_covariances_are_checked(tmp_path, covariance, definite):
    """A covariance is symmetric with eigenvalues not below 0, here known in closed form; never assumed to be."""
    cov = np.full((2, 1, 3, 3), np.nan)
    cov[1, 0] = 1e-6 * covariance
    recording = point_recording(tmp_path / "a.x", "made", names=["a"], xyz=np.ones((2, 1, 3)), unit="m", fps=1.0)
    tracks = recording.points
    points = MarkerTracks(names=("a",), t_s=tracks.t_s, xyz_m=tracks.xyz_m, cov_m2=cov, status=tracks.status)
    if definite:
        plausible(replace(recording, points=points))
    else:
        with pytest.raises(FormatError, match="the covariance of marker 'a' in frame 2 is not a covariance"):
            plausible(replace(recording, points=points))


def test_a_standard_deviation_below_zero(tmp_path):
    """Squared it would pass for a variance."""
    (tmp_path / "w.csv").write_text(
        "frame,t_s,a_x,a_y,a_z,a_sd,a_origin\n1,0,1,2,3,-0.1,measured\n2,1,1,2,3,0.1,measured\n"
    )
    with pytest.raises(FormatError, match=r"deviation of marker 'a' in frame 1 is -0\.1"):
        read(tmp_path / "w.csv")


@pytest.mark.parametrize("end", ["\r\n", "\r", "\r\r\n", "mixed"])
def test_line_ends_of_any_kind(tmp_path, end):
    """Unix, Windows, old Macs, translated twice, an empty line between, and a mixture give the same values."""
    head, rows = text_of("dlc.csv")
    text = head + "\n".join([*rows, ""])
    (tmp_path / "a.csv").write_bytes(text.encode())
    whole = read(tmp_path / "a.csv")
    ends = iter(["\n\r", "\n", "\r\n", "\r", "\n", "\r\r\n"] if end == "mixed" else [end] * 6)
    (tmp_path / "a.csv").write_bytes("".join(c if c != "\n" else next(ends) for c in text).encode())
    got = read(tmp_path / "a.csv")
    np.testing.assert_array_equal(got.frames, whole.frames)
    np.testing.assert_array_equal(got.pixels.uv_px, whole.pixels.uv_px)


def bomb_mat(path):
    """A deflated variable of 4 GB, as MATLAB 5 lays it out; only its beginning is there."""
    inner = b"\x0e\0\0\0" + (0xFFFFFFF0).to_bytes(4, "little")
    packed = zlib.compress(inner + bytes(1 << 20))
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"
    path.write_bytes(head + (15).to_bytes(4, "little") + len(packed).to_bytes(4, "little") + packed)


def bomb_hdf5(path):
    """A dataset of 1 GB, of which not one chunk was written."""
    with h5py.File(path, "w") as file:
        file.create_dataset("tracks", shape=(1 << 27,), dtype="f8", chunks=(1 << 10,), compression="gzip")


def bomb_sparse(path):
    path.write_text("Sparse format 3D coordinates file\n100000000\t60\t1\n1\t1\t5.5\n")


def bomb_parquet(path):
    import pyarrow
    import pyarrow.parquet as parquet

    run = pyarrow.DictionaryArray.from_arrays(np.zeros(1 << 20, dtype=np.int32), pyarrow.array([0.0]))
    parquet.write_table(pyarrow.table({f"c{i}": run for i in range(90)}), path)


@contextmanager
def little_memory():
    """What is done in it takes less than an eighth of what the smallest bomb unpacks to."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < 1 << 26
    finally:
        tracemalloc.stop()


BOMBS = {"a.mat": bomb_mat, "a.h5": bomb_hdf5, "a_xyzpts.tsv": bomb_sparse, "a.parquet": bomb_parquet}


@pytest.mark.parametrize("name", BOMBS)
def test_what_would_fill_the_memory_is_refused_by_its_head(tmp_path, name):
    """Gigabytes announced in a few kilobytes: refused before anything of that size is made."""
    path = tmp_path / name
    BOMBS[name](path)
    assert path.stat().st_size < LEAST / 100
    with little_memory(), pytest.raises(FormatError, match="memory"):
        read(path)


def npz_bomb(path, *, lie):
    """An archive that says it holds 2 GB; or whose array says so of itself."""
    words = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {(1 << 28,)}, }}".encode()
    head = b"\x93NUMPY\1\0" + (118).to_bytes(2, "little") + words.ljust(117) + b"\n"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("header.npy", head + bytes(1 << 20))
    if not lie:
        data = bytearray(path.read_bytes())
        at = data.index(b"PK\1\2") + 24  # of the central directory: the size unpacked
        data[at : at + 4] = (1 << 31).to_bytes(4, "little")
        path.write_bytes(data)


@pytest.mark.parametrize("lie", [False, True])
def test_a_model_that_would_fill_the_memory(tmp_path, lie):
    """Refused by the sizes in its heads, by both readers of such archives, before 2 GB are unpacked."""
    npz_bomb(tmp_path / "a.npz", lie=lie)
    message = "has shape" if lie else r"it would take 2\.15 GB unpacked"
    with little_memory(), pytest.raises(FormatError, match=message):
        load_model(tmp_path / "a.npz")
    with little_memory(), pytest.raises(archive.ArchiveError, match=message):
        archive.read(tmp_path / "a.npz")


def test_no_folder_for_temporary_files_is_needed(tmp_path, monkeypatch):
    """Where it is full or forbidden, MATLAB and HDF5 files are read as ever: nothing is written there."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["tracks"] = np.arange(24.0).reshape(2, 1, 4, 3)
    whole = read(tmp_path / "a.h5").points.xyz_m
    os.utime(tmp_path / "a.h5", (1, 1))  # another state of the file: not remembered
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none" / "there"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "none" / "there"))
    np.testing.assert_array_equal(read(tmp_path / "a.h5").points.xyz_m, whole)


@pytest.mark.rare
def test_an_ascii_terminal_changes_nothing_that_is_read(tmp_path):
    """In the locale C, without Python's UTF-8 mode, names of markers and files are what they are elsewhere."""
    xyz = np.arange(18.0).reshape(3, 2, 3)
    recording = point_recording(tmp_path / "m", "made", names=["\u00e9paule", "\u819d"], xyz=xyz, unit="m", fps=100.0)
    names = ["w\u00e9.csv", "w_long.csv", "w.trc", "w\u00e9.parquet", "w.nc", "w\u00e9.c3d"]
    script = (
        "import sys; from pathlib import Path; from mocap.io.registry import read\n"
        "print([ascii(read(p).names) for p in sorted(Path(sys.argv[1]).iterdir())])"
    )
    folder = tmp_path / "files"
    folder.mkdir()
    for name in names:
        write(recording, folder / name)
    env = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", script, str(folder)], env=env, capture_output=True, text=True, check=False
    )
    assert done.stdout.count(r"'\\xe9paule', '\\u819d'") == len(names), done.stderr
