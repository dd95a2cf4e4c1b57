"""Tables as people have them: what pandas, openpyxl and codecs write of a table is read as the table itself."""

import sys
import zipfile

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap.errors import FormatError
from mocap.io.format import Hints
from mocap.io.registry import identify, read
from tests.real_data import real

COLUMNS = ["pt1_cam1_X", "pt1_cam1_Y", "pt1_cam2_X", "pt1_cam2_Y"]
TABLE = pd.DataFrame([[1.5, 2.25, 3.0, 4.0], [10.125, -2.5, np.nan, np.nan], [1e-7, 7.0, 1234.5, 0.0]], columns=COLUMNS)
UV = TABLE.to_numpy().reshape(3, 2, 2).swapaxes(0, 1)[:, :, None]
"""(2, 3, 1, 2) pixels of the table."""
POINTS = "a_X,a_Y,a_Z,b_X,b_Y,b_Z\n1.5,2,3,4,5,6\n0,-1.25,2,NaN,NaN,NaN\n"


def pixels(path, hints=None):
    recording = read(path, hints)
    assert recording.pixels is not None
    assert recording.paths == (path,)
    return recording.pixels.uv_px


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_encodings(tmp_path, encoding, end):
    """A name with letters of western Europe comes out of each encoding; only the guessed one is told."""
    path = tmp_path / "x.csv"
    path.write_bytes(f"Flügel_X,Flügel_Y,Flügel_Z{end}1,2,3{end}4,5,6{end}".encode(encoding))
    recording = read(path)
    assert recording.names == ("Flügel",)
    np.testing.assert_array_equal(recording.points.xyz_m[:, 0], [[1, 2, 3], [4, 5, 6]])
    assert any("Windows-1252" in finding for finding in recording.findings) == (encoding == "cp1252")


@pytest.mark.parametrize("title", ["time (s)", "Zeit (s)", "Zeit [s]", "t_s", "temps", "Tiempo", "tempo"])
@pytest.mark.parametrize("titles", ["Hüfte X,Hüfte Y,Hüfte Z", "Hüfte cam1 X,Hüfte cam1 Y"])
def test_times_in_other_languages(tmp_path, titles, title):
    """A column of seconds at 1/250 s is 250 frames a second under each title, and no marker."""
    path = tmp_path / "Übersicht.csv"
    columns = 1 + titles.count(",")
    rows = [",".join([f"{k / 250}", *("1" * columns)]) for k in range(3)]
    path.write_text("\n".join([f"{title},{titles}", *rows, ""]), encoding="utf-8")
    assert read(path).fps == pytest.approx(250)
    assert read(path).names == ("Hüfte",)


def test_a_letter_far_down_is_seen(tmp_path):
    """A table that is ASCII for a megabyte, then Windows-1252."""
    path = tmp_path / "x.csv"
    rows = [f"{k},0.1,tip,1,2,3,NaN,measured" for k in range(40000)]
    text = "\n".join(["frame,t_s,marker,x_m,y_m,z_m,sd_m,origin", *rows, "40000,4000,tïp,1,2,3,NaN,measured", ""])
    path.write_bytes(text.encode("cp1252"))
    with pytest.raises(FormatError, match="are not all frames x 2 markers"):  # and not: is no text
        read(path)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("é".encode() + b"\xe9,b\n1,2\n", "line 1 is not UTF-8 text though other lines are"),
        (b"a_X,a_Y,a_Z\n1,2,\x81\n", "line 2 is not UTF-8 text; expected"),
        (b"a_X,a_Y,a_Z\n1,2,\x01\xe9\n", "line 2 is not UTF-8 text; expected"),
        ("a_X,a_Y,a_Z\n1,2,3\n".encode("utf-16")[:-1], "begins as UTF-16"),
        (b"a_X;a_Y;a_Z\n1,5;2;3\n1.5;2;3\n", r"line 3: '1\.5' has a decimal point .* decimal commas \(1,5\)"),
        (b"a_X;a_Y;a_Z\n1.234;2;3\n1,5;2;3\n", r"line 2: '1\.234' has a decimal point"),
        (b"a_X;a_Y;a_Z\n1,5;2;3\n1,2,5;2;3\n", "line 3, a_X: '\"?1[.,]2[.,]5\"?' is not a number|line 3 has 5 cells"),
        (b"a_X;a_Y;a_Z\n1,5;2;3\n1;2\n", "line 3 has 2 cells, expected 3"),
        (b"a_X;a_Y;a_Z\n1,5;2;3\n1_0;2;3\n", "'1_0' is not a number"),
    ],
)
def test_what_is_not_decided_is_refused(tmp_path, data, message):
    """Two kinds of decimals, letters of two encodings, controls: one line that says where, in the file's own lines."""
    path = tmp_path / "x.csv"
    path.write_bytes(data)
    with pytest.raises(FormatError, match=rf"^x\.csv: .*{message}"):
        read(path)


