"""Files as other versions and options of their programs write them: what is sound is read, and right."""

import json
from itertools import cycle

import h5py
import numpy as np
import pandas as pd
import pytest

from mocap.errors import FormatError
from mocap.io.lines import MISSING_WORDS
from mocap.io.registry import read, write
from mocap.io.together import joined

XYZ = np.array([[[1.5, 2, 3], [4, 5, 6]], [[np.nan] * 3, [7, 8, 9]], [[10, 11, 12], [13, 14, 15]]])
"""(3, 2, 3) positions of two markers, of which the first is not seen in the second frame."""
UV = XYZ[..., :2]


def _rows(values, separator=",", lead=lambda _: (), missing="NaN"):
    rows = [[missing if np.isnan(v) else f"{v:g}" for v in row] for row in values.reshape(len(values), -1)]
    return "".join(separator.join([*lead(i), *row]) + "\n" for i, row in enumerate(rows))


def _read(tmp_path, name, text):
    (tmp_path / name).write_text(text, encoding="utf-8")
    return read(tmp_path / name)


@pytest.mark.parametrize(("word", "separator"), list(zip(sorted(MISSING_WORDS), cycle(",;"))))
def test_words_for_a_missing_number(tmp_path, word, separator):
    """R, pandas, Java, spreadsheets and C's printf each write a missing number in their own way."""
    titles = separator.join(["frame", *(f"{name}_{axis}" for name in "ab" for axis in "xyz")])
    found = _read(tmp_path, "a.csv", f"{titles}\n{_rows(XYZ, separator, lambda i: [str(i)], word)}")
    np.testing.assert_array_equal(found.points.xyz_m, XYZ)
    qualisys = (
        f"NO_OF_FRAMES\t3\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nMARKER_NAMES\ta\tb\n{_rows(XYZ, chr(9), missing=word)}"
    )
    np.testing.assert_allclose(_read(tmp_path, "a.tsv", qualisys).points.xyz_m, XYZ / 1000)


@pytest.mark.parametrize("title", ["{}_{}", "{}_{} ", "{} {}"])
@pytest.mark.parametrize("axes", ["xy", "XY"])
def test_two_coordinates_of_each_marker_are_pixels(tmp_path, title, axes):
    """A table of x and y alone, without a frame, is no table of positions whose z is missing."""
    titles = ",".join(title.format(name, axis) for name in ("nose", "tail") for axis in axes)
    found = _read(tmp_path, "a.csv", f"{titles}\n{_rows(UV)}")
    assert found.names == ("nose", "tail")
    np.testing.assert_array_equal(found.pixels.uv_px[0], UV)


def test_the_separator_that_a_spreadsheet_was_told(tmp_path):
    """``sep=;`` before the titles is for Excel."""
    titles = "frame;a_x;a_y;a_z;b_x;b_y;b_z"
    rows = _rows(XYZ, ";", lambda i: [str(i)]).replace(".", ",")
    np.testing.assert_array_equal(_read(tmp_path, "a.csv", f"sep=;\n{titles}\n{rows}").points.xyz_m, XYZ)


def test_events_of_qualisys(tmp_path):
    """QTM writes a line for each event into the head: they are counted, though their key is the same."""
    head = (
        "NO_OF_FRAMES\t3\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nEVENT\ton\t1\t0\nEVENT\toff\t3\t0.02\nMARKER_NAMES\ta\tb\n"
    )
    titles = "\t".join(["Frame", "Time", *(f"{name} {axis}" for name in "ab" for axis in "XYZ")])
    rows = _rows(XYZ, "\t", lambda i: [str(i + 1), f"{i / 100:g}"], "")
    np.testing.assert_allclose(_read(tmp_path, "a.tsv", f"{head}{titles}\n{rows}").points.xyz_m, XYZ / 1000)


@pytest.mark.parametrize("separator", [",", "\t"])
@pytest.mark.parametrize("more", [[], ["X'", "Y'", "Z'"], ["X'", "Y'", "Z'", "X''", "Y''", "Z''"]])
def test_velocities_of_vicon(tmp_path, separator, more):
    """Nexus separates by commas or tabs, and may write velocities and accelerations after each marker's positions."""
    width = 3 + len(more)
    names = ["", "", *(cell for name in ("s:a", "s:b") for cell in [name, *[""] * (width - 1)])]
    axes, units = ["X", "Y", "Z", *more] * 2, [*["mm"] * 3, *["mm/s"] * 3, *["mm/s^2"] * 3][:width] * 2
    lines = [["Trajectories"], ["100"], names, ["Frame", "Sub Frame", *axes], ["", "", *units]]
    values = np.concatenate([XYZ, np.full((3, 2, len(more)), 99.0)], axis=-1)
    rows = _rows(values, separator, lambda i: [str(i + 1), "0"], "")
    found = _read(tmp_path, "a.csv", "".join(separator.join(line) + "\n" for line in lines) + rows)
    assert (found.names, found.unit, found.fps) == (("s:a", "s:b"), "mm", 100.0)
    np.testing.assert_allclose(found.points.xyz_m, XYZ / 1000)


