"""Known headers over row numbers, markers among other things, planes in centimetres, JSON that is whole."""

import json

import numpy as np
import pytest

from mocap import clean
from mocap import read as read_recording
from mocap.errors import FormatError
from mocap.io.format import Hints
from mocap.io.registry import read

TITLES = [f"pt{m}_cam{c}_{a}" for m in (1, 2) for c in (1, 2) for a in "XY"]
UV = np.random.default_rng(0).uniform(100, 900, (30, 8)).round(3)


def write(path, title, numbers, quote=""):
    """DLTdv's table behind a first column with a title."""
    head = ",".join([title, *(f"{quote}{one}{quote}" for one in TITLES)])
    rows = (f"{quote}{n}{quote}," + ",".join(map(str, row)) for n, row in zip(numbers, UV.tolist(), strict=True))
    path.write_text("\n".join([head, *rows, ""]))


@pytest.mark.parametrize("title", ["0", "X", "", '""', "Unnamed: 0", "V1", "row"])
@pytest.mark.parametrize("start", [0, 1])
def test_row_numbers_before_a_known_header_are_left_out(tmp_path, title, start):
    """DLTdv's table stays DLTdv's, with its conventions, behind what pandas and R write over their row numbers."""
    path = tmp_path / "x_xypts.csv"
    write(path, title, range(start, start + 30), quote='"' if title == '""' else "")
    found = read(path)
    assert found.format == "dltdv-xypts"
    np.testing.assert_array_equal(found.pixels.uv_px.transpose(1, 2, 0, 3).reshape(30, 8), UV)
    assert any("numbers the rows" in finding for finding in found.findings)


def test_a_column_that_is_no_row_number_stays(tmp_path):
    """Rows with a hole, or numbers of another kind: what they count is not known, so nothing is left out."""
    for numbers in ([*range(10), *range(11, 31)], range(7, 37), np.linspace(0, 1, 30)):
        write(tmp_path / "x_xypts.csv", "0", numbers)
        with pytest.raises(FormatError, match="state what the columns are"):
            read(tmp_path / "x_xypts.csv")


def test_markers_among_other_columns_are_read_and_the_rest_is_named(tmp_path):
    """Ten markers and a force plate: forces have x, y and z too, and are no markers; mostly other things is refused."""
    rng = np.random.default_rng(1)
    markers = [f"m{k}_{a}" for k in range(10) for a in "xyz"]
    others = ["Fx", "Fy", "Fz", "Mx", "My", "Mz", "EMG1"]
    values = rng.uniform(100, 900, (20, 37))
    np.savetxt(tmp_path / "x.csv", values, "%.4f", ",", header=",".join([*markers, *others]), comments="")
    found = read(tmp_path / "x.csv")
    assert found.names == tuple(f"m{k}" for k in range(10))
    np.testing.assert_allclose(found.points.xyz_m.reshape(20, 30), values[:, :30], atol=1e-4)
    assert f"7 columns are of no marker, left out: {', '.join(others)}" in found.findings
    np.savetxt(tmp_path / "x.csv", values[:, :10], "%.4f", ",", header=",".join([*markers[:3], *others]), comments="")
    with pytest.raises(FormatError, match="state what the columns are"):
        read(tmp_path / "x.csv")


@pytest.mark.parametrize("stated", ["title", "option", "nothing"])
def test_two_columns_in_centimetres_are_a_plane(mocap, tmp_path, stated):
    """A unit in the titles, or that is stated, makes 2D coordinates lengths, exactly; else they are pixels."""
    t = np.arange(60) / 100
    values = np.stack([t, 10 + np.sin(t), 5 + t, 14 + np.sin(t), 6 + t], axis=-1).round(4)
    unit = " (cm)" if stated == "title" else ""
    head = ",".join(["time (s)", *(f"{name}_{a}{unit}" for name in "ab" for a in "xy")])
    np.savetxt(tmp_path / "x.csv", values, "%.4f", ",", header=head, comments="")
    recording = read_recording(tmp_path / "x.csv", unit="cm" if stated == "option" else None)
    words = ["--unit", "cm"] if stated == "option" else []
    out = mocap("info", tmp_path / "x.csv", *words)[1]
    assert ("contains pixels; unit px" if stated == "nothing" else "contains positions in a plane; unit cm") in out
    if stated == "nothing":
        assert recording.source.mm_per_px is None
        return
    code, _, err = mocap("convert", tmp_path / "x.csv", tmp_path / "y.csv", *words)
    assert code == 1
    assert "cannot store what x.csv contains (positions in a plane" in err
    cleaned = clean(recording)
    np.testing.assert_allclose(cleaned.data["position"].values[..., :2].reshape(60, 4), values[:, 1:] / 100, atol=1e-9)
    assert any("lengths in a plane" in str(finding) for finding in recording.findings)


