"""The audit on recordings that other people made with other programs."""

from pathlib import Path

import numpy as np
import pytest

from mocap.audit import alarms, audit_filmed, estimate_offsets
from mocap.audit.geometry import camera_findings, fit_findings
from mocap.cameras.camera import Camera, record, stacked, undistorted
from mocap.cameras.origin import decide_origin, ideal_pixels
from mocap.io.anipose import read_calibration
from mocap.io.dltdv import read_coefficients, read_pixels, read_points
from mocap.io.dvproject import read_project
from mocap.io.format import Hints
from mocap.io.profile import with_profile
from mocap.io.registry import by_name
from mocap.records import MarkerTracks, PixelTracks
from tests.real_data import real

CAVE = "bat_cave_dltdv7"
TUNNEL = "bat_windtunnel_dltdv8"


def audit(pixels: PixelTracks, cameras: tuple[Camera, ...], stored: MarkerTracks | None = None):
    """Everything, with DLTdv's three iterations of undistortion."""
    decision = decide_origin(cameras, pixels.uv_px)
    ideal = ideal_pixels(
        cameras,
        pixels.uv_px,
        pixels=decision.pixels,
        coefficients=decision.coefficients,
        height_px=decision.height_px,
        iterations=3,
    )
    return {f.kind: f for f in audit_filmed(cameras, pixels, ideal, decision, stored=stored)}


def tunnel(name: str, profile: bool) -> tuple[PixelTracks, tuple[Camera, ...], MarkerTracks]:
    """A trial of the wind tunnel as CSV files."""
    folder: Path = real(TUNNEL, "derived_csv", name)
    cameras = read_coefficients(folder / f"{name}_dltCoefs.csv")
    if profile:
        cameras = with_profile(cameras, folder / f"{name}_camera_profile.txt")
    pixels = read_pixels(folder / f"{name}_xypts.csv", fps=700)
    return pixels, cameras, read_points(folder / f"{name}_xyzpts.csv", fps=700)


def test_a_bats_stale_points_and_missing_lens():
    """078A3 F5: 8 of 3284 stored points are known to be stale (by up to 12 mm); its lenses were not applied.

    k1 of the four lenses, by the wand calibration of the same day: -0.12 to -0.15.
    """
    found = audit(*tunnel("078A3_F5", profile=False))
    assert found["stale points"].numbers["points"] == 8
    assert found["stale points"].numbers["most_m"] == pytest.approx(0.012, abs=0.0005)
    assert found["distortion"].alarm
    assert -0.17 < found["distortion"].numbers["k1"] < -0.1
    assert not found["mirrored world"].alarm  # nothing states the rows: the finding asks


def test_a_bat_with_lenses_in_a_mirrored_world():
    """FE404 F2: no stale point; lenses applied once; the world is left-handed, as its authors say."""
    found = audit(*tunnel("FE404_F2", profile=True))
    assert "stale points" not in found
    assert not found["distortion"].alarm
    assert found["mirrored world"].alarm


def test_a_late_camera_is_late_in_every_trial():
    """Two trials of one bat, clicked apart, agree on how late camera 1 is, within their stated deviations.

    Deviations are of independent estimates; three times their root sum of squares are exceeded once in 400.
    """
    trials = [
        ("F2", "carollia_2Apr2021_078A3m_trial2_dvProject.mat"),
        ("F3", "carollia_2April2021_078A3m_trial3_dvProject.mat"),
    ]
    found = []
    for folder, name in trials:
        project = read_project(real(TUNNEL, "078A3", folder, name), fps=700)
        assert project.cameras is not None
        ideal = undistorted(project.cameras, project.pixels.uv_px, iterations=3)
        estimate = estimate_offsets(stacked(project.cameras), ideal)
        assert estimate is not None
        found.append(estimate)
    a, b = found
    apart = np.abs(a.offset_frames - b.offset_frames) / np.hypot(a.sd_frames, b.sd_frames)
    assert apart.max() < 3
    assert a.offset_frames[0] > 10 * a.sd_frames[0]
    assert a.offset_frames[0] > 0.5


def test_cave_bats_follow_from_their_pixels():
    """All stored points of the cave follow from the pixels; the cameras run in step (25 Hz, one clock)."""
    pixels = read_pixels(real(CAVE, "P000_15000_bats", "DLTdv7_data_20180817-P000-15000xypts.csv"), fps=25)
    stored = read_points(real(CAVE, "P000_15000_bats", "DLTdv7_data_20180817-P000-15000xyzpts.csv"), fps=25)
    cameras = read_coefficients(real(CAVE, "P03_1000_speaker", "2018-08-17_wand_dltCoefs_round4.csv"))
    found = audit(pixels, cameras, stored)
    assert "stale points" not in found
    assert not found["camera offsets"].alarm
    assert found["distortion"].alarm  # -0.28 to -0.29 in the wand calibration of the other night
    assert -0.35 < found["distortion"].numbers["k1"] < -0.15


def test_the_broken_mouse_calibration_is_called_out():
    """The shipped calibration has camera ``side`` as a copy of ``top``, and the labels of ``side`` do not fit it."""
    cameras = read_calibration(real("mouse_charuco_4cam", "calibration.toml"))
    copied = {f.kind: f for f in camera_findings(cameras, y_up=False)}
    assert copied["copied cameras"].cameras == ("side", "top")
    tracks = []
    for camera in cameras:
        path = real("mouse_charuco_4cam", camera.name, f"minimal_{camera.name}_proofread.analysis.h5")
        recording = by_name("sleap-analysis").read(path, Hints())
        assert recording.pixels is not None
        tracks.append(recording.pixels.uv_px[0])
    ideal = undistorted(cameras, np.stack(tracks))
    found = fit_findings(cameras, ideal)
    assert [f.cameras for f in alarms(found)] in ([("side",)], [tuple(c.name for c in cameras)])


def test_our_own_pictures_of_real_cameras_are_clean():
    """Points seen again through the real rig of the cave, without its distortion: nothing is wrong, nor found."""
    cameras = read_coefficients(real(CAVE, "P03_1000_speaker", "2018-08-17_wand_dltCoefs_round4.csv"))
    stored = read_points(real(CAVE, "P000_15000_bats", "DLTdv7_data_20180817-P000-15000xyzpts.csv"), fps=25)
    uv = record(cameras, stored.xyz_m) + np.random.default_rng(2).normal(0, 0.3, (3, *stored.xyz_m.shape[:2], 2))
    pixels = PixelTracks(names=stored.names, cameras=("a", "b", "c"), t_s=stored.t_s, uv_px=uv)
    assert not [f.text for f in audit(pixels, cameras).values() if f.alarm]
