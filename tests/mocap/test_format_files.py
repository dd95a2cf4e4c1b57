"""Every format on real files of other people, and on small ones as their programs write them, against other readers."""

import json
import pickle
import sys

import h5py
import numpy as np
import pandas as pd
import pytest

from app.cli import main
from mocap.cameras import project, stacked, undistorted
from mocap.errors import FormatError
from mocap.formats.easywand import read_easywand, read_tform
from mocap.formats.format import Hints
from mocap.formats.plain import parse_columns
from mocap.formats.profile import read_sba_profile
from mocap.formats.registry import FORMATS, identify, read
from mocap.formats.together import joined
from mocap.records import Origin
from tests.real_data import real

REAL = {
    "bat_windtunnel_dltdv8/078A3/F5/carollia_2April2021_078A3m_trial5_dvProject.mat": ("dltdv-project", 15, 4, 973),
    "bat_windtunnel_dltdv8/derived_csv/078A3_F5/078A3_F5_xypts.csv": ("dltdv-xypts", 15, 4, 973),
    "bat_windtunnel_dltdv8/derived_csv/078A3_F5/078A3_F5_xyzres.csv": ("dltdv-xyzres", 15, 0, 973),
    "bat_windtunnel_dltdv8/derived_csv/078A3_F5/078A3_F5_offsets.csv": ("dltdv-offsets", 0, 4, 973),
    "bat_windtunnel_dltdv8/derived_csv/078A3_F5/078A3_F5_dltCoefs.csv": ("dltdv-coefficients", 0, 4, 0),
    "bat_windtunnel_dltdv8/derived_csv/FE404_F2/FE404_F2_camera_profile.txt": ("camera-profile", 0, 4, 0),
    "bat_windtunnel_dltdv8/windtunnelCalibration2/extrinsicCalib_20230228_easyWandData.mat": ("easywand", 2, 4, 100),
    "bat_windtunnel_dltdv8/windtunnelCalibration2/extrinsicCalib_20230228_cam1Tforms.mat": ("easywand-tforms", 0, 1, 0),
    "bat_cave_dltdv7/P000_15000_bats/DLTdv7_data_20180817-P000-15000xyzCI.csv": ("dltdv-xyzci", 15, 0, 376),
    "bat_cave_dltdv7/P000_15000_bats/DLTdv7_data_20180817-P000-15000xyzpts.csv": ("dltdv-xyzpts", 15, 0, 376),
    "mudskipper_dltdv8_2d/sparse_tsv/Cropped_Loc2_0852_0857_01xypts.tsv": ("dltdv-sparse", 2, 1, 1900),
    "xmalab_pig/3dpts.csv": ("xmalab-3d", 10, 0, 435),
    "xmalab_pig/rbt.csv": ("xmalab-rigid-bodies", 2, 0, 435),
    "xmalab_pig/trainingdata/20061229_pig_trial01/trial01_2dpts.csv": ("xmalab-2d", 10, 2, 25),
    "mouse_charuco_4cam/calibration.toml": ("anipose-calibration", 0, 4, 0),
    "mouse_charuco_4cam/points3d.h5": ("sleap-anipose-3d", 15, 0, 120),
    "mouse_charuco_4cam/top/minimal_top_proofread.analysis.h5": ("sleap-analysis", 15, 1, 120),
    "charuco_4cam_caliscope/post_optimization/camera_array.toml": ("anipose-calibration", 0, 4, 0),
    "snake_glide_qualisys/205_81.tsv": ("qualisys-tsv", 15, 0, 266),
    "mouse_mocap_qtm/MOS1aD_S15_M5_MC2_T2_TRM_15MMIN_B.mat": ("qualisys-mat", 11, 0, 10500),
    "snake_gap_vicon/053_Snake89_gap02_1.csv": ("vicon-csv", 14, 0, 672),
    "c3d_samples/sample_01/Eb015pi.c3d": ("c3d", 26, 0, 450),
    "c3d_samples/pyomeca/markers.trc": ("trc", 51, 0, 93),
}
"""Format, points, cameras and frames as PROVENANCE.md and the files' own heads count them."""


