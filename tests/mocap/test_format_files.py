"""Every format on real files of other people, and on small ones as their programs write them, against other readers."""

import json
import pickle
import sys

import h5py
import numpy as np
import pandas as pd
import pytest

from mocap.cameras.camera import project, stacked, undistorted
from mocap.cli.main import main
from mocap.errors import FormatError
from mocap.io.easywand import read_easywand, read_tform
from mocap.io.registry import read
from mocap.io.together import joined
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
    gone = (cells.reshape(len(cells), 14, 3) == "").any(axis=2)
    assert (
        found["missing"] == pytest.approx(gone[:, ~gone.all(axis=0)].mean(), abs=1e-6) == pytest.approx(0.003, abs=5e-4)
    )


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
    assert "not a known format. Nearest are " in found[0]["error"]
    assert info(tmp_path / "nowhere.csv")[1]["findings"][0].endswith("No such file or directory")


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
    with pytest.raises(FormatError, match="both contain a calibration"):
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


def test_tforms_are_the_lenses_of_the_coefficients():
    """One Tforms file a camera, in any order, joined with DLT coefficients: the lenses that easyWand's result holds."""
    folder = real("bat_windtunnel_dltdv8", "windtunnelCalibration2")
    forms = [read(folder / f"extrinsicCalib_20230228_cam{c}Tforms.mat") for c in (3, 1, 4, 2)]
    coefficients = read(real("bat_windtunnel_dltdv8", "derived_csv", "FE404_F2", "FE404_F2_dltCoefs.csv"))
    whole = joined([coefficients, *forms])
    wand = read_easywand(folder / "extrinsicCalib_20230228_easyWandData.mat")
    for camera, lens in zip(whole.cameras, wand.lenses, strict=True):
        np.testing.assert_allclose(camera.lens.centre_px, lens.centre_px, atol=1e-6)
        np.testing.assert_allclose(camera.lens.coefficients, lens.coefficients, atol=1e-12)
