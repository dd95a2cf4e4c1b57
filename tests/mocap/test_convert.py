"""``mocap convert``, and tracking from any format."""

import json
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mocap.cleaning.cleaning import clean
from mocap.cli.main import main
from mocap.errors import CalibrationError, MocapError
from mocap.io.manifest import MANIFEST
from mocap.io.registry import read, write
from mocap.reading.reading import read as read_recording
from mocap.records import Status
from mocap.results.tracked import Tracked
from tests.mocap.recordings import points
from tests.mocap.rerun.flapping import make_run
from tests.real_data import real


@pytest.fixture
def mocap(capsys, monkeypatch):
    """Exit code, standard output and error of ``mocap ...``."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["mocap", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return run


def swing(frames=60):
    """Two markers that swing, a gap in one."""
    t = np.arange(frames) / 250
    xyz = np.stack([np.stack([np.sin(9 * t), np.cos(9 * t), 0.1 + t], axis=1), np.ones((frames, 3))], axis=1)
    xyz[20:25, 0] = np.nan
    return points(["wrist", "table"], xyz)


def test_a_chain_of_formats_keeps_what_each_can_say(mocap, tmp_path):
    """Through five files and back, positions move by the print of TRC only; the input is never written over."""
    write(swing(), tmp_path / "a.csv")
    chain = ["a.csv", "b.c3d", "c.nc", "d.trc", "e.parquet", "f_long.csv"]
    for old, new in pairwise(chain):
        code, _, err = mocap("convert", tmp_path / old, tmp_path / new)
        assert code == 0, err
    back = read(tmp_path / "f_long.csv")
    assert (back.fps, back.names) == (250.0, ("wrist", "table"))
    # 24 bits of 1.3 m in C3D, half a nanometre in TRC
    np.testing.assert_allclose(back.points.xyz_m, swing().points.xyz_m, rtol=0, atol=1.3 * 2**-24 + 0.5e-9)
    code, _, err = mocap("convert", tmp_path / "a.csv", tmp_path / "a.csv", "--force")
    assert code == 1
    assert "is read from" in err


def test_convert_asks_for_what_no_file_says(mocap, tmp_path):
    """DLTdv's points have neither rate nor unit: C3D needs both; what is lost on the way is listed."""
    write(swing(), tmp_path / "a_xyzpts.csv")
    out = tmp_path / "a.c3d"
    assert "give --fps" in mocap("convert", tmp_path / "a_xyzpts.csv", out)[2]
    assert "give --unit" in mocap("convert", tmp_path / "a_xyzpts.csv", out, "--fps", 250)[2]
    assert not out.exists()
    code, text, _ = mocap("convert", tmp_path / "a_xyzpts.csv", out, "--fps", 250, "--unit", "mm", "--json")
    assert code == 0
    assert json.loads(text)["written"] == [str(out)]
    # the numbers are taken as millimetres, and %.6f of them is left of the positions
    np.testing.assert_allclose(read(out).points.xyz_m, swing().points.xyz_m * 1e-3, atol=1e-9)
    code, _, err = mocap("convert", out, tmp_path / "b_xyzpts.csv")
    assert code == 0
    assert "not written: the frame rate, 250" in err
    assert mocap("convert", out, tmp_path / "b.bvh")[0] == 1


def test_views_and_calibration_become_a_dltdv_set(mocap, tmp_path):
    """Four SLEAP files and calibration.toml: pixels, coefficients and profile that project as the cameras do."""
    folder = real("mouse_charuco_4cam")
    views = [folder / name / f"minimal_{name}_proofread.analysis.h5" for name in ("back", "mid", "side", "top")]
    code, _, err = mocap("convert", *views, folder / "calibration.toml", tmp_path / "mouse_xypts.csv")
    assert code == 0, err
    assert "not written: scores" in err
    ends = ("xypts.csv", "offsets.csv", "dltCoefs.csv", "profile.txt")
    assert {path.name for path in tmp_path.iterdir()} == {MANIFEST, *(f"mouse_{end}" for end in ends)}
    np.testing.assert_allclose(read(tmp_path / "mouse_xypts.csv").pixels.uv_px[3], read(views[3]).pixels.uv_px[0],
                               atol=0.5e-6)  # fmt: skip


