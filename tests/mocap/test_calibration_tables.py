"""Calibration tables as spreadsheets leave them are read as the plain CSV: points, wands, profiles, coefficients."""

import pickle
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import mocap
from mocap.calibration import calibrate
from mocap.calibration.calibrate import from_points, from_wand
from mocap.cameras.camera import record, stacked
from mocap.errors import CalibrationError, FormatError
from mocap.io.dltdv import read_pixels, write_coefficients
from mocap.io.profile import read_profile
from mocap.io.registry import as_table, identify, read
from tests.mocap.rigs import cloud, ring
from tests.mocap.test_calibrate import wand_files

SPREADSHEETS = {
    "semicolons": {"sep": ";"},
    "decimal commas": {"sep": ";", "decimal": ","},
    "tabs": {"sep": "\t"},
    "tabs and decimal commas": {"sep": "\t", "decimal": ","},
    "UTF-16": {"sep": "\t", "encoding": "utf-16"},
    "Windows-1252": {"encoding": "cp1252"},
    "UTF-8 with a mark": {"encoding": "utf-8-sig"},
    "empty columns": {},
    "workbook": {},
}


@pytest.fixture(autouse=True, scope="module")
def solved_once():
    """Cameras of the very same numbers are solved for once; any other number is solved for, and told by the cameras."""

    def once(solve):
        known = {}

        def solved(*args, **options):
            key = pickle.dumps((args, options))
            if key not in known:
                known[key] = solve(*args, **options)
            return known[key]

        return solved

    with pytest.MonkeyPatch.context() as patch:
        for name in ("fit_dlt", "calibrate_wand"):
            patch.setattr(calibrate, name, once(getattr(calibrate, name)))
        yield


def spreadsheet(path: Path, how: str, table: pd.DataFrame, *, titles: bool = True) -> Path:
    """The table as one of ``SPREADSHEETS`` has it."""
    if how == "workbook":
        pytest.importorskip("openpyxl", reason="workbooks need the extra excel")
        path = path.with_suffix(".xlsx")
        table.to_excel(path, index=False, header=titles)
        return path
    if how == "empty columns":
        rows = table.to_csv(index=False, header=titles, na_rep="NaN").replace("\n", ",,\n")
        path.write_text(rows + "," * (len(table.columns) + 1) + "\n")
        return path
    table.to_csv(path, index=False, header=titles, na_rep="NaN", **SPREADSHEETS[how])
    return path


@pytest.fixture
def known_points(tmp_path):
    """Known points in millimetres and their pixels, one of them not seen by a camera."""
    points = cloud(np.random.default_rng(3), 20)
    uv = np.concatenate(list(record(ring(3), points)), axis=1)
    uv[4, 2:4] = np.nan
    xyz = pd.DataFrame((1e3 * points).round(6), columns=[*"xyz"])  # a workbook keeps 15 digits
    pixels = pd.DataFrame(uv.round(6), columns=[f"cam{c}_{axis}" for c in (1, 2, 3) for axis in "xy"])
    xyz.to_csv(tmp_path / "plain_points.csv", index=False, header=False)
    pixels.to_csv(tmp_path / "plain_pixels.csv", index=False, header=False, na_rep="NaN")
    cameras, _ = from_points(tmp_path / "plain_points.csv", tmp_path / "plain_pixels.csv", unit_m=1e-3)
    return tmp_path, xyz, pixels, stacked(cameras)


@pytest.mark.parametrize(
    ("how", "titles"),
    [("decimal commas", False), ("Windows-1252", True), ("empty columns", False), ("workbook", True)],
)
def test_known_points(known_points, how, titles):
    """The coefficients are the same to the last bit, and the report says how the tables were read."""
    folder, xyz, pixels, want = known_points
    if how == "Windows-1252":
        xyz, pixels = xyz.assign(größe=0.0), pixels.assign(größe=0.0)
    first = spreadsheet(folder / "points.csv", how, xyz, titles=titles)
    second = spreadsheet(folder / "pixels.csv", how, pixels, titles=titles)
    cameras, report = from_points(first, second, unit_m=1e-3)
    np.testing.assert_array_equal(stacked(cameras), want)
    said = "\n".join(report.lines)
    assert ("points.csv: cells are separated by semicolons" in said) == (how in ("semicolons", "decimal commas"))


