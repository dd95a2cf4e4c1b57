"""Each threshold of the audit and of cameras, with a case just below and one just above it."""

from dataclasses import replace

import numpy as np
import pytest

from mocap.audit.geometry import lens_findings
from mocap.audit.offsets import Offsets, late_cameras
from mocap.audit.samples import jump_findings, point_findings, sizes, usual_speed
from mocap.audit.stored import stale_points
from mocap.cameras.arrangement import find_arrangement, groups
from mocap.cameras.camera import record
from mocap.cameras.origin import PixelOrigin
from mocap.records import marker_tracks
from tests.mocap.rigs import cloud, ring


@pytest.mark.parametrize(
    ("offset", "sd", "late"), [(0.08, 1e-3, False), (0.12, 1e-3, True), (0.35, 0.1, False), (0.45, 0.1, True)]
)
def test_a_camera_is_late_by_a_tenth_of_a_frame_and_four_deviations(offset, sd, late):
    """One of three cameras; of normal errors four deviations are one in 16,000."""
    found = Offsets(
        offset_frames=np.array([0.0, 0.0, offset]), sd_frames=np.full(3, sd), before_px=1.0, after_px=1.0, samples=100
    )
    assert (late_cameras(found) > 0).tolist() == [False, False, late]


@pytest.mark.parametrize(("off_m", "stale"), [(1.7e-6, 0), (2.3e-6, 1)])
def test_a_stored_point_is_stale_beyond_its_print(off_m, stale):
    """Twice the last digit that files print, a micrometre."""
    stored = np.zeros((1, 1, 3))
    tracks = marker_tracks(("a",), np.zeros(1), stored)
    assert len(stale_points(stored + np.array([off_m, 0, 0]), tracks)) == stale


@pytest.mark.parametrize(("size_m", "found"), [(4e-4, 1), (6e-4, 0), (36.0, 0), (44.0, 1)])
def test_animals_are_from_half_a_millimetre_to_forty_metres(size_m, found):
    """Two markers so far from each other, in three frames."""
    assert len(sizes(np.tile([[0.0, 0, 0], [size_m, 0, 0]], (3, 1, 1)))) == found


def walking(n_frames=1200):
    """Two markers, a metre from each other, that walk by 1.01 mm a frame; and their times."""
    t_s = np.arange(n_frames) / 100
    path = 0.101 * t_s[:, None, None] * [1.0, 0, 0]
    return path + np.array([[0.0, 0, 0], [0.0, 1.0, 0]]), t_s


def test_the_usual_speed_is_half_more_than_the_fastest_steps():
    """All steps are alike: their 99.9 % quantile is their speed."""
    assert usual_speed(*walking()) == pytest.approx(1.5 * 0.101)


@pytest.mark.parametrize(("share", "found"), [(0.08, 0), (0.12, 1)])
def test_a_jump_goes_a_tenth_of_the_way_to_another_marker(share, found):
    """Shorter ones are soft tissue and noise."""
    xyz, t_s = walking()
    xyz[600:, 0, 1] -= share
    assert len(jump_findings(xyz, t_s, ("a", "b"))) == found


@pytest.mark.parametrize(("samples", "found"), [(2, 0), (3, 1)])
def test_three_samples_before_a_jump_tell_it_from_a_click(samples, found):
    """The jump is by half of the way to the other marker, at the beginning of the track."""
    xyz, t_s = walking()
    xyz[:samples, 0, 1] += 0.5
    assert len(jump_findings(xyz, t_s, ("a", "b"))) == found


@pytest.mark.parametrize(("slow", "found"), [(1, 1), (2, 0)])
def test_repeats_stand_between_steps_of_usual_length(slow, found):
    """One of two steps after them, of which the first ones are slow."""
    rng = np.random.default_rng(0)
    step = rng.uniform(0.9, 1.1, (100, 3))
    step[49], step[50 : 50 + slow] = 0.0, 0.1
    xyz = np.cumsum(step, axis=0)[:, :, None] * [1e-2, 0, 0] + rng.uniform(0, 0.3, (3, 3))
    tracks = marker_tracks(("a", "b", "c"), np.arange(100) / 100, xyz)
    assert [f.kind for f in point_findings(tracks)] == ["repeated frames"] * found


@pytest.mark.parametrize(("shared", "together"), [(7, []), (8, [[0, 1]])])
def test_cameras_that_share_eight_points_are_judged_together(shared, together):
    """Of two cameras of many points."""
    seen = np.ones((2, 40), dtype=bool)
    seen[0, shared:20] = seen[1, 20:] = False
    seen[1, shared:20], seen[0, 20:] = True, True
    assert groups(seen) == together


def upside_down(radius_m, noise_px):
    """What is found of three cameras, one of which films upside down, and a cloud so near to its middle."""
    rng = np.random.default_rng(4)
    cameras = ring(3)
    uv = record(cameras, cloud(rng, 60, radius_m=radius_m)[None])
    uv += noise_px * rng.standard_normal(uv.shape)
    uv[0, ..., 1] = 1024 - uv[0, ..., 1]
    return find_arrangement(cameras, uv)


@pytest.mark.parametrize(
    ("radius_m", "noise_px", "found"),
    [(0.0105, 0.0, False), (0.0155, 0.0, True), (0.0205, 2.5, False), (0.028, 2.5, True)],
)
def test_a_change_is_named_from_three_pixels_and_three_times_as_near(radius_m, noise_px, found):
    """Rays miss by 230 px for each metre of the cloud: 2.4 and 3.6 px; with noise 2.7 and 3.6 times what it leaves."""
    assert (upside_down(radius_m, noise_px) is not None) == found


def test_a_lens_is_clearly_wrong_from_a_fifth_more_residual():
    """Pixels without distortion, and profiles of ever more: an alarm where they fit 1.2 times as ill."""
    rng = np.random.default_rng(0)
    uv = record(ring(4), cloud(rng, 200).reshape(50, 4, 3))
    uv += rng.normal(0, 0.5, uv.shape)
    as_is = PixelOrigin(
        pixels="upper-left",
        coefficients="upper-left",
        stated=True,
        matters=True,
        height_px=None,
        residual_px=1.0,
        next_px=np.inf,
    )
    told = []
    for share in np.geomspace(0.5, 10, 16):
        cameras = [
            replace(c, lens=replace(c.lens, k=(share * c.lens.k[0], 0.0, 0.0), p=(0.0, 0.0)))
            for c in ring(4, lens=True)
        ]
        (found,) = lens_findings(cameras, uv, as_is)
        told.append((found.numbers["once_px"] / found.numbers["not_at_all_px"], found.alarm))
    assert any(1.05 < ratio < 1.2 for ratio, _ in told)
    assert any(1.2 < ratio < 1.5 for ratio, _ in told)
    assert all(alarm == (ratio > 1.2) for ratio, alarm in told)
