"""Formats of other programs, where it can be as their own libraries write them."""

import json
import sys

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from mocap.errors import FormatError
from mocap.io.registry import read, write

T, PARTS = 7, ("nose", "tail base")
RNG = np.random.default_rng(3)
XYZ = RNG.normal(size=(T, 2, 3)).round(6)
UV = RNG.uniform(0, 640, (T, 2, 2)).round(4)


def deeplabcut(axes, values):
    """DeepLabCut's own table: pandas columns scorer, bodyparts, coords."""
    columns = pd.MultiIndex.from_product([["DLC_3D"], PARTS, list(axes)], names=["scorer", "bodyparts", "coords"])
    return pd.DataFrame(values.reshape(T, -1), columns=columns)


@pytest.mark.parametrize("how", ["csv", "table", "fixed"])
def test_three_dimensions_of_deeplabcut(tmp_path, how):
    """x, y, z of each body part, as pandas writes DeepLabCut's table in CSV and both layouts of HDF5."""
    xyz = XYZ.copy()
    xyz[2, 1] = np.nan
    table = deeplabcut("xyz", xyz)
    path = tmp_path / ("a.csv" if how == "csv" else "a.h5")
    if how == "csv":
        table.to_csv(path)
    else:
        pytest.importorskip("tables")
        table.to_hdf(path, key="df_with_missing", format=how)
    got = read(path)
    assert got.names == PARTS
    assert got.unit is None
    np.testing.assert_array_equal(got.points.xyz_m, xyz)
    np.testing.assert_array_equal(got.frames, np.arange(T))


def test_a_part_without_z_is_refused(tmp_path):
    """Three dimensions of some and two of others are no table of DeepLabCut."""
    table = deeplabcut("xyz", XYZ).drop(columns=("DLC_3D", "nose", "z"))
    table.to_csv(tmp_path / "a.csv")
    with pytest.raises(FormatError, match="nose has no x and y and z"):
        read(tmp_path / "a.csv")


def sleap_labels(tracks=2):
    """Labels as SLEAP makes them: predictions in frames 3 to 9 of one video, one of them corrected by hand."""
    sleap_io = pytest.importorskip("sleap_io")
    skeleton = sleap_io.Skeleton(nodes=list(PARTS))
    video = sleap_io.Video(filename="films/left.mp4", open_backend=False)
    named = [sleap_io.Track(name=f"m{a}") for a in range(tracks)]
    frames = []
    for t in range(T):
        own = [
            sleap_io.PredictedInstance.from_numpy(
                UV[t] + 1000 * a, skeleton, point_scores=np.array([0.5, 0.25]), track=named[a]
            )
            for a in range(tracks)
            if (t, a) != (4, 1)
        ]
        if t == 2:
            own.append(sleap_io.Instance.from_numpy(UV[t] + 7, skeleton, track=named[0], from_predicted=own[0]))
        frames.append(sleap_io.LabeledFrame(video=video, frame_idx=3 + t, instances=own))
    return sleap_io.Labels(frames, videos=[video], skeletons=[skeleton], tracks=named)


