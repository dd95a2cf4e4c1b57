"""What is not wrong is not called wrong: each case accused a recording, or its cameras, of what they had not done."""

import numpy as np
import pytest
from scipy.io import savemat

from mocap.audit import alarms
from mocap.audit.inspect import inspect
from mocap.cameras.camera import dlt_coefficients, record
from mocap.io.describe import summary
from mocap.io.dltdv import write_points
from mocap.io.format import Hints
from mocap.io.registry import read
from tests.mocap.rigs import cloud, ring
from tests.mocap.test_audit import clean, points_of
from tests.real_data import real


def test_easywand_without_wand_points_is_judged_by_its_background(tmp_path):
    """Background points fit their calibration: the residual of their pixels is stated, and nothing is blamed."""
    cameras, rng = ring(3), np.random.default_rng(4)
    uv = record(cameras, cloud(rng, 100))
    struct = {
        "nCams": 3,
        "coefs": np.stack([dlt_coefficients(c) for c in cameras], axis=1),
        "focalLengths": np.full(3, 1200.0),
        "ppts": np.tile([640.0, 512.0], 3),
        "nlin": np.zeros(15),
        "imageWidth": np.full(3, 1280),
        "imageHeight": np.full(3, 1024),
        "wandPts": np.zeros((0, 12)),
        "wandLen": 0.5,
        "backgroundPts": (uv + rng.normal(0, 0.4, uv.shape)).transpose(1, 0, 2).reshape(100, 6),
    }
    savemat(tmp_path / "rig_easyWandData.mat", {"easyWandData": struct})
    (found,) = inspect([tmp_path / "rig_easyWandData.mat"], Hints())
    assert not [f["text"] for f in found["audit"] if f["alarm"]]
    (origin,) = [f for f in found["audit"] if f["kind"] == "pixel origin"]
    assert origin["numbers"]["residual_px"] == pytest.approx(0.4, abs=0.1)


def test_the_arenas_easywand_file_fits():
    """659 background points of a real session, 0.6 px."""
    (found,) = inspect([real("bat_arena_two_digitisers", "calibration09_1maxRes_easyWandData.mat")], Hints())
    (origin,) = [f for f in found["audit"] if f["kind"] == "pixel origin"]
    assert origin["numbers"]["residual_px"] < 1.0


def test_a_raw_file_and_its_filled_copy_are_two_versions(tmp_path):
    """Same points, holes filled: said so, with how many; not that they do not belong together."""
    scene = clean()
    raw = scene.stored(scene.xyz_m).xyz_m.copy()
    raw[40:60, 2] = np.nan
    for name, xyz in (("raw", raw), ("filled", scene.xyz_m)):
        write_points(tmp_path / f"{name}_xyzpts.csv", points_of(xyz, scene.pixels))
    found = inspect([tmp_path / "raw_xyzpts.csv", tmp_path / "filled_xyzpts.csv"], Hints())
    text = " ".join(found[0]["findings"])
    assert "two versions of one recording" in text
    assert "20 samples are only in filled_xyzpts.csv" in text
    assert "belong together" not in text


def test_points_of_another_calibration_are_in_another_world():
    """Turned, scaled and shifted stored points are not called stale; smoothed ones are."""
    scene = clean()
    c, s = np.cos(0.4), np.sin(0.4)
    xyz = scene.stored().xyz_m @ (1.3 * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])) + [0.3, -1.0, 0.2]
    (found,) = alarms(scene.audit(stored=points_of(np.round(xyz, 6), scene.pixels)))
    assert found.kind == "another world"
    assert found.numbers["scale"] == pytest.approx(1.3, abs=0.02)
    assert found.numbers["left_m"] < 1e-4


def test_missing_counts_what_was_digitised(tmp_path):
    """Every tenth frame of one marker of three is clicked, 5 of 30 clicks are missing: 1 in 6, not 95 %."""
    xyz = np.full((300, 3, 3), np.nan)
    xyz[::10, 0] = cloud(np.random.default_rng(1), 30)
    xyz[::10, 1] = xyz[::10, 0] + 1
    xyz[:100:10, 1] = np.nan
    scene = clean()
    write_points(
        tmp_path / "a_xyzpts.csv",
        points_of(np.pad(xyz, ((0, 0), (0, 2), (0, 0)), constant_values=np.nan), scene.pixels),
    )
    found = summary(read(tmp_path / "a_xyzpts.csv"))
    assert found["missing"] == pytest.approx(10 / 60, abs=1e-6)
    assert found["undigitised"] == {"frames": 270, "markers": ["pt3", "pt4", "pt5"]}


def test_convert_writes_no_file_of_nothing(mocap, tmp_path):
    """Pixels without points: no xyzpts and no xyzres that are all NaN."""
    uv = clean().pixels.uv_px.transpose(1, 2, 0, 3).reshape(300, -1)
    header = ",".join(f"pt{m + 1}_cam{c + 1}_{x}" for m in range(5) for c in range(4) for x in "XY")
    np.savetxt(tmp_path / "a_xypts.csv", uv, "%.6f", ",", header=header, comments="")
    code, _, _ = mocap("convert", tmp_path / "a_xypts.csv", tmp_path / "b_xypts.csv")
    assert code == 0
    assert sorted(p.name for p in tmp_path.glob("b_*")) == ["b_offsets.csv", "b_xypts.csv"]
