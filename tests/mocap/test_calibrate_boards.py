"""Rigs from boards: synthetic ones with their truth, real ones with what others found."""

from dataclasses import replace
from pathlib import Path

import cv2
import h5py
import numpy as np
import pandas as pd
import pytest

import mocap
from mocap.calibration.board_rig import calibrate_boards
from mocap.calibration.boards import BoardViews, Charuco, Checkerboard, Corners, detect, pictures_of, read_grey
from mocap.calibration.intrinsics import fit_intrinsics
from mocap.calibration.scene import RigCamera, rig_lens, similarity
from mocap.cameras.camera import stacked, undistorted
from mocap.cameras.lens import BrownLens, FisheyeLens
from mocap.cameras.triangulate import linear
from mocap.errors import CalibrationError
from mocap.io.anipose import read_calibration
from tests.mocap.board_scenes import BOARD, SIZE, poses, rig, seen
from tests.real_data import real


def session(seed, cameras, each=8, noise_px=0.1, **options):
    """Boards held before every camera in turn."""
    rng = np.random.default_rng(seed)
    boards = {f"{i}-{k}": T for i, c in enumerate(cameras) for k, T in enumerate(poses(rng, c, each))}
    return boards, seen(rng, cameras, boards, noise_px=noise_px, **options)


def difference(found, cameras, T_truth_from_board):
    """(C) metres between places found and true ones, in the frame of a board, z towards the viewer."""
    T = np.diag([1.0, -1, -1, 1]) @ np.linalg.inv(T_truth_from_board)
    true = np.stack([T[:3, :3] @ c.position_m + T[:3, 3] for c in cameras])
    return np.linalg.norm(np.stack([c.position_m for c in found]) - true, axis=1)


def test_a_rig_is_found_in_the_frame_of_a_board():
    """Four cameras that see each other's boards, 0.1 px of noise: focal lengths and places within 4 deviations.

    A camera at 2 m whose focal length errs by df stands df / f x 2 m too far or near; the noise of a board adds 1 mm.
    """
    cameras = rig(8)[:4]
    boards, views = session(1, cameras)
    found = calibrate_boards(views, BOARD, world_frame="0-0", choices=("brown2",))
    assert found.rms_px == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    assert difference(found.cameras, cameras, boards["0-0"]).max() < 4 * found.f_sd_px.max() / 1200 * 2 + 1e-3
    f = np.array([c.lens.f_px[0] for c in found.cameras])
    assert (np.abs(f - 1200) < 4 * found.f_sd_px + 0.1).all()
    np.testing.assert_allclose(found.T_world_from_board["0-0"], np.diag([1.0, -1, -1, 1]), atol=1e-9)


def test_views_that_overlap_in_a_chain_are_enough():
    """Camera i shares boards with i + 1 only: places still come out; two groups without a link are named."""
    cameras = rig(9)[:5]
    rng = np.random.default_rng(2)
    boards, who = {}, {}
    for i in range(4):
        for k, T in enumerate(poses(rng, cameras[i], 14)):
            boards[f"{i}-{k}"], who[f"{i}-{k}"] = T, {i, i + 1}
    views = seen(rng, cameras, boards, who=who)
    found = calibrate_boards(views, BOARD, world_frame="0-0", choices=("brown2",))
    assert difference(found.cameras, cameras, boards["0-0"]).max() < 0.02  # four links of 0.3 degrees at 2 m
    cut = {
        n: replace(v, corners={s: c for s, c in v.corners.items() if not s.startswith("1-")}) for n, v in views.items()
    }
    with pytest.raises(
        CalibrationError, match=r"cameras 'cam3', 'cam4', 'cam5' never see the board at the same time as"
    ):
        calibrate_boards(cut, BOARD, choices=("brown2",))