@pytest.mark.parametrize("name", ["a.trc", "a.c3d", "a.nc", "a.parquet", "a.csv"])
def test_any_format_can_be_tracked(tmp_path, name):
    """Prepared from any file that holds its rate, a recording is what it is from DLTdv's with --fps."""
    write(swing(), tmp_path / name)
    write(swing(), tmp_path / "a_xyzpts.csv")
    ours, dltdv = (
        clean(read_recording(tmp_path / name)),
        clean(read_recording(tmp_path / "a_xyzpts.csv", fps=250)),
    )
    assert ours.dt_s == pytest.approx(1 / 250)
    np.testing.assert_allclose(ours.xyz_m, dltdv.xyz_m, atol=1e-6)
    with pytest.raises(MocapError, match="give `fps`"):
        clean(read_recording(tmp_path / "a_xyzpts.csv"))


def test_a_unit_that_is_stated_scales(tmp_path):
    """Points of a file without a unit are taken in the unit that its user states, else in metres."""
    write(swing(), tmp_path / "a_xyzpts.csv")
    plain, scaled = (clean(read_recording(tmp_path / "a_xyzpts.csv", fps=250, unit=unit)) for unit in (None, "cm"))
    np.testing.assert_allclose(scaled.xyz_m, plain.xyz_m / 100, atol=1e-12)
    write(swing(), tmp_path / "a.trc")
    with pytest.raises(MocapError, match="states lengths in m, not in mm"):
        clean(read_recording(tmp_path / "a.trc", unit="mm"))


def test_files_without_tracks_or_cameras_are_named(tmp_path):
    """Residuals are no tracks, points are no pixels, a skeleton of pixels needs cameras."""
    (tmp_path / "res.csv").write_text("pt1_dltres\n1.5\n")
    (tmp_path / "px.csv").write_text("pt1_cam1_X,pt1_cam1_Y,pt1_cam2_X,pt1_cam2_Y\n1,2,3,4\n")
    write(swing(), tmp_path / "a.trc")
    for file, error, message in (
        ("res.csv", MocapError, "contains no tracks"),
        ("px.csv", CalibrationError, "without a calibration: calibrate, or give `calibration`"),
    ):
        with pytest.raises(error, match=message):
            clean(read_recording(tmp_path / file, fps=100))
    with pytest.raises(MocapError, match=r"a\.trc: contains positions"):
        clean(read_recording(tmp_path / "a.trc", calibration=tmp_path / "px.csv"))
    with pytest.raises(MocapError, match=r"a\.trc: contains no cameras"):
        clean(read_recording(tmp_path / "px.csv", calibration=tmp_path / "a.trc", fps=100))


def test_netcdf_keeps_standard_deviations_and_status(tmp_path):
    """To NetCDF and back, in millimetres too; a marker that was not seen has none."""
    rng = np.random.default_rng(2)
    sd_m = rng.uniform(1e-4, 1e-3, size=(7, 2))
    sd_m[3, 1] = np.nan
    xyz_m = rng.normal(size=(7, 2, 3))
    xyz_m[3, 1] = np.nan
    status = np.where(np.isnan(sd_m), Status.MISSING, Status.MEASURED)
    status[5, 0] = Status.SMOOTHED
    lines = ["frame,t_s," + ",".join(f"{m}_{end}" for m in ("a", "b") for end in ("x", "y", "z", "sd", "origin"))]
    words = {int(s): s.name.lower() for s in Status}
    for t in range(7):
        cells = [
            ",".join(
                [*(f"{v:.17g}" if np.isfinite(v) else "" for v in (*xyz_m[t, m], sd_m[t, m])), words[status[t, m]]]
            )
            for m in range(2)
        ]
        lines.append(f"{t + 1},{t / 100:g}," + ",".join(cells))
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    for name, unit in (("b.nc", None), ("c.nc", "mm")):
        recording = read(tmp_path / "a.csv")
        recording = recording if unit is None else replace(recording, unit=unit)
        assert not [r for r in write(recording, tmp_path / name) if "deviation" in r]
        back = read(tmp_path / name)
        np.testing.assert_allclose(back.points.sd_m, sd_m, rtol=1e-12)
        np.testing.assert_array_equal(back.points.status, status)


def test_our_own_netcdf_is_read_with_its_covariances(tmp_path):
    """``markers.nc`` holds covariances; a table made of it holds the standard deviations."""
    run = make_run(n_frames=12, n_cameras=0, n_joints=0)
    dataset = Tracked.of(run).markers
    dataset.to_netcdf(tmp_path / "markers.nc", engine="h5netcdf")
    back = read(tmp_path / "markers.nc")
    np.testing.assert_allclose(back.points.cov_m2, run.cov_m2, rtol=1e-12)
