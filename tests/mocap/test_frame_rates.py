"""A frame rate that is not the camera's: told where the number is odd, an alarm where the motion contradicts it."""

import numpy as np
import pytest
from mocap.datasets import make_bat

import mocap
from mocap.audit.rate import cycle_frames, rate_findings
from mocap.findings import Kind
from tests.real_data import real

MADE = make_bat(seed=1)
XYZ = MADE.truth.xyz_m
"""Beats take 27 frames at 240 a second."""


def test_a_cycle_is_found_in_frames_with_gaps_and_noise():
    """Beats of 27 frames, also where a third is missing; none in a random walk, nor in an animal that stands still."""
    rng = np.random.default_rng(0)
    assert cycle_frames(XYZ) == pytest.approx(27, abs=1)
    holes = np.where(rng.random(XYZ.shape[:2])[..., None] < 1 / 3, np.nan, XYZ)
    assert cycle_frames(holes + rng.normal(0, 1e-3, XYZ.shape)) == pytest.approx(27, abs=1)
    assert np.isnan(cycle_frames(np.cumsum(rng.normal(0, 1e-3, (300, 6, 3)), axis=0)))
    assert np.isnan(cycle_frames(XYZ[:1] + rng.normal(0, 1e-4, (300, XYZ.shape[1], 3))))
    assert np.isnan(cycle_frames(XYZ[:5]))


@pytest.mark.parametrize(
    ("fps", "slower", "told"),
    [(240.0, 1, None), (25.0, 1, False), (25.0, 3, True), (24.0, 3, True), (400.0, 3, None)],
)
def test_the_motion_contradicts_a_rate_of_playback(fps, slower, told):
    """Beats in 27 frames at 25 a second are 0.93 Hz, near what a pendulum of 0.3 m does; in 81 they are too slow."""
    xyz = np.repeat(XYZ, slower, axis=0)
    found = rate_findings(xyz, fps, playback=True)
    assert [one.alarm for one in found] == ([] if told is None else [told])
    assert all(one.kind is Kind.FRAME_RATE and one.mends == ("fps",) for one in found)
    assert not rate_findings(xyz, fps, playback=False)


def test_a_rate_that_replaces_another_is_told():
    """As stated, and what the file states; nothing where both are one."""
    (one,) = rate_findings(XYZ, 700.0, playback=False, in_file=25.56)
    assert not one.asks
    assert "25.56" in one.text
    assert not rate_findings(XYZ, 700.0, playback=False, in_file=700.0)


@pytest.mark.rare
@pytest.mark.parametrize(("flight", "alarm"), [("F2", True), ("F5", False)])
def test_one_flight_by_itself_shows_its_rate_of_playback(flight, alarm):
    """The project that states 25.56: beats of 0.4 Hz; one that states 700: 9 Hz, and no word. Both are mirrored."""
    (path,) = real("bat_windtunnel_dltdv8", "078A3", flight).glob("*dvProject.mat")
    found = mocap.clean(mocap.read(path)).findings
    assert [one.mends for one in found if one.kind is Kind.FRAME_RATE] == ([("fps",)] if alarm else [])
    assert any(one.kind is Kind.FRAME_RATE and one.alarm for one in found) == alarm
    (mirrored,) = (one for one in found if one.kind is Kind.MIRRORED_WORLD)
    assert mirrored.alarm
    assert mirrored.mends == ("calibration",)
