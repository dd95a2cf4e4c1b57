"""Tables in the layouts of people and their scripts: each is read with the values of the plain one, or refused."""

from itertools import cycle

import numpy as np
import pytest

import mocap
from mocap.errors import FormatError
from mocap.io.format import Hints
from mocap.io.lines import SLOW
from mocap.io.registry import read

T, NAMES = 8, ("nose", "tail")
XYZ = (np.random.default_rng(1).normal(size=(T, 2, 3)) + 1).round(4)
XYZ[2, 1] = np.nan
TITLES = [f"{name}_{axis}" for name in NAMES for axis in "xyz"]


def rows(separator=",", lead=lambda t: [str(t)], missing="", mark="."):
    """A line of numbers for each frame, with what stands before them."""
    return [
        separator.join([*lead(t), *(missing if np.isnan(v) else f"{v:.4f}".replace(".", mark) for v in XYZ[t].ravel())])
        for t in range(T)
    ]


def table(tmp_path, lines, *, encoding="utf-8", end="\n", name="a.csv", **hints):
    (tmp_path / name).write_bytes((end.join(lines) + end).encode(encoding))
    return read(tmp_path / name, Hints(**hints))


def is_right(got, *, fps=None, unit=None, names=NAMES):
    """The values, names, rate and unit of the table."""
    size = {"mm": 1e-3}.get(unit, 1.0)
    np.testing.assert_allclose(got.points.xyz_m, XYZ * size, rtol=1e-12)
    assert (got.names, got.unit) == (names, unit)
    assert got.fps == (None if fps is None else pytest.approx(fps, rel=1e-9))
    return got


PLAIN = [",".join(["frame", *TITLES]), *rows()]


@pytest.mark.parametrize("separator", [" ", "   ", "|", "\t", ";"])
@pytest.mark.parametrize("mark", [".", ","])
def test_whatever_separates_cells(tmp_path, separator, mark):
    """Blanks, also several and before the first cell, bars, tabs, semicolons; with decimal points or commas."""
    lines = [separator.join(["frame", *TITLES]), *rows(separator, missing="NaN", mark=mark)]
    is_right(table(tmp_path, lines))
    if separator == "   ":
        is_right(table(tmp_path, [f"  {line}" for line in lines], name="a.txt"))


@pytest.mark.parametrize(
    ("encoding", "end", "over"),
    [
        ("utf-8-sig", "\n", []),
        ("utf-8-sig", "\r", ["# a note"]),
        ("utf-16", "\r\n", []),
        ("utf-16", "\r", ["# a note"]),
    ],
)
def test_marks_and_line_ends(tmp_path, encoding, end, over):
    """Marks of byte order and the line ends of each system, also where the table is laid out anew."""
    is_right(table(tmp_path, [*over, *PLAIN], encoding=encoding, end=end))


def test_what_follows_the_last_row(tmp_path):
    """The ends of files of DOS and of printers, blank lines and comments are no rows."""
    for last in (["", ""], ["\x1a"], ["\f"], ["# end"]):
        assert "blank" not in " ".join(is_right(table(tmp_path, [*PLAIN, *last])).findings)


def test_blank_lines_among_rows_are_told(tmp_path):
    """They are no frames, but may have been some."""
    got = is_right(table(tmp_path, [*PLAIN[:4], "", *PLAIN[4:6], "# note", "", *PLAIN[6:]]))
    assert any(finding.startswith("2 blank lines among the rows left out") for finding in got.findings)


@pytest.mark.parametrize("mark", ["#", "%", "//", "!"])
def test_comments(tmp_path, mark):
    """Comments of Python, R, MATLAB, C and Fortran, wherever they stand, are told; one that takes out a row is not."""
    for lines in (
        [f"{mark} exported, by me", f"{mark}rate: 100", *PLAIN],
        [f"{mark} exported by me", f"{mark} {PLAIN[0]}", *PLAIN[1:]],
        [*PLAIN[:4], f"{mark} a note, here", *PLAIN[4:]],
    ):
        assert "left out, and not counted" in " ".join(is_right(table(tmp_path, lines)).findings)  # or of titles alone
    with pytest.raises(FormatError):
        table(tmp_path, [*PLAIN[:4], mark + PLAIN[4], *PLAIN[5:]])