def _labels(index):
    columns = pd.MultiIndex.from_product([["me"], ["a", "b"], ["x", "y"]], names=["scorer", "bodyparts", "coords"])
    return pd.DataFrame(UV.reshape(3, -1), index, columns)


@pytest.mark.parametrize("key", ["df_with_missing", "keypoints"])
@pytest.mark.parametrize("split", [True, False])
@pytest.mark.parametrize("order", [[0, 1, 2], [1, 0, 2]])
def test_labels_by_hand_have_the_frames_of_their_images(tmp_path, key, split, order):
    """DeepLabCut labels some images of a film: their numbers are in their names, and rows go in their order."""
    images = [("labeled-data", "film", f"img{n}.png") for n in (7, 30, 120)]
    index = pd.MultiIndex.from_tuples(images) if split else ["\\".join(image) for image in images]
    table = _labels(index).iloc[order]
    table.to_csv(tmp_path / "a.csv")
    pytest.importorskip("tables")
    table.to_hdf(tmp_path / "a.h5", key=key, mode="w")
    for found in (read(tmp_path / "a.csv"), read(tmp_path / "a.h5")):
        np.testing.assert_array_equal(found.frames, [7, 30, 120])
        np.testing.assert_array_equal(found.pixels.uv_px[0], UV)


def test_labels_of_several_films_are_counted(tmp_path):
    """Images of two films have no common frame numbers: a finding says so."""
    _labels(["a/img1.png", "a/img2.png", "b/img1.png"]).to_csv(tmp_path / "a.csv")
    found = read(tmp_path / "a.csv")
    np.testing.assert_array_equal(found.frames, [0, 1, 2])
    assert "images of 2 videos" in " ".join(found.findings)


@pytest.mark.parametrize("image", ["{}.jpg", "film_{:06d}.png", "{}"])
def test_people_in_one_list(tmp_path, image):
    """AlphaPose's list, and COCO's results: x, y and a score of each keypoint; people of an image share its name."""
    people = [
        {"image_id": image.format(n), "category_id": 1, "keypoints": [1 + n, 2, 0.9, 3, 4 + n, 0.8], "score": 1}
        for n in (5, 6, 8)
    ]
    far = {"image_id": image.format(6), "category_id": 1, "keypoints": [900, 900, 0.9, 950, 950, 0.9], "score": 1}
    found = _read(tmp_path, "a.json", json.dumps([*people, far]) + "\n")
    np.testing.assert_array_equal(found.frames, [5, 6, 8])
    np.testing.assert_array_equal(found.pixels.uv_px[0], [[[1 + n, 2], [3, 4 + n]] for n in (5, 6, 8)])
    np.testing.assert_allclose(found.score[0], [[0.9, 0.8]] * 3)


def test_frames_without_a_person_are_frames(tmp_path):
    """Where the first frame of one camera shows nobody, its frames still are those of the other."""
    (tmp_path / "poses").mkdir()
    for n in range(4):
        people = [{"pose_keypoints_2d": [n, 1, 0.9, 2, 3, 0.9]}] if n % 2 else []
        (tmp_path / "poses" / f"film_{n:012d}_keypoints.json").write_text(json.dumps({"people": people}))
    found = read(tmp_path / "poses")
    np.testing.assert_array_equal(found.frames, range(4))
    np.testing.assert_array_equal(found.pixels.t_s, range(4))
    np.testing.assert_array_equal(found.pixels.seen[0, :, 1], [False, True, False, True])


def _matlab(path, table):
    """Version 7.3 as MATLAB lays it out: HDF5 after 512 bytes, columns as rows, cells by reference, UTF-16 text."""
    with h5py.File(path, "w", userblock_size=512) as file:
        pool = file.create_group("#refs#")

        def put(group, name, value):
            if isinstance(value, dict):
                kind, item = "struct", group.create_group(name)
                for key, inner in value.items():
                    put(item, key, inner)
            elif isinstance(value, list) and value and isinstance(value[0], dict):  # a struct array: no class of fields
                kind, item = "struct", group.create_group(name)
                for key in value[0]:
                    item[key] = refer([one[key] for one in value])
            elif isinstance(value, list):
                kind, item = "cell", group.create_dataset(name, data=refer(value))
            elif isinstance(value, str):
                kind, item = "char", group.create_dataset(name, data=np.array([list(value.encode("utf-16-le")[::2])]).T)
            else:
                kind, item = "double", group.create_dataset(name, data=np.atleast_2d(value).astype(float).T)
            item.attrs["MATLAB_class"] = np.bytes_(kind)

        def refer(values):
            for value in values:
                put(pool, str(len(pool)), value)
            names = [str(len(pool) - len(values) + i) for i in range(len(values))]
            return np.array([pool[name].ref for name in names], dtype=h5py.ref_dtype).reshape(-1, 1)

        for name, value in table.items():
            put(file, name, value)
    head = b"MATLAB 7.3 MAT-file, Platform: PCWIN64, Created on: Mon Jan  1 00:00:00 2024 HDF5 schema 1.00 ."
    path.write_bytes(head.ljust(124) + b"\0\2IM" + path.read_bytes()[128:])


