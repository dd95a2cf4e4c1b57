"""Files that are not what they should be: one line that names the file, the place and what to do; nothing half done."""

import os
import re
import threading
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eal.arrays import unique
from mocap.batches.find import find_trials
from mocap.cameras.camera import dlt_camera
from mocap.documents import read_toml
from mocap.errors import CalibrationError, FormatError, MocapError
from mocap.io.csv_table import read_table
from mocap.io.dltdv import read_coefficients, read_pixels, read_points
from mocap.io.movies import open_movie
from mocap.io.profile import read_profile, with_profile
from mocap.io.registry import as_table, read
from mocap.records import PixelTracks

DAMAGED = True
"""Files are, which are therefore read in processes of their own."""
HEAD = "p_cam1_X,p_cam1_Y\n"
ROW_OF_11 = ",".join(["1.5"] * 11) + "\n"

PIXELS = {
    "empty": ("", "the file is empty"),
    "blank lines only": ("\n\n  \n", "the file is empty"),
    "header only": (HEAD, "contains no rows"),
    "no header": ("1,2\n3,4\n", "column 1 is '1'.*is this the 2D file"),
    "the 3D file": ("p_X,p_Y,p_Z\n1,2,3\n", "column 1 is 'p_X'.*is this the 2D file"),
    "a word": (HEAD + "1,2\n3,left\n", "line 3, p_cam1_Y: 'left' is not a number; correct it or write NaN"),
    "a decimal comma": (HEAD + "1,5,2\n", "line 2 has 3 cells, expected 2"),
    "semicolons": ("p_cam1_X;p_cam1_Y\n1;2\n", "semicolons; export it with commas"),
    "another missing word": (HEAD + "lost,2\n", "line 2, p_cam1_X: 'lost' is not a number"),
    "a truth value": (HEAD + "1,2\n1,True\n", "line 3, p_cam1_Y: 'True' is not a number"),
    "thousands": (HEAD + "1_000,2\n", "line 2, p_cam1_X: '1_000' is not a number"),
    "infinite": (HEAD + "1,2\n-inf,2\n", "line 3, p_cam1_X: infinite"),
    "an open quote": (HEAD + '1,2\n3,"4\n', "line 3, p_cam1_Y: '\"4' is not a number"),
    "a short line": (HEAD + "1,2\n3\n4,5\n", "line 3 has 1 cells, expected 2; export it again"),
    "a long line": (HEAD + "1,2\n3,4,5\n4,5\n", "line 3 has 3 cells, expected 2"),
    "an empty line": (HEAD + "1,2\n\n4,5\n", "line 3 has 1 cells"),
    "the same name twice": ("p_cam1_X,p_cam1_Y,p_cam1_X,p_cam1_Y\n1,2,3,4\n", "'p' appears twice.*rename one"),
    "a camera short": (
        "p_cam1_X,p_cam1_Y,p_cam2_X,p_cam2_Y,q_cam1_X,q_cam1_Y\n1,2,3,4,5,6\n",
        "marker 'q' has no X and Y columns for cam2: 6 columns do not make 2 markers x 2 cameras x 2",
    ),
    "not text": (b"\x93NUMPY\x01\x00v\xff\xfe\n1,2\n", "not a text file"),
    "UTF-16": ((HEAD + "1,2\n").encode("utf-16"), "not a text file"),
}

POINTS = {
    "the 2D file's axes": ("p_U,p_V\n1,2\n", "column 1 is 'p_U'; expected names like pt1_X"),
    "an axis short": ("p_X,p_Y\n1,2\n", "marker 'p' needs the columns p_X, p_Y and p_Z"),
    "the same name twice": ("p_X,p_Y,p_Z,p_X,p_Y,p_Z\n1,2,3,4,5,6\n", "'p' appears twice.*rename one"),
    "a word": ("p_X,p_Y,p_Z\n1,2,?\n", "line 2, p_Z: '\\?' is not a number"),
}