def test_a_board_that_looks_the_same_upside_down_is_turned_back():
    """One camera always reports a 9 x 7 board from the other end, the others at random: the rig comes out."""
    board = Checkerboard(columns=9, rows=7, square_m=0.03)
    assert board.turnable
    cameras = rig(8)[:3]
    _, views = session(3, cameras, local=board.points())
    rng = np.random.default_rng(1)
    turned = {
        n: replace(
            v,
            corners={
                s: replace(c, uv_px=c.uv_px[::-1]) if n == "cam2" or rng.random() < 0.5 else c
                for s, c in v.corners.items()
            },
        )
        for n, v in views.items()
    }
    found = calibrate_boards(turned, board, choices=("brown2",))
    assert found.rms_px < 0.2
    assert not found.left_out
    apart = [np.linalg.norm(a.position_m - b.position_m) for a in found.cameras for b in found.cameras]
    true = [np.linalg.norm(a.position_m - b.position_m) for a in cameras for b in cameras]
    np.testing.assert_allclose(apart, true, atol=6e-3)


def test_a_picture_of_another_instant_is_left_out():
    """One picture under a wrong name: named, and the rig is as good as without it."""
    cameras = rig(8)[:3]
    boards, views = session(4, cameras)
    name = "cam2"
    shared = [s for s in views[name].corners if sum(s in v.corners for v in views.values()) == 3]
    corners = dict(views[name].corners)
    corners[shared[0]], corners[shared[1]] = corners[shared[1]], corners[shared[0]]
    views[name] = replace(views[name], corners=corners)
    found = calibrate_boards(views, BOARD, world_frame=next(s for s in boards if s not in shared), choices=("brown2",))
    assert set(found.left_out) <= {(n, s) for n in views for s in shared[:2]}
    assert len(found.left_out) >= 2
    assert found.rms_px < 0.2


@pytest.mark.parametrize(
    ("lens", "right"),
    [
        (BrownLens.of((1200.0, 1205.0), (640.0, 512.0), (-0.1, 0.02, 0.0, 0.0, 0.0)), {"brown2"}),
        (FisheyeLens.of((500.0, 503.0), (640.0, 512.0), (0.02, -0.01, 0.002, 0.0)), {"fisheye"}),
    ],
    ids=["brown2", "fisheye"],
)
def test_the_model_is_chosen_by_pictures_held_out(lens, right):
    """The simplest model that says what the true lens does is taken; its pixels are those of the truth to 0.3 px.

    Judged where boards were: within 80 % of the picture.
    """
    rng = np.random.default_rng(5)
    camera = RigCamera(name="one", lens=lens, rotation=np.eye(3), translation_m=np.zeros(3), size_px=SIZE)
    boards, near = {}, 0.24 * lens.f_px[0] / 1200 * 1.6
    for k in range(60):
        T = poses(rng, camera, 1, spread_m=0.0)[0]
        T[:3, 3] += [*rng.uniform(-1, 1, 2) * [0.3, 0.24], 0.0]
        T[2, 3] += near + rng.uniform(0.1, 0.3)
        boards[str(k)] = T
    views = seen(rng, (camera,), boards)["one"]
    assert len(views.corners) > 12
    found = fit_intrinsics(list(views.corners.values())[:12], SIZE, name="one")
    assert found.choice in right
    u, v = np.meshgrid(np.linspace(200, 1080, 9), np.linspace(160, 860, 7))
    rays = lens.normalised(lens.undistort(np.stack([u, v], axis=-1)))
    ours = found.lens.normalised(found.lens.undistort(np.stack([u, v], axis=-1)))
    assert np.sqrt(np.mean(np.sum((rays - ours) ** 2, axis=-1))) * lens.f_px[0] < 4.0