def test_commas_with_semicolons_in_names_stay_commas(tmp_path):
    """A semicolon in the name of every row of a table does not separate its cells."""
    path = tmp_path / "x.csv"
    rows = "".join(f"{k},{k},'a\\x3bb,1,2,3,NaN,measured\n" for k in range(5))
    path.write_text("frame,t_s,marker,x_m,y_m,z_m,sd_m,origin\n" + rows)
    assert read(path).names == ("a;b",)
    path.write_text("a;b_x,a;b_y,a;b_z\n1,2,3\n")
    assert read(path).names == ("a;b",)


@given(
    st.lists(
        st.lists(st.floats(-1e6, 1e6, allow_nan=False).map(lambda x: round(x, 6)), min_size=4, max_size=4),
        min_size=1,
        max_size=8,
    ),
    st.sampled_from([";", "\t"]),
    st.sampled_from(["utf-8", "utf-16"]),
)
def test_any_table_with_decimal_commas(tmp_path_factory, rows, separator, encoding):
    """What is written with decimal commas is read as what is written with points."""
    folder = tmp_path_factory.mktemp("x")
    table = pd.DataFrame(rows, columns=COLUMNS)
    table.to_csv(folder / "comma.csv", sep=separator, decimal=",", index=False, encoding=encoding)
    table.to_csv(folder / "point.csv", index=False)
    np.testing.assert_array_equal(pixels(folder / "comma.csv"), pixels(folder / "point.csv"))


COEFFICIENTS = "".join(f"{k}.5,{k}.25,-{k},1e-{k}\n" for k in range(1, 12))


@pytest.mark.parametrize("columns", [0, 1, 4])
@pytest.mark.parametrize("rows", [0, 1, 3])
def test_coefficients_that_a_spreadsheet_has_widened(tmp_path, columns, rows):
    """Empty columns and rows of separators around coefficients are no cameras."""
    path = tmp_path / "c.csv"
    blank = "," * (3 + columns) + "\n"
    path.write_text(COEFFICIENTS.replace("\n", "," * columns + "\n") + blank * rows)
    recording = read(path)
    assert (recording.format, len(recording.cameras)) == ("dltdv-coefficients", 4)
    assert any("nothing but separators: left out" in finding for finding in recording.findings) == (rows > 0)


def test_a_missing_coefficient_is_still_missing(tmp_path):
    """A column that has some numbers, or says NaN, is a camera."""
    path = tmp_path / "c.csv"
    path.write_text(COEFFICIENTS.replace("\n", ",\n")[:-1] + "1\n")
    with pytest.raises(FormatError, match="coefficient L1 of camera 5 is missing"):
        read(path)


def test_empty_rows_of_pixels_are_frames(tmp_path):
    """Where nothing counts the rows, those of separators only are frames in which nothing was seen, and told."""
    path = tmp_path / "x.csv"
    path.write_text(",".join(COLUMNS) + ",,\n1,2,3,4,,\n,,,,,\n5,6,7,8,,\n,,,,,\n")
    assert pixels(path).shape == (2, 4, 1, 2)
    assert (
        "the last line contains nothing but separators: read as frames in which nothing was seen" in read(path).findings
    )


