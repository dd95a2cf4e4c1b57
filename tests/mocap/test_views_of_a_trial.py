"""Views of one trial, a camera (and a side) a file, with likelihoods, go to ``track`` and ``convert`` directly."""

import numpy as np
import pytest
from scipy.io import savemat

import mocap as library
from mocap.audit.inspect import inspect
from mocap.cameras.camera import dlt_coefficients, record
from mocap.io.format import Hints
from mocap.io.plain import parse_columns
from mocap.io.registry import read
from tests.mocap.rigs import ring
from tests.mocap.test_audit import moving
from tests.real_data import real

RIG = ring(3)
N = 60


def easywand(path, cameras=RIG):
    """What easyWand saves, without wand points."""
    n = len(cameras)
    struct = {
        "nCams": n,
        "coefs": np.stack([dlt_coefficients(c) for c in cameras], axis=1),
        "focalLengths": np.full(n, 1200.0),
        "ppts": np.tile([640.0, 512.0], n),
        "nlin": np.zeros(5 * n),
        "imageWidth": np.full(n, 1280),
        "imageHeight": np.full(n, 1024),
        "wandPts": np.zeros((0, 4 * n)),
        "wandLen": 0.5,
    }
    savemat(path, {"easyWandData": struct})


@pytest.fixture
def rat(tmp_path):
    """A camera and side a file: frame, likelihood, and two paws; the calibration is easyWand's."""
    easywand(tmp_path / "rig_easyWandData.mat")
    uv = record(RIG, moving(np.arange(N)))
    likely = np.random.default_rng(1).uniform(0.5, 1, (3, N))
    files = []
    for c in range(3):
        for s, side in enumerate(("left", "right")):
            table = np.column_stack([np.arange(N), likely[c], uv[c, :, 2 * s], uv[c, :, 2 * s + 1]])
            files.append(tmp_path / f"rat_cam{c + 1}_{side}.csv")
            header = "frame,likelihood,fore_x,fore_y,hind_x,hind_y"
            np.savetxt(files[-1], table, "%.4f", ",", header=header, comments="")
    return files, tmp_path / "rig_easyWandData.mat", uv, likely


def test_columns_with_likelihoods(tmp_path):
    """A third column titled as a likelihood makes pixels, by titles and by ``--columns``; so does one for all."""
    rows = "frame,tip_x,tip_y,tip_likelihood\n0,1,2,0.9\n1,3,4,0.8\n2,5,6,0.1\n"
    (tmp_path / "a.csv").write_text(rows)
    maps = ("", "paw=tip_x,tip_y,tip_likelihood;frame=frame", "paw=2,3;frame=1;likelihood=4")
    for text in maps:
        found = read(tmp_path / "a.csv", Hints(columns=parse_columns(text)))
        assert found.pixels is not None
        assert found.score is not None
        np.testing.assert_allclose(found.pixels.uv_px[0, :, 0], [[1, 2], [3, 4], [5, 6]])
        np.testing.assert_allclose(found.score[0, :, 0], [0.9, 0.8, 0.1])
        assert found.frames.tolist() == [0, 1, 2]


def test_files_of_a_camera_and_a_side_become_one_recording(rat):
    """Six files and easyWand's calibration, in any order: three calibrated cameras, four paws by side, likelihoods."""
    files, rig, uv, likely = rat
    found = library.read([*files[::-1], rig], fps=200)
    contents = found
    assert contents.pixels is not None
    assert contents.score is not None
    assert contents.camera_names == ("cam1", "cam2", "cam3")
    assert sorted(contents.names) == ["fore_left", "fore_right", "hind_left", "hind_right"]
    for m, name in enumerate(["fore_left", "hind_left", "fore_right", "hind_right"]):
        got = contents.pixels.uv_px[:, :, contents.names.index(name)]
        np.testing.assert_allclose(got, uv[:, :, m], atol=1e-3)
    np.testing.assert_allclose(contents.score[:, :, 0], likely, atol=1e-3)


def test_track_and_convert_take_the_views(mocap, rat, tmp_path):
    """``track cam1 cam2 cam3 easyWandData.mat`` tracks; ``convert`` writes DLTdv's set with the coefficients."""
    files, rig, _, _ = rat
    command = ("track", *files, rig, "--fps", "200", "--model", "constant_velocity", "--no-validate")
    code, _, err = mocap(*command, "--out", tmp_path / "out")
    assert code == 0, err
    assert (tmp_path / "out" / "markers.csv").read_text().startswith("frame,t_s,fore")
    code, _, err = mocap("convert", *files[::2], rig, tmp_path / "rat_xypts.csv")
    assert code == 0, err
    assert (tmp_path / "rat_dltCoefs.csv").is_file()


def test_a_project_and_a_calibration_are_compared():
    """A real project beside easyWand's file of another day: both residuals, and that coefficients differ."""
    tunnel = "bat_windtunnel_dltdv8"
    project = real(tunnel, "078A3", "F5", "carollia_2April2021_078A3m_trial5_dvProject.mat")
    rig = real(tunnel, "windtunnelCalibration2", "extrinsicCalib_20230228_easyWandData.mat")
    text = " ".join(inspect([project, rig], Hints())[0]["findings"])
    assert "with other coefficients: the median triangulation residual" in text
    assert "with its own" in text


def test_the_report_tells_residuals_by_camera_and_marker(tmp_path):
    """One marker is clicked six times as carelessly (3 px) in one camera of four: the table names both."""
    from mocap.cleaning.cleaning import clean
    from mocap.report.report import residual_lines, residuals_by_camera

    rig = ring(4)
    rng = np.random.default_rng(4)
    uv = record(rig, moving(np.arange(N)))
    uv = uv + rng.normal(0, 0.5, uv.shape)
    uv[2, :, 1] += 3.0 * rng.normal(0, 1, (N, 2))
    header = ",".join(f"pt{m + 1}_cam{c + 1}_{x}" for m in range(5) for c in range(4) for x in "XY")
    np.savetxt(
        tmp_path / "a_xypts.csv", uv.transpose(1, 2, 0, 3).reshape(N, -1), "%.6f", ",", header=header, comments=""
    )
    np.savetxt(tmp_path / "rig.csv", np.stack([dlt_coefficients(c) for c in rig], axis=1), "%.12g", ",")
    found = residuals_by_camera(
        clean(library.read(tmp_path / "a_xypts.csv", calibration=tmp_path / "rig.csv", fps=200))
    )
    worst = max(((c, m) for c in found for m in found[c]), key=lambda cm: found[cm[0]][cm[1]] or 0.0)
    assert worst == ("cam3", "pt2")
    assert (found["cam1"]["all"] or 9) < 1.0
    lines = residual_lines(found)
    assert lines[4] == "| marker | cam1 | cam2 | cam3 | cam4 |"
    assert lines[7].startswith("| pt2 |")
