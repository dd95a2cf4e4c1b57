"""What a person states wins, and tells of the frames around it: simulated markers in front of three cameras."""

import numpy as np
import pytest

import mocap
from mocap.cameras.camera import record
from mocap.cameras.origin import PixelOptions
from mocap.cameras.triangulate import robust
from mocap.cleaning.bias import carried, hand_sd
from mocap.cleaning.cleaning import clean
from mocap.reading.edits import Edit, edited
from mocap.reading.ideal_pixels import of_pixels
from mocap.records import PixelTracks, Status
from tests.mocap.rigs import ring

NAMES, NOISE_PX, SIGNED = ("a", "b", "c", "d"), 0.3, {"who": "test", "when": "2026-01-01T00:00:00+00:00"}
WRONG, MIDDLE = slice(60, 90), 75
"""Frames in which the first camera's points of the second marker are off, and the middle of them."""


def scene(error_px=(2.4, -1.8), wrong=WRONG, late=0.0):
    """Four markers that swing, in three cameras; the pixels that are right, and the truth."""
    cameras, t_s, rng = ring(3), np.arange(150) / 100, np.random.default_rng(0)
    start, places = rng.uniform(0, 6, (4, 3)), 0.1 * rng.normal(size=(4, 3))

    def at(t_s):
        return 0.1 * np.sin(2 * np.pi * t_s[:, None, None] + start) + places

    right = record(cameras, at(t_s))
    right[2] = record(cameras, at(t_s - late / 100))[2]
    uv = right + NOISE_PX * rng.normal(size=right.shape)
    uv[0, wrong, 1] += error_px
    pixels = PixelTracks(names=NAMES, cameras=tuple(c.name for c in cameras), t_s=t_s, uv_px=uv)
    options = PixelOptions(origin="upper-left", calibration_origin="upper-left", correct_lag=late != 0)
    return of_pixels(pixels, cameras, name="t", unit="m", options=options), right, at(t_s)


def placed(uv_px, frame, marker=1, cameras=(0,)):
    """Edits that place a marker where (C, T, M, 2) pixels have it."""
    return [
        Edit(
            what="place",
            frame=frame + 1,
            marker=NAMES[marker],
            camera=f"cam{c + 1}",
            uv_px=tuple(uv_px[c, frame, marker].tolist()),
            **SIGNED,
        )
        for c in cameras
    ]


def tracked(recording, edits=()):
    """Positions, deviations and status of the second marker, as the library replays edits."""
    found = mocap.track(edited(recording, list(edits)), model="constant_velocity", validate=False).tracks
    return found.xyz_m[:, 1], found.sd_m[:, 1], found.status[:, 1]


def test_one_correction_pulls_a_lasting_error_to_the_truth():
    """Of 30 frames in which a camera errs by 3 px: at the correction within the stated deviation, a third beside it.

    Two corrections leave less; frames without the error are known as well as before.
    """
    recording, right, xyz = scene()
    off = []
    for frames in ((), (MIDDLE,), (66, 84)):
        found, sd_m, _ = tracked(recording, [edit for frame in frames for edit in placed(right, frame)])
        off.append(np.linalg.norm(found - xyz[:, 1], axis=-1))
        assert (off[-1][list(frames)] < np.sqrt(3) * sd_m[list(frames)]).all()  # of three coordinates together
    before, one, two = off
    rms = [np.sqrt(np.mean(part[WRONG] ** 2)) for part in off]
    assert before[MIDDLE] > 2.5e-3
    assert one[MIDDLE] < 0.3 * before[MIDDLE]
    assert (one[70:80] < 0.5 * before[70:80]).all()
    assert rms[2] < rms[1] < 0.6 * rms[0]
    for part in (one, two):
        assert np.sqrt(np.mean(part[:50] ** 2)) < 1.05 * np.sqrt(np.mean(before[:50] ** 2))


@pytest.mark.parametrize("wrong", [slice(0, 0), slice(MIDDLE, MIDDLE + 1)])
def test_a_right_neighbourhood_stays(wrong):
    """A correction where points are right, or of an error of one frame: no other sample is believed otherwise."""
    recording, right, xyz = scene((12.0, 9.0), wrong)
    before, after = clean(recording), clean(edited(recording, placed(right, MIDDLE)))
    kept = np.arange(len(xyz)) != MIDDLE
    np.testing.assert_allclose(after.xyz_m[kept], before.xyz_m[kept], atol=2e-4)
    np.testing.assert_array_equal(after.xyz_m[:40], before.xyz_m[:40])
    assert np.linalg.norm(after.xyz_m[MIDDLE, 1] - xyz[MIDDLE, 1]) < 1e-3


def test_what_disagrees_by_far_is_kept():
    """A marker that a person has 8 cm from where all else has it is there: measured, however it got there."""
    recording, _, xyz = scene()
    away = xyz.copy()
    away[MIDDLE, 1, 2] += 0.08
    found, sd_m, status = tracked(recording, placed(record(ring(3), away), MIDDLE, cameras=(0, 1, 2)))
    assert status[MIDDLE] == Status.MEASURED
    assert np.linalg.norm(found[MIDDLE] - away[MIDDLE, 1]) < max(3 * np.sqrt(3) * sd_m[MIDDLE], 2e-3)


def test_one_place_outweighs_cameras_that_contradict_it():
    """Of three rays the one that a person placed stays, and the others are rejected where they miss it."""
    recording, right, _ = scene()
    right[0, MIDDLE, 1] += 40.0
    done = clean(edited(recording, placed(right, MIDDLE)))
    np.testing.assert_allclose(done.uv_px[0, MIDDLE, 1], right[0, MIDDLE, 1])
    assert not done.rays_rejected[0, MIDDLE, 1]
    assert done.rays_rejected[1:, MIDDLE, 1].any()