def test_titles_of_numpy(tmp_path):
    """``numpy.savetxt(..., header=...)`` writes titles as a comment, and blanks between cells."""
    path = tmp_path / "a.txt"
    for delimiter in (" ", ",", "\t", ";"):
        numbers = np.column_stack([np.arange(T), XYZ.reshape(T, -1)])
        np.savetxt(path, numbers, delimiter=delimiter, header=delimiter.join(["frame", *TITLES]))
        is_right(read(path))


@pytest.mark.parametrize(
    "over",
    [
        ["", ""],
        [",,,,,,"],
        ["My lab's export"],
        ["Subject,rat 3", "Rate,100"],
        ["Subject,rat 3,,,,,", ",,,,,,"],
        ["Date: 2024-01-02", ""],
    ],
)
def test_notes_before_the_titles(tmp_path, over):
    """They are left out, and shown; a unit among them is that of the positions."""
    got = is_right(table(tmp_path, [*over, *PLAIN]))
    for words in (cell for line in over for cell in line.split(",") if cell.strip()):
        assert words in " ".join(got.findings)
    is_right(table(tmp_path, [*over, "Units: mm", *PLAIN]), unit="mm")


@pytest.mark.parametrize(("lead", "unit"), [("", "mm"), ("frames", "(mm)"), ("#", "[mm]"), ("-", "millimeters")])
def test_units_in_a_row_of_their_own(tmp_path, lead, unit):
    """Under the titles or above them."""
    units = ",".join([lead, *[unit] * 6])
    is_right(table(tmp_path, [PLAIN[0], units, *PLAIN[1:]]), unit="mm")
    is_right(table(tmp_path, [units, *PLAIN]), unit="mm")


OVER = ("nose,,,tail,,", ",nose,,,tail,", "nose,nose,nose,tail,tail,tail")


@pytest.mark.parametrize(("separator", "over"), list(zip(",;\t", OVER, strict=True)))
@pytest.mark.parametrize("axes", ["x,y,z,x,y,z", "X,Y,Z,X,Y,Z", "X1,Y1,Z1,X2,Y2,Z2", "x [mm],y [mm],z [mm]"])
def test_names_over_axes(tmp_path, separator, over, axes):
    """A name over the first, the middle or each of its columns; frames titled in either row, or none; times; units."""
    unit = "mm" if "mm" in axes else None
    axes = axes if axes.count(",") == 5 else f"{axes},{axes}"

    def lines(*titles, lead=lambda t: [str(t)]):
        return [*(line.replace(",", separator) for line in titles), *rows(separator, lead)]

    is_right(table(tmp_path, lines(f"Frame,{over}", f",{axes}")), unit=unit)
    is_right(table(tmp_path, lines(f",{over}", f"frame,{axes}")), unit=unit)
    is_right(table(tmp_path, lines(over, axes, lead=lambda _: [])), unit=unit)

    def both(t):
        return [str(t), f"{t / 100:.2f}"]

    is_right(table(tmp_path, lines(f"Frame,Time,{over}", f",,{axes}", lead=both)), unit=unit, fps=100)
    if unit is None:
        units = ",s,mm,mm,mm,mm,mm,mm"
        is_right(table(tmp_path, lines(f"Frame,Time,{over}", f",,{axes}", units, lead=both)), unit="mm", fps=100)


def test_what_stands_between_names_and_axes(tmp_path):
    """Visual3D writes five rows of titles: files, names, kinds, folders, axes."""
    titles = ["\t".join(["", *row]) for row in (["a.c3d"] * 6, np.repeat(NAMES, 3), ["TARGET"] * 6, ["ORIGINAL"] * 6)]
    lines = [*titles, "\t".join(["ITEM", *"XYZXYZ"]), *rows("\t", lead=lambda t: [str(t + 1)])]
    got = is_right(table(tmp_path, lines, name="a.txt"))
    np.testing.assert_array_equal(got.frames, 1 + np.arange(T))


def test_names_that_leave_open_whose_axes_are_meant(tmp_path):
    """Two names over one x, y, z, one name twice, or none: refused."""
    for over in ("nose,tail,,,,", "nose,,,nose,,", "nose,,,,,"):
        with pytest.raises(FormatError):
            table(tmp_path, [f"frame,{over}", ",x,y,z,x,y,z", *rows()])


