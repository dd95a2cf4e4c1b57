"""NWB files: what is written comes back, by us, by pynwb, and without a complaint of nwbinspector."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from mocap.cameras.camera import record, stacked
from mocap.errors import FormatError
from mocap.io.contents import FileContents
from mocap.io.registry import identify, read, write
from mocap.records import PixelTracks, Status, marker_tracks
from tests.mocap.rigs import ring

pytest.importorskip("ndx_pose")


def scene():
    """Two cameras with a lens, three points, one in a gap, with covariances."""
    cameras = ring(2, lens=True)
    rng, t_s = np.random.default_rng(0), np.arange(6) / 240
    xyz = rng.normal(0, 0.05, (6, 3, 3))
    xyz[2, 1] = np.nan
    spread = rng.normal(0, 1e-3, (6, 3, 3, 3))
    cov = spread @ np.swapaxes(spread, -1, -2)
    cov[2, 1] = np.nan
    status = np.full((6, 3), Status.MEASURED)
    status[3, 1], status[2, 1] = Status.SMOOTHED, Status.MISSING
    names = ("nose", "wrist/l", "tail:tip")
    return FileContents(
        format="a", paths=(Path("trial.csv"),), names=names, frames=np.arange(1, 7), fps=240.0, unit="m",
        points=marker_tracks(names, t_s, xyz, cov_m2=cov, status=status),
        pixels=PixelTracks(names=names, cameras=tuple(c.name for c in cameras), t_s=t_s, uv_px=record(cameras, xyz)),
        camera_names=tuple(c.name for c in cameras), cameras=cameras, pixel_origin="upper-left",
        score=np.where(np.isnan(xyz[..., 0]), np.nan, rng.uniform(0, 1, (2, 6, 3))),
    )  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("nwb") / "trial.nwb"
    remarks = write(scene(), path)
    return path, remarks


def test_all_of_it_comes_back(written):
    """Positions, covariance, status, pixels, scores, cameras with lenses, rate, unit, names: to the last bits."""
    path, expected = written[0], scene()
    assert identify(path).name == "nwb"
    back = read(path)
    assert (back.names, back.camera_names, back.unit) == (expected.names, expected.camera_names, "m")
    assert back.fps == pytest.approx(240)
    np.testing.assert_array_equal(back.frames, expected.frames)
    np.testing.assert_array_equal(back.points.xyz_m, expected.points.xyz_m)
    np.testing.assert_allclose(back.points.cov_m2, expected.points.cov_m2, rtol=1e-12)
    np.testing.assert_array_equal(back.points.status, expected.points.status)
    np.testing.assert_array_equal(back.pixels.uv_px, expected.pixels.uv_px)
    np.testing.assert_array_equal(back.score, expected.score)
    np.testing.assert_allclose(stacked(back.cameras), stacked(expected.cameras), rtol=1e-12)
    for one, other in zip(back.cameras, expected.cameras, strict=True):
        np.testing.assert_array_equal(one.lens.coefficients, other.lens.coefficients)
        np.testing.assert_allclose(one.lens.intrinsic, other.lens.intrinsic, rtol=1e-12, atol=1e-9)


def test_nwbinspector_finds_nothing_to_correct(written):
    """Only what nobody can know from a recording: who the animal was, who did it."""
    from nwbinspector import Importance, inspect_nwbfile

    least = Importance.BEST_PRACTICE_VIOLATION.value
    found = inspect_nwbfile(nwbfile_path=str(written[0]))
    assert {m.check_function_name for m in found if m.importance.value >= least} <= {"check_subject_exists"}


def test_movement_finds_positions_where_it_looks(written):
    """As movement 0.15's from_nwb_file does: processing, behavior, PoseEstimation, and the data of each series."""
    pynwb = pytest.importorskip("pynwb")
    with pynwb.NWBHDF5IO(written[0], "r") as io:
        poses = io.read().processing["behavior"]["PoseEstimation"]
        series = poses.pose_estimation_series
        found = np.stack([np.asarray(series[key].data) for key in ("nose", "wrist_l", "tail_tip")], axis=1)
        camera = poses.pose_estimations["cam2_pixels"].device
        assert camera.rotation_matrix[()].shape == (3, 3)
    np.testing.assert_array_equal(found, scene().points.xyz_m)


def test_pixels_alone_and_files_of_others(written, tmp_path):
    """Pixels with a frame left out, whose times are written; millimetres with a conversion, no table of ours."""
    whole, frames = scene(), np.array([1, 2, 3, 4, 5, 7])
    pixels = replace(whole.pixels, t_s=(frames - 1) / 240)
    alone = replace(whole, points=None, pixels=pixels, frames=frames)
    write(alone, tmp_path / "two.nwb")
    back = read(tmp_path / "two.nwb")
    assert back.points is None
    np.testing.assert_array_equal(back.frames, frames)
    np.testing.assert_array_equal(back.pixels.uv_px, alone.pixels.uv_px)
    path = tmp_path / "others.nwb"
    path.write_bytes(written[0].read_bytes())
    with h5py.File(path, "a") as file:
        del file["processing/behavior/PoseUncertainty"]
        for item in file["processing/behavior/PoseEstimation"].values():
            if item.attrs.get("neurodata_type") == "PoseEstimationSeries":
                item["data"].attrs["unit"], item["data"].attrs["conversion"] = "millimeters", 2.0
    back = read(path)
    np.testing.assert_allclose(back.points.xyz_m, 2e-3 * scene().points.xyz_m)
    assert not np.isfinite(back.points.cov_m2).any()


def test_a_file_without_poses_is_refused_in_one_line(written, tmp_path):
    """What was expected, and what to do."""
    path = tmp_path / "none.nwb"
    path.write_bytes(written[0].read_bytes())
    with h5py.File(path, "a") as file:
        del file["processing/behavior/PoseEstimation"]
    with pytest.raises(FormatError, match=r"none.nwb: .*PoseEstimation of ndx-pose"):
        read(path)


def test_reading_needs_no_package(written):
    """A user without the extra reads a colleague's file."""
    code = (
        "import sys; sys.modules['pynwb'] = sys.modules['ndx_pose'] = None\n"
        f"from mocap.io.registry import read; from pathlib import Path; print(read(Path({str(written[0])!r})).fps)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=True)
    assert float(done.stdout) == pytest.approx(240)