def test_places_that_contradict_each_other_are_told():
    """Two clicks whose rays miss each other: the marker is between them, and a finding says where to look."""
    recording, right, _ = scene()
    right[0, MIDDLE, 1] += 40.0
    done = clean(edited(recording, placed(right, MIDDLE, cameras=(0, 1, 2))))
    told = [f for f in done.findings if f.kind == "corrections by hand"]
    assert [(f.frames, f.markers) for f in told] == [((MIDDLE + 1,), ("b",))]
    assert done.tracks.status[MIDDLE, 1] == Status.MEASURED
    assert not done.rays_rejected[:, MIDDLE, 1].any()
    assert not [f for f in clean(edited(recording, placed(scene()[1], MIDDLE))).findings if f.kind == told[0].kind]


def test_a_recording_that_is_all_by_hand():
    """A file without a point, in which a person placed two markers in all cameras: they are where he placed them."""
    recording, right, xyz = scene()
    empty = recording.having(pixels=np.full(right.shape, np.nan))
    edits = [edit for frame in range(20) for m in (0, 1) for edit in placed(right, frame, m, cameras=(0, 1, 2))]
    done = clean(edited(empty, edits))
    np.testing.assert_allclose(done.xyz_m[:20, :2], xyz[:20, :2], atol=1e-6)
    assert (done.tracks.status[:20, :2] == Status.MEASURED).all()


def test_names_that_a_person_exchanged_stay_exchanged():
    """In frames in which every path says otherwise."""
    recording, _, xyz = scene((0.0, 0.0))
    swap = Edit(what="exchange", frame=71, last=80, marker="a", other="b", **SIGNED)
    done = clean(edited(recording, [swap]))
    np.testing.assert_allclose(done.xyz_m[70:80, [0, 1]], xyz[70:80, [1, 0]], atol=3e-3)


def test_a_place_in_a_late_camera_is_where_the_picture_shows_it():
    """A camera that runs 2.4 frames late: what is placed in its picture is read when the others see it."""
    recording, right, _ = scene((0.0, 0.0), late=2.4)
    before, after = clean(recording), clean(edited(recording, placed(right, MIDDLE, cameras=(2,))))
    frame, marker = np.argwhere(after.by_hand[2])[0]
    assert (abs(frame - MIDDLE) in (2, 3), marker) == (True, 1)
    own = recording.pixels.uv_px[2, MIDDLE, 1] - right[2, MIDDLE, 1]
    np.testing.assert_allclose(before.ideal_px[2, frame, 1] - own, after.uv_px[2, frame, 1], atol=1e-6)


def test_errors_last_with_a_probability_and_end():
    """One correction: the mean is left^n e, the variance that of e or of none; between two equal ones more of e."""
    uv = np.full((1, 41, 1, 2), 5.0)
    hand = np.full_like(uv, np.nan)
    hand[0, 20, 0] = (2.0, 1.0)
    sd, left = np.full(uv.shape[:3], 1e-6), 0.9
    mean, variance, share = carried(uv, sd, hand, hand_sd_px=1e-6, left=left, dt_s=0.01)
    rho = left ** np.abs(np.arange(41) - 20)
    np.testing.assert_allclose(mean[0, :, 0], rho[:, None] * [3.0, 4.0], rtol=1e-6)
    np.testing.assert_allclose(variance[0, :, 0], rho * (1 - rho) * 25 / 2, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(share[0, :, 0], rho, rtol=1e-9)
    hand[0, 10, 0] = (2.0, 1.0)
    mean, *_ = carried(uv, sd, hand, hand_sd_px=1e-6, left=left, dt_s=0.01)
    np.testing.assert_allclose(mean[0, 15, 0, 0], 3.0 * 2 * left**5 / (1 + left**10), rtol=1e-6)  # of e on both sides
    hand[0, [10, 20], 0] = 5.0 + 0.1
    mean, variance, _ = carried(uv, sd, hand, hand_sd_px=0.1, left=left, dt_s=0.01)
    assert not mean.any()
    assert not variance.any()


def test_a_persons_noise_is_learned_of_his_clicks():
    """Points of three clicks with 1 px of noise, where the recording has 0.3: few say little, many say so."""
    cameras, rng = ring(3), np.random.default_rng(1)
    matrices = np.stack([camera.matrix for camera in cameras])
    clicks = record(cameras, rng.uniform(-0.2, 0.2, (300, 1, 3)))
    clicks += 0.6 * rng.normal(size=clicks.shape)
    few = clicks.copy()
    few[:, 2:] = np.nan
    assert hand_sd(matrices, few, usual_px=0.3)[0] == pytest.approx(0.3, abs=0.1)
    assert hand_sd(matrices, clicks, usual_px=0.3)[0] == pytest.approx(0.6, rel=0.1)


def test_certain_rays_are_never_rejected():
    """The worst ray is kept where it is certain, the others go; all certain: the point is between them."""
    cameras = ring(4)
    matrices = np.stack([camera.matrix for camera in cameras])
    uv = record(cameras, np.zeros((1, 1, 3)))
    uv[0] += 50.0
    certain = np.zeros(uv.shape[:3], dtype=bool)
    assert robust(matrices, uv, sd_px=1.0).rejected[0].all()
    certain[0] = True
    found = robust(matrices, uv, sd_px=1.0, certain=certain)
    assert not found.rejected[0].any()
    assert found.rejected[1:].sum() >= 2
    certain[:] = True
    found = robust(matrices, uv, sd_px=1.0, certain=certain)
    assert not found.rejected.any()
    assert np.isfinite(found.xyz_m).all()
