"""Kinematics for other programs, read back by what those programs' users read them with."""

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat

from docs.tools import columns
from mocap.errors import MocapError
from mocap.results.exports import EXPORTS
from mocap.results.keypoints import KEYPOINTS
from mocap.results.tracked import Tracked
from tests.mocap.rerun.flapping import make_run


@pytest.fixture(scope="module")
def result():
    return Tracked.of(make_run(n_frames=30))


@pytest.fixture(scope="module")
def angle(result):
    return next(q for q in result.kinematics.quantities if q.unit == "deg" and q.kind == "joint")


def test_excel_holds_values_deviations_and_status(result, angle, tmp_path):
    """As pandas reads it; empty cells where there is none."""
    pytest.importorskip("openpyxl")
    result.export_kinematics(tmp_path / "a.xlsx")
    book = pd.read_excel(tmp_path / "a.xlsx", sheet_name=None)
    np.testing.assert_allclose(book["value"][angle.name], angle.value)
    np.testing.assert_allclose(book["sd"][angle.name], angle.sd)
    words = np.array(["missing", "measured", "filled"])[angle.rests]
    assert book["status"][angle.name].tolist() == words.tolist()
    assert set(book["quantities"]["quantity"]) == set(result.kinematics)


def test_matlab_holds_the_same(result, angle, tmp_path):
    """As SciPy reads it; names and values in one order."""
    result.export_kinematics(tmp_path / "a.mat")
    table = loadmat(tmp_path / "a.mat", simplify_cells=True)
    column = list(table["names"]).index(angle.name)
    np.testing.assert_array_equal(table["value"][:, column], angle.value)
    np.testing.assert_array_equal(table["sd"][:, column], angle.sd)
    variables = {name for name in table if not name.startswith("__")}
    assert variables == set(columns.documented("kinematics.mat"))


def test_the_page_of_files_names_every_export():
    """Of each kind that ``--export`` knows; those of other programs' key points by how their names end."""
    section = columns.page().split("## What other commands write")[1]
    names = [name.removeprefix("kinematics") for name, _ in EXPORTS.values() if name]
    names += [name.removeprefix("markers") for files in KEYPOINTS.values() for name in files.values()]
    assert [name for name in names if f"{name}`" not in section] == []


@pytest.mark.parametrize("kind", ["mot", "sto"])
def test_opensim_files_state_their_size(result, angle, tmp_path, kind):
    """Header with rows, columns and degrees; then a table with tabs."""
    path = tmp_path / f"a.{kind}"
    result.export_kinematics(path)
    lines = path.read_text().splitlines()
    end = lines.index("endheader")
    assert "inDegrees=yes" in lines[:end]
    table = pd.read_csv(path, sep="\t", skiprows=end + 1)
    assert f"nRows={len(table)}" in lines[:end]
    assert f"nColumns={len(table.columns)}" in lines[:end]
    name = angle.name.removesuffix("_deg") if kind == "mot" else angle.name
    np.testing.assert_allclose(table[name], angle.value, rtol=1e-8)


def test_an_unknown_kind_is_refused(result, tmp_path):
    with pytest.raises(MocapError, match="exported as"):
        result.export_kinematics(tmp_path / "a.fbx")


def test_one_refused_export_leaves_the_others(tmp_path, monkeypatch):
    """What refuses is told, with its reason; what was asked for before and after it is written."""
    result = Tracked.of(make_run(n_frames=30))

    def refuse(*_):
        raise MocapError("no bones")

    monkeypatch.setattr("mocap.results.exports.osim_text", refuse)
    refused = result.write_kinematics(tmp_path, exports=["mat", "osim", "sto"], pictures=False)
    assert refused == ["osim: no bones"]
    assert (tmp_path / "kinematics.mat").exists()
    assert (tmp_path / "kinematics.sto").exists()


def test_workbooks_hold_no_escapes(result, tmp_path):
    """A semicolon splits no cell of a workbook: meanings are the text that the records have."""
    pytest.importorskip("openpyxl")
    result.export_kinematics(tmp_path / "a.xlsx")
    sheet = pd.read_excel(tmp_path / "a.xlsx", sheet_name="quantities")
    assert not sheet["meaning"].str.contains("\\x3b", regex=False).any()
    assert sheet["meaning"].tolist() == [q.what for q in result.kinematics.quantities]