def test_implausible_calibrations_are_refused():
    """Boards that all face the camera leave the focal length open; too few pictures; a world frame that nobody saw."""
    rng = np.random.default_rng(6)
    camera = RigCamera(name="one", lens=rig(1)[0].lens, rotation=np.eye(3), translation_m=np.zeros(3), size_px=SIZE)
    flat = {}
    for k in range(8):
        T = np.eye(4)
        T[:3, 3] = [*rng.uniform(-0.3, 0.1, 2), 1.5]
        flat[str(k)] = T
    with pytest.raises(
        CalibrationError,
        match=r"not determine its focal length|no known|principal point|focal "
        r"length of",
    ):
        calibrate_boards(seen(rng, (camera,), flat), BOARD, choices=("brown2",))
    few = {k: flat[k] for k in list(flat)[:3]}
    with pytest.raises(CalibrationError, match="found in 3 images, and 5 are needed"):
        calibrate_boards(seen(rng, (camera,), few), BOARD)
    _, views = session(7, rig(8)[:2])
    with pytest.raises(CalibrationError, match="no camera sees the board in the world frame 'x'"):
        calibrate_boards(views, BOARD, world_frame="x", choices=("brown2",))


def test_drawn_boards_are_found(tmp_path):
    """A checkerboard drawn from either end starts at the same corner; a ChArUco negative of the old print is told."""
    squares = np.kron(np.add.outer(np.arange(7), np.arange(10)) % 2, np.ones((40, 40)))
    picture = np.pad(255 * squares, 80, constant_values=255).astype(np.uint8)
    board = Checkerboard(columns=9, rows=6, square_m=0.03)
    first, second = board.find(picture), board.find(np.ascontiguousarray(picture[::-1, ::-1]))
    assert first is not None
    assert second is not None
    far = np.array(picture.shape[::-1]) - 1
    np.testing.assert_allclose(second.uv_px, far - first.uv_px, atol=0.2)
    np.testing.assert_allclose(
        np.diff(first.uv_px.reshape(6, 9, 2)[:, :, 0], axis=1),
        40 * np.sign(first.uv_px[1, 0] - first.uv_px[0, 0]),
        atol=0.3,
    )
    printed = Charuco(columns=6, rows=8, square_m=0.03, marker_m=0.022, dictionary="DICT_4X4_50", legacy=True)
    drawn = 255 - cv2.copyMakeBorder(
        printed.board().generateImage((480, 640)), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255
    )
    for camera in "ab":
        (tmp_path / camera).mkdir()
        cv2.imwrite(str(tmp_path / camera / f"{camera}_1.png"), drawn)
    told, views = detect(pictures_of(tmp_path), replace(printed, legacy=False))
    assert told == replace(printed, inverted=True)
    assert [len(v.corners["1"].ids) for v in views.values()] == [35, 35]


def test_folders_of_pictures(tmp_path):
    """Folders a camera; one folder; names with clocks that differ; what tells nothing is refused."""
    for name in ("left01", "left02", "right01", "right02"):
        (tmp_path / f"{name}.png").touch()
    assert {c: list(v) for c, v in pictures_of(tmp_path).items()} == {"left": ["01", "02"], "right": ["01", "02"]}
    clocks = tmp_path / "clocks"
    for camera, clock in (("a", 1201), ("b", 1202)):
        (clocks / camera / "images").mkdir(parents=True)
        for k in range(3):
            (clocks / camera / "images" / f"{camera}-{clock + k}-{k}.png").touch()
    assert {c: list(v) for c, v in pictures_of(clocks).items()} == {"a": ["0", "1", "2"], "b": ["0", "1", "2"]}
    (tmp_path / "nothing").mkdir()
    with pytest.raises(CalibrationError, match="no images here"):
        pictures_of(tmp_path / "nothing")
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "picture.png").touch()
    with pytest.raises(CalibrationError, match="the name does not state camera and frame"):
        pictures_of(tmp_path / "odd")


def test_a_real_stereo_pair():
    """All 25 boards found in both cameras; root mean square error at most 0.20 px; cameras 3.87 squares apart."""
    board = Checkerboard(columns=9, rows=6, square_m=0.02379)
    _, views = detect(pictures_of(real("checkerboard_stereo_pair")), board)
    assert [len(v.corners) for v in views.values()] == [25, 25]
    found = calibrate_boards(views, board, choices=("brown",))
    assert found.rms_px <= 0.20
    a, b = found.cameras
    assert np.linalg.norm(a.position_m - b.position_m) / board.square_m == pytest.approx(3.870, rel=0.01)