def test_empty_rows_after_frame_numbers_are_none(tmp_path):
    """Where each row has its frame, a row without is none."""
    path = tmp_path / "x.csv"
    path.write_text("frame,a_x,a_y,a_z,\n7,1,2,3,\n8,4,5,6,\n,,,,\n")
    assert read(path).frames.tolist() == [7, 8]


TYPED = {
    "spaces": "t3L cam1 X,t3L cam1 Y,t3L cam2 X,t3L cam2 Y",
    "case": "t3L_Cam1_X,t3l cam1 y,T3L CAM2 X,t3L cam2 Y",
    "another word": "t3L camera 1 u,t3L camera 1 v,t3L camera 2 u,t3L camera 2 v",
    "pixels": "t3L cam1 X (px),t3L cam1 Y (px),t3L cam2 X (px),t3L cam2 Y (px)",
    "camera first": "cam1 t3L x,cam1 t3L y,cam2 t3L x,cam2 t3L y",
    "lower case with lines": "t3L_cam1_x,t3L_cam1_y,t3L_cam2_x,t3L_cam2_y",
}


@pytest.mark.parametrize("titles", TYPED.values(), ids=TYPED.keys())
def test_typed_titles(tmp_path, titles):
    """Marker, camera and axis are found in what a person types; what they were taken for is told."""
    path = tmp_path / "x.csv"
    path.write_text(titles + "\n" + TABLE.to_csv(index=False, header=False))
    np.testing.assert_array_equal(pixels(path), UV)
    recording = read(path)
    assert (recording.names, recording.camera_names) == (("t3L",), ("cam1", "cam2"))
    assert "is read as marker 't3L', camera 1, x" in recording.findings[0]


def test_typed_titles_that_are_not_whole(tmp_path):
    """A coordinate that is missing leaves the table a plain one, which asks for its columns."""
    path = tmp_path / "x.csv"
    path.write_text("t3L cam1 X,t3L cam1 Y,t3L cam2 X\n1,2,3\n")
    with pytest.raises(FormatError, match="state what the columns are"):
        read(path)


def test_a_real_file_of_another_country(tmp_path):
    """The real pixels of a bat with decimal commas, semicolons and Windows line ends are the same pixels."""
    path = real("bat_windtunnel_dltdv8")
    path = next(iter(sorted(path.rglob("*xypts.csv"))))
    want = read(path)
    copy = tmp_path / path.name
    copy.write_bytes(path.read_bytes().replace(b",", b";").replace(b".", b",").replace(b"\n", b"\r\n"))
    got = read(copy)
    assert identify(path).name == got.format
    np.testing.assert_array_equal(got.pixels.uv_px, want.pixels.uv_px)


def workbook(path, **sheets):
    pytest.importorskip("openpyxl", reason="workbooks need the extra excel")
    with pd.ExcelWriter(path, engine="openpyxl") as book:
        for name, table in sheets.items():
            table.to_excel(book, sheet_name=name, index=False)
    return path


def test_a_workbook(tmp_path):
    """A sheet is read as the CSV file that holds its cells, number for number."""
    path = workbook(tmp_path / "trial_xypts.xlsx", only=TABLE)
    assert identify(path).name == "dltdv-xypts"
    np.testing.assert_array_equal(pixels(path), UV)


def test_the_sheet_is_stated(tmp_path):
    """Of several sheets one is named, or counted from 1; else all are listed."""
    path = workbook(tmp_path / "x.xlsx", notes=pd.DataFrame({"a": ["b"]}), data=TABLE)
    for sheet in ("data", "2"):
        np.testing.assert_array_equal(pixels(path, Hints(sheet=sheet)), UV)
    assert "read from the sheet 'data'" in read(path, Hints(sheet="2")).findings
    with pytest.raises(
        FormatError, match=r"2 sheets with cells; state one with `sheet`, or save it alone: 1 'notes', 2 'data'"
    ):
        read(path)
    with pytest.raises(FormatError, match=r"no sheet '3'; there are 1 'notes', 2 'data'"):
        read(path, Hints(sheet="3"))