@pytest.mark.parametrize(
    ("form", "names"),
    [
        *[(form, NAMES) for form in ("x_nose", "X_nose", "x.nose", "x nose", "noseX", "nose.x", "nose-x", "nose x")],
        *[(form, NAMES) for form in ("nose[x]", "nose (x)", "nose:x", "nose/x", "nose_X")],
        ("x1", ("point1", "point2")),
    ],
)
def test_titles_of_coordinates(tmp_path, form, names):
    """The axis before or after the name, whatever stands between."""
    titles = []
    for number, name in enumerate(NAMES, start=1):
        upper, own = ("X" in form), form.replace("nose", "@").replace("1", str(number))
        for axis in "XYZ" if upper else "xyz":
            titles.append(own.replace("X" if upper else "x", axis).replace("@", name))
    is_right(table(tmp_path, [",".join(["frame", *titles]), *rows()]), names=names)
    for unit in (" (mm)", "[mm]"):
        is_right(table(tmp_path, [",".join(["frame", *(t + unit for t in titles)]), *rows()]), unit="mm", names=names)


CLOCKS = {
    "hours": lambda t: f"00:00:{1 + t / 100:05.2f}",
    "minutes": lambda t: f"00:{1 + t / 100:05.2f}",
    "comma": lambda t: f'"12:30:01,{250 + 10 * t:03d}"',
    "midnight": lambda t: f"23:59:59.{96 + t:02d}" if t < 4 else f"00:00:00.{t - 4:02d}",
    "date": lambda t: f"2024-03-01T12:30:01.{250 + 10 * t:03d}Z",
    "pandas": lambda t: f"2024-03-01 12:30:01.{250_000 + 10_000 * t}",
    "new year": lambda t: f"2023-12-31 23:59:59.{96 + t:02d}" if t < 4 else f"2024-01-01 00:00:00.{t - 4:02d}",
}


@pytest.mark.parametrize(("clock", "title"), list(zip(CLOCKS, cycle(["time", "timestamp", "Time (s)"]))))
def test_times_of_a_clock(tmp_path, clock, title):
    """Hours, minutes and seconds, with a date or without; after midnight they go on."""
    got = table(tmp_path, [",".join([title, *TITLES]), *rows(lead=lambda t: [CLOCKS[clock](t)])])
    assert any("clock times" in finding for finding in is_right(got, fps=100).findings)


def test_time_codes_with_frames_are_not_guessed(tmp_path):
    """00:00:01:12 needs a rate that no one states."""
    with pytest.raises(FormatError, match="'00:00:01:00' is not a number"):
        table(tmp_path, [",".join(["time", *TITLES]), *rows(lead=lambda t: [f"00:00:01:{t:02d}"])])


UNITS = {
    1: "s sec secs seconds",
    1e-3: "ms msec millis milliseconds",
    1e-6: "us µs microseconds",
    1e-9: "ns nanoseconds",
}


TITLES_OF_TIMES = ("time_{}", "Time ({})", "t [{}]", "timestamp_{}", "{}", "time/{}", "elapsed_time_{}")


@pytest.mark.parametrize(
    ("size", "word", "title"),
    [
        *((size, word, "time_{}") for size, words in UNITS.items() for word in words.split()),
        *((1e-3, "ms", title) for title in TITLES_OF_TIMES[1:]),
    ],
)
def test_the_unit_of_times_is_in_their_title(tmp_path, size, word, title):
    """In short or in full."""
    lines = [",".join([title.format(word), *TITLES]), *rows(lead=lambda t: [f"{t / 100 / size:.6g}"])]
    is_right(table(tmp_path, lines), fps=100)


@pytest.mark.parametrize(
    ("step", "said"),
    [(5, "if they are milliseconds, 200"), (4.1667, "239.998"), (5000, "5000"), (1, "if they count frames")],
)
def test_times_that_can_hardly_be_seconds_are_questioned(tmp_path, step, said):
    """What is 0.2 frames a second as seconds is a finding with the rate that it would be; 2 frames a second is none."""
    got = table(tmp_path, [",".join(["time", *TITLES]), *rows(lead=lambda t: [f"{step * t:.6g}"])])
    told = next(finding for finding in got.findings if finding.startswith(SLOW))
    assert (said if step < 5000 else "microseconds, 200") in told
    found = [finding for finding in mocap.read(tmp_path / "a.csv", unit="m").findings if str(finding) == told]
    assert [finding.alarm for finding in found] == [True]  # and first among what is wrong in a report
    assert not any(str(f).startswith(SLOW) for f in mocap.read(tmp_path / "a.csv", unit="m", fps=200).findings)
    got = table(tmp_path, [",".join(["time", *TITLES]), *rows(lead=lambda t: [f"{0.5 * t}"])])
    assert not any(finding.startswith(SLOW) for finding in got.findings)