COEFFICIENTS = {
    "a row short": ("1,2\n" * 10, "10 rows x 2 columns; expected DLT coefficients: 11 rows"),
    "2D": ("1,2\n" * 8, "8 rows are a 2D DLT, from which no 3D points can be computed"),
    "transposed": (ROW_OF_11 * 4, "4 rows x 11 columns.*transposed"),
    "with a header": ("a,b\n" + "1,2\n" * 11, "line 1, column 1: 'a' is not a number"),
    "a coefficient short": ("1,2\n" * 10 + "1,NaN\n", "L11 of camera 2 is missing: calibrate again"),
    "ragged": ("1,2\n" * 5 + "1\n" + "1,2\n" * 5, "line 6 has 1 cells, expected 2"),
    "spaces": ("1 2\n" * 11, "line 1, column 1: '1 2' is not a number"),
    "empty": ("", "the file is empty"),
}


def check(tmp_path, content, message, read):
    """Reading fails with one line that names the file and matches; the file stays as it was."""
    path = tmp_path / "trial7.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    before = path.read_bytes()
    with pytest.raises(FormatError, match=message) as caught:
        read(path)
    text = str(caught.value)
    assert text.startswith("trial7.csv: ")
    assert "\n" not in text
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["trial7.csv"]


@pytest.mark.parametrize("case", PIXELS)
def test_bad_pixels(tmp_path, case):
    """Every broken 2D file is refused with its place; none is read as something else."""
    check(tmp_path, *PIXELS[case], lambda path: read_pixels(path, fps=100))


@pytest.mark.parametrize("case", POINTS)
def test_bad_points(tmp_path, case):
    """Every broken 3D file is refused with its place."""
    check(tmp_path, *POINTS[case], lambda path: read_points(path, fps=100))


@pytest.mark.parametrize("case", COEFFICIENTS)
def test_bad_coefficients(tmp_path, case):
    """Coefficients that are not 11 numbers for each camera are refused, with a guess at why."""
    check(tmp_path, *COEFFICIENTS[case], read_coefficients)


@pytest.mark.parametrize("read", [lambda p: read_pixels(p, fps=1), read_coefficients, read_table, read_profile])
def test_a_file_that_is_not_there(tmp_path, read):
    """A missing file, or a folder in its place, is a FormatError that names it, not a traceback."""
    with pytest.raises(FormatError, match=r"nothing\.csv: cannot be read: No such file"):
        read(tmp_path / "nothing.csv")
    with pytest.raises(FormatError, match="cannot be read"):
        read(tmp_path)


@pytest.fixture
def pipe(tmp_path):
    """Makes a named pipe below the folder; whoever opens one to read it finds its end, and not a test that hangs."""
    made, over = [], threading.Event()

    def let_go():
        while not over.wait(0.05):
            for path in made:
                with suppress(OSError):  # nobody reads it
                    os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))

    def make(name):
        made.append(tmp_path / name)
        made[-1].parent.mkdir(exist_ok=True)
        os.mkfifo(made[-1])
        return made[-1]

    thread = threading.Thread(target=let_go)
    thread.start()
    yield make
    over.set()
    thread.join()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