def test_titles_of_known_points_say_which_column_is_which(known_points):
    """Columns in another order, cameras in another order, a column of point numbers: titles decide."""
    folder, xyz, pixels, want = known_points
    xyz = xyz.rename(columns=lambda axis: f"{axis.upper()} (mm)").assign(point=np.arange(20.0))
    pixels = pixels.rename(columns=lambda title: title.replace("cam", "Camera ").replace("_", " "))
    xyz.iloc[:, ::-1].to_csv(folder / "points.csv", index=False)
    pixels.iloc[:, ::-1].to_csv(folder / "pixels.csv", index=False)
    cameras, _ = from_points(folder / "points.csv", folder / "pixels.csv", unit_m=1e-3)
    np.testing.assert_array_equal(stacked(cameras), want)
    with pytest.raises(CalibrationError, match=r"the title 'Z \(mm\)' states mm, but coordinates would be read as m"):
        from_points(folder / "points.csv", folder / "pixels.csv", unit_m=1.0)


WAND = {"background": None, "length_m": 0.4, "moves": "none", "lower_left": False, "tell": str}


@pytest.fixture(scope="module")
def known_wand(tmp_path_factory):
    """Pixels of 15 frames of a wand, lenses, and the cameras from the plain files."""
    folder = tmp_path_factory.mktemp("wand")
    wand_files(folder)
    pixels = pd.read_csv(folder / "wand_xypts.csv")[:15]
    pixels.to_csv(folder / "wand.csv", index=False, na_rep="NaN")
    cameras, _, _ = from_wand(folder / "wand.csv", profile=folder / "profile.txt", **WAND)
    return pixels, pd.read_csv(folder / "profile.txt", sep=" ", header=None), stacked(cameras)


@pytest.mark.parametrize("how", ["decimal commas", "UTF-16", "Windows-1252", "workbook"])
def test_a_wand_and_its_profile(tmp_path, known_wand, how):
    """Cameras from a wand are the same to the last bit from the plain files and from a spreadsheet's."""
    pixels, lenses, want = known_wand
    if how == "Windows-1252":
        pixels = pixels.rename(columns=lambda title: title.replace("a_", "ä_"))
    wand = spreadsheet(tmp_path / "wand.csv", how, pixels)
    profile = spreadsheet(tmp_path / "lenses.csv", how, lenses, titles=False)
    got, _, report = from_wand(wand, profile=profile, **WAND)
    np.testing.assert_array_equal(stacked(got), want)
    said = "\n".join(report.lines)
    assert ("wand.csv: letters are not in UTF-8" in said) == (how == "Windows-1252")
    assert ("lenses.csv: cells are separated by semicolons" in said) == (how in ("semicolons", "decimal commas"))


def test_a_wand_with_typed_titles(tmp_path):
    """Titles as a person types them are known as well as DLTdv's."""
    wand_files(tmp_path)
    plain = read_pixels(tmp_path / "wand_xypts.csv", fps=1.0)
    text = (tmp_path / "wand_xypts.csv").read_text()
    first, _, rest = text.partition("\n")
    (tmp_path / "typed.csv").write_text(first.replace("_", " ").lower() + "\n" + rest)
    stated = {"background": tmp_path / "typed.csv", "length_m": 0.4, "moves": "none", "lower_left": False, "tell": str}
    _, _, report = from_wand(tmp_path / "typed.csv", profile=tmp_path / "profile.txt", **stated)
    assert "typed.csv: titles were typed: 'a cam1 x' is read as marker 'a', camera 1, x" in "\n".join(report.lines)
    np.testing.assert_array_equal(read(tmp_path / "typed.csv").pixels.uv_px, plain.uv_px)


def test_positions_are_no_wand(tmp_path):
    """A file of positions in place of pixels is refused with what was expected."""
    (tmp_path / "xyz.csv").write_text("a_X,a_Y,a_Z\n1,2,3\n")
    with pytest.raises(FormatError, match=r"^xyz\.csv: contains no pixels .*pt1_cam1_X"):
        from_wand(
            tmp_path / "xyz.csv", background=None, profile=tmp_path / "p.txt", length_m=1.0, moves="none",
            lower_left=False, tell=str,
        )  # fmt: skip


