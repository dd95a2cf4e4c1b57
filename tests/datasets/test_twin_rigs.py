"""Both rigs against OpenCV: the cameras record what cv2.projectPoints says."""

import cv2
import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat, make_lizard
from mocap.datasets.bats import bat_motion
from mocap.datasets.film import frame_times
from mocap.datasets.rig import tunnel_cameras

from mocap.cameras.camera import decompose, dlt_coefficients, record


@pytest.mark.parametrize(("make", "n_cameras"), [(make_bat, 8), (make_bat, 30), (make_lizard, 4)])
def test_projected_truth_is_opencvs(make, n_cameras):
    recording = make(seed=1, n_frames=20, n_cameras=n_cameras)
    got = record(recording.cameras, recording.truth.xyz_m)
    for c, camera in enumerate(recording.cameras):
        pinhole, lens = decompose(camera), camera.lens
        assert not pinhole.mirrored
        expected, _ = cv2.projectPoints(
            recording.truth.xyz_m.reshape(-1, 3),
            cv2.Rodrigues(pinhole.rotation)[0],
            pinhole.translation_m,
            pinhole.intrinsic,
            np.array([lens.k[0], lens.k[1], *lens.p, lens.k[2]]),
        )
        np.testing.assert_allclose(got[c].reshape(-1, 2), expected[:, 0], atol=1e-9, rtol=0)


def test_fisheyes_record_what_opencv_says():
    """Thirty fisheyes around a lap with U-turns: cv2.fisheye.projectPoints, to 1e-9 px."""
    recording = make_bat(seed=1, n_frames=40, fps=30, n_cameras=30, lens="fisheye", manoeuvre="turn")
    got = record(recording.cameras, recording.truth.xyz_m)
    for c, camera in enumerate(recording.cameras):
        pinhole = decompose(camera)
        xyz_m = recording.truth.xyz_m.reshape(-1, 1, 3)
        ahead = (xyz_m[:, 0] @ pinhole.rotation.T + pinhole.translation_m)[:, 2] > 0
        assert ahead.mean() > 0.9
        rotation, coefficients = cv2.Rodrigues(pinhole.rotation)[0], np.array(camera.lens.k)
        expected, _ = cv2.fisheye.projectPoints(xyz_m, rotation, pinhole.translation_m, pinhole.intrinsic, coefficients)
        np.testing.assert_allclose(got[c].reshape(-1, 2)[ahead], expected[ahead, 0], atol=1e-9, rtol=0)


def test_a_camera_that_starts_late_records_later_instants():
    """Against a cubic through four frames of the truth; a camera that starts with the first one is on time."""
    on_time = make_lizard(seed=2, n_frames=60, digitiser=PERFECT)
    late = make_lizard(seed=2, n_frames=60, digitiser=PERFECT, start_spread_frames=0.9)
    np.testing.assert_array_equal(late.truth.xyz_m, on_time.truth.xyz_m)
    np.testing.assert_array_equal(late.pixels.uv_px[0], on_time.pixels.uv_px[0])
    frames, spine = late.start_s * late.fps, on_time.truth.names.index("spine")
    assert 0.2 < np.ptp(frames) < 0.9
    middle, xyz_m = np.arange(10, 50), on_time.truth.xyz_m[:, spine]
    for c in range(1, 4):
        k, f = int(np.floor(frames[c])), frames[c] % 1
        weights = (-f * (f - 1) * (f - 2) / 6, (f + 1) * (f - 1) * (f - 2) / 2)
        weights += (-(f + 1) * f * (f - 2) / 2, (f + 1) * f * (f - 1) / 6)
        between = sum(w * xyz_m[middle + k + j] for w, j in zip(weights, (-1, 0, 1, 2), strict=True))
        got, on_frame = late.pixels.uv_px[c, middle, spine], record(late.cameras, xyz_m[middle])[c]
        # 3 / 128 of the fourth difference: 1 mm of sway at 3 Hz, at 250 Hz: 1e-3 (2 pi 3 / 250)^4 3 / 128 = 1e-9 m
        # and skin of 0.2 mm at 6 Hz as much; 3000 px / m
        np.testing.assert_allclose(got, record(late.cameras, between)[c], atol=1e-5)
        assert np.abs(got - on_frame).max() > 0.05


@pytest.mark.parametrize("n_cameras", [2, 8, 30])
def test_the_bat_stays_in_nearly_every_picture(n_cameras):
    """The rig is aimed well: the whole flight is in each picture, in front of each camera, with room around it."""
    cameras = tunnel_cameras(n_cameras)
    uv_px = record(cameras, bat_motion(0)(frame_times(540, 240.0)).xyz_m)
    for camera, uv in zip(cameras, uv_px, strict=True):
        assert (uv > 0).all()
        assert (uv < camera.size_px).all()
        assert np.isfinite(dlt_coefficients(camera)).all()


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_focal_length_and_centre_are_one_number_each_in_matrix_and_lens(make):
    """A camera profile has one f and one centre: the projection's must be the lens's, or the files would lie."""
    for camera in make(n_frames=1).cameras:
        intrinsic = decompose(camera).intrinsic
        np.testing.assert_allclose(np.diag(intrinsic)[:2], camera.lens.f_px, rtol=1e-12)
        np.testing.assert_allclose(intrinsic[:2, 2], camera.lens.centre_px, rtol=1e-12)
        assert abs(intrinsic[0, 1]) < 1e-9
