"""Tables as strangers write them: quoted cells, frames under any title, no last line end, unnamed trajectories."""

import numpy as np
import pytest

from mocap.errors import FormatError
from mocap.io.format import Hints
from mocap.io.lines import rate_of_times
from mocap.io.registry import read

PLAIN = "frame,a_x,a_y,a_z,b_x,b_y,b_z\n" + "".join(f"{i},{i}.25,2.5,3.5,4.5,{-i}.75,6.5\n" for i in range(1, 7))
TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\t"
    "OrigDataStartFrame\tOrigNumFrames\n100\t100\t6\t2\tmm\t100\t1\t6\nFrame#\tTime\ta\t\t\tb\t\t\n"
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
    + "".join(f"{i}\t{i / 100:.3f}\t{i}.25\t2.5\t3.5\t4.5\t{-i}.75\t6.5\n" for i in range(1, 7))
)


def table(tmp_path, text, name="a.csv", **hints):
    (tmp_path / name).write_text(text, encoding="utf-8", newline="")
    return read(tmp_path / name, Hints(**hints))


def same(got, whole):
    np.testing.assert_array_equal(got.points.xyz_m, whole.points.xyz_m)
    np.testing.assert_array_equal(got.frames, whole.frames)
    return got


def quoted(text):
    return "\n".join(",".join(f'"{cell}"' if cell else "" for cell in row.split(",")) for row in text.split("\n"))


def test_quotes_around_cells_are_no_part_of_them(tmp_path):
    """Excel's "quote all" changes neither the format that is found nor a value, in tables of any program."""
    whole = table(tmp_path, PLAIN)
    assert same(table(tmp_path, quoted(PLAIN)), whole).names == ("a", "b")
    dlc = "scorer,s,s,s\nbodyparts,a,a,a\ncoords,x,y,likelihood\n" + "0,1.5,2.5,0.9\n1,,,0.1\n"
    first, second = table(tmp_path, dlc), table(tmp_path, quoted(dlc))
    assert (second.format, second.names) == (first.format, first.names) == ("deeplabcut-csv", ("a",))
    np.testing.assert_array_equal(second.pixels.uv_px, first.pixels.uv_px)


def test_columns_that_are_stated_are_believed(tmp_path):
    """Titles that mean nothing, and columns that say what they are: no format must be named."""
    text = PLAIN.replace("a_x,a_y,a_z,b_x,b_y,b_z", "p,q,r,s,t,u")
    columns = {"a": ("p", "q", "r"), "b": ("5", "6", "7"), "frame": ("frame",)}
    same(table(tmp_path, text, columns=columns), table(tmp_path, PLAIN))
    with pytest.raises(FormatError, match="in no known format"):
        table(tmp_path, text)


@pytest.mark.parametrize(
    "title",
    [
        "frame_index",
        "frame_idx",
        "frame_number",
        "FrameNo",
        "Frame No.",
        "timestamp",
        "index",
        "img",
        "Bildnr",
        "",
        "t0",
    ],
)
def test_a_column_that_counts_up_is_of_the_frames(tmp_path, title):
    """By its title, or because all others are x, y and z of markers; one that does not count up is not taken for it."""
    whole = table(tmp_path, PLAIN)
    same(table(tmp_path, PLAIN.replace("frame", title)), whole)
    with pytest.raises(FormatError):
        table(tmp_path, PLAIN.replace("frame", title).replace("\n3,", "\n1,"))


@pytest.mark.parametrize("name", ["a.csv", "a.trc", "a_long.csv"])
def test_a_last_line_without_its_end(tmp_path, name):
    """It is read, with a finding, where it is whole; with fewer cells or decimals than the others it is refused."""
    long = "frame,t_s,marker,x_m,y_m,z_m,origin,score\n"
    long += "".join(f"{i},{i / 100},a,{i}.25,2.5,3.5,measured,0.500\n" for i in range(1, 7))
    text = {"a.csv": PLAIN, "a.trc": TRC}.get(name, long)
    whole = table(tmp_path, text, name)
    got = same(table(tmp_path, text.removesuffix("\n"), name), whole)
    assert set(got.findings) - set(whole.findings) == {
        "the last line has no line end: if the file was cut there, its last number is wrong"
    }
    with pytest.raises(FormatError, match="seems to be cut"):
        table(tmp_path, text[:-2], name)
    with pytest.raises(FormatError):
        table(tmp_path, text[: text.rindex("\n", 0, -1) + 8], name)


def test_trajectories_without_a_name(tmp_path):
    """Further ones, ones between others, and none at all: U_1, U_2, ... with the values of their columns."""
    whole = table(tmp_path, TRC, "a.trc")
    for names, expected in (
        ("a\t\t\t", ("a", "U_1")),
        ("\t\t\tb", ("U_1", "b")),
        ("", ("U_1", "U_2")),
        ("U_1", ("U_1", "U_2")),
    ):
        got = same(table(tmp_path, TRC.replace("a\t\t\tb\t\t", names), "a.trc"), whole)
        assert got.names == expected
        assert any("without a unique name" in finding for finding in got.findings)
    for number in ("66", "0", ""):
        got = same(table(tmp_path, TRC.replace("\t6\t2\tmm", f"\t6\t{number}\tmm"), "a.trc"), whole)
        assert any(finding.startswith("NumMarkers is") for finding in got.findings)
    got = same(table(tmp_path, TRC.replace("a\t\t\tb", "a\t\t\ta"), "a.trc"), whole)
    assert got.names == ("a", "a_2")  # as of C3D
    assert any("without a unique name" in finding for finding in got.findings)
    for unit in ("Millimeters", "millimetre", "mm "):
        assert same(table(tmp_path, TRC.replace("\tmm", f"\t{unit}"), "a.trc"), whole).unit == "mm"
    with pytest.raises(FormatError, match=r"line 4 names 1 after Frame# and Time"):
        table(tmp_path, TRC.replace("a\t\t\tb\t\t", "\ta\t\t"), "a.trc")


def test_rows_that_end_before_the_last_trajectory(tmp_path):
    """Cortex writes no tabs after the last trajectory that it saw; a row that ends within one is refused."""
    whole = table(tmp_path, TRC.replace("\t4.5\t-3.75\t6.5", "\t\t\t"), "a.trc")
    got = same(table(tmp_path, TRC.replace("\t4.5\t-3.75\t6.5", ""), "a.trc"), whole)
    assert "1 rows end before the last trajectory, which was read as not seen there" in got.findings
    with pytest.raises(FormatError, match="line 9 has 7 cells"):
        table(tmp_path, TRC.replace("\t4.5\t-3.75\t6.5", "\t4.5\t-3.75"), "a.trc")


def test_blanks_in_place_of_tabs(tmp_path):
    """Columns that an editor set with blanks hold the same numbers."""
    same(table(tmp_path, TRC.expandtabs(12).replace("\n            ", "\n"), "a.trc"), table(tmp_path, TRC, "a.trc"))


@pytest.mark.parametrize(
    ("fps", "decimals"), [(25, 5), (29.97, 6), (60, 9), (99.5, 5), (120, 6), (239.76, 5), (300, 9), (700, 5), (1000, 6)]
)
def test_the_rate_that_people_stated(tmp_path, fps, decimals):
    """Times that were rounded when they were written give the rate with the fewest digits, not 699.999999."""
    times = np.round(3.0 + np.arange(2000) / fps, decimals)
    assert rate_of_times(tmp_path, times)[0] == fps
