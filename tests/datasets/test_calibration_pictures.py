"""Photographs of boards: OpenCV finds their corners where the true cameras project them."""

import json

import cv2
import numpy as np
import pytest
from mocap.datasets.calibration_session import (
    Board,
    board_session,
    photograph,
    viewfinder,
    wand_sweep,
    write_board_session,
    write_wand_sweep,
)
from mocap.datasets.lizards import SLOPE_RAD
from mocap.datasets.rig import tank_cameras, tunnel_cameras

from mocap.cameras.camera import decompose, record
from mocap.io.dltdv import read_pixels

CHECKERS = Board(columns=10, rows=7, square_m=0.025)
CHARUCO = Board(columns=7, rows=5, square_m=0.035, marker_m=0.026)
RIGS = {
    "brown": tunnel_cameras(3),
    "fisheye": tunnel_cameras(3, lens="fisheye"),
    "tank": tank_cameras(3, slope_rad=SLOPE_RAD),
}


@pytest.mark.parametrize("rig", RIGS)
def test_the_viewfinder_is_the_inverse_of_the_lens(rig):
    """Bicubic splines over 8 px against Newton's method: 3 h^4 / 128 of the fourth derivative, below 1e-4 px here."""
    camera = RIGS[rig][0]
    finder, rng = viewfinder(camera), np.random.default_rng(0)
    u, v = (np.sort(rng.uniform(0, n - 1, 40)) for n in camera.size_px)
    exact = camera.lens.undistort(np.stack(np.meshgrid(u, v), axis=-1))
    np.testing.assert_allclose(finder.ideal(v, u), exact, atol=1e-4)


def held(camera, board, *, away_m, tilt):
    """Rotation and origin of a board whose middle is before the camera, 150 px off its axis, tilted."""
    eye = decompose(camera)
    about = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    rotation = eye.rotation.T @ about
    aside = np.array([120, 90, camera.lens.f_px[0]]) / camera.lens.f_px[0]
    middle = eye.position_m + eye.rotation.T @ (away_m * aside)
    return rotation, middle - rotation @ board.corners_m.mean(axis=0)


def found_corners(picture, board):
    """(K, 2) corners that OpenCV finds, refined, and their numbers."""
    if board.marker_m:
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        drawn = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m, dictionary)
        corners, numbers, _, _ = cv2.aruco.CharucoDetector(drawn).detectBoard(picture)
        numbers = numbers.ravel()
    else:
        found, corners = cv2.findChessboardCorners(picture, (board.columns - 1, board.rows - 1))
        assert found
        numbers = np.arange(len(board.corners_m))
    refined = cv2.cornerSubPix(picture, corners.astype(np.float32), (4, 4), (-1, -1), (3, 50, 1e-4))
    return refined.reshape(-1, 2), numbers


@pytest.mark.parametrize(
    ("rig", "board", "away_m"),
    [
        ("brown", CHECKERS, 0.55),
        ("fisheye", CHECKERS, 0.5),
        ("fisheye", CHARUCO, 0.5),
        ("tank", Board(columns=10, rows=7, square_m=0.012), 0.75),
    ],
)
def test_corners_are_where_the_camera_records_them(rig, board, away_m):
    """No bias, and no more scatter than the finder's own: it is off by 0.03 px here, and tells light from dark."""
    camera = RIGS[rig][1]
    rotation, origin = held(camera, board, away_m=away_m, tilt=0.4)
    picture = photograph(
        viewfinder(camera),
        board,
        board.texture(),
        rotation=rotation,
        translation_m=origin,
        rng=np.random.default_rng(0),
        blur_px=0.7,
        noise=1.5,
    )
    corners, numbers = found_corners(picture, board)
    assert len(corners) == len(board.corners_m)
    error = corners - record([camera], board.corners_m @ rotation.T + origin)[0, numbers]
    # means of 24 to 54 corners of 0.03 px: standard error below 0.006 px, and a bias of 1/100 px is none in practice
    assert np.abs(error.mean(axis=0)).max() < 0.025
    assert error.std() < 0.06
    # half a pixel of systematic shift, the classical mistake, would be twenty times the bound