def test_the_real_mouse_rig():
    """Corners that sleap-anipose detected: 0.45 px at most over all, where the shipped calibration errs by 92 px."""
    with h5py.File(real("mouse_charuco_4cam", "calibration.metadata.h5")) as file:
        detected = file["detected_corners"][()]  # type: ignore[index]
    board = Charuco(columns=8, rows=11, square_m=0.024, marker_m=0.01875, dictionary="DICT_4X4_1000")
    local, views = board.points(), {}
    for name, uv in zip(("back", "mid", "side", "top"), np.asarray(detected), strict=True):
        corners = {}
        for t, u in enumerate(uv):
            at = np.flatnonzero(np.isfinite(u).all(axis=-1))
            if len(at) >= 6:
                corners[str(t)] = Corners(ids=at, local_m=local[at], uv_px=u[at])
        views[name] = BoardViews(size_px=(1280, 1024), corners=corners)
    found = calibrate_boards(views, board, choices=("fisheye",))
    assert found.rms_px <= 0.45
    assert not found.left_out


def test_real_charuco_points():
    """Places of four webcams from their known lenses: points within 1 mm (median) of those that caliscope shipped.

    Up to a similarity: the shipped points have edges of 53.84 mm where the board has 54.
    """
    folder = real("charuco_4cam_caliscope", "post_optimization")
    cameras = read_calibration(folder / "camera_array.toml")
    corners = folder / "calibration" / "extrinsic" / "CHARUCO"
    pixels, points = pd.read_csv(corners / "xy_CHARUCO.csv"), pd.read_csv(corners / "xyz_CHARUCO.csv")
    views: dict[str, BoardViews] = {}
    for c, rows in pixels.groupby("cam_id"):
        seen_by = {}
        for t, r in rows.groupby("sync_index"):
            if len(r) >= 6:
                local, uv = r[[f"obj_loc_{a}" for a in "xyz"]].to_numpy(), r[["img_loc_x", "img_loc_y"]].to_numpy()
                seen_by[str(t)] = Corners(ids=r.keypoint_id.to_numpy(), local_m=local, uv_px=uv)
        views[cameras[int(str(c))].name] = BoardViews(size_px=(1280, 720), corners=seen_by)
    board = Charuco(columns=4, rows=5, square_m=0.054, marker_m=0.04, dictionary="DICT_4X4_1000")
    found = calibrate_boards(views, board, lenses={c.name: rig_lens(c) for c in cameras})
    rows = {key: i for i, key in enumerate(zip(points.sync_index, points.keypoint_id, strict=True))}
    uv = np.full((4, len(rows), 2), np.nan)
    for c, t, k, x, y in pixels[["cam_id", "sync_index", "keypoint_id", "img_loc_x", "img_loc_y"]].to_numpy():
        if (t, k) in rows:
            uv[int(c), rows[t, k]] = (x, y)
    rig_found = [c.camera() for c in found.cameras]
    ours = linear(stacked(rig_found), undistorted(rig_found, uv))
    theirs = points[["x_coord", "y_coord", "z_coord"]].to_numpy()
    ok = np.isfinite(ours[:, 0])
    T = similarity(ours[ok], theirs[ok])
    off = np.linalg.norm(ours[ok] @ T[:3, :3].T + T[:3, 3] - theirs[ok], axis=1)
    assert np.median(off) < 1e-3
    assert np.cbrt(np.linalg.det(T[:3, :3])) == pytest.approx(53.84 / 54, abs=2e-3)


def test_one_place_finds_corners():
    """``images``, ``lenses`` and ``places`` find boards by ``boards.detect``; nothing else looks for corners."""
    root = Path(mocap.__file__).parent
    finders = ("findChessboardCorners", "CharucoDetector", "cornerSubPix", "findCirclesGrid")
    looking = {p.relative_to(root).as_posix() for p in root.rglob("*.py") if any(f in p.read_text() for f in finders)}
    assert looking == {"calibration/boards.py"}
    detecting = {p.stem for p in (root / "calibration").glob("*.py") if " detect(" in p.read_text()}
    assert detecting - {"boards"} == {"calibrate", "calibrate_lenses", "calibrate_places"}


