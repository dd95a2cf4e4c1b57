"""Points of two rays that meet by accident: refused by what the other markers and the motion say of them."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat
from mocap.filters.hidden_gaps import EACH_MARKER, Effort
from mocap.filters.models.pose import PoseSettings

from mocap.cameras.camera import record
from mocap.cleaning.cleaning import clean
from mocap.reading.ideal_pixels import of_pixels
from mocap.records import Status
from mocap.report.job import run_job
from mocap.skeleton import Skeleton
from mocap.tracking.blocks import track_block
from mocap.tracking.learning import learn_from
from mocap.tracking.tracking import seen_part, why_no_pose
from mocap.tracking.two_rays import continuing, disagreements, unconfirmed, without_contradicted, worth_checking
from tests.mocap.recordings import with_markers

LIMBS = ("shoulder", "elbow", "wrist", "d3_tip", "d5_tip", "ankle")
MARKERS = ("snout", "sternum", "back", "pelvis", "tail", *(f"{name}_{side}" for side in "lr" for name in LIMBS))
WRONG, RIGHT, T, FRAMES = "wrist_l", "wrist_r", 64, slice(22, 42)
SETTINGS = PoseSettings(ranks=(6,))


@pytest.fixture(scope="module")
def scene():
    """A bat in four cameras that see all of it, but for 20 frames in which both wrists are seen by two alone."""
    bat = flight(4)
    uv = clicked(bat)
    wrong, right = (bat.truth.names.index(name) for name in (WRONG, RIGHT))
    for marker in (wrong, right):
        uv[2:, FRAMES, marker] = np.nan
    return bat, replace(bat.pixels, uv_px=uv), (wrong, right)


def flight(seed):
    return with_markers(make_bat(seed=seed, n_frames=T, n_cameras=4, digitiser=PERFECT), MARKERS)


def clicked(bat):
    uv = record(bat.cameras, bat.truth.xyz_m)
    return uv + np.random.default_rng(1).normal(0, 0.5, uv.shape)


def prepared(bat, pixels):
    return clean(of_pixels(pixels, bat.cameras, Skeleton(name="bat", markers=pixels.names), name="bat"))


def along_first_ray(pixels, cameras, marker, truth, metres):
    """The second camera's clicks of a marker, on a point behind it that the first camera sees in the same pixel."""
    centre = -np.linalg.solve(cameras[0].matrix[:, :3], cameras[0].matrix[:, 3])
    away = truth[FRAMES, marker] - centre
    moved = truth.copy()
    moved[FRAMES, marker] += metres * away / np.linalg.norm(away, axis=1, keepdims=True)
    uv = pixels.uv_px.copy()
    uv[1, FRAMES, marker] = record(cameras[1:2], moved)[0, FRAMES, marker]
    return replace(pixels, uv_px=uv)


def test_two_rays_that_meet_at_a_wrong_place_are_refused(scene):
    """The second shows a place 15 mm behind the wrist: they meet, and no third ray tells. All 20 are refused.

    Of the right wrist, which two rays show where it is, 2 of 20 at most are refused.
    """
    bat, pixels, (wrong, right) = scene
    one = prepared(bat, along_first_ray(pixels, bat.cameras, wrong, bat.truth.xyz_m, 0.015))
    asked = unconfirmed(one)
    assert asked[FRAMES, wrong].mean() > 0.9
    assert asked[FRAMES, right].mean() > 0.9
    said = []
    checked = without_contradicted(one, progress=said.append)
    assert said == sorted(said)
    assert len(set(said)) > len(one.t_s)  # a frame at a time, not a pass
    assert (checked.rejected["contradicted"][FRAMES, wrong] == asked[FRAMES, wrong]).all()
    assert checked.rejected["contradicted"][FRAMES, right].sum() <= 2
    assert np.isnan(checked.xyz_m[FRAMES, wrong]).all()
    (told,) = [line for line in checked.findings if "two-camera points inconsistent with the motion" in line.text]
    assert told.numbers["samples"] == checked.rejected["contradicted"].sum()  # of all rounds together
    assert "wrist_l" in told.markers
    lost = np.isfinite(one.uv_px[..., 0]) & np.isnan(checked.uv_px[..., 0])
    assert lost[1, FRAMES, wrong].mean() > 0.9  # looked at again, the camera that is wrong is found
    lost[1, FRAMES, wrong] = False
    assert not lost.any()


def test_a_camera_that_shows_another_marker_is_found(scene):
    """The second camera shows another marker for 20 frames: all its rays are refused there, and no other ray is.

    The first camera's rays stay; points that both made where they met by accident are refused.
    """
    bat, pixels, (wrong, _) = scene
    uv = pixels.uv_px.copy()
    uv[1, FRAMES, wrong] = uv[1, FRAMES, bat.truth.names.index("elbow_l")] + np.random.default_rng(2).normal(
        0, 1, (20, 2)
    )
    one = prepared(bat, replace(pixels, uv_px=uv))
    seen = np.isfinite(one.uv_px[..., 0])
    (run,) = [run for run in disagreements(one) if run.marker == wrong]
    assert run.cameras == (0, 1)
    assert worth_checking(one)
    checked = without_contradicted(one)
    refused = seen & np.isnan(checked.uv_px[..., 0])
    expected = np.zeros_like(seen)
    expected[1, FRAMES, wrong] = seen[0, FRAMES, wrong] & seen[1, FRAMES, wrong]
    assert expected.sum() >= 15
    np.testing.assert_array_equal(refused, expected)
    np.testing.assert_array_equal(checked.rays_rejected, one.rays_rejected | expected)
    assert np.isnan(checked.xyz_m[FRAMES, wrong]).all()
    assert any("of two cameras that disagree" in line.text for line in checked.findings)


