"""Positions without a unit: the length of the animal is told, and a unit guessed only where one alone makes it one."""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets import make_bat, write_recording

import mocap
from mocap.cameras.camera import decompose, project, stacked
from mocap.cleaning.cleaning import clean
from mocap.cli.main import main
from mocap.errors import FormatError
from mocap.findings import Kind
from mocap.io.dltdv import write_coefficients
from mocap.io.registry import read
from mocap.io.unstated_unit import XRAYED_M, guessed, in_metres, length, of_cameras
from tests.real_data import real


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def table(path, xyz):
    """Positions as a table with titles and no unit."""
    titles = [f"m{m}_{axis}" for m in range(xyz.shape[1]) for axis in "xyz"]
    rows = [",".join("" if np.isnan(v) else repr(float(v)) for v in row.ravel()) for row in xyz]
    path.write_text("\n".join([",".join(titles), *rows, ""]))
    return path


def test_the_length_is_the_median_of_the_greatest_distance(rng):
    """As all pairs by brute force have it, with markers missing here and there."""
    xyz = rng.normal(size=(200, 6, 3))
    xyz[rng.random((200, 6)) < 0.3] = np.nan
    apart = np.linalg.norm(xyz[:, :, None] - xyz[:, None], axis=-1)
    two = np.isfinite(xyz[..., 0]).sum(axis=1) >= 2
    want = np.median(np.nanmax(apart[two], axis=(1, 2)))
    np.testing.assert_allclose(length(xyz), want, rtol=1e-12)


def test_the_length_of_one_marker_is_its_way(rng):
    """One marker has no length; how far it gets about stands for it. Of nothing it is not known."""
    xyz = rng.normal(size=(50, 1, 3))
    np.testing.assert_allclose(length(xyz), np.linalg.norm(xyz.max(axis=(0, 1)) - xyz.min(axis=(0, 1))))
    assert np.isnan(length(np.full((5, 3, 3), np.nan)))


@pytest.mark.parametrize("size_m", [0.003, 0.02, 0.15, 0.5, 1.0, 1.8, 5.0])
def test_metres_stay_and_millimetres_are_found(size_m):
    """From a fly to an elephant in metres, and from 20 mm on in millimetres: both are what they are."""
    assert guessed(size_m) == "m"
    assert guessed(1e3 * size_m) == ("mm" if size_m > 0.02 else "m")


@pytest.mark.parametrize(("long", "unit"), [(6.84, "cm"), (68.4, "mm"), (0.0684, "m"), (1e3, None)])
def test_what_x_rays_show_is_in_centimetres(long, unit):
    """A jaw of 68.4 mm, in each unit; nothing of a metre fits between a source and its image intensifier."""
    assert guessed(long, bounds_m=XRAYED_M) == unit


@pytest.mark.parametrize("size_m", [0.05, 0.34, 0.6, 1.8, 5.0])
def test_what_cannot_be_metres_is_millimetres(tmp_path, size_m):
    """Animals of 50 to 600 mm too: told before all else, with the other lengths; what is stated wins."""
    bat = make_bat(seed=3, n_frames=30, n_cameras=3).truth.xyz_m
    xyz = bat * size_m / length(bat)
    path = table(tmp_path / "x.csv", 1e3 * xyz)
    source = mocap.read(path, fps=100)
    said = str(source.findings[0])
    assert said.startswith("NO UNIT IS STATED: lengths are assumed to be in mm, so that the animal is ")
    assert re.search(r"state the unit: m if it is [\d.e+]+ k?m long, cm if it is [\d.e+]+ m*m long", said)
    np.testing.assert_allclose(source.points.xyz_m, xyz, rtol=1e-12)
    stated = mocap.read(path, fps=100, unit="cm")
    assert not any("unit" in finding.text.lower() for finding in stated.findings)
    np.testing.assert_allclose(stated.points.xyz_m, 10 * xyz, rtol=1e-12)


@pytest.mark.parametrize("factor", [1e6, 1e-6])
def test_no_unit_makes_it_an_animal(tmp_path, factor):
    """A bat of 340 km, or of 340 nm, is refused, with its length in every unit; a stated one is believed."""
    path = table(tmp_path / "x.csv", factor * make_bat(seed=3, n_frames=30, n_cameras=3).truth.xyz_m)
    with pytest.raises(FormatError, match=r"no unit is stated, and none makes the animal one: .* state `unit`"):
        mocap.read(path, fps=100)
    assert mocap.read(path, fps=100, unit="um").data.attrs["space_unit"] == "um"


def test_noise_that_no_cameras_have(tmp_path, rng):
    """A bee in millimetres is as long as a lorry in metres; what jitters by decimetres is in no metres."""
    bee = 0.012 * rng.normal(size=(1, 5, 3)) / 3 + np.linspace(0, 0.5, 200)[:, None, None]
    path = table(tmp_path / "x.csv", 1e3 * (bee + rng.normal(size=bee.shape) * 2e-4))
    said = str(mocap.read(path, fps=100).findings[0])
    assert said.startswith("NO UNIT IS STATED: lengths are assumed to be in mm")


def test_metres_are_told_once_and_quietly(tmp_path):
    """An animal of usual length in metres: its length, and no alarm."""
    bat = make_bat(seed=3, n_frames=30, n_cameras=3).truth.xyz_m
    source = mocap.read(table(tmp_path / "x.csv", bat), fps=100)
    assert str(source.findings[0]) == (
        f"no unit is stated: lengths are assumed to be in metres, so that the animal is {1e3 * length(bat):.3g} mm long"
    )


