"""DLTdv8's projects, against the CSV files derived from them with other code, and against damage."""

import shutil

import h5py
import numpy as np
import pytest

from mocap.cameras.camera import stacked, undistorted
from mocap.cameras.triangulate import linear
from mocap.errors import FormatError
from mocap.io.dltdv import read_coefficients, read_pixels, read_points
from mocap.io.dvproject import read_project
from mocap.io.profile import with_profile
from tests.real_data import real

PROJECTS = {
    "078A3_F5": ("078A3", "F5", "carollia_2April2021_078A3m_trial5_dvProject.mat"),
    "FE404_F2": ("FE404", "F2", "AFAMcarollia_2Apr2021_FE404m_Y20210402H163035.291883000_F2_dvProject.mat"),
}
HALF_DIGIT = 0.5000001e-6


def project_file(trial):
    return real("bat_windtunnel_dltdv8", *PROJECTS[trial])


@pytest.mark.parametrize("trial", PROJECTS)
def test_projects_are_the_derived_csv(trial):
    """Pixels and stored points agree to the six decimals of the CSV; cameras and lenses to the digits of theirs."""
    project = read_project(project_file(trial))
    folder = real("bat_windtunnel_dltdv8", "derived_csv", trial)
    pixels = read_pixels(folder / f"{trial}_xypts.csv", fps=700)
    assert project.pixels.cameras == pixels.cameras
    assert project.fps == 700
    np.testing.assert_allclose(project.pixels.t_s, pixels.t_s, rtol=1e-12)
    np.testing.assert_allclose(project.pixels.uv_px, pixels.uv_px, rtol=0, atol=HALF_DIGIT)
    stored = read_points(folder / f"{trial}_xyzpts.csv", fps=700)
    np.testing.assert_allclose(project.points.xyz_m, stored.xyz_m, rtol=0, atol=HALF_DIGIT)
    cameras = read_coefficients(folder / f"{trial}_dltCoefs.csv")
    for ours, theirs in zip(project.cameras, cameras, strict=True):
        np.testing.assert_allclose(ours.matrix, theirs.matrix, rtol=1e-5, atol=1e-6)
        assert ours.size_px == (2560, 1600)
    assert not project.tables["offset_frames"].any()
    profile = folder / f"{trial}_camera_profile.txt"
    assert (project.cameras[0].lens is not None) == profile.exists()
    if profile.exists():
        for ours, theirs in zip(project.cameras, with_profile(cameras, profile), strict=True):
            assert ours.lens == theirs.lens


@pytest.mark.parametrize(("trial", "points", "stale"), [("078A3_F5", 3284, 8), ("FE404_F2", 816, 0)])
def test_stored_points_follow_from_the_project_alone(trial, points, stale):
    """PROVENANCE.md: but for the stale ones, undistorted as DLTdv does, pixels give the stored points to rounding."""
    project = read_project(project_file(trial))
    uv = undistorted(project.cameras, project.pixels.uv_px, iterations=3)
    distance = np.linalg.norm(linear(stacked(project.cameras), uv) - project.points.xyz_m, axis=-1)
    known = np.isfinite(distance)
    assert known.sum() == points
    assert np.sum(distance[known] > 1e-6) == stale
    assert np.median(distance[known]) < 1e-14


def test_the_stated_rate_wins():
    """078A3/F2 was saved with the rate of playback, 25.56 Hz: the user may know better."""
    path = real("bat_windtunnel_dltdv8", "078A3", "F2", "carollia_2Apr2021_078A3m_trial2_dvProject.mat")
    assert read_project(path).fps == 25.56
    assert read_project(path).with_rate(700).pixels.t_s[700] == 1.0