def as_opencv(found, size):
    """Root mean square error and focal length of Brown's lens, as ``cv2.calibrateCamera`` fits it to corners."""
    local = [one.local_m.astype(np.float32) for one in found]
    rms, K, *_ = cv2.calibrateCamera(local, [one.uv_px.astype(np.float32) for one in found], size, None, None)  # type: ignore
    return rms, (K[0, 0] + K[1, 1]) / 2


@pytest.mark.parametrize(("camera", "opencv_px", "f_px"), [("mid", 0.164, 760.5), ("top", 0.170, 947.5)])
def test_the_real_charuco_images(camera, opencv_px, f_px):
    """Corners of 21 images a camera are those of OpenCV's detector, and the lens is that of its calibrateCamera.

    OpenCV minimises squares; ours counts outlying corners less (Cauchy's loss), so that its root mean square is up to
    3 % larger. The focal lengths differ by less than three standard deviations.
    """
    board = Charuco(columns=8, rows=11, square_m=0.024, marker_m=0.01875, dictionary="DICT_4X4_1000")
    files = sorted(real("mouse_charuco_4cam", camera, "calibration_images").glob("*.jpg"))
    board, views = detect({camera: {file.stem: file for file in files}}, board)
    detector = cv2.aruco.CharucoDetector(board.board())
    theirs = []
    for file in files:
        uv, ids, *_ = detector.detectBoard(read_grey(file))
        theirs.append(Corners(ids=ids.ravel(), local_m=board.points()[ids.ravel()], uv_px=uv.reshape(-1, 2)))
        np.testing.assert_array_equal(views[camera].corners[file.stem].ids, theirs[-1].ids)
        np.testing.assert_array_equal(views[camera].corners[file.stem].uv_px, theirs[-1].uv_px)
    rms, f = as_opencv(theirs, views[camera].size_px)
    assert (rms, f) == (pytest.approx(opencv_px, abs=2e-3), pytest.approx(f_px, abs=0.5))
    found = fit_intrinsics(list(views[camera].corners.values()), views[camera].size_px, name=camera, choices=("brown",))
    assert found.rms_px == pytest.approx(rms, rel=0.03)
    assert abs(np.mean(found.lens.f_px) - f) < 3 * found.f_sd_px


@pytest.mark.parametrize("camera", ["left", "right"])
def test_corners_of_the_real_checkerboard_beside_opencv(camera):
    """Corners of ours fit OpenCV's model no worse than those of ``cv2.cornerSubPix`` in windows of 5 and of 11 px."""
    board = Checkerboard(columns=9, rows=6, square_m=0.02379)
    _, views = detect({camera: pictures_of(real("checkerboard_stereo_pair"))[camera]}, board)
    grids = {file.stem: file for file in pictures_of(real("checkerboard_stereo_pair"))[camera].values()}
    theirs: dict[int, list[Corners]] = {5: [], 11: []}
    for file in grids.values():
        picture = read_grey(file)
        _, uv = cv2.findChessboardCorners(picture, (9, 6))
        for window, found in theirs.items():
            stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
            fine = cv2.cornerSubPix(picture, np.asarray(uv).copy(), (window, window), (-1, -1), stop)
            found.append(Corners(ids=np.arange(54), local_m=board.points(), uv_px=fine.reshape(-1, 2)))
    size = views[camera].size_px
    ours, of_5, of_11 = (as_opencv(found, size) for found in (list(views[camera].corners.values()), *theirs.values()))
    assert ours[0] <= min(of_5[0], of_11[0])
    assert ours[1] == pytest.approx(of_11[1], abs=1.0)  # the wide window is the better one where squares are 40 px
