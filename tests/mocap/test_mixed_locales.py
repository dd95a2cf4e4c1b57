"""Decimal commas below titles with points, and times that begin anew in a part that was cut out."""

import numpy as np
import pytest

from mocap.errors import FormatError
from mocap.io.registry import read

XYZ_MM = np.random.default_rng(0).uniform(100, 900, (40, 2, 3)).round(2)


def rows(first, comma=True, fps=100):
    """Lines of frame, time and coordinates."""
    lines = []
    for f, row in enumerate(XYZ_MM.reshape(40, 6)):
        cells = [str(f + first), f"{f / fps:.5f}", *(f"{value:.2f}" for value in row)]
        lines.append("\t".join(cell.replace(".", ",") if comma else cell for cell in cells))
    return "\n".join([*lines, ""])


def trc(comma=True):
    return (
        "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n100.00\t100.00\t40\t2\tmm\n"
        "Frame#\tTime\ta\t\t\tb\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n" + rows(1, comma)
    )


def tsv(first=1, comma=True, fps=100):
    return (
        "NO_OF_FRAMES\t40\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nNO_OF_ANALOG\t0\nANALOG_FREQUENCY\t0\n"
        "DESCRIPTION\t--\nTIME_STAMP\t2024-01-01, 10:00:00.000\t123.4\nDATA_INCLUDED\t3D\nMARKER_NAMES\ta\tb\n"
        "Frame\tTime\ta X\ta Y\ta Z\tb X\tb Y\tb Z\n" + rows(first, comma, fps)
    )


@pytest.mark.parametrize("comma", [True, False])
@pytest.mark.parametrize(("name", "text"), [("a.trc", trc), ("a.tsv", tsv)])
def test_points_of_titles_are_no_decimal_points(tmp_path, name, text, comma):
    """A rate of ``100.00`` or a clock above numbers with decimal commas: the numbers are what they are with points."""
    (tmp_path / name).write_text(text(comma=comma))
    found = read(tmp_path / name)
    np.testing.assert_allclose(found.points.xyz_m * 1000, XYZ_MM, rtol=1e-12)
    assert found.fps == 100


def test_numbers_of_both_kinds_are_refused(tmp_path):
    """A decimal point among numbers with commas may be one between thousands: nothing is guessed."""
    whole = f"{XYZ_MM[20, 0, 0]:.2f}"
    (tmp_path / "a.trc").write_text(trc().replace(whole.replace(".", ","), whole, 1))
    with pytest.raises(FormatError, match="is not a finite number"):
        read(tmp_path / "a.trc")


def test_times_that_begin_anew(tmp_path):
    """Frames from 1000, times from 0: a part of a recording; with times of another rate it is refused."""
    (tmp_path / "a.tsv").write_text(tsv(first=1000))
    found = read(tmp_path / "a.tsv")
    np.testing.assert_array_equal(found.frames, np.arange(1000, 1040))
    assert "Time begins at 0 in frame 1000: times are those of the frames" in found.findings
    (tmp_path / "a.tsv").write_text(tsv(first=1000, fps=90))
    with pytest.raises(FormatError, match="does not fall on"):
        read(tmp_path / "a.tsv")


QUOTED = {
    "decimal commas": (lambda value: f"{value / 1000:.5f}".replace(".", ","), 1000),
    "thousands": (lambda value: f"{10 * value:,.2f}", 0.1),
    "points": (lambda value: f"{value:.2f}", 1),
}


@pytest.mark.parametrize("how", QUOTED)
def test_quoted_numbers_with_commas(tmp_path, how):
    """``"0,5000"`` and ``"5,000.00"`` are numbers, by what all cells have; ``"5,000"`` is refused."""
    spelt, factor = QUOTED[how]
    lines = [",".join(f'"{name}_{axis}"' for name in "ab" for axis in "xyz")]
    lines += [",".join(f'"{spelt(value)}"' for value in row) for row in XYZ_MM.reshape(40, 6)]
    (tmp_path / "a.csv").write_text("\n".join([*lines, ""]))
    found = read(tmp_path / "a.csv")
    np.testing.assert_allclose(found.points.xyz_m * factor, XYZ_MM, rtol=1e-9, atol=1e-9)
    lines[1:] = [",".join(['"5,000"'] * 6)] * 40
    (tmp_path / "a.csv").write_text("\n".join([*lines, ""]))
    with pytest.raises(FormatError):
        read(tmp_path / "a.csv")


def test_a_title_that_stands_twice_is_named(tmp_path):
    """Two markers of one name are two: which is which is not guessed."""
    (tmp_path / "a.csv").write_text("time,hip_x,hip_y,hip_z,hip_x,hip_y,hip_z\n" + "0,1,2,3,4,5,6\n" * 3)
    with pytest.raises(FormatError, match="the column 'hip_x' stands twice"):
        read(tmp_path / "a.csv")


SPELT = {
    "a typographic minus": (",", lambda value: f"{value - 500:.2f}".replace("-", "\u2212"), lambda mm: mm - 500),
    "a minus": (",", lambda value: f"{value - 500:.2f}", lambda mm: mm - 500),
    "hard blanks between thousands": (
        ";",
        lambda value: f"{10 * value:,.2f}".replace(",", "\u202f").replace(".", ","),
        lambda mm: 10 * mm,
    ),
}


