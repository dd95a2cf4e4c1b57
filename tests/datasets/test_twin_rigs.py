"""Both rigs against OpenCV: the cameras record what cv2.projectPoints says."""

import cv2
import numpy as np
import pytest

from datasets import make_bat, make_lizard
from mocap.cameras import decompose, dlt_coefficients, record


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


@pytest.mark.parametrize("n_cameras", [2, 8, 30])
def test_the_bat_stays_in_nearly_every_picture(n_cameras):
    """The rig is aimed well: the whole flight is in each picture, in front of each camera, with room around it."""
    recording = make_bat(seed=0, n_frames=540, n_cameras=n_cameras)
    uv_px = record(recording.cameras, recording.truth.xyz_m)
    for camera, uv in zip(recording.cameras, uv_px, strict=True):
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
