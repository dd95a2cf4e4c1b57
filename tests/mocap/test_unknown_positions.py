"""Positions of which nothing is known are left empty and told, those that are known stay: gaps short and long."""

import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat
from mocap.filters.hide import GAP_FRAMES, length_bins
from mocap.filters.models.constant_velocity import MarkerSettings
from mocap.filters.observations import PositionObservations
from mocap.filters.track import REMEMBERED, forgotten, smooth

import mocap
from eal.arrays import Z95
from mocap.cleaning.cleaning import clean
from mocap.io.unstated_unit import length
from mocap.plots.animal import _phases
from mocap.recording import of_points
from mocap.records import Status, marker_tracks
from mocap.report.job import unknown_positions
from mocap.report.report import own_gap_samples
from mocap.skeleton import Skeleton
from mocap.tracking.tracking import learn_motion, seen_part, track, unknown_samples, with_track

T, M = 60, 6
X = np.random.default_rng(1).normal(size=(1, M, 3)) + 0.01 * np.random.default_rng(0).standard_normal((T, M, 3))
MEASURED, SMOOTHED = int(Status.MEASURED), int(Status.SMOOTHED)


def codes():
    """All measured but marker 0 in frames 20 to 39."""
    origin = np.full((T, M), MEASURED)
    origin[20:40, 0] = SMOOTHED
    return origin


def test_a_gap_is_empty_where_its_interval_is_as_wide_as_the_animal():
    """Standard deviations on both sides of length / (2 x 1.96); measured samples stay however vague they are."""
    most = length(X) / (2 * Z95)
    sd = np.zeros((T, M))
    sd[20:30, 0], sd[30:40, 0], sd[:, 1] = 0.99 * most, 1.01 * most, 5 * most
    found = unknown_samples(X, sd, codes(), extent_m=np.nan)
    assert found[30:40, 0].all()
    assert found.sum() == 10


def test_errors_that_all_samples_share_do_not_count():
    """A depth that one camera knows to half of the animal: gaps whose deviation is hardly larger are kept."""
    sd = np.full((T, M), 0.5 * length(X))
    sd[20:40, 0] *= 1.05
    assert not unknown_samples(X, sd, codes(), extent_m=np.nan).any()


def test_few_markers_have_the_extent_of_their_motion():
    """Two points 2 mm apart on a path of a metre: a gap known to 10 mm is kept, one known to 0.5 m is not."""
    x, origin = np.zeros((T, 2, 3)), codes()[:, :2]
    x[:, :, 0] = np.linspace(0, 1, T)[:, None] + [0, 0.002]
    sd = np.zeros((T, 2))
    sd[20:30, 0], sd[30:40, 0] = 0.01, 0.5
    found = unknown_samples(x, sd, origin, extent_m=1.0)
    assert found[30:40, 0].all()
    assert found.sum() == 10


@pytest.mark.parametrize(("dark", "lost"), [(2 * REMEMBERED, 0), (2 * REMEMBERED + 7, 7)])
def test_a_motion_is_forgotten_in_the_middle_of_a_long_darkness(dark, lost):
    """What is at least as near to a sighting as the longest gap that models learn of is not; nor are the ends."""
    shown = np.ones(dark + 50, dtype=bool)
    shown[:15] = False
    shown[30 : 30 + dark] = False
    found = forgotten(shown)
    assert found.sum() == lost
    assert not found[:15].any()
    assert not found[30 : 30 + REMEMBERED].any()