def small_project(path, *, pixels=((0, 0, 5.0),)):
    """Two frames, one point, two cameras, no calibration; ``pixels``: (row, column, value)."""
    dense = np.zeros((2, 4))
    for row, column, value in pixels:
        dense[row, column] = value
    with h5py.File(path, "w") as file:
        data = file.create_group("udExport/data")
        for name, value in {"nvid": 2, "numpts": 1, "movFrameRates": 100}.items():
            data[name] = np.array([[float(value)]])
        for name, table in {"xypts": dense, "dltpts": np.zeros((2, 3)), "offset": np.zeros((2, 2))}.items():
            group = data.create_group(name)
            group.attrs["MATLAB_sparse"] = np.uint64(len(table))
            columns, rows = np.nonzero(table.T)
            group["jc"] = np.append(0, np.cumsum((table != 0).sum(axis=0))).astype(np.uint64)
            if len(rows):
                group["ir"], group["data"] = rows.astype(np.uint64), table.T[table.T != 0]
        data["dltcoef"] = np.zeros(2, dtype=np.uint64)
        data["dltcoef"].attrs["MATLAB_empty"] = np.uint8(1)
        del columns
    return path


def test_a_project_without_calibration(tmp_path):
    """What is absent was not seen; half a pixel is none; without coefficients there are no cameras."""
    project = read_project(small_project(tmp_path / "p.mat", pixels=[(1, 2, 7.0), (1, 3, 8.0), (0, 0, 5.0)]))
    assert project.cameras == ()
    assert project.pixels.seen.sum() == 1
    np.testing.assert_array_equal(project.pixels.uv_px[1, 1, 0], [7, 8])
    assert project.pixels.names == ("pt1",)
    assert not project.points.seen.any()


def edit(path, name, value):
    with h5py.File(path, "r+") as file:
        del file[f"udExport/data/{name}"]
        if value is not None:
            file[f"udExport/data/{name}"] = value


def test_a_rate_of_zero_is_none(tmp_path):
    """A project without a rate still has its pixels; who reads it is asked for the rate."""
    path = small_project(tmp_path / "trial7.mat")
    edit(path, "movFrameRates", np.array([[0.0]]))
    assert read_project(path).fps is None


DAMAGE = {
    "no coefficients": ("dltcoef", None, "not a readable project.*dltcoef"),
    "coefficients of one camera": ("dltcoef", np.ones((1, 11)), "expected 11 finite numbers for each of 2 cameras"),
    "another number of points": ("numpts", np.array([[3.0]]), "xypts has 4 columns, expected 12"),
    "rows out of range": ("xypts/ir", np.array([9], dtype=np.uint64), "sparse matrix xypts contradicts its own size"),
    "columns that do not end": (
        "xypts/jc",
        np.array([0, 1, 1, 1, 3], dtype=np.uint64),
        "xypts contradicts its own size",
    ),
}


@pytest.mark.parametrize(("name", "value", "message"), DAMAGE.values(), ids=DAMAGE)
def test_damaged_projects_are_refused(tmp_path, name, value, message):
    """One line that names the file and what contradicts what."""
    path = small_project(tmp_path / "trial7.mat")
    edit(path, name, value)
    with pytest.raises(FormatError, match=message) as caught:
        read_project(path)
    assert str(caught.value).startswith("trial7.mat: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("keep", [0, 100, 5000, 50_000])
def test_cut_projects_are_refused(tmp_path, keep):
    path = tmp_path / "cut.mat"
    path.write_bytes(project_file("FE404_F2").read_bytes()[:keep])
    with pytest.raises(FormatError, match=r"cut\.mat: not a readable project"):
        read_project(path)


def test_older_mat_files_and_absent_ones_are_named(tmp_path):
    """A MATLAB 5 file is no HDF5."""
    path = tmp_path / "old.mat"
    shutil.copy(real("mouse_mocap_qtm", "MOS1aD_S15_M5_MC2_T2_TRM_15MMIN_B.mat"), path)
    with pytest.raises(FormatError, match=r"old\.mat: not a readable project"):
        read_project(path)
    with pytest.raises(FormatError, match="cannot be read: no such file"):
        read_project(tmp_path / "nowhere.mat")