def test_labels_of_sleap(tmp_path):
    """Written by sleap-io: frames, tracks, scores, and a correction in place of what it corrects."""
    labels = sleap_labels()
    labels.save(str(tmp_path / "a.slp"), verbose=False)
    got = read(tmp_path / "a.slp")
    assert got.names == ("m0_nose", "m0_tail base", "m1_nose", "m1_tail base")
    assert got.camera_names == ("left",)
    np.testing.assert_array_equal(got.frames, np.arange(3, 3 + T))
    expected = np.concatenate([UV, UV + 1000], axis=1)
    expected[2, :2], expected[4, 2:] = UV[2] + 7, np.nan
    np.testing.assert_allclose(got.pixels.uv_px[0], expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(got.score[0, 0], [0.5, 0.25, 0.5, 0.25])
    assert np.isnan(got.score[0, 2, :2]).all()


def test_sleap_without_its_library(tmp_path, monkeypatch):
    """A person is told which extra to install."""
    sleap_labels().save(str(tmp_path / "a.slp"), verbose=False)
    monkeypatch.setitem(sys.modules, "sleap_io", None)
    with pytest.raises(FormatError, match=r"a\.slp.* needs sleap_io.*pip install .*\[sleap\]"):
        read(tmp_path / "a.slp")


def test_keypoints_of_coco(tmp_path):
    """Frames by the numbers of images in whatever order, animals by track, invisible keypoints are not seen."""
    images = [{"id": 40 - t, "file_name": f"left/img{t + 5:04d}.png"} for t in range(T)]
    kinds = [{"id": 1, "name": "mouse", "keypoints": list(PARTS)}]
    marks = [
        {
            "id": 2 * t + a,
            "image_id": 40 - t,
            "category_id": 1,
            "track_id": a,
            "keypoints": np.column_stack([UV[t] + 1000 * a, [2, 0 if t == 1 else 1]]).ravel().tolist(),
        }
        for t in range(T)
        for a in (1, 0)
    ]
    (tmp_path / "a.json").write_text(json.dumps({"images": images[::-1], "categories": kinds, "annotations": marks}))
    got = read(tmp_path / "a.json")
    assert got.names == ("mouse0_nose", "mouse0_tail base", "mouse1_nose", "mouse1_tail base")
    np.testing.assert_array_equal(got.frames, np.arange(5, 5 + T))
    expected = np.concatenate([UV, UV + 1000], axis=1)
    expected[1, 1::2] = np.nan
    np.testing.assert_array_equal(got.pixels.uv_px[0], expected)
    marks[3]["keypoints"] = [1, 2, 3]
    (tmp_path / "a.json").write_text(json.dumps({"images": images, "categories": kinds, "annotations": marks}))
    with pytest.raises(FormatError, match=r"^a\.json: annotation 2 has no image, or not x, y and visibility"):
        read(tmp_path / "a.json")


def test_coco_as_sleap_io_writes_it(tmp_path):
    """The same instances as in the labels that were saved."""
    sleap_io = pytest.importorskip("sleap_io")
    labels = sleap_labels(tracks=1)
    labels.labeled_frames[2].instances.pop()
    try:
        sleap_io.save_coco(labels, str(tmp_path / "a.json"))
    except Exception as error:  # it may want the images of the film
        pytest.skip(f"sleap-io cannot write it without the video: {error}")
    got = read(tmp_path / "a.json")
    np.testing.assert_allclose(got.pixels.uv_px[0], UV, atol=1e-6)


@pytest.mark.parametrize("animals", [1, 2])
def test_predictions_of_dannce(tmp_path, animals):
    """``save_data_AVG.mat``: frames x (animals x) 3 x points, and the sample numbers."""
    xyz = RNG.normal(size=(T, animals, 3, 5))
    pred = xyz[:, 0] if animals == 1 else xyz
    score = np.full((T, 5) if animals == 1 else (T, animals, 5), 0.25)
    savemat(tmp_path / "a.mat", {"pred": pred, "data": np.zeros(3), "p_max": score, "sampleID": 11 + 3 * np.arange(T)})
    got = read(tmp_path / "a.mat")
    np.testing.assert_array_equal(got.points.xyz_m, np.swapaxes(xyz, 2, 3).reshape(T, -1, 3))
    np.testing.assert_array_equal(got.frames, 11 + 3 * np.arange(T))
    assert got.score.shape == (T, 5 * animals)
    assert got.names[0] == ("point1" if animals == 1 else "animal1_point1")


def test_labels_of_label3d(tmp_path):
    """DANNCE's label file, a struct for each camera, and Label3D's own session with the names of its skeleton."""
    cameras = np.empty((2, 1), dtype=object)
    for c in range(2):
        own = {"data_2d": UV.reshape(T, -1), "data_3d": XYZ.reshape(T, -1), "data_frame": 5 * np.arange(T)[:, None] + 1}
        cameras[c, 0] = own
    savemat(tmp_path / "a.mat", {"labelData": cameras, "camnames": np.array(["l", "r"], dtype=object)})
    got = read(tmp_path / "a.mat")
    assert got.format == "label3d"
    np.testing.assert_array_equal(got.points.xyz_m, XYZ)
    np.testing.assert_array_equal(got.frames, 5 * np.arange(T) + 1)
    skeleton = {"joint_names": np.array(PARTS, dtype=object), "joints_idx": np.array([[1, 2]])}
    savemat(tmp_path / "b.mat", {"data_3D": XYZ.reshape(T, -1), "skeleton": skeleton, "status": np.zeros((2, 2, T))})
    got = read(tmp_path / "b.mat")
    assert got.names == PARTS
    np.testing.assert_array_equal(got.points.xyz_m, XYZ)


def test_tables_of_caliscope(tmp_path):
    """A row for each point that a camera saw: what no row tells was not seen; the rate is that of the mean times."""
    rows = [
        (10 + t, port, t, 100 + t / 50 + 0.001 * port, p, *(UV[t, m] + 1000 * port), 0, 0, 0)
        for t in range(T)
        for port in (1, 3)
        for m, p in enumerate((4, 9))
        if (t, port, m) != (3, 3, 1)
    ]
    titles = "sync_index,port,frame_index,frame_time,point_id,img_loc_x,img_loc_y,obj_loc_x,obj_loc_y,obj_loc_z"
    pd.DataFrame(rows, columns=titles.split(",")).to_csv(tmp_path / "xy.csv", index=False)
    got = read(tmp_path / "xy.csv")
    assert (got.names, got.camera_names, got.fps) == (("point_4", "point_9"), ("port_1", "port_3"), 50)
    expected = np.stack([UV + 1000, UV + 3000])
    expected[1, 3, 1] = np.nan
    np.testing.assert_allclose(got.pixels.uv_px, expected, rtol=1e-15)
    np.testing.assert_array_equal(got.frames, 10 + np.arange(T))
    rows = [(t, p, *XYZ[t, m]) for t in range(T) for m, p in enumerate((4, 9))]
    pd.DataFrame(rows, columns=["sync_index", "point_id", "x_coord", "y_coord", "z_coord"]).to_csv(
        tmp_path / "xyz.csv", index=False
    )
    np.testing.assert_array_equal(read(tmp_path / "xyz.csv").points.xyz_m, XYZ)


def test_trajectories_of_kinovea(tmp_path):
    """Every cell in quotes; times are milliseconds, or count frames; an empty pair was not seen."""
    head = '"Time","left hand/0/X","left hand/0/Y","ball/0/X","ball/0/Y"\n'
    for step, fps in ((40.0, 25), (1, None)):
        rows = [
            f'"{step * t:g}",'
            + ",".join(f'"{v:.4f}"' if not (t == 3 and k > 1) else "" for k, v in enumerate(UV[t].ravel()))
            for t in range(T)
        ]
        (tmp_path / "a.csv").write_text(head + "\n".join(rows) + "\n", encoding="utf-8")
        got = read(tmp_path / "a.csv")
        assert (got.format, got.names, got.fps) == ("kinovea", ("left hand", "ball"), fps)
        expected = UV.copy()
        expected[3, 1] = np.nan
        np.testing.assert_array_equal(got.pixels.uv_px[0], expected)


def storage(values, names, more="inDegrees=yes\n", separator="\t"):
    rows = "".join(
        separator.join([f"{0.5 + t / 200:.4f}", *(f"{v:.6f}" for v in row)]) + "\n" for t, row in enumerate(values)
    )
    head = f"Coordinates\nversion=1\nnRows={len(values)}\nnColumns={len(names) + 1}\n{more}endheader\n"
    return head + separator.join(["time", *names]) + "\n" + rows


@pytest.mark.parametrize("end", ["mot", "sto"])
def test_quantities_of_opensim(tmp_path, end):
    """Joint angles are what they are: a table of quantities at their times, never positions."""
    angles = RNG.normal(size=(T, 3)).round(6)
    (tmp_path / f"a.{end}").write_text(storage(angles, ["knee_angle_r", "hip", "speed"]), encoding="utf-8")
    got = read(tmp_path / f"a.{end}")
    assert got.points is None
    assert got.fps == 200
    np.testing.assert_array_equal(got.tables["quantities"], angles)
    assert "angles are in degrees" in got.findings
    write(got, tmp_path / "o.csv")
    table = pd.read_csv(tmp_path / "o.csv")
    np.testing.assert_allclose(table["t_s"], 0.5 + np.arange(T) / 200)
    np.testing.assert_array_equal(table[["knee_angle_r", "hip", "speed"]], angles)
    with pytest.raises(FormatError, match="cannot store"):
        write(got, tmp_path / "o.c3d")


def test_markers_in_opensims_vectors(tmp_path):
    """A table of Vec3 holds positions, each cell three numbers with commas between."""
    text = storage(np.zeros((T, 0)), list(PARTS), "DataType=Vec3\nUnits=mm\n")
    body = text[: text.index("time\t")] + "time\t" + "\t".join(PARTS) + "\n"
    body += "".join(f"{t / 100}\t" + "\t".join(",".join(map(str, point)) for point in XYZ[t]) + "\n" for t in range(T))
    (tmp_path / "a.sto").write_text(body, encoding="utf-8")
    got = read(tmp_path / "a.sto")
    assert (got.names, got.fps) == (PARTS, 100)
    np.testing.assert_allclose(got.points.xyz_m, XYZ * 1e-3, rtol=1e-15)


def test_structures_of_the_mocap_toolbox(tmp_path):
    """Positions with their names and rate, in no unit; derivatives and a second structure are refused."""
    own = {"type": "MoCap data", "nFrames": T, "nMarkers": 2, "freq": 120.0, "timederOrder": 0, "anaFreq": 0}
    own |= {"markerName": np.array(PARTS, dtype=object)[:, None], "data": XYZ.reshape(T, -1), "other": {"descr": "x"}}
    savemat(tmp_path / "a.mat", {"d": own, "n": 3})
    got = read(tmp_path / "a.mat")
    assert (got.format, got.names, got.fps, got.unit) == ("mocaptoolbox", PARTS, 120, None)
    np.testing.assert_array_equal(got.points.xyz_m, XYZ)
    for wrong, said in (
        ({"d": own | {"timederOrder": 1}}, "order 1 of derivatives"),
        ({"d": own | {"type": "norm data"}}, "'norm data'"),
        ({"d": own | {"nMarkers": 3}}, "nMarkers is 3, for 2 names"),
        ({"d": own, "e": own}, "structures d, e; expected one"),
    ):
        savemat(tmp_path / "a.mat", wrong)
        with pytest.raises(FormatError, match=said):
            read(tmp_path / "a.mat")


def test_cameras_that_caliscope_ignores(tmp_path):
    """A camera that was left out of the calibration has no place; one that only lacks it is named."""
    lens = "size = [640, 480]\nmatrix = [[900.0, 0, 320], [0, 900.0, 240], [0, 0, 1]]\ndistortions = [0, 0, 0, 0, 0]\n"
    place = "translation = [{}, 0.0, 0.0]\nrotation = [0.0, 0.0, 0.0]\n"
    text = f"[cameras.0]\n{lens}{place.format(0)}[cameras.1]\n{lens}ignore = true\n[cameras.2]\n{lens}{place.format(1)}"
    (tmp_path / "camera_array.toml").write_text(text)
    assert read(tmp_path / "camera_array.toml").camera_names == ("cam_0", "cam_2")
    (tmp_path / "camera_array.toml").write_text(text.replace("true", "false"))
    with pytest.raises(FormatError, match="cam_1 states a lens, but not where the camera is"):
        read(tmp_path / "camera_array.toml")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("kind", ["", "<!DOCTYPE Cameras>\n"])
def test_vicon_cameras_in_any_encoding(tmp_path, encoding, kind):
    """What the first line says of the encoding need not be so; a document may name its kind, but define nothing."""
    frame = 'FOCAL_LENGTH="2000" ORIENTATION="0 0 0 1" POSITION="100 0 500" PRINCIPAL_POINT="960 540"'
    text = (
        f'<?xml version="1.0" encoding="UTF-16" ?>\n{kind}<Cameras><Camera DEVICEID="21" SENSOR_SIZE="1920 1080" '
        f'TYPE="Video"><KeyFrames><KeyFrame {frame}/></KeyFrames></Camera></Cameras>\n'
    )
    (tmp_path / "a.xcp").write_bytes(text.encode(encoding))
    (camera,) = read(tmp_path / "a.xcp").cameras
    assert (camera.name, camera.size_px) == ("21", (1920, 1080))
    (tmp_path / "a.xcp").write_bytes(text.replace(kind, '<!DOCTYPE a [<!ENTITY b "c">]>\n', 1).encode(encoding))
    if kind:
        with pytest.raises(FormatError, match="defines entities"):
            read(tmp_path / "a.xcp")