def test_a_sheet_of_a_file_without_sheets(tmp_path):
    """A sheet that is stated of a text is a mistake, and not ignored."""
    (tmp_path / "x.csv").write_text(POINTS)
    with pytest.raises(FormatError, match="is not a workbook"):
        read(tmp_path / "x.csv", Hints(sheet="1"))


def test_formulas_without_values(tmp_path):
    """A formula that no spreadsheet has computed is no empty cell."""
    table = TABLE.astype(object)
    table.iloc[1, 1] = "=1+1"
    path = workbook(tmp_path / "x.xlsx", only=table)
    with pytest.raises(FormatError, match=r"row 3, column 2 of 'only': the formula '=1\+1' has no value"):
        read(path)


def test_words_in_a_workbook_are_refused(tmp_path):
    """Dates, truth values and words are no numbers, as in text."""
    for wrong in (pd.Timestamp("2024-01-02"), True, "1,5"):
        table = TABLE.astype(object)
        table.iloc[1, 1] = wrong
        with pytest.raises(FormatError, match=r"line 3.*(is not a number|has 5 cells)"):
            read(workbook(tmp_path / "x.xlsx", only=table))


@pytest.mark.parametrize("cut", [30, 100, 1000, -100, -10])
def test_a_workbook_that_is_cut(tmp_path, cut):
    """A part of a workbook is refused by name."""
    path = workbook(tmp_path / "x.xlsx", only=TABLE)
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(FormatError, match=r"^x\.xlsx: "):
        read(path)


def test_a_workbook_made_to_fill_the_memory(tmp_path, monkeypatch):
    """What is announced to be larger than its file may hold is refused before it is unpacked."""
    monkeypatch.setattr("mocap.io.apart.LEAST", 1 << 22)
    path = workbook(tmp_path / "x.xlsx", only=TABLE)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as pack, pack.open("xl/media/zeros", "w") as stream:
        for _ in range(5):
            stream.write(bytes(1 << 20))
    with pytest.raises(FormatError, match="made to fill the memory"):
        read(path)


def test_a_sheet_that_says_it_is_huge(tmp_path, monkeypatch):
    """One cell in the last corner of a sheet takes neither memory nor time."""
    monkeypatch.setattr("mocap.io.apart.LEAST", 1 << 21)
    path = workbook(tmp_path / "x.xlsx", only=TABLE)
    bomb = tmp_path / "bomb.xlsx"
    row = '<row r="{0}"><c r="XFD{0}"><v>1</v></c></row>'
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as target:
        for name in source.namelist():
            data = source.read(name)
            if name == "xl/worksheets/sheet1.xml":
                rows = "".join(row.format(r) for r in range(5, 45)).encode()
                data = data.replace(b"</sheetData>", rows + b"</sheetData>")
            target.writestr(name, data)
    with pytest.raises(FormatError, match="made to fill the memory"):
        read(bomb)


def test_without_openpyxl_the_extra_is_named(tmp_path, monkeypatch):
    """The message says what to install."""
    path = workbook(tmp_path / "x.xlsx", only=TABLE)
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(FormatError, match=r"pip install .*\[excel\]'"):
        read(path)


@pytest.mark.parametrize(("name", "start"), [("x.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"), ("x.ods", b"PK\3\4")])
def test_spreadsheets_of_other_kinds(tmp_path, name, start):
    """They are refused with what to save them as."""
    (tmp_path / name).write_bytes(start + bytes(100))
    with pytest.raises(FormatError, match=r"save it as \.xlsx, or as CSV"):
        read(tmp_path / name)