def test_a_long_darkness_is_tracked_and_empty():
    """As if the two parts were two recordings: the same on both sides; in the middle nothing, and that is told."""
    film = make_bat(seed=2, n_frames=460, n_cameras=2, digitiser=PERFECT)
    names, rng = film.truth.names[:8], np.random.default_rng(0)
    xyz = film.truth.xyz_m[:, :8] + 3e-4 * rng.standard_normal((460, 8, 3))
    xyz[80:380] = np.nan
    cov = np.where(np.isfinite(xyz[..., :1, None]), 9e-8 * np.eye(3), np.nan)
    tracks = marker_tracks(names, film.truth.t_s, xyz, cov_m2=cov)
    recording = clean(of_points(tracks, Skeleton(name="some", markers=names), name="bat"))
    model = learn_motion(seen_part(recording), MarkerSettings())
    whole = with_track(recording, recording, "constant_velocity", track(recording, model))
    status, there = whole.tracks.status, np.isfinite(whole.tracks.xyz_m[..., 0])
    assert not there[80 + REMEMBERED : 380 - REMEMBERED].any()
    assert whole.data["unknown"].values[80 + REMEMBERED : 380 - REMEMBERED].all()
    assert (status[100 + REMEMBERED] == Status.MISSING).all()
    assert there[:82].all()
    assert there[-82:].all()
    alone = model.motion, PositionObservations(xyz_m=xyz[:80], sd_m=np.sqrt(cov[:80, :, 0, 0]))
    first = smooth(alone[0], alone[1], film.truth.t_s[:80])
    np.testing.assert_allclose(whole.tracks.xyz_m[:79], first.xyz_m[:79], atol=2e-4)


@pytest.mark.rare
def test_no_quantity_is_known_in_a_long_darkness():
    """Angles, speeds, the path of the body and joints: empty where positions are, and known on both sides."""
    film = make_bat(seed=2, n_frames=360, n_cameras=2, digitiser=PERFECT)
    skeleton, rng = film.skeleton, np.random.default_rng(0)
    xyz = film.truth.xyz_m + 3e-4 * rng.standard_normal(film.truth.xyz_m.shape)
    xyz[40:320] = np.nan
    recording = mocap.from_arrays(xyz, names=film.truth.names, fps=film.fps, unit="m", skeleton=skeleton)
    whole = mocap.track(recording, model="constant_velocity", validate=False)
    found, dark = whole.kinematics, slice(40 + REMEMBERED, 320 - REMEMBERED)
    lit = np.r_[5:35, 325:355]
    assert len(range(*dark.indices(360))) > 50
    for one in found.quantities:
        assert not np.isfinite(one.value[dark]).any(), one.name
        assert not np.isfinite(one.sd[dark]).any(), one.name
    for name in ("body_speed_m_s", "elbow_l_angle_deg", "wing_l_stroke_deg"):
        assert np.isfinite(found[name].value[lit]).mean() > 0.9, name
    assert not np.isfinite(whole.data["joint_world"].values[dark]).any()


def test_what_is_left_empty_is_told_once():
    """How many, and the frames of most; nothing where there are none."""
    assert unknown_positions(0, 100) == []
    (one,) = unknown_positions(30, 1000, [3, 10, 11, 12, 13, 20])
    assert one.text.startswith("30 positions are too uncertain")  # their share is in the table of samples
    assert "frames 10 to 13" in one.text
    assert not one.alarm


def test_samples_of_gaps_are_counted_by_their_length():
    """Gaps of 10, 11, 100 and 101 frames, each inside; what is before the first sighting is no gap."""
    assert [int(length_bins(np.array(n))) for n in (1, 10, 11, 25, 26, 50, 51, 100, 101)] == [0, 0, 1, 1, 2, 2, 3, 3, 4]
    origin = np.full((400, 1), MEASURED)
    origin[:7] = int(Status.PREDICTED)
    for start, frames in ((20, 10), (40, 11), (60, 100), (200, 101)):
        origin[start : start + frames] = SMOOTHED
    assert own_gap_samples(origin) == {"0": 10, "1": 11, "2": 0, "3": 100, "4": 101}
    assert len(GAP_FRAMES) == 4


def test_poses_of_the_figure_were_measured():
    """Extremes of a motion lie in frames that were filled: the figure shows measured ones, and all where none is."""
    swing = np.sin(np.linspace(0, 20, T))[:, None, None] * np.linspace(-1, 1, M)[None, :, None] * [0, 0, 1.0]
    xyz = X[:1] + swing
    measured = np.ones((T, M), dtype=bool)
    xyz[30:40] *= 3
    measured[30:40] = False
    frames, _ = _phases(xyz, measured)
    assert len(frames) == 3
    assert measured[frames].all()
    assert len(_phases(xyz, np.zeros_like(measured))[0]) == 3
