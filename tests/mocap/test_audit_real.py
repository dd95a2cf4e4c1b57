"""The audit on recordings that other people made with other programs."""

import numpy as np

from mocap.audit import alarms, audited, estimate_offsets
from mocap.audit.geometry import camera_findings, fit_findings
from mocap.cameras.camera import Camera, record, stacked, undistorted
from mocap.cameras.origin import decide_origin
from mocap.io.anipose import read_calibration
from mocap.io.dltdv import read_coefficients, read_points
from mocap.io.dvproject import read_project
from mocap.io.format import Hints
from mocap.io.registry import by_name
from mocap.records import PixelTracks
from tests.real_data import real

CAVE = "bat_cave_dltdv7"
TUNNEL = "bat_windtunnel_dltdv8"


def audit(pixels: PixelTracks, cameras: tuple[Camera, ...]):
    """Everything, with DLTdv's three iterations of undistortion."""
    decision = decide_origin(cameras, pixels.uv_px)
    ideal = decision.ideal(cameras, pixels.uv_px, iterations=3)
    return {f.kind: f for f in audited(cameras, pixels, ideal, decision).findings}


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
        project = read_project(real(TUNNEL, "078A3", folder, name)).with_rate(700)
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
