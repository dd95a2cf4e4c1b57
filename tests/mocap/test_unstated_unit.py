"""Positions without a unit: the length of the animal is told, and a unit guessed only where one alone makes it one."""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets import make_bat, write_recording

from mocap.cli.main import main
from mocap.io.dltdv import write_coefficients
from mocap.io.registry import read
from mocap.io.unstated_unit import guessed, in_metres, length
from mocap.pipeline.prepare import prepare
from mocap.pipeline.recording import Recording
from tests.real_data import real

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


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
@pytest.mark.parametrize("unit", UNITS)
def test_a_guess_is_never_wrong_for_an_animal(size_m, unit):
    """From a fly to an elephant, in whatever unit: metres are kept, or the guess is the unit that it is in."""
    assert guessed(size_m / UNITS[unit]) in ("m", unit)


@pytest.mark.parametrize("size_m", [1.0, 1.8, 5.0])
def test_what_can_be_millimetres_only_is_read_so(tmp_path, size_m):
    """A person in millimetres would be 1.8 km in metres and 18 m in centimetres: a guess, stated before all else."""
    bat = make_bat(seed=3, n_frames=30, n_cameras=3).truth.xyz_m
    xyz = bat * size_m / length(bat)
    source = Recording(tracks=table(tmp_path / "x.csv", 1e3 * xyz), fps=100)
    assert source.frame_findings[0].startswith(
        "NO UNIT IS STATED: lengths are assumed to be in mm, so that the animal is "
    )
    np.testing.assert_allclose(source.contents.points.xyz_m, xyz, rtol=1e-12)


def test_what_no_metres_can_be_is_told_loudly(tmp_path):
    """A bat in millimetres may be one of centimetres: metres, with both lengths; the unit, if stated, ends it."""
    bat = make_bat(seed=3, n_frames=30, n_cameras=3).truth.xyz_m
    long = f"{1e3 * length(bat):.3g}"
    path = table(tmp_path / "x.csv", 1e3 * bat)
    source = Recording(tracks=path, fps=100)
    said = source.frame_findings[0]
    assert said.startswith(
        f"NO UNIT IS STATED: lengths are assumed to be in metres, so that the animal is {long} m long"
    )
    assert f"mm if it is {long} mm long" in said
    np.testing.assert_allclose(source.contents.points.xyz_m, 1e3 * bat, rtol=1e-12)
    stated = Recording(tracks=path, fps=100, unit="mm")
    assert not any("unit" in finding.lower() for finding in stated.frame_findings)
    np.testing.assert_allclose(stated.contents.points.xyz_m, bat, rtol=1e-12)


def test_noise_that_no_cameras_have(tmp_path, rng):
    """A bee in millimetres is as long as a lorry in metres; what jitters by decimetres is in no metres."""
    bee = 0.012 * rng.normal(size=(1, 5, 3)) / 3 + np.linspace(0, 0.5, 200)[:, None, None]
    path = table(tmp_path / "x.csv", 1e3 * (bee + rng.normal(size=bee.shape) * 2e-4))
    said = Recording(tracks=path, fps=100).frame_findings[0]
    assert said.startswith("NO UNIT IS STATED: lengths are assumed to be in metres")
    told = re.search(r"jitters by (\d+) mm", said)
    assert told is not None
    assert abs(int(told[1]) - 200) < 30  # 3000 fourth differences, each correlated with 4 others, tell it to 5 %


def test_metres_are_told_once_and_quietly(tmp_path):
    """An animal of usual length in metres: its length, and no alarm."""
    bat = make_bat(seed=3, n_frames=30, n_cameras=3).truth.xyz_m
    source = Recording(tracks=table(tmp_path / "x.csv", bat), fps=100)
    assert source.frame_findings[0] == (
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
    assert "is 153 m long" in said[0]
    assert "mm if it is 153 mm long" in said[0]
    folder = real("bat_windtunnel_dltdv8", "derived_csv")
    for path in sorted(folder.rglob("*_xyzpts.csv")):
        recording, said = in_metres(read(path))
        assert recording.unit is None
        assert len(said) == 1
        assert "lengths are assumed to be in metres, so that the animal is" in said[0]
    assert in_metres(read(real("snake_gap_vicon", "040_Snake94_gap02_3.csv")))[1] == ()


def test_a_calibration_in_millimetres(tmp_path):
    """Coefficients whose unit nobody states are those of metres: a bat of a hundred metres is told of, first of all."""
    bat = make_bat(seed=3, n_frames=40, n_cameras=3)
    files = write_recording(bat, tmp_path)
    calibration = read(files["coefficients"])
    in_mm = [replace(c, matrix=c.matrix @ np.diag([1e-3, 1e-3, 1e-3, 1.0])) for c in calibration.cameras]
    write_coefficients(tmp_path / "mm.csv", in_mm)
    files |= {"coefficients": tmp_path / "mm.csv"}

    def first(unit):
        source = Recording(
            tracks=files["pixels"], fps=100, calibration=files["coefficients"], profile=files["profile"], unit=unit
        )
        return prepare(source).findings[0]

    assert first(None).startswith("THE ANIMAL IS ")
    assert re.search(r"mm if it is \d+ mm long", first(None))
    assert not first("mm").startswith("THE ANIMAL")


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
    said = Recording(tracks=path, fps=10).frame_findings
    assert any("numbers have decimal commas: 0,1 is read as 0.1" in finding for finding in said[:2])
