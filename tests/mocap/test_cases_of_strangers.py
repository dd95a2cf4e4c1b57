"""Small files made after public ones that were once misread: what is right is stated beside each."""

import numpy as np
import pytest

import mocap
from mocap.io.format import Hints
from mocap.io.registry import read
from mocap.skeleton_files import read_skeleton
from tests.real_data import real

CASES = ("..", "cases", "strangers4")


def test_the_knee_of_a_leg_whose_hip_is_the_origin():
    """The angle in the plane of the swing, to the noise of the smoothed track; a proposal has the knee, too.

    Noise of 0.5 mm on bones of 0.25 m turns each by 0.12 degrees a sample, the angle between them by 0.28 degrees
    (0.12 sqrt(5), as the knee counts twice); what is smoothed errs by less than that.
    """
    path = real(*CASES, "02_origin_marker", "root_relative.csv")
    true = np.load(path.with_name("knee_angle_deg.npy"))
    recording = mocap.read(path, skeleton=read_skeleton(path.with_name("leg.toml")))
    assert (recording.data["position"].sel(keypoint="hip") == 0).all()
    tracked = mocap.track(recording, validate=False)
    position = tracked.markers["position"].transpose("time", "keypoint", "space", ...).to_numpy().reshape(-1, 3, 3)
    thigh, shank = position[:, 1] - position[:, 0], position[:, 2] - position[:, 1]
    angles = [np.arctan2(bone[:, 2], bone[:, 0]) for bone in (thigh, shank)]
    planar = 180 - np.abs(np.degrees(np.angle(np.exp(1j * (angles[0] - angles[1])))))
    assert np.sqrt(np.mean((planar - true) ** 2)) < 0.2
    bent = true < 170  # in space a straight knee is as far from 180 degrees as the markers leave the plane
    angle = tracked.kinematics["knee_angle_deg"].value
    assert np.sqrt(np.mean((angle - true)[bent] ** 2)) < 0.2
    (knee,) = mocap.propose_skeleton(mocap.read(path)).skeleton.joints
    assert (knee.name, knee.parent, knee.centre, knee.child) == ("knee", "hip", "knee", "ankle")


@pytest.mark.parametrize(
    ("case", "file", "format", "names", "frames", "fps"),
    [
        ("01_zero_throughout_with_residual", "residual.c3d", "c3d", 8, 120, 100),
        ("03_rounded_times", "wing.trc", "trc", 2, 100, 2000),
        ("04_index_column", "index_0_xypts.csv", "dltdv-xypts", 2, 60, None),
        ("05_sleap_analysis_csv", "one.analysis.csv", "sleap-csv", 3, 50, None),
    ],
)
def test_files_are_what_their_cases_state(case, file, format, names, frames, fps):
    """Format, markers, frames and rate; what is at the origin without having been seen is missing."""
    found = read(real(*CASES, case, file))
    assert (found.format, len(found.names), len(found.frames), found.fps) == (format, names, frames, fps)
    if format == "c3d":
        assert np.isnan(found.points.xyz_m[:, 5:]).all()
        assert np.isfinite(found.points.xyz_m[:, :5]).all()
        kept = read(real(*CASES, case, file), Hints(zero="position"))
        assert (kept.points.xyz_m[:, 5:] == 0).all()


def test_row_numbers_change_nothing():
    """The table behind row numbers is the table without them."""
    path = real(*CASES, "04_index_column", "index_0_xypts.csv")
    uv = [read(one).pixels.uv_px for one in (path, path.with_name("without_xypts.csv"))]
    np.testing.assert_array_equal(*uv)