@pytest.mark.parametrize("title", ["{} x (mm)", "{}_{} [mm]", "{} {}_mm"])
def test_a_unit_in_the_titles_is_stated(tmp_path, title):
    """Coordinates that all have the same unit in their titles have it."""
    title = title.replace("x", "{}")
    path = tmp_path / "x.csv"
    path.write_text(",".join(["frame", *(title.format("tip", axis) for axis in "xyz")]) + "\n1,1000,2000,3000\n")
    recording = read(path)
    assert (recording.unit, recording.names) == ("mm", ("tip",))
    np.testing.assert_allclose(recording.points.xyz_m, [[[1, 2, 3]]])


def test_real_recordings_whose_unit_is_known():
    """A mouse in millimetres is told of; bats in metres are bats; what states its unit is not doubted."""
    said = in_metres(read(real("mouse_charuco_4cam", "points3d.h5")))[1]
    assert len(said) == 1
    assert said[0].alarm
    assert said[0].text.startswith(
        "NO UNIT IS STATED: lengths are assumed to be in mm, so that the animal is 153 mm long"
    )
    for folder in ("xmalab_pig", "xromm_macaque_jaw"):
        recording, said = in_metres(read(real(folder, "3dpts.csv")))
        assert said[0].alarm
    assert said[0].text.startswith(
        "NO UNIT IS STATED: lengths are assumed to be in cm, so that the animal is 68.4 mm long"
    )
    folder = real("bat_windtunnel_dltdv8", "derived_csv")
    for path in sorted(folder.rglob("*_xyzpts.csv")):
        recording, said = in_metres(read(path))
        assert recording.unit is None
        assert len(said) == 1
        assert "lengths are assumed to be in metres, so that the animal is" in said[0].text
    assert in_metres(read(real("snake_gap_vicon", "040_Snake94_gap02_3.csv")))[1] == ()


def test_a_calibration_in_millimetres(tmp_path):
    """Coefficients whose unit nobody states are those of metres: a bat of a hundred metres is told of, first of all."""
    bat = make_bat(seed=3, n_frames=40, n_cameras=3)
    files = write_recording(bat, tmp_path)
    calibration = read(files["coefficients"])
    in_mm = [replace(c, matrix=c.matrix @ np.diag([1e-3, 1e-3, 1e-3, 1.0])) for c in calibration.cameras]
    write_coefficients(tmp_path / "mm.csv", in_mm)
    files |= {"coefficients": tmp_path / "mm.csv"}

    def prepared(unit, name="coefficients"):
        source = mocap.read(files["pixels"], fps=100, calibration=files[name], profile=files["profile"], unit=unit)
        return clean(source)

    assumed, stated = prepared(None), prepared("mm")
    assert assumed.findings[0].text.startswith(
        "NO UNIT IS STATED: lengths are assumed to be in mm, so that the animal is "
    )
    assert not [finding for finding in stated.findings if finding.kind == Kind.ASSUMED_UNIT]
    np.testing.assert_allclose(assumed.xyz_m, stated.xyz_m)
    np.testing.assert_allclose(length(assumed.xyz_m), length(bat.truth.xyz_m), rtol=0.05)  # without hidden tips


def test_a_calibration_whose_unit_nobody_states(tmp_path):
    """A bat in metres: its length, quietly, first of all; from 30 km away, loudly."""
    bat = make_bat(seed=3, n_frames=40, n_cameras=3)
    files = write_recording(bat, tmp_path)
    source = mocap.read(files["pixels"], fps=100, calibration=files["coefficients"], profile=files["profile"])
    quiet = [str(finding) for finding in clean(source).findings if not finding.alarm]
    assert re.match(r"no unit is stated: lengths are assumed to be in metres, .* is \d+ mm long$", quiet[0])
    matrices = stacked(bat.cameras)
    k = np.array([np.linalg.inv(decompose(c).intrinsic) for c in bat.cameras])
    back = np.einsum("cij,cjk->cik", k, matrices)
    back[:, 2, 3] += 3e4  # far away, by a lens as long
    far = np.einsum("cij,cjk->cik", np.linalg.inv(k) @ np.diag([1e4, 1e4, 1.0]), back)
    _, said = of_cameras(far, project(far, bat.truth.xyz_m), where="x")
    assert said[0].alarm
    assert said[0].text.startswith("NO UNIT IS STATED")
    assert "filmed from 30 km to 30 km away" in said[0].text


def test_info_tells_it_too(tmp_path, monkeypatch, capsys):
    """The finding stands among the first of ``mocap info``."""
    bat = make_bat(seed=3, n_frames=30, n_cameras=3).truth.xyz_m
    path = table(tmp_path / "x.csv", 1e3 * bat)
    monkeypatch.setattr(sys, "argv", ["mocap", "info", str(path), "--json"])
    with pytest.raises(SystemExit):
        main()
    assert json.loads(capsys.readouterr().out)["findings"][0].startswith("NO UNIT IS STATED")


def test_how_a_text_was_read_begins_the_report(tmp_path):
    """Decimal commas and semicolons are told where the recording is tracked, not only by ``mocap info``."""
    path = tmp_path / "x.csv"
    path.write_text("a_x;a_y;a_z\n0,1;0,2;0,3\n0,2;0,2;0,3\n")
    said = mocap.read(path, fps=10).findings
    assert any("numbers have decimal commas: 0,1 is read as 0.1" in finding.text for finding in said[:2])
