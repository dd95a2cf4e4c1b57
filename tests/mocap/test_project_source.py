"""DLTdv8 projects as a source: pixels, cameras and stored points in one file."""

import json

import h5py
import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat, write_recording

from mocap.cleaning.cleaning import clean
from mocap.errors import CalibrationError, MocapError
from mocap.io.dltdv import read_coefficients, read_pixels, read_points
from mocap.io.profile import with_profile
from mocap.reading.reading import read

FPS = 240.0


def write_project(path, pixels, cameras, *, calibrated=True):
    """A project of DLTdv8 as MATLAB writes it, as far as it is read; nothing stored."""
    uv = np.transpose(pixels.uv_px, (1, 2, 0, 3)).reshape(len(pixels.t_s), -1)
    tables = {"xypts": np.nan_to_num(uv), "dltpts": np.zeros((len(uv), 3 * len(pixels.names)))}
    tables["offset"] = np.zeros((len(uv), len(cameras)))
    numbers = {"nvid": len(cameras), "numpts": len(pixels.names), "movFrameRates": 30.0}
    with h5py.File(path, "w") as file:
        data = file.create_group("udExport/data")
        for name, value in numbers.items():
            data[name] = np.array([[float(value)]])
        for name, table in tables.items():
            group = data.create_group(name)
            group.attrs["MATLAB_sparse"] = np.uint64(len(table))
            _, rows = np.nonzero(table.T)
            group["jc"] = np.append(0, np.cumsum((table != 0).sum(axis=0))).astype(np.uint64)
            if len(rows):
                group["ir"], group["data"] = rows.astype(np.uint64), table.T[table.T != 0]
        refs = []
        for m, name in enumerate(pixels.names):
            file[f"names/{m}"] = np.array([[ord(c)] for c in name], dtype=np.uint16)
            refs.append(file[f"names/{m}"].ref)
        data["pointNames"] = np.array([refs], dtype=h5py.ref_dtype)
        if not calibrated:
            data["dltcoef"] = np.zeros(2, dtype=np.uint64)
            data["dltcoef"].attrs["MATLAB_empty"] = np.uint8(1)
            return path
        data["dltcoef"] = np.array([(c.matrix / c.matrix[2, 3]).ravel()[:11] for c in cameras])
        data["movsizes"] = np.array([c.size_px[::-1] for c in cameras], dtype=float).T
        refs = []
        for c, camera in enumerate(cameras):
            lens = camera.lens
            k, p = lens.k, lens.p
            file[f"lens/{c}/tdata"] = np.array([[*lens.f_px, *lens.centre_px, k[0], k[1], *p, k[2], 3]], dtype=float)
            refs.append(file[f"lens/{c}"].ref)
        data["camud"] = np.array([refs], dtype=h5py.ref_dtype)
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A recording as DLTdv's tables, and the same pixels and cameras as a project."""
    folder = tmp_path_factory.mktemp("bat")
    paths = write_recording(make_bat(seed=3, n_frames=40, n_cameras=3, digitiser=PERFECT), folder)
    cameras = with_profile(read_coefficients(paths["coefficients"]), paths["profile"])
    pixels = read_pixels(paths["pixels"], fps=FPS)
    write_project(folder / "bat_dvProject.mat", pixels, cameras)
    write_project(folder / "raw_dvProject.mat", pixels, cameras, calibrated=False)
    return {**paths, "project": folder / "bat_dvProject.mat", "raw": folder / "raw_dvProject.mat"}


def test_a_project_is_what_its_tables_are(files):
    """Points, covariances, findings and names are those of xypts, coefficients and profile, to the solver's rounding.

    Pixels are the same numbers; matrices are scaled once more: 1e-16 times the squared condition of a triangulation.
    """
    tables = clean(read(files["pixels"], fps=FPS, calibration=files["coefficients"], profile=files["profile"]))
    project = clean(read(files["project"], fps=FPS))
    assert project.names == tables.names
    np.testing.assert_allclose(project.t_s, tables.t_s, rtol=1e-12)
    np.testing.assert_allclose(project.xyz_m, tables.xyz_m, rtol=0, atol=1e-8)
    np.testing.assert_allclose(project.cov_m2, tables.cov_m2, rtol=1e-4, atol=1e-14)


def test_coefficients_that_are_given_go_first(mocap, files, tmp_path):
    """A project without calibration says so; with --dlt and --profile it gives the points of the tables."""
    with pytest.raises(
        CalibrationError, match=r"raw_dvProject\.mat: a project without DLT coefficients: .*give `calibration`"
    ):
        clean(read(files["raw"], fps=FPS))
    cameras = ["--dlt", files["coefficients"], "--profile", files["profile"]]
    points = []
    for tracks, options in ((files["pixels"], cameras), (files["raw"], cameras), (files["project"], [])):
        out = tmp_path / f"{tracks.stem}.csv"
        code, stdout, err = mocap("triangulate", tracks, *options, "--out", out, "--json")
        assert code == 0, err
        assert json.loads(stdout)["points"] > 500
        points.append(read_points(out, fps=FPS).xyz_m)
    for other in points[1:]:
        np.testing.assert_allclose(other, points[0], rtol=0, atol=1.01e-6)  # six decimals are written


def test_what_tables_alone_need_is_asked_for(mocap, files, tmp_path):
    """Tables need --dlt; options about cameras need cameras, which a project has."""
    code, _, err = mocap("triangulate", files["pixels"], "--out", tmp_path / "a.csv")
    assert code == 1
    assert "give --calibration" in err
    with pytest.raises(MocapError, match="`origin` concerns cameras"):
        read(tmp_path / "a_xyzpts.csv", fps=FPS, origin="upper-left")
    assert read(files["project"], fps=FPS, origin="upper-left").filmed


def test_a_project_that_is_none(mocap, tmp_path):
    """Any other file of that ending is named in one line."""
    path = tmp_path / "x.mat"
    path.write_text("pt1_X\n")
    code, _, err = mocap("track", path, "--fps", 100, "--out", tmp_path / "run")
    assert code == 1
    assert "x.mat: contains no rows of numbers" in err
    assert len(err.strip().splitlines()) == 1