@pytest.fixture
def info(capsys, monkeypatch):
    """``mocap info ... --json``: exit code and what it printed."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["mocap", "info", *map(str, arguments), "--json"])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, json.loads(capsys.readouterr().out)

    return run


@pytest.mark.parametrize("file", REAL)
def test_real_files_are_known_by_content(file, tmp_path):
    """Under any name, a file is what it is; only XMALab's and DLTdv's twins are told apart by their names."""
    path = real(*file.split("/"))
    if "xyzpts" not in file:
        path = tmp_path / "renamed.dat"
        path.write_bytes(real(*file.split("/")).read_bytes())
    recording = read(path)
    found = (recording.format, len(recording.names), len(recording.camera_names), len(recording.frames))
    assert found == REAL[file]


def test_info_prints_what_was_asked_for(info):
    """One object a file with the eight keys; numbers of a real file as its authors count them."""
    code, found = info(real("snake_gap_vicon", "053_Snake89_gap02_1.csv"))
    assert code == 0
    assert list(found)[:8] == ["format", "points", "cameras", "frames", "fps", "units", "missing", "findings"]
    assert (found["fps"], found["units"], found["first_frame"]) == (150.0, "mm", 767)
    # PROVENANCE.md: of the 10 markers on the snake 0.3 % are missing, in 3 gaps, the longest of 7 frames
    text = real("snake_gap_vicon", "053_Snake89_gap02_1.csv").read_text().splitlines()[5:]
    cells = np.array([(line.split(",") + [""] * 44)[2:44] for line in text if line.strip(",")])
    assert found["missing"] == pytest.approx((cells.reshape(len(cells), 14, 3) == "").any(axis=2).mean(), abs=1e-6)


def test_wrong_files_are_told_so(info, tmp_path):
    """No traceback: what the file is, what was looked for, exit code 1; the good file beside it is still described."""
    (tmp_path / "a.csv").write_text("pt1_cam1_X,pt1_cam1_Y\n1,2\n3,4\n")
    cases = {"photo.jpg": b"\xff\xd8\xff\xe0" + bytes(100), "empty.csv": b"", "notes.txt": b"Dear diary,\nno bats.\n"}
    for name, content in cases.items():
        (tmp_path / name).write_bytes(content)
        code, found = info(tmp_path / name, tmp_path / "a.csv")
        assert code == 1
        assert found[0]["format"] is None
        assert found[0]["error"].startswith(name)
        assert found[1]["format"] == "dltdv-xypts"
    assert "Looked for: project of DLTdv8" in found[0]["error"]
    assert info(tmp_path / "nowhere.csv")[1]["findings"][0].endswith("No such file or directory")
    assert info(tmp_path)[1]["error"].endswith("is a folder; expected a file")


def test_files_that_belong_together_are_compared(info):
    """Pixels with the coefficients of their cameras; those of another rig are called out."""
    folder = real("bat_windtunnel_dltdv8", "derived_csv")
    pixels = folder / "078A3_F5" / "078A3_F5_xypts.csv"
    code, found = info(pixels, folder / "078A3_F5" / "078A3_F5_dltCoefs.csv")
    assert code == 0
    assert "4 cameras, calibrated, 973 frames" in " ".join(found[0]["findings"])
    other = real("bat_cave_dltdv7", "P03_1000_speaker", "2018-08-17_wand_dltCoefs_round4.csv")
    _, found = info(pixels, other)
    assert "3 cameras calibrated, 4 in the pixels" in " ".join(found[0]["findings"])


@pytest.mark.parametrize(
    "parts",
    [
        ("bat_windtunnel_dltdv8", "windtunnelCalibration2", "extrinsicCalib_20230228"),
        ("bat_cave_dltdv7", "2018-07-28_wand_and_detections", "video_calibration_data", "round3_2018-07-28"),
    ],
)
def test_easywand_undistorts_as_it_stored(parts):
    """Undistorting the recorded wand, by DLTdv's three iterations, gives each pixel that easyWand stored, to 0.02 px.

    The stored ones are fewer (outliers were taken out) and in one set on other rows: each must be some recorded pixel.
    """
    folder, stem = real(*parts[:-1]), parts[-1]
    wand = read_easywand(folder / f"{stem}_easyWandData.mat")
    for ideal, stored in zip(undistorted(wand.cameras, wand.wand_px, iterations=3), wand.wand_ideal_px, strict=True):
        stored, ideal = (px.reshape(-1, 2)[np.isfinite(px[..., 0]).ravel()] for px in (stored, ideal))
        assert len(stored) > 50
        off = np.abs(stored[:, None] - ideal).max(axis=-1)
        assert off.min(axis=1).max() < 0.02
    lens, iterations = read_tform(folder / f"{stem}_cam1Tforms.mat")
    assert iterations == 3
    np.testing.assert_allclose(lens.centre_px, wand.lenses[0].centre_px, atol=1e-6)
    np.testing.assert_allclose(lens.coefficients, wand.lenses[0].coefficients, atol=1e-12)


def test_rigid_bodies_carry_their_markers():
    """In its bone's frame a marker stands still; the other way of reading the matrix would let it wander.

    Both files were filtered by themselves, and markers err by some 0.1 mm: still is 0.05 cm (RMS), wandering more.
    """
    markers, bodies = read(real("xmalab_pig", "3dpts.csv")), read(real("xmalab_pig", "rbt.csv"))
    transforms = bodies.tables["transforms"]
    jaw = [i for i, name in enumerate(markers.names) if name.lower().startswith("lower")]
    skull = [i for i in range(len(markers.names)) if i not in jaw]
    for body, own in ((bodies.names.index("Jaw"), jaw), (bodies.names.index("Skull"), skull)):
        rotation, shift = transforms[:, body, :3, :3], transforms[:, body, :3, 3]
        xyz = markers.points.xyz_m[:, own] - shift[:, None]
        local = np.einsum("tji,tmj->tmi", rotation, xyz)
        wrong = np.einsum("tij,tmj->tmi", rotation, xyz)
        assert local.std(axis=0).max() < 0.05
        assert wrong.std(axis=0).max() > 0.1


def test_sleap_views_meet_in_the_calibrated_cameras():
    """Four files of one camera and a calibration become one recording, cameras by name, not by the order of files.

    PROVENANCE.md: the shipped points reproject to 5 to 10 px in back, mid and top, and to 92 px in side, whose
    calibration is a copy of another's.
    """
    folder = real("mouse_charuco_4cam")
    views = [read(folder / name / f"minimal_{name}_proofread.analysis.h5") for name in ("top", "side", "back", "mid")]
    whole = joined([*views, read(folder / "calibration.toml")])
    assert whole.camera_names == ("back", "mid", "side", "top")
    shipped = read(folder / "points3d.h5").points.xyz_m
    off = undistorted(whole.cameras, whole.pixels.uv_px) - project(stacked(whole.cameras), shipped)
    median = np.nanmedian(np.linalg.norm(off, axis=-1), axis=(1, 2))
    assert (median[[0, 1, 3]] < 12).all()
    assert median[2] > 60
    with pytest.raises(FormatError, match="both hold a calibration"):
        joined([whole, read(folder / "calibration.toml")])


def test_deeplabcut_csv_is_what_pandas_reads():
    """The columns of a real prediction, by names."""
    folder = real("bat_windtunnel_dltdv8", "078A3", "F5_markerless")
    path = next(folder.glob("*Bane*.csv"))
    table = pd.read_csv(path, header=[0, 1, 2], index_col=0)
    recording = read(path)
    scorer = table.columns[0][0]
    for m, name in enumerate(recording.names):
        np.testing.assert_allclose(recording.pixels.uv_px[0, :, m, 0], table[(scorer, name, "x")])
        np.testing.assert_allclose(recording.score[0, :, m], table[(scorer, name, "likelihood")])
    np.testing.assert_array_equal(recording.frames, table.index)


def _pandas_hdf(path, columns, values, *, fixed):
    """A frame as pandas 2 and PyTables 3 lay it out (read off files that they wrote)."""
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        if not fixed:
            kind = [("index", "<i8"), ("values_block_0", "<f8", (len(columns),))]
            rows = np.zeros(len(values), dtype=kind)
            rows["index"], rows["values_block_0"] = np.arange(len(values)), values
            group.create_dataset("table", data=rows).attrs["values_block_0_kind"] = np.bytes_(pickle.dumps(columns, 0))
            return
        group.attrs["axis0_nlevels"] = len(columns[0])
        group.attrs["nblocks"] = 1
        for level, words in enumerate(zip(*columns, strict=True)):
            unique = sorted(set(words))
            for what in ("axis0", "block0_items"):
                group[f"{what}_level{level}"] = np.array(unique, dtype="S")
                group[f"{what}_label{level}"] = np.array([unique.index(w) for w in words], dtype=np.int8)
        group["axis1"], group["block0_values"] = np.arange(len(values)), values


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("individuals", [None, ("bat1", "bat2")])
def test_deeplabcut_hdf5(tmp_path, fixed, individuals):
    """Both layouts of pandas, with one animal and with two."""
    who = [()] if individuals is None else [(name,) for name in individuals]
    columns = [("DLC", *i, p, c) for i in who for p in ("nose", "tail") for c in ("x", "y", "likelihood")]
    values = np.arange(4.0 * len(columns)).reshape(4, -1) / 100
    values[2, :2] = np.nan
    _pandas_hdf(tmp_path / "a.h5", columns, values, fixed=fixed)
    recording = read(tmp_path / "a.h5")
    assert recording.format == "deeplabcut-h5"
    assert recording.names == (("nose", "tail") if individuals is None else
                               ("bat1_nose", "bat1_tail", "bat2_nose", "bat2_tail"))  # fmt: skip
    assert recording.pixel_origin == "upper-left"
    np.testing.assert_array_equal(recording.pixels.uv_px[0, :, :, 0], values[:, ::3])
    np.testing.assert_array_equal(recording.score[0], values[:, 2::3])
    assert not recording.pixels.seen[0, 2, 0]


QTM = "NO_OF_FRAMES\t2\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nMARKER_NAMES\ta\tb\nTRAJECTORY_TYPES\tMeasured\tMixed\n"
SMALL = {
    "DLTdv 8.4": ("x.csv", "tip_cam1_U,tip_cam1_V\n1,2\n3,4\n", "dltdv-xypts", 1, 1, 2),
    "DLTdv filtered": ("x.csv", "pt1filt_X,pt1filt_Y,pt1filt_Z\n1,2,3\n", "dltdv-xyzpts", 1, 0, 1),
    "Argus": ("x.csv", "a_cam_1_x,a_cam_1_y,a_cam_10_x,a_cam_10_y\n1,2,3,4\n", "argus-xypts", 1, 2, 1),
    "Argus 3D": ("x.csv", "a_x,a_y,a_z\n1,2,3\n", "argus-xyzpts", 1, 0, 1),
    "Argus offsets": ("x.csv", "camera_1,camera_2\n0,3\n", "argus-offsets", 0, 2, 1),
    "Argus intervals": (
        "x.csv",
        "a_x_lower,a_x_upper,a_y_lower,a_y_upper,a_z_lower,a_z_upper\n0,1,0,2,0,3\n",
        "argus-xyz-cis",
        1,
        0,
        1,
    ),
    "Argus residuals": ("b-xyzres.csv", "a,b\n1,2\n", "argus-xyzres", 2, 0, 1),
    "Argus sparse": ("b-xypts.tsv", "Row\tColumn\tEntry\n9\t4\t2\n2\t1\t5.5\n2\t2\t6.5\n", "argus-sparse", 2, 1, 9),
    "Argus cameras": ("x.txt", "900 320 240 1 0 0 0 0 0 0 1 0 0 0 0 0 5\n" * 2, "argus-sba-profile", 0, 2, 0),
    "sparse points": (
        "b-xyzpts.tsv",
        "Sparse format 3D coordinates file\n9\t6\t1\n2\t1\t5.5\n",
        "dltdv-sparse",
        2,
        0,
        9,
    ),
    "point names": ("x", "PointNames_to_go_with_DLTdv8a_sparsesave_arrays\na\nb\n", "dltdv-point-names", 2, 0, 0),
    "XMALab frames": ("x.csv", "Frame,a_X,a_Y,a_Z\n7,1,2,3\n8,NaN,NaN,NaN\n", "xmalab-3d", 1, 0, 2),
    "XMALab offsets": (
        "x.csv",
        "cam0_offsetcam1_offseta_cam1_X,a_cam1_Y,a_cam2_X,a_cam2_Y\n0,0,1,2,3,4\n",
        "xmalab-2d",
        1,
        2,
        1,
    ),
    "Anipose": (
        "x.csv",
        "a_x,a_y,a_z,a_error,a_ncams,a_score,fnum\n1,2,3,0.5,2,0.9,0\n1,2,3,10,2,0.9,1\n",
        "anipose-3d",
        1,
        0,
        2,
    ),
    "Lightning Pose": (
        "x.csv",
        "scorer,lp,lp,lp\nbodyparts,a,a,a\ncoords,x,y,likelihood\n0,1,2,0.5\n",
        "deeplabcut-csv",
        1,
        1,
        1,
    ),
    "two animals": (
        "x.csv",
        "scorer,s,s,s,s\nindividuals,i,i,j,j\nbodyparts,a,a,a,a\ncoords,x,y,x,y\n0,1,2,,\n",
        "deeplabcut-csv",
        2,
        1,
        1,
    ),
    "labels by hand": (
        "x.csv",
        "scorer,,,s,s\nbodyparts,,,a,a\ncoords,,,x,y\nlabeled-data,v,img0001.png,1,2\nlabeled-data,v,img0009.png,,\n",
        "deeplabcut-csv",
        1,
        1,
        2,
    ),
    "a comma at each line's end": ("x.csv", "pt1_cam1_X,pt1_cam1_Y,\n1,2,\n3,4,\n", "dltdv-xypts", 1, 1, 2),
    "QTM without titles": ("x.tsv", QTM + "1\t2\t3\t4\t5\t6\n7\t8\t9\t\t\t\n", "qualisys-tsv", 2, 0, 2),
    "QTM with frames, without titles": (
        "x.tsv",
        QTM + "7\t0.06\t1\t2\t3\t4\t5\t6\t\n8\t0.07\t7\t8\t9\t\t\t\t\n",
        "qualisys-tsv",
        2,
        0,
        2,
    ),
    "plain": ("x.csv", "time,hip.x,hip.y,hip.z\n0,1,2,3\n0.1,4,5,6\n", "csv", 1, 0, 2),
}


@pytest.mark.parametrize("case", SMALL)
def test_small_files_as_the_programs_write_them(case, tmp_path):
    """Variants that no real file here shows: format, points, cameras, frames."""
    name, content, *expected = SMALL[case]
    (tmp_path / name).write_text(content)
    recording = read(tmp_path / name)
    found = [recording.format, len(recording.names), len(recording.camera_names), len(recording.frames)]
    assert found == expected


def test_values_of_small_files(tmp_path):
    """Columns by name, cameras by number, codes as the programs mean them."""

    def small(case):
        name, content, *_ = SMALL[case]
        (tmp_path / name).write_text(content)
        return read(tmp_path / name)

    np.testing.assert_array_equal(small("Argus").pixels.uv_px[:, 0, 0], [[1, 2], [3, 4]])
    assert small("Argus").camera_names == ("cam1", "cam10")
    np.testing.assert_array_equal(small("Argus intervals").tables["interval"][0, 0], [0.5, 1, 1.5])
    np.testing.assert_array_equal(small("XMALab offsets").pixels.uv_px[:, 0, 0], [[1, 2], [3, 4]])
    np.testing.assert_array_equal(small("XMALab frames").frames, [7, 8])
    assert small("DLTdv filtered").points.origin[0, 0] == Origin.SMOOTHED
    np.testing.assert_array_equal(small("Anipose").points.origin[:, 0], [Origin.MEASURED, Origin.INTERPOLATED])
    np.testing.assert_array_equal(small("Argus sparse").pixels.seen[0, :, 0], np.arange(9) == 1)
    assert small("plain").fps == 10.0
    for case, first in (("QTM without titles", 1), ("QTM with frames, without titles", 7)):
        assert small(case).frames[0] == first
        np.testing.assert_allclose(small(case).points.xyz_m[0], [[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])
        np.testing.assert_array_equal(small(case).points.seen[1], [True, False])
    assert small("two animals").animals == (("i", "a"), ("j", "a"))


def test_sparse_files_know_their_cameras_and_names(tmp_path):
    """The offsets beside a sparse file tell how many cameras there are, and pointNames.tsv the names; or the user."""
    cells = "".join(f"1\t{c}\t{c}\n" for c in range(1, 9))
    (tmp_path / "b_xypts.tsv").write_text(f"Sparse format camera coordinates file\n3\t8\t8\n{cells}")
    stated = read(tmp_path / "b_xypts.tsv", Hints(cameras=4))
    np.testing.assert_array_equal(stated.pixels.uv_px[:, 0, 0], [[1, 2], [3, 4], [5, 6], [7, 8]])
    (tmp_path / "b_offsets.tsv").write_text("Sparse format camera offsets file\n3\t2\t1\n1\t2\t5\n")
    (tmp_path / "b_pointNames.tsv").write_text("PointNames_to_go_with_DLTdv8a_sparsesave_arrays\ntip of wing\nroot\n")
    told = read(tmp_path / "b_xypts.tsv")
    assert told.names == ("tip of wing", "root")
    assert len(told.camera_names) == 2
    np.testing.assert_array_equal(told.pixels.uv_px[:, 0, 1], [[5, 6], [7, 8]])
    with pytest.raises(FormatError, match="not a whole number of points for 3 cameras"):
        read(tmp_path / "b_xypts.tsv", Hints(cameras=3))


def test_anipose_turns_back(tmp_path):
    """(p + center) M undoes the frame that Anipose put its points into: p = M x - center for a rotation M."""
    rng = np.random.default_rng(0)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    centre, world = rng.normal(size=3), rng.normal(size=(5, 3))
    table = {f"a_{axis}": (world @ rotation.T - centre)[:, k] for k, axis in enumerate("xyz")}
    table |= {"a_error": 0.5, "a_ncams": 2, "a_score": 0.9}
    table |= {f"M_{i}{j}": rotation[i, j] for i in range(3) for j in range(3)}
    table |= {f"center_{i}": centre[i] for i in range(3)} | {"fnum": np.arange(5)}
    pd.DataFrame(table).to_csv(tmp_path / "a.csv", index=False)
    np.testing.assert_allclose(read(tmp_path / "a.csv").points.xyz_m[:, 0], world, atol=1e-12)


def test_sba_profiles_place_cameras(tmp_path):
    """A camera 5 before the origin that is turned about its axis by 90 degrees: x appears along v."""
    half = np.sqrt(0.5)
    (tmp_path / "p.txt").write_text(f"900 320 240 1 0 -0.1 0 0 0 0 {half} 0 0 {half} 0 0 5\n")
    (camera,) = read_sba_profile(tmp_path / "p.txt")
    uv = project(stacked([camera]), np.array([[0.0, 0, 0], [1.0, 0, 0]]))[0]
    np.testing.assert_allclose(uv, [[320, 240], [320, 240 + 900 / 5]], atol=1e-9)
    assert camera.lens.k == (-0.1, 0.0, 0.0)


def test_columns_can_be_stated(tmp_path):
    """Titles or numbers, with and without a header; what is not there is named."""
    path = tmp_path / "a.csv"
    path.write_text("t,foo,bar,baz,u,v\n0,1,2,3,4,5\n1,6,7,8,9,10\n")
    with pytest.raises(FormatError, match="state which columns hold what"):
        read(path)
    recording = read(path, Hints(columns=parse_columns("tip=foo,bar,baz; time=t")))
    np.testing.assert_array_equal(recording.points.xyz_m[:, 0], [[1, 2, 3], [6, 7, 8]])
    assert recording.fps == 1.0
    flat = read(path, Hints(columns=parse_columns("tip=5,6")))
    np.testing.assert_array_equal(flat.pixels.uv_px[0, :, 0], [[4, 5], [9, 10]])
    with pytest.raises(FormatError, match="no column 'nose'"):
        read(path, Hints(columns=parse_columns("tip=nose,bar,baz")))
    path.write_text("1,2,3\n4,,6\n")
    np.testing.assert_array_equal(read(path, Hints(columns=parse_columns("a=1,2,3"))).points.seen[:, 0], [True, False])


def test_trc_is_read_by_its_times(tmp_path):
    """A wrong DataRate is told, times go before it; empty, NaN and (0, 0, 0) are gaps; metres are metres."""
    head = "PathFileType\t4\t(X/Y/Z)\ta.trc\n" + "\t".join(
        ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame", "OrigNum"]
    )
    rows = "1\t0.00\t1\t2\t3\n2\t0.01\t\t\t\n3\t0.02\tNaN\tNaN\tNaN\n4\t0.03\t0\t0\t0\n"
    text = f"{head}\n60\t60\t4\t1\tm\t60\t1\t4\nFrame#\tTime\ttip\t\t\n\t\tX1\tY1\tZ1\n\n{rows}"
    (tmp_path / "a.trc").write_text(text)
    recording = read(tmp_path / "a.trc")
    assert recording.fps == pytest.approx(100.0)
    np.testing.assert_array_equal(recording.points.seen[:, 0], [True, False, False, False])
    np.testing.assert_array_equal(recording.points.xyz_m[0, 0], [1, 2, 3])
    assert "DataRate says 60" in " ".join(recording.findings)
    (tmp_path / "b.trc").write_text("\n".join(text.split("\n")[:-2]) + "\n")
    assert "3 rows, but NumFrames says 4: the file is cut" in " ".join(read(tmp_path / "b.trc").findings)


def test_unsupported_cameras_are_refused_by_name(tmp_path):
    """Omnidirectional models are no lens here; the message says which model it is."""
    for columns, name in ((13, "CMei"), (19, "Scaramuzza")):
        path = tmp_path / f"{columns}.txt"
        path.write_text(" ".join(["1"] * columns) + "\n")
        assert identify(path).name == "camera-profile"
        with pytest.raises(FormatError, match=f"{name}.*not supported"):
            read(path)


def test_names_of_formats_are_unique():
    assert len({format.name for format in FORMATS}) == len(FORMATS)