def test_noise_and_blur_are_those_asked_for():
    """Away from the board, noise has its deviation and twice the rounding's 1/12; blur keeps the light."""
    camera = RIGS["tank"][0]
    board = Board(columns=6, rows=6, square_m=0.02)
    rotation, origin = held(camera, board, away_m=0.75, tilt=0.0)
    options = {"rotation": rotation, "translation_m": origin}
    finder, texture = viewfinder(camera), board.texture()
    clean = photograph(finder, board, texture, rng=np.random.default_rng(0), blur_px=0, noise=0, **options)
    noisy = photograph(finder, board, texture, rng=np.random.default_rng(0), blur_px=0, noise=3.0, **options)
    difference = (noisy.astype(float) - clean)[:150]
    # 1.5e5 pixels: standard error 0.2 %; both pictures are rounded, the noisy one to 1 / 12
    assert abs(difference.std() / np.sqrt(9 + 2 / 12) - 1) < 0.01
    soft = photograph(finder, board, texture, rng=np.random.default_rng(0), blur_px=2.0, noise=0, **options)
    # a blur keeps the sum and takes from the contrast
    assert abs(soft.astype(float).mean() - clean.mean()) < 0.05
    assert soft.astype(float).std() < clean.std()


def test_what_shows_no_front_of_a_board_is_no_picture():
    camera = RIGS["brown"][0]
    finder, texture = viewfinder(camera), CHECKERS.texture()
    options = {"rng": np.random.default_rng(0), "blur_px": 0.7, "noise": 1.0}
    rotation, origin = held(camera, CHECKERS, away_m=0.6, tilt=0.0)
    behind = rotation @ np.diag([1.0, -1, -1])
    assert photograph(finder, CHECKERS, texture, rotation=rotation, translation_m=origin, **options) is not None
    assert photograph(finder, CHECKERS, texture, rotation=behind, translation_m=origin, **options) is None
    back = 2 * decompose(camera).position_m - origin
    assert photograph(finder, CHECKERS, texture, rotation=rotation, translation_m=back, **options) is None


@pytest.mark.rare
def test_a_session_is_pictures_by_camera_and_instant_with_their_truth(tmp_path):
    """Pictures of one name are one instant in all cameras; the truth's corners are in the pictures; bytes repeat."""
    cameras = RIGS["tank"]
    board = Board(columns=10, rows=7, square_m=0.012)
    session = board_session(cameras, board, seed=1, n_frames=3, depth=(0.9, 1.0))
    count = write_board_session(session, tmp_path / "a")
    assert write_board_session(board_session(cameras, board, seed=1, n_frames=3, depth=(0.9, 1.0)), tmp_path / "b")
    pictures = sorted((tmp_path / "a" / "images").glob("*/*.png"))
    assert len(pictures) == count
    with np.load(tmp_path / "a" / "truth.npz") as truth:
        corners_px = truth["corners_px"]
    found = 0
    for path in pictures:
        assert path.read_bytes() == (tmp_path / "b" / path.relative_to(tmp_path / "a")).read_bytes()
        c, frame = [camera.name for camera in cameras].index(path.parent.name), int(path.stem) - 1
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        ok, corners = cv2.findChessboardCorners(picture, (9, 6))
        if ok:
            found += 1
            got, expected = corners.reshape(-1, 2), corners_px[c, frame]
            # the order may begin at the other end of the board
            assert min(np.abs(got - expected).max(), np.abs(got[::-1] - expected).max()) < 1.5
    assert found >= 3
    card = json.loads((tmp_path / "a" / "card.json").read_text())
    assert (card["options"], card["pictures"]) == ("--checkerboard 9x6 --square-mm 12", count)


def test_a_wand_keeps_its_length_and_reads_back(tmp_path):
    sweep = wand_sweep(RIGS["brown"], seed=2, length_m=0.2, reach_m=(0.25, 0.1, 0.1), n_frames=400)
    np.testing.assert_allclose(np.linalg.norm(sweep.xyz_m[:, 0] - sweep.xyz_m[:, 1], axis=-1), 0.2, atol=1e-15)
    error = sweep.pixels.uv_px - record(sweep.cameras, sweep.xyz_m)
    seen = sweep.pixels.seen
    assert seen.mean() > 0.9
    # some 4000 numbers: standard error 1.1 %
    assert abs(error[seen].std() / 0.3 - 1) < 0.05
    write_wand_sweep(sweep, tmp_path)
    pixels = read_pixels(tmp_path / "wand_xypts.csv", fps=60)
    assert pixels.names == ("wand_1", "wand_2")
    np.testing.assert_allclose(pixels.uv_px, sweep.pixels.uv_px, atol=5.1e-7)