PROFILE = pd.DataFrame(
    [[k, 1000.5 + k, 640, 480, 320.25, 240.5, 1.125, -0.1, 0.01, 0.002, -0.003, 0.5e-5] for k in (1, 2, 3)],
    columns=["cam", "f", "W", "H", "cx", "cy", "AR", "k1", "k2", "p1", "p2", "k3"],
)


@pytest.mark.parametrize("how", [*SPREADSHEETS, "spaces and decimal commas"])
@pytest.mark.parametrize("titles", [True, False])
def test_profiles(tmp_path, how, titles):
    """A profile is known by content and read as the same lenses."""
    PROFILE.to_csv(tmp_path / "plain.txt", sep=" ", index=False, header=False)
    table = PROFILE.astype({"cam": int, "W": int, "H": int})
    if how == "spaces and decimal commas":
        path = tmp_path / "profile.csv"
        table.to_csv(path, sep=" ", decimal=",", index=False, header=titles)
    else:
        path = spreadsheet(tmp_path / "profile.csv", how, table, titles=titles)
    want = read_profile(tmp_path / "plain.txt")
    with as_table(path) as (file, _):
        assert read_profile(file) == want
    assert identify(path).name == "camera-profile"
    assert read(path).lenses == want


def test_titles_of_a_profile_say_which_column_is_which(tmp_path):
    """Titles in another order, spelt in another way."""
    PROFILE.to_csv(tmp_path / "plain.csv", index=False)
    other = PROFILE.rename(columns={"cam": "Camera", "W": "width", "H": "Height", "AR": "aspect ratio"})
    other.iloc[:, ::-1].to_csv(tmp_path / "other.csv", index=False)
    assert read_profile(tmp_path / "other.csv") == read_profile(tmp_path / "plain.csv")


@pytest.mark.parametrize(
    "rows",
    [
        "1,2,3,4,5,6,7,8,9,10,11,12\n2,2,3,4,5,6,7,8,9,10,11,12\n",  # no picture is 3 pixels wide
        "5,1000,640,480,320,240,1,0,0,0,0,0\n6,1000,640,480,320,240,1,0,0,0,0,0\n",
    ],
)
def test_twelve_columns_of_other_numbers_are_no_profile(tmp_path, rows):
    """Between commas anything may have twelve numbers; only cameras counted from 1 with a picture size are lenses."""
    (tmp_path / "x.csv").write_text(rows)
    assert identify(tmp_path / "x.csv").name == "csv"


@pytest.mark.parametrize("how", SPREADSHEETS)
@pytest.mark.parametrize("titles", [True, False])
def test_coefficients(tmp_path, how, titles):
    """Coefficients, with or without titles of cameras, are the same cameras."""
    write_coefficients(tmp_path / "plain.csv", ring(3))
    table = pd.read_csv(tmp_path / "plain.csv", header=None)
    table.columns = ["cam1", "Cam 2", "camera_3"]
    path = spreadsheet(tmp_path / "c.csv", how, table, titles=titles)
    assert identify(path).name == "dltdv-coefficients"
    np.testing.assert_array_equal(stacked(read(path).cameras), stacked(read(tmp_path / "plain.csv").cameras))


def test_the_report_says_how_calibration_and_profile_were_read(tmp_path):
    """Tracks in plain CSV with coefficients and a profile from a spreadsheet: the same pixels, and two sentences."""
    wand_files(tmp_path)
    cameras = ring(4)
    write_coefficients(tmp_path / "plain.csv", cameras)
    table = pd.read_csv(tmp_path / "plain.csv", header=None)
    lenses = pd.read_csv(tmp_path / "profile.txt", sep=" ", header=None)
    stated = {"tracks": tmp_path / "wand_xypts.csv", "fps": 1.0, "unit": "m", "origin": "upper-left"}
    want = mocap.read(**stated, calibration=tmp_path / "plain.csv", profile=tmp_path / "profile.txt")
    got = mocap.read(
        **stated,
        calibration=spreadsheet(tmp_path / "c.csv", "decimal commas", table, titles=False),
        profile=spreadsheet(tmp_path / "p.csv", "semicolons", lenses, titles=False),
    )
    np.testing.assert_array_equal(got.ideal_px, want.ideal_px)
    assert [said.text.partition(" and ")[0] for said in got.findings if "separated" in said.text] == [
        "c.csv: cells are separated by semicolons", "p.csv: cells are separated by semicolons",
    ]  # fmt: skip
    assert not [said for said in want.findings if "separated" in said.text]
