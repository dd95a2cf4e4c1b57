"""A marker that jumps to another place is found and named; careless clicks and quick wings are not called jumps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mocap.datasets import make_bat, make_lizard

from mocap.audit import alarms, audited, jump_findings
from mocap.audit.file_audit import audit_recording
from mocap.cameras.camera import record, undistorted
from mocap.cameras.origin import PixelOptions, decide_origin
from mocap.cleaning.cleaned import Cleaned
from mocap.cleaning.cleaning import clean
from mocap.io.contents import FileContents
from mocap.recording import of_points
from mocap.records import Status, marker_tracks
from mocap.skeleton import Skeleton
from mocap.tracking.tracking import jump_cov


def alarms_of(twin, uv):
    """Alarms of a twin with other pixels."""
    decision = decide_origin(twin.cameras, uv, PixelOptions(origin="upper-left", calibration_origin="upper-left"))
    pixels = replace(twin.pixels, uv_px=uv)
    return alarms(audited(twin.cameras, pixels, undistorted(twin.cameras, uv), decision).findings)


@pytest.mark.parametrize("hole", [0, 1, 4])
def test_a_jump_in_a_hole_is_found(hole):
    """From frame 100 on one marker of a bat is clicked 203 mm away, after a hole of so many frames; also in 3D alone.

    At 240 frames a second that is faster than 1.5 times the 99.9 % quantile (11 m/s) over up to 4 frames.
    """
    twin = make_bat(seed=5, n_frames=200)
    marker = twin.pixels.names.index("elbow_l")
    xyz = np.array(twin.truth.xyz_m)
    way = np.array([0.203, 0.0, 0.0]) if hole < 4 else np.array([0.6, 0.0, 0.0])
    xyz[100:, marker] += way
    uv = np.array(twin.pixels.uv_px)
    uv[:, :, marker] += (record(twin.cameras, xyz) - record(twin.cameras, twin.truth.xyz_m))[:, :, marker]
    uv[:, 100 - hole : 100, marker] = np.nan
    xyz[100 - hole : 100, marker] = np.nan
    for found in (
        [f for f in alarms_of(twin, uv) if f.kind == "jump"],
        jump_findings(xyz, twin.pixels.t_s, twin.pixels.names),
    ):
        (one,) = found
        assert one.markers == ("elbow_l",)
        assert one.frames == (100 - hole, 101)
        assert one.numbers["length"] == pytest.approx(np.linalg.norm(way), abs=0.05)


@pytest.mark.rare
def test_without_a_frame_rate_steps_are_told_per_frame():
    """No metres per second that nobody knows: in 3D and in calibrated pixels."""
    twin = make_bat(seed=5, n_frames=200)
    names = twin.truth.names
    xyz = np.array(twin.truth.xyz_m)
    xyz[100:, names.index("elbow_l")] += [0.203, 0.0, 0.0]
    points = marker_tracks(names, np.arange(200.0), xyz)
    uv = record(twin.cameras, xyz)
    pixels = replace(twin.pixels, t_s=np.arange(200.0), uv_px=uv)
    shared = {"format": "x", "paths": (Path("x"),), "names": names, "frames": np.arange(200), "fps": None}
    cameras = {"pixels": pixels, "cameras": twin.cameras, "camera_names": twin.pixels.cameras}
    stated = PixelOptions(origin="upper-left", calibration_origin="upper-left")
    for parts in ({"points": points}, cameras):
        contents = FileContents(**shared, **parts)
        for rate, told, not_told in ((None, " mm per frame", "m/s"), (240.0, " m/s", "per frame")):
            found = audit_recording(contents if rate is None else contents.with_rate(rate), stated)
            (text,) = (f.text for f in found if f.kind == "jump")
            assert told in text
            assert not_told not in text


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_single_clicks_are_not_jumps(make):
    """1 % of clicks off by 80 px in a whole flight and a whole walk: careless, no marker has jumped."""
    twin = make(seed=6, n_frames=250)
    rng = np.random.default_rng(1)
    uv = np.array(twin.pixels.uv_px)
    wrong = rng.random(uv.shape[:3]) < 0.01
    uv[wrong] += rng.choice([-80.0, 80.0], (wrong.sum(), 2))
    assert not [f.text for f in alarms_of(twin, uv) if f.kind == "jump"]


def test_a_gap_across_a_jump_is_not_filled_with_confidence():
    """203 mm in a gap of one frame: both places are inside two deviations there, and nothing else is widened."""
    bat = make_bat(seed=5, n_frames=200)
    names, xyz = bat.truth.names, np.array(bat.truth.xyz_m)
    marker = names.index("elbow_l")
    xyz[100:, marker, 0] += 0.203
    xyz[99:100, marker] = np.nan
    prepared = clean(of_points(marker_tracks(names, bat.truth.t_s, xyz), Skeleton(name="bat", markers=names), name="a"))
    origin = np.where(np.isfinite(xyz[..., 0]), Status.MEASURED, Status.SMOOTHED).astype(np.int8)
    line = np.array([np.interp(np.arange(200), np.r_[:99, 100:200], np.delete(x, 99)) for x in xyz[:, marker].T])
    filled = xyz.copy()
    filled[:, marker] = line.T
    sd = np.sqrt(np.diagonal(jump_cov(prepared[Cleaned].jumps, filled, origin), axis1=-2, axis2=-1))
    before, after = bat.truth.xyz_m[99:100, marker], bat.truth.xyz_m[99:100, marker] + [0.203, 0, 0]
    for place in (before, after):
        assert (np.abs(filled[99:100, marker] - place)[:, 0] < 2 * sd[99:100, marker, 0]).all()
    sd[99:100, marker] = 0
    assert not sd.any()