def test_matlab_files_of_version_7_3(tmp_path):
    """Matrices, cells of texts, structs and struct arrays are those of files of version 5."""
    data = np.transpose(np.concatenate([XYZ, np.ones((3, 2, 1))], axis=-1), (1, 2, 0))
    labelled = {"Labels": ["a", "long name"], "Data": data, "Count": 2}
    qtm = {"Frames": 3, "FrameRate": 200, "StartFrame": 4, "Trajectories": {"Labeled": labelled}}
    tables = {
        "qualisys-mat": {"trial": qtm},
        "dannce": {"pred": np.swapaxes(XYZ, 1, 2), "sampleID": [[4, 5, 6]]},
        "label3d": {"labelData": [{"data_3d": XYZ.reshape(3, -1), "data_frame": np.array([[4, 5, 6]])}] * 2},
    }
    for name, table in tables.items():
        if name == "dannce":
            table["sampleID"] = np.array(table["sampleID"])
        _matlab(tmp_path / f"{name}.mat", table)
        found = read(tmp_path / f"{name}.mat")
        assert found.format == name
        np.testing.assert_allclose(found.points.xyz_m, XYZ / (1000 if name == "qualisys-mat" else 1))
        np.testing.assert_array_equal(found.frames, [4, 5, 6])
        if name == "qualisys-mat":
            assert (found.names, found.fps) == (("a", "long name"), 200.0)


@pytest.mark.parametrize("name", ["a.dlc.csv", "a.analysis.h5"])
def test_rows_from_the_lower_left_are_turned_or_refused(tmp_path, name):
    """DeepLabCut and SLEAP count from the upper left: rows of Argus are turned where heights are known."""
    argus = _read(tmp_path, "a-xypts.csv", "a_cam_1_x,a_cam_1_y,b_cam_1_x,b_cam_1_y\n" + _rows(UV))
    with pytest.raises(FormatError, match=r"from the upper left, a-xypts\.csv from the lower left: convert it with"):
        write(argus, tmp_path / name)
    profile = _read(tmp_path, "profile.txt", "1 900 640 480 320 240 1 0 0 0 0 0\n")
    told = write(joined([argus, profile]), tmp_path / name)
    assert "counted from the lower left, are written as counted from the upper left" in " ".join(told)
    np.testing.assert_allclose(read(tmp_path / name).pixels.uv_px[0], UV * [1, -1] + [0, 480])


def test_rows_from_an_unknown_corner_are_told(tmp_path):
    """A file that counts from the upper left says nothing of rows that may count from below."""
    told = write(_read(tmp_path, "a_xypts.csv", "pt1_cam1_X,pt1_cam1_Y\n1,2\n"), tmp_path / "a.dlc.csv")
    assert told == ["pixel rows are written as they are, and will be read as counted from the upper left"]


@pytest.mark.parametrize("key", ["df_with_missing", "tracks", "keypoints", "anything"])
@pytest.mark.parametrize("layout", ["fixed", "table"])
def test_tables_of_several_kinds_of_numbers(tmp_path, key, layout):
    """Single and double precision and whole numbers in one table of pandas, under whatever key."""
    pytest.importorskip("tables")
    levels = {"scorer": ["me"], "bodyparts": ["b", "a"], "coords": ["x", "y", "likelihood"]}
    columns = pd.MultiIndex.from_product(levels.values(), names=list(levels))
    values = np.concatenate([UV, np.full((3, 2, 1), 1.0)], axis=-1)
    table = pd.DataFrame(values.reshape(3, -1), columns=columns)
    kinds = {"x": "float32", "y": "float64", "likelihood": "int64"}
    table = table.astype({column: kinds[column[2]] for column in columns})
    table.to_hdf(tmp_path / "a.h5", key=key, mode="w", format=layout)
    found = read(tmp_path / "a.h5")
    assert (found.format, found.names) == ("deeplabcut-h5", ("b", "a"))
    np.testing.assert_array_equal(found.pixels.uv_px[0], UV)
    np.testing.assert_array_equal(found.score[0], 1.0)
    table.to_hdf(tmp_path / "a.h5", key="other", format=layout)
    if key == "df_with_missing":
        np.testing.assert_array_equal(read(tmp_path / "a.h5").pixels.uv_px[0], UV)
    else:
        with pytest.raises(FormatError, match=f"has the tables .*{key}.*expected one, or df_with_missing"):
            read(tmp_path / "a.h5")
    table[("me", "a", "x")] = "word"
    table[[("me", "a", "x")]].to_hdf(tmp_path / "w.h5", key=key, mode="w", format=layout)
    with pytest.raises(FormatError, match="expected numbers only"):
        read(tmp_path / "w.h5")
