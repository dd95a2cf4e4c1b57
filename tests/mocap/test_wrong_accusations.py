"""What is not wrong is not called wrong: each case accused a recording, or its cameras, of what they had not done."""

import subprocess
from dataclasses import replace
from subprocess import CompletedProcess, TimeoutExpired

import numpy as np
import pytest
from scipy.io import savemat

from mocap.audit import alarms, fit_findings, jump_findings, pixel_findings, point_findings
from mocap.audit.geometry import camera_findings
from mocap.audit.inspect import inspect
from mocap.audit.stored import stored_findings
from mocap.cameras.camera import dlt_coefficients, record, stacked, undistorted
from mocap.cameras.triangulate import linear, refine
from mocap.errors import FormatError
from mocap.io.contents import summary
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


@pytest.mark.parametrize("step", [1.0, 0.5, 1 / 16])
def test_clicks_on_a_grid_are_not_float16(step):
    """Whole pixels of a film of 1,920, halves, and sixteenths of a picture of 100 px: they are what they are."""
    rng = np.random.default_rng(0)
    wide = 100 if step < 0.1 else 1920
    uv = np.round(rng.uniform(0.05, 0.95, (1, 60, 3, 2)) * wide / step) * step
    scene = clean(n_frames=60)
    pixels = replace(scene.pixels, names=("a", "b", "c"), cameras=("cam1",), uv_px=uv)
    said = [f.text for f in pixel_findings(pixels)]
    assert not any("float16" in text for text in said)
    assert any(f"multiples of {step:g} px" in text and ("whole pixels" in text) == (step == 1) for text in said) == (
        step > 0.1
    )


def test_an_animal_that_lies_still_is_no_stalled_recording():
    """A simulated animal rests for 50 frames, moves, and comes to rest again: nothing was stored twice."""
    t = np.clip(np.arange(300) - 50, 0, 150) / 150
    way = (t**3 * (10 - 15 * t + 6 * t**2))[:, None, None] * [0.5, 0.2, 0.1]  # the smoothest way from rest to rest
    scene = clean()
    assert not point_findings(points_of(scene.xyz_m[:1] + way, scene.pixels))


def test_a_step_of_a_millimetre_is_no_other_marker():
    """A person stands still, a marker slips by 1 mm, the next is 50 mm away; one that goes there is named."""
    rng = np.random.default_rng(2)
    xyz = np.array([[0.0, 0, 1], [0.05, 0, 1], [0, 0.05, 1.2]]) + rng.normal(0, 1e-5, (600, 3, 3))
    xyz[300:, 0, 0] += 1e-3
    assert not jump_findings(xyz, np.arange(600) / 100, "abc")
    xyz[300:, 0, 0] += 0.047
    (found,) = jump_findings(xyz, np.arange(600) / 100, "abc")
    assert "probably swapped with 'b'" in found.text
    xyz[300:, 0, 2] += 0.1  # to where there is no marker
    (found,) = jump_findings(xyz, np.arange(600) / 100, "abc")
    assert "swapped" not in found.text


def test_points_rounded_or_solved_otherwise_are_not_stale():
    """Three decimals, and the points of least reprojection error: no pixels were edited, and the world is the same."""
    scene = clean()
    ideal = undistorted(scene.cameras, scene.pixels.uv_px)
    xyz = linear(stacked(scene.cameras), ideal)
    assert not alarms(scene.audit(stored=points_of(np.round(xyz, 3), scene.pixels)))
    best, _ = refine(stacked(scene.cameras), ideal, xyz, sd_px=0.5)
    findings = scene.audit(stored=points_of(np.round(best, 6), scene.pixels))
    assert not alarms(findings)
    assert any("another method" in f.text for f in findings)


def test_careless_clicks_are_no_foreign_calibration():
    """12 px of noise, on an animal of 200 px: rays miss by what clicks scatter, and the calibration is not blamed."""
    scene = clean(lens=False)
    uv = record(scene.cameras, 0.2 * scene.xyz_m)
    assert not fit_findings(scene.cameras, uv + np.random.default_rng(3).normal(0, 12, uv.shape))


@pytest.mark.parametrize(("count", "sd_px"), [(4, 15.0), (3, 4.0)])
def test_a_careless_hand_is_no_foreign_camera(count, sd_px):
    """One film of four, or of three, is clicked 8 and 30 times as carelessly: its calibration is not blamed.

    Pixels that miss by as much but lie as smoothly as the others' are.
    """
    scene = clean(lens=False)
    cameras, uv = scene.cameras[:count], scene.pixels.uv_px[:count].copy()
    uv[1] += np.random.default_rng(3).normal(0, sd_px, uv[1].shape)
    assert not fit_findings(cameras, uv)
    uv[1] = scene.pixels.uv_px[1] + 3 * sd_px
    (found,) = fit_findings(cameras, uv)
    assert found.cameras == (cameras[1].name,)