@pytest.mark.parametrize("name", ["a.csv", "a_xypts.csv", "a.nc", "a.mat", "a.xlsx", "a.c3d", "a.toml", "p.txt"])
def test_a_pipe_is_not_waited_for(pipe, name):
    """Whatever it is called, and whatever is expected there: it is refused before it is opened."""
    path = pipe(name)
    for reads in (read, as_named_table, read_toml):
        with pytest.raises(FormatError, match="is no regular file"):
            reads(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
def test_pipes_among_files_are_none_of_them(pipe, tmp_path):
    """Pictures of a film, recordings of a folder, a manifest."""
    with pytest.raises(FormatError, match="contains no images"):
        open_movie(pipe("cam1/1.png").parent)
    pipe("lab/a_xypts.csv")
    with pytest.raises(MocapError, match="no trial was found"):
        find_trials([tmp_path / "lab"])
    with pytest.raises(MocapError, match="no trial was found"):
        find_trials([pipe("list.csv")])


def as_named_table(path):
    """As readers take what the user names: a profile, coefficients, known points."""
    with as_table(path) as (file, _):
        return file.read_bytes()


def table_bytes(decimals, n_rows=6, n_columns=4):
    rng = np.random.default_rng(4)
    values = rng.uniform(0, 1000, (n_rows, n_columns))
    values[rng.random(values.shape) < 0.2] = np.nan
    values[-1, -1] = 123.456789
    head = ",".join(f"p{i}_cam1_{a}" for i in range(n_columns // 2) for a in "XY")
    rows = [",".join("NaN" if np.isnan(x) else f"{x:.{decimals}f}" for x in row) for row in values]
    return (head + "\n" + "\n".join(rows) + "\n").encode()


@given(cut=st.integers(1, 400))
def test_a_file_cut_anywhere_is_seen(tmp_path_factory, cut):
    """A fixed-decimal file cut at any byte is refused or read with a word, unless the cut falls between two lines.

    Only there is what is left a whole file: one that ends with, or just before, a line end. With few rows above it
    nothing tells a last number that was cut from a short one: the missing line end is a finding.
    """
    whole = table_bytes(6)
    assert len(whole) > 200
    cut %= len(whole)
    path = tmp_path_factory.mktemp("cut") / "trial7_xypts.csv"
    path.write_bytes(whole[:cut])
    header = whole.index(b"\n") + 1
    if cut > header and (whole[cut - 1 : cut] == b"\n" or whole[cut : cut + 1] == b"\n"):
        read(path)
        return
    try:
        found = read(path)
    except FormatError:
        return
    assert any("no line end" in said for said in found.findings)
    assert whole[:cut].count(b"\n") < 4


@pytest.mark.parametrize("left", range(0, 10))
def test_each_cut_of_the_last_number(tmp_path, left):
    """123.456789 cut to 123.45, 123., 12 or nothing is still a number or a gap; that it is cut shows in its length."""
    whole = table_bytes(6).rstrip(b"\n")
    (tmp_path / "trial7_xypts.csv").write_bytes(whole[: len(whole) - 10 + left])
    with pytest.raises(FormatError, match=r"the last cell '[0-9.]*' seems to be cut; export the file again"):
        read(tmp_path / "trial7_xypts.csv")


@pytest.mark.parametrize(
    "text", ["1.25,3.75\n2.5,4.5", "1,2\n3,4", "1.125,NaN\n2.5,4", "1.25,2.5\nNaN,NaN", "1.5,2.0\n,"]
)
def test_a_whole_file_without_a_last_line_end_is_read(tmp_path, text):
    """Numbers written at their natural length, as people and spreadsheets do, are not taken for cut."""
    (tmp_path / "x.csv").write_text(HEAD + text)
    assert read_pixels(tmp_path / "x.csv", fps=1).uv_px.shape == (1, 2, 1, 2)


def test_spaces_around_cells_are_nothing(tmp_path):
    """Cells padded with spaces or tabs read as without, missing ones too."""
    (tmp_path / "x.csv").write_text("p_cam1_X , p_cam1_Y\n 1 , NaN\n\t2,\t3 \n")
    np.testing.assert_array_equal(read_table(tmp_path / "x.csv")[1], [[1, np.nan], [2, 3]])


CELLS = (
    *("0.1", "-.5", "5.", "+1e-3", "2.2250738585072014e-308", "123456.78901234567", "0.30000000000000004", '"7"', '""'),
    *("", "NaN", "nan", "NA", '"NA"', "inf", "-inf", "1e400", "Nan", "-nan", "Infinity", "true", "FALSE", "1_0", "0x1"),
    *("1d3", "1e", "--1", "\uff11", '"1', "1 2", "None", "5"),
)


@pytest.mark.parametrize("cell", CELLS)
def test_short_tables_read_as_long_ones(tmp_path, monkeypatch, cell):
    """A table that is read without pandas has the numbers of pandas to the last bit, or no reader takes it."""
    path, found = tmp_path / "x.csv", []
    path.write_text(f"a,b\n1,2\n{cell},3\n", encoding="utf-8")
    for small in (1 << 18, 0):
        monkeypatch.setattr("mocap.io.csv_table.SMALL", small)
        try:
            found.append(read_table(path)[1].tobytes())
        except FormatError:
            found.append(None)
    assert found[0] == found[1]


def profile(tmp_path, *lines):
    path = tmp_path / "cameras.txt"
    path.write_text("\n".join(lines) + "\n")
    return path


LINE = "1 1698 2560 1600 1281 887 1 -0.12 0.05 0 0 0"


@pytest.mark.parametrize(("columns", "kind"), [(13, "omnidirectional"), (17, "bundle-adjustment"), (19, "Scaramuzza")])
def test_profiles_of_other_camera_models_are_named(tmp_path, columns, kind):
    """A profile of a model that we do not have is refused by that model's name, not read as another."""
    path = profile(tmp_path, LINE, " ".join(["1"] * columns))
    with pytest.raises(
        FormatError, match=rf"^cameras\.txt: line 2 has {columns} columns \(.*{kind}.*not supported.*expected 12"
    ):
        read_profile(path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1 2 3", "line 2 has 3 columns; expected 12"),
        (LINE.replace("887", "x"), "line 2 contains something that is not a number"),
        ("2" + LINE[1:].replace("2560", "nan"), "line 2 contains something that is not a number"),
        ("2" + LINE[1:].replace("1698", "0"), "line 2 describes no camera"),
        ("2" + LINE[1:].replace("1698", "inf"), "line 2 contains something that is not a number"),
    ],
)
def test_broken_profile_lines(tmp_path, line, message):
    """A line that is no camera is refused with its number: not finite, no focal length, words, too few columns."""
    with pytest.raises(FormatError, match=rf"^cameras\.txt: {message}"):
        read_profile(profile(tmp_path, LINE, line))
    with pytest.raises(FormatError, match=rf"^cameras\.txt: {message.replace('2', '4', 1)}"):
        read_profile(profile(tmp_path, "", LINE, "", line))


def test_a_camera_described_twice(tmp_path):
    """Two lines of one number leave open which is which."""
    with pytest.raises(FormatError, match="line 2 describes camera 1 again"):
        read_profile(profile(tmp_path, LINE, LINE))


def test_an_empty_profile(tmp_path):
    """No line, no camera."""
    with pytest.raises(FormatError, match="the file is empty"):
        read_profile(profile(tmp_path, ""))


def test_a_profile_of_another_rig(tmp_path):
    """A profile for three cameras does not fit coefficients for two: the message has both numbers."""
    cameras = tuple(dlt_camera(f"cam{i}", np.arange(11.0) + 1) for i in (1, 2))
    with pytest.raises(CalibrationError, match="describes 3 cameras, but the coefficients are for 2"):
        with_profile(cameras, profile(tmp_path, *(f"{i} {LINE[2:]}" for i in (1, 2, 3))))


def test_records_refuse_what_no_recording_is():
    """Names twice, times that stand still and arrays of another shape are refused by name."""
    with pytest.raises(ValueError, match=re.escape("t_s must increase, but t_s[2] = 0.1 s follows 0.1 s")):
        PixelTracks(names=("a",), cameras=("c",), t_s=[0, 0.1, 0.1], uv_px=np.zeros((1, 3, 1, 2)))
    with pytest.raises(ValueError, match="'a' appears twice"):
        unique("marker", ("a", "b", "a"))
    with pytest.raises(ValueError, match=re.escape("uv_px must have shape (1, 2, 1, 2), but has (1, 3, 1, 2)")):
        PixelTracks(names=("a",), cameras=("c",), t_s=[0, 0.1], uv_px=np.zeros((1, 3, 1, 2)))


def test_records_are_copies_that_nobody_writes_to():
    """Changing the array that a record was made from does not change the record, and the record cannot be changed."""
    uv = np.zeros((1, 1, 1, 2))
    pixels = PixelTracks(names=("a",), cameras=("c",), t_s=[0.0], uv_px=uv)
    uv[:] = 7
    assert not pixels.uv_px.any()
    with pytest.raises(ValueError, match="read-only"):
        pixels.uv_px[:] = 1