def test_nothing_is_refused_where_all_is_right(scene):
    """Two right rays each: 1 of 20 at most, and so few that they are not worth a pass of the filter."""
    bat, pixels, _ = scene
    one = prepared(bat, pixels)
    checked = without_contradicted(one)
    refused = np.isnan(checked.xyz_m[..., 0]) & np.isfinite(one.xyz_m[..., 0])
    assert unconfirmed(one).sum() > 30
    assert refused.sum() <= 2
    assert not disagreements(one)
    assert not worth_checking(one)


def test_two_cameras_have_no_third(scene):
    """Where there are two cameras in all every point is of two rays, and none is doubted for that."""
    bat, pixels, _ = scene
    two = replace(pixels, uv_px=pixels.uv_px[:2], cameras=pixels.cameras[:2])
    one = clean(of_pixels(two, bat.cameras[:2], Skeleton(name="bat", markers=two.names), name="bat"))
    assert not unconfirmed(one).any()


@pytest.mark.parametrize(("metres", "joins"), [(0.0, True), (0.015, False), (-0.03, False)])
def test_a_run_that_goes_on_from_where_the_marker_was_is_believed(scene, metres, joins):
    """Points near its ends, though a pose filter expects them 5 cm away; not where it jumps by 15 mm and back."""
    bat, pixels, (wrong, right) = scene
    one = prepared(bat, along_first_ray(pixels, bat.cameras, wrong, bat.truth.xyz_m, metres))
    asked, away_m = unconfirmed(one), np.full(one.xyz_m.shape[:2], np.nan)
    for marker in (wrong, right):
        frames = np.flatnonzero(asked[:, marker])
        away_m[frames[[0, 1, 2, -3, -2, -1]], marker] = 0.05
    found = continuing(one, asked, away_m)
    assert (found[np.isfinite(away_m[:, wrong]), wrong] == joins).all()
    assert found[np.isfinite(away_m[:, right]), right].all()
    assert not found[np.isnan(away_m)].any()


def test_a_wrong_point_amid_a_run_that_joins_is_not_believed(scene):
    """One click 3 cm off among right ones: the marker by itself, too, is expected elsewhere."""
    bat, pixels, (wrong, _) = scene
    one = prepared(bat, along_first_ray(pixels, bat.cameras, wrong, bat.truth.xyz_m, 0.0))
    asked = unconfirmed(one)
    frame = int(np.flatnonzero(asked[:, wrong])[1])
    xyz = one.xyz_m.copy()
    xyz[frame, wrong] += 0.03 / np.sqrt(3)
    away_m = np.full(asked.shape, np.nan)
    away_m[frame, wrong] = 0.03
    assert not continuing(one.having(position=xyz), asked, away_m).any()


@pytest.fixture(scope="module")
def learned():
    """A model of two other flights."""
    others = [flight(seed) for seed in (5, 6)]
    return learn_from(
        [prepared(other, replace(other.pixels, uv_px=clicked(other))) for other in others],
        models=(EACH_MARKER, SETTINGS),
        effort=Effort(validated=1, most_frames=T, times=1),
    )


def test_a_learned_model_checks_a_recording_that_is_too_short_to_learn_from(scene, learned):
    """30 frames teach no pose, and alone are believed; with another flight's model the wrong points are refused."""
    bat, pixels, (wrong, _) = scene
    uv = np.array(along_first_ray(pixels, bat.cameras, wrong, bat.truth.xyz_m, 0.015).uv_px[:, 17:47])
    uv[2:, 5:25, bat.truth.names.index("elbow_r")] = np.nan  # enough of two rays to be worth the pass
    short = prepared(bat, replace(pixels, uv_px=uv, t_s=pixels.t_s[:30]))
    assert "40" in (why_no_pose(seen_part(short)) or "")
    asked = unconfirmed(short)[:, wrong]
    assert asked.sum() > 15
    _, alone = run_job(short, validated=False)
    _, checked = run_job(short, learned=learned, validated=False)
    assert np.isfinite(alone.xyz_m[asked, wrong]).all()
    assert np.isnan(checked.xyz_m[asked, wrong]).all()


def test_long_recordings_are_checked_block_by_block(scene, learned):
    """The wrong points are refused in the block that holds them, which says so with the recording's frames."""
    bat, pixels, (wrong, _) = scene
    film = along_first_ray(pixels, bat.cameras, wrong, bat.truth.xyz_m, 0.015)
    uv = np.array(film.uv_px)
    uv[2:, 12:52, :5] = np.nan  # enough of two rays to be worth the pass
    film = replace(film, uv_px=uv)
    skeleton = Skeleton(name="bat", markers=pixels.names)
    run, cleaned, *_ = track_block(of_pixels(film, bat.cameras, skeleton, name="bat"), range(T), learned=learned)
    asked = unconfirmed(prepared(bat, film))[:, wrong]
    assert asked.sum() > 15
    assert (run.tracks.status[asked, wrong] == Status.REJECTED).all()
    assert any("two-camera points inconsistent with the motion" in found.text for found in cleaned.findings)