@pytest.mark.parametrize("reach_m", [0.02, 0.3])
def test_an_animal_that_turns_in_rounded_positions_is_no_stalled_recording(reach_m):
    """To and fro, in whole millimetres: at its turning points frames are the same; those stored twice are named."""
    scene = clean()
    way = reach_m * np.sin(2 * np.pi * np.arange(300) / 100)[:, None, None] * [1.0, 0, 0]
    xyz = np.round(scene.xyz_m[:1] + way, 3)
    assert (xyz[1:] == xyz[:-1]).all(axis=(1, 2)).any()
    assert not point_findings(points_of(xyz, scene.pixels))
    xyz[150:153] = xyz[149]
    assert [f.kind for f in point_findings(points_of(xyz, scene.pixels))] == ["repeated frames"] * (reach_m > 0.1)


def test_points_left_in_a_corner_were_not_copied():
    """Who digitises leaves hidden points at one place of the picture, in both films; tracks that move are named."""
    scene = clean()
    uv = scene.pixels.uv_px.copy()
    uv[:2, 100:250, 2:4] = [3.0, 5.0]
    assert not [f for f in pixel_findings(replace(scene.pixels, uv_px=uv)) if f.kind == "copied pixels"]
    uv[1, 100:250, 2:4] = uv[0, :150, :2]
    uv[0, 100:250, 2:4] = uv[0, :150, :2]
    (found,) = [f for f in pixel_findings(replace(scene.pixels, uv_px=uv)) if f.kind == "copied pixels"]
    assert found.cameras == scene.pixels.cameras[:2]


def test_a_film_that_two_people_digitised_was_not_copied():
    """The calibration of one camera twice: that its points come from one camera is said, too."""
    first, *others = clean().cameras
    (found,) = camera_findings((first, replace(first, name="again"), *others), y_up=False)
    assert "both are tracks of one camera" in found.text


@pytest.mark.parametrize("how", ["smoothed", "rounded", "of least reprojection error", "repeated", "at rest"])
def test_points_computed_otherwise_are_no_swapped_shifted_or_half_solved_ones(how):
    """Nor are those of an animal that does the same again, or nothing: every shift in time fits these."""
    scene = clean(2)
    uv = scene.pixels.uv_px.copy()
    if how == "repeated":
        uv = np.tile(uv[:, :30], (1, 10, 1, 1))
    elif how == "at rest":
        uv = np.tile(uv[:, :1], (1, 300, 1, 1)) + np.random.default_rng(3).normal(0, 0.5, uv.shape)
    pixels = replace(scene.pixels, uv_px=uv)
    matrices, ideal = stacked(scene.cameras), undistorted(scene.cameras, uv)
    xyz = linear(matrices, ideal)
    stored = {
        "smoothed": lambda: 0.5 * xyz + 0.25 * (np.roll(xyz, 1, 0) + np.roll(xyz, -1, 0)),
        "rounded": lambda: np.round(xyz, 3),
        "of least reprojection error": lambda: refine(matrices, ideal, xyz, sd_px=0.5)[0],
    }.get(how, lambda: xyz + 1e-3)()
    found = stored_findings(matrices, ideal, points_of(stored, pixels), cameras=pixels.cameras)
    assert not {"wrong columns", "time shift", "one v row"} & {f.kind for f in found}


def test_a_camera_that_hangs_upside_down_is_not_mirrored():
    """Its picture is turned by half a circle, which is no reflection; one that films in a mirror may be right."""
    turned = np.array([[-1.0, 0, 1280], [0, -1, 1024], [0, 0, 1]])
    first, *others = clean(lens=False).cameras
    assert camera_findings([replace(first, matrix=turned @ first.matrix), *others], y_up=False) == []
    mirror = np.array([[-1.0, 0, 1280], [0, 1, 0], [0, 0, 1]])
    (found,) = camera_findings([replace(first, matrix=mirror @ first.matrix), *others], y_up=False)
    assert "right if one films in a mirror" in found.text


def test_a_busy_computer_is_no_damaged_file(tmp_path, monkeypatch):
    """A reader that had no time says so; one that is ended by its library says that."""
    path = tmp_path / "a.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    monkeypatch.setattr(subprocess, "run", lambda *_, timeout, **__: (_ for _ in ()).throw(TimeoutExpired("", timeout)))
    with pytest.raises(FormatError, match=r"a\.h5: was not read as HDF5 within \d+ s: try again"):
        read(path)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: CompletedProcess("", -11, b"", b""))
    with pytest.raises(FormatError, match=r"a\.h5: the library that reads HDF5 crashed on it"):
        read(path)