def test_json_that_parses_is_whole(tmp_path):
    """COCO's file without a last line end, numbers over many lines, is read; one that is cut is refused."""
    marks = [{"id": k, "image_id": k, "category_id": 1, "keypoints": [k + 0.5, 2.25, 2]} for k in range(40)]
    whole = {
        "images": [{"id": k, "file_name": f"a/{k:03d}.png"} for k in range(40)],
        "categories": [{"id": 1, "name": "mouse", "keypoints": ["nose"]}],
        "annotations": marks,
        "tail": [[1.25, 2.25, 3.25], [1.25, 2.25]],
    }
    path = tmp_path / "x.json"
    text = json.dumps(whole).replace("], [", ",\n").replace(", 2.25]]}", ",\n2.2]]}")
    path.write_text(text)
    json.loads(text)
    assert len(read(path).frames) == 40
    path.write_text(text[:-4])
    with pytest.raises(FormatError):
        read(path)


TRIPLES = {
    ("nose_", "tail_", "F"): ["nose", "tail"],
    ("nose_", "tail_", "F_"): ["nose", "tail", "F"],
    ("A", "E", "F"): ["A", "E", "F"],
    ("a_", "b_", "f_"): ["a", "b", "f"],
    ("nose", "tail", "F"): ["nose", "tail"],
    ("nose_", "tail_", "F1", "M1"): ["nose", "tail"],
    ("nose_", "F1_", "F2_"): ["nose", "F1", "F2"],
    ("nose_", "tail_", "F_", "M_"): ["nose", "tail"],
    ("m0_", "m1_", "acc_", "GRF_"): ["m0", "m1"],
    ("a_",): ["a"],
    ("F", "M"): None,
    ("force_",): None,
}
"""What stands before x, y and z in the titles of a table, and which of it are markers; None: it is refused."""


@pytest.mark.parametrize(("before", "markers"), TRIPLES.items(), ids=["".join(one) for one in TRIPLES])
def test_forces_beside_markers_are_no_marker(tmp_path, before, markers):
    """``Fx`` beside ``nose_x`` is a force; ``F_x`` beside ``nose_x`` and ``Fx`` beside ``Ax`` are of a marker F."""
    titles = ["time", *(name + axis for name in before for axis in "xyz")]
    values = np.random.default_rng(2).uniform(1, 2, (20, len(titles))).round(4)
    values[:, 0] = np.arange(20) / 100
    np.savetxt(tmp_path / "x.csv", values, "%.4f", ",", header=",".join(titles), comments="")
    if markers is None:
        with pytest.raises(FormatError, match="state what the columns are"):
            read(tmp_path / "x.csv")
        return
    found = read(tmp_path / "x.csv")
    assert list(found.names) == markers
    own = [titles.index(name + axis) for name in before if name.rstrip("_") in markers for axis in "xyz"]
    np.testing.assert_array_equal(found.points.xyz_m.reshape(20, -1), values[:, own])
    assert ("left out" in found.findings[0]) == (len(markers) < len(before))
    stated = read(tmp_path / "x.csv", Hints(columns={"F": tuple(titles[-3:]), "time": ("time",)}))
    np.testing.assert_array_equal(stated.points.xyz_m[:, 0], values[:, -3:])


def test_a_file_without_markers_says_so(mocap, tmp_path):
    """A C3D file of angles alone: what was left out is named, by all entrances; nothing empty is written of it."""
    import ezc3d

    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["UNITS"]["value"], point["RATE"]["value"], point["LABELS"]["value"] = ["mm"], [100], ["LHipAngles"]
    file.add_parameter("POINT", "ANGLES", ["LHipAngles"])
    file["data"]["points"] = np.ones((4, 1, 10))
    file["data"]["meta_points"] = {"residuals": np.zeros((1, 1, 10)), "camera_masks": np.zeros((7, 1, 10), bool)}
    file.write(str(tmp_path / "x.c3d"))
    with pytest.raises(FormatError, match=r"x.c3d: contains no markers \(c3d\): .*modelled quantities"):
        read_recording(tmp_path / "x.c3d")
    assert read(tmp_path / "x.c3d", Hints()).names == ()
    code, out, _ = mocap("info", tmp_path / "x.c3d")
    assert code == 0
    assert "it contains nothing else: no markers" in out
    code, _, err = mocap("convert", tmp_path / "x.c3d", tmp_path / "x.csv")
    assert (code, (tmp_path / "x.csv").exists()) == (1, False)
    assert "contains no markers (c3d)" in err
