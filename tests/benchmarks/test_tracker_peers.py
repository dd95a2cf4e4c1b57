"""What is optimised and filtered in place of ours is the same problem."""

import cv2
import numpy as np
from mocap.datasets import make_bat

import mocap
from benchmarks import tracker_peers as peers


def test_cameras_without_skew_see_the_points_with_the_same_errors():
    """K (R x + t) of the problem is off by what the rays of the recording are, to rounding of pixels in float64."""
    film = make_bat(n_frames=12, n_cameras=3)
    matrices = np.stack([camera.matrix for camera in film.cameras])
    recording = mocap.clean(mocap.from_pixels(film.pixels.uv_px, matrices, fps=240))
    problem = peers.problem(recording)
    for i, camera in enumerate(recording.cameras):
        pose = problem["rvec"][i], problem["tvec_mm"][i], problem["matrix"][i], np.zeros(5)
        ours = cv2.projectPoints(1e3 * recording.xyz_m.reshape(-1, 3), *pose)[0][:, 0]
        seen = recording.xyz_m.reshape(-1, 3) @ camera.matrix[:, :3].T + camera.matrix[:, 3]
        error = recording.data["ideal"].to_numpy()[i].reshape(-1, 2) - seen[:, :2] / seen[:, 2:]
        np.testing.assert_allclose(problem["uv_px"][i].reshape(-1, 2) - ours, error, atol=1e-6)


def test_two_frames_are_the_two_on_end_that_show_most(tmp_path):
    """Of four rows the second and the third have most numbers."""
    (tmp_path / "a.csv").write_text("u,v\n1,NaN\n2,3\n4,5\nNaN,6\n")
    peers.two_frames(tmp_path / "a.csv", tmp_path / "b.csv")
    assert (tmp_path / "b.csv").read_text() == "u,v\n2,3\n4,5\n"


def test_the_kalman_filter_takes_gaps_and_markers_never_seen():
    """It ends, and takes some time."""
    xyz = np.cumsum(np.ones((9, 2, 3)), axis=0)
    xyz[3:5, 0] = xyz[:, 1] = np.nan
    assert peers.kalman(xyz, 0.01) > 0