@pytest.mark.parametrize("how", SPELT)
def test_numbers_as_locales_spell_them(tmp_path, how):
    """Scandinavian minus signs and French thousands: each value is that of the plain spelling, and it is told."""
    sep, spelt, true = SPELT[how]
    lines = [sep.join(f"{name}_{axis}" for name in "ab" for axis in "xyz")]
    lines += [sep.join(map(spelt, row)) for row in XYZ_MM.reshape(40, 6)]
    (tmp_path / "a.csv").write_text("\n".join([*lines, ""]), encoding="utf-8")
    found = read(tmp_path / "a.csv")
    np.testing.assert_allclose(found.points.xyz_m, true(XYZ_MM), atol=1e-9)
    assert any("U+2212" in one or "between thousands" in one for one in found.findings) == (how != "a minus")


@pytest.mark.parametrize(
    ("start", "step", "fps"), [(45415.5, 0.01 / 86400, 100), (45415.5, 5e-4, 2000), (0, 1e-5, 1e5)]
)
def test_dates_of_a_spreadsheet_are_days(tmp_path, start, step, fps):
    """A hundredth of a second in days is a hundred frames a second; half a millisecond in seconds is not."""
    lines = [f"{start + k * step:.10f},{k}.5,{k}.25,{k}.125" for k in range(40)]
    (tmp_path / "a.csv").write_text("\n".join(["time,a_x,a_y,a_z", *lines, ""]))
    found = read(tmp_path / "a.csv")
    assert found.fps == pytest.approx(fps, rel=1e-5)
    assert any("times are days" in one for one in found.findings) == (fps == 100)


def german(value):
    return f"{value:,.2f}".replace(",", "_").replace(".", ",").replace("_", ".")


def fortran(value):
    return f"{value:.8E}".replace("E", "D")


def no_letter(value):
    mantissa, exponent = f"{value:.8E}".split("E")
    return f"{mantissa}{exponent[0]}{int(exponent[1:]):03d}"


PROGRAMS = {
    "points between thousands; semicolons": (";", german),
    "points between thousands; tabs": ("\t", german),
    "points between thousands; quotes": (",", lambda value: f'"{german(value)}"'),
    "commas between thousands; semicolons": (";", lambda value: f"{value:,.2f}"),
    "commas between thousands; tabs": ("\t", lambda value: f"{value:,.2f}"),
    "Fortran": (",", fortran),
    "Fortran, small letter": ("\t", lambda value: fortran(value).lower()),
    "Fortran without a letter": (",", no_letter),
    "Fortran, blanks": ("   ", fortran),
}


def table(path, separator, spelt, values, *, names="ab"):
    lines = [separator.join(["frame", *(f"{name}_{axis}" for name in names for axis in "xyz")])]
    lines += [separator.join([str(f), *map(spelt, row)]) for f, row in enumerate(values, start=1)]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("how", PROGRAMS)
def test_numbers_as_programs_spell_them(tmp_path, how):
    """Each value, small, large and negative, is that of the plain spelling, and it is told what was read as what."""
    separator, spelt = PROGRAMS[how]
    values = 10 * XYZ_MM.reshape(40, 6) - 1500
    found = read(table(tmp_path / "a.csv", separator, spelt, values))
    np.testing.assert_allclose(found.points.xyz_m.reshape(40, 6), values, rtol=1e-8, atol=1e-9)
    assert any("is read as" in one for one in found.findings)


def test_a_column_that_leaves_its_thousands_open_is_named(tmp_path):
    """``1.234`` alone in a column, beside decimal commas or whole numbers: refused with line and column.

    Numbers with decimals throughout, without trailing zeros, or from 0 to 1 are decimals; none is refused.
    """
    path = tmp_path / "a.csv"
    values = 10 * XYZ_MM.reshape(40, 6)
    rows = [[german(value) for value in row] for row in values]
    for row in rows:
        row[4] = row[4].partition(",")[0]
    rows[0][4] = "1.234"
    table(path, ";", str, rows)
    with pytest.raises(FormatError, match=r"a\.csv: line 2, b_y: '1\.234': its point or comma may stand between"):
        read(path)
    table(path, ";", str, [["0,5", "1.234", "2,5"]] * 5, names="a")
    with pytest.raises(FormatError, match=r"line 2: '1\.234' has a decimal point"):
        read(path)
    whole = [[f"{k:,.0f}".replace(",", ".") for k in (900 + 5 * i, 1000 + i, 3)] for i in range(40)]
    for separator in (";", "\t"):
        table(path, separator, str, whole, names="a")
        with pytest.raises(FormatError, match=r"line 22, a_x: '1\.000'"):
            read(path)
    for spelt in ("{:.3f}", "{:.4g}", "{:.6g}"):
        decimals = np.arange(120).reshape(40, 3) / 7
        table(path, ";", spelt.format, decimals, names="a")
        np.testing.assert_allclose(read(path).points.xyz_m[:, 0], decimals, rtol=1e-3, atol=1e-3)


def test_words_that_look_like_exponents_stay(tmp_path):
    """A title is no number, and a file of Fortran that also writes E has both."""
    path = tmp_path / "a.csv"
    path.write_text("frame,1.5D+02_x,1.5D+02_y,1.5D+02_z\n1,1.5D+02,-.5d-03,2.5E+01\n2,1,2,3\n")
    found = read(path)
    assert found.names == ("1.5D+02",)
    np.testing.assert_array_equal(found.points.xyz_m[0, 0], [150, -5e-4, 25])