def test_separators_at_the_end_of_rows(tmp_path):
    """Of all lines, of the rows or of the titles alone; and empty columns that keep others apart."""
    first, *others = PLAIN
    is_right(table(tmp_path, [f"{line}," for line in PLAIN]))
    is_right(table(tmp_path, [first, *(f"{line}," for line in others)]))
    is_right(table(tmp_path, [first + ",", *others]))
    is_right(table(tmp_path, [line.replace(",", ",,", 1) for line in PLAIN]))


def test_commas_that_may_be_of_thousands_are_not_guessed(tmp_path):
    """1,234 in quotes is a number or a thousand times another; 1,2345 is no thousand; 1,234.5 and 1.234,5 say it."""
    quoted = [PLAIN[0], *(",".join(f'"{c}"' for c in row.split(";")) for row in rows(";", mark=","))]
    is_right(table(tmp_path, quoted))
    titles = ",".join(TITLES[:3])
    found = table(tmp_path, [titles, *[",".join(['"1,234.5"'] * 3)] * 3])
    assert (found.points.xyz_m == 1234.5).all()
    found = table(tmp_path, [titles, *[",".join(['"1.234,5"'] * 3)] * 3])
    assert (found.points.xyz_m == 1234.5).all()
    for cell in ("1,234", "1.234,5.6"):
        with pytest.raises(FormatError):
            table(tmp_path, [titles, *[",".join([f'"{cell}"'] * 3)] * 3])
    for cell in ("1.234,5", "1,234.5"):
        found = table(tmp_path, [titles.replace(",", ";"), *[";".join([cell] * 3)] * 3])
        assert (found.points.xyz_m == 1234.5).all()
    with pytest.raises(FormatError, match=r"line 2, a_y: '1,234\.5': its point or comma may"):
        table(tmp_path, ["a_x;a_y;a_z", *["1.234,5;1,234.5;1"] * 3])


def test_columns_of_words(tmp_path):
    """A column of words does not keep the others from being read; it is named, and so is a word among numbers."""
    lines = [",".join([*TITLES, "note"]), *(f"{row},ok" for row in rows(lead=lambda _: []))]
    columns = {name: tuple(f"{name}_{axis}" for axis in "xyz") for name in NAMES}
    is_right(table(tmp_path, lines, columns=columns))
    found = table(tmp_path, lines)
    is_right(found)
    assert any("1 column is of no marker, left out: note" in finding for finding in found.findings)
    with pytest.raises(FormatError, match="'ok' is not a number"):
        table(tmp_path, [*lines[:3], lines[3].replace(",ok", ",1"), *lines[4:]], columns=columns)


def test_titles_below_a_row_are_none(tmp_path):
    """Lines that were exchanged: the numbers above the titles are a frame, also where hardly a marker was seen."""
    for row in (PLAIN[1], "9,,,,,,", ",,,,1.5,2.5,3.5"):
        for at in (1, 3):
            with pytest.raises(FormatError):
                table(tmp_path, [row, *PLAIN[1:at], PLAIN[0], *PLAIN[at:]])


def test_a_table_in_a_workbook(tmp_path):
    """Notes, names over axes, units and clock times in Excel."""
    openpyxl = pytest.importorskip("openpyxl")
    import datetime

    book = openpyxl.Workbook()
    for row in (["Rat 3"], [], ["", "nose", "", "", "tail"], ["Time", *"xyz" * 2], ["", *["mm"] * 6]):
        book.active.append(row)
    for t in range(T):
        clock = datetime.time(0, 0, 1, 10_000 * t)
        book.active.append([clock, *(None if np.isnan(v) else float(v) for v in XYZ[t].ravel())])
    book.save(tmp_path / "a.xlsx")
    is_right(read(tmp_path / "a.xlsx"), fps=100, unit="mm")
