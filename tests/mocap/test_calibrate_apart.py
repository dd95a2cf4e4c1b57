"""Lenses and places apart: each camera's lens from its own pictures at any time, its place from known points."""

import json
import shutil
import sys
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from mocap.datasets.calibration_session import Board, board_session, photograph, viewfinder, write_board_session
from scipy.spatial.transform import Rotation

from mocap.calibration.board_rig import calibrate_boards
from mocap.calibration.boards import Corners
from mocap.calibration.intrinsics import fit_intrinsics
from mocap.calibration.places import place_camera, place_cameras
from mocap.cameras.camera import KnownLens, decompose, pinhole_camera, record
from mocap.cameras.lens import BrownLens
from mocap.cli.main import main
from mocap.errors import CalibrationError, FormatError
from mocap.io.anipose import read_calibration, read_lenses, write_lenses
from mocap.io.clicked import read_clicks, read_scene
from tests.mocap.board_scenes import BOARD, SIZE, poses, rig, seen
from tests.mocap.rigs import look_at

FREE = (0, 1, 2, 3, 4, 5)
SD = np.array([3.0, 3.0, 3.0, 3.0, 0.005, 0.01])


def own_views(seed, n=20, noise_px=0.1):
    """One camera's views of a board."""
    camera = rig(1)
    rng = np.random.default_rng(seed)
    boards = {str(i): T for i, T in enumerate(poses(rng, camera[0], n))}
    return list(seen(rng, camera, boards, noise_px=noise_px)[camera[0].name].corners.values())


@cache
def own_fit(seed):
    """The lens of ``own_views``."""
    return fit_intrinsics(own_views(seed), SIZE, name="a", choices=("brown2",))


def scene(seed, n=10, flat=False):
    """Known points, cameras with lenses that are known to within SD, and clicks of 0.5 px."""
    rng = np.random.default_rng(seed)
    cameras, xyz = rig(3), rng.uniform(-0.4, 0.4, (n, 3)) * [1, 1, not flat]
    cov = np.diag(SD**2)
    true = [KnownLens(name=c.name, lens=c.lens, size_px=SIZE, free=FREE, cov=cov) for c in cameras]
    lenses = [replace(k, lens=k.moved(rng.normal(size=6) * SD)) for k in true]
    uv = np.stack([c.record(xyz) for c in cameras]) + rng.normal(0, 0.5, (3, n, 2))
    return cameras, lenses, xyz, uv


def test_a_lens_is_as_well_known_as_it_says():
    """Ten seeds of six numbers: 95 % intervals hold 60 true ones, but for at most 7 (99.9 % of such draws)."""
    truth = np.array([1200.0, 1212.0, 645.0, 505.0, -0.2, 0.08])
    z = []
    for seed in range(10):
        found = own_fit(seed)
        known = KnownLens(name="a", lens=found.lens, free=found.free, cov=found.cov)
        z.append((known.numbers - np.append(truth, [0, 0, 0]))[:6] / known.sd[:6])
    assert np.count_nonzero(np.abs(z) > 1.96) <= 7
    assert 0.6 < np.std(z) < 1.3


def test_a_lens_beside_opencv():
    """``calibrateCamera`` on the same corners: within half a deviation, and deviations that agree to 40 %."""
    views, found = own_views(3), own_fit(3)
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    _, k, d, _, _, sd, _, _ = cv2.calibrateCameraExtended(
        [v.local_m.astype(np.float32) for v in views],
        [v.uv_px.astype(np.float32) for v in views],
        SIZE,
        np.eye(3),
        np.zeros(5),
        flags=flags,
    )
    theirs = np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], d.ravel()[0], d.ravel()[1]])
    known = KnownLens(name="a", lens=found.lens, free=found.free, cov=found.cov)
    assert (np.abs(known.numbers[:6] - theirs) < 0.5 * known.sd[:6]).all()
    np.testing.assert_allclose(known.sd[:6] / sd.ravel()[:6], 1.0, atol=0.4)


def test_errors_of_one_picture_go_together():
    """Every corner given four times with one error: nothing is known that was not, so deviations do not halve.

    Over 6 seeds the median ratio is above 0.75: chance moves a single one by 0.2.
    """
    ratio = []
    for seed in range(6):
        again = [
            Corners(ids=np.tile(v.ids, 4), local_m=np.tile(v.local_m, (4, 1)), uv_px=np.tile(v.uv_px, (4, 1)))
            for v in own_views(seed)
        ]
        ratio.append(fit_intrinsics(again, SIZE, name="a", choices=("brown2",)).f_sd_px / own_fit(seed).f_sd_px)
    assert np.median(ratio) > 0.75


@pytest.mark.parametrize("flat", [False, True])
def test_a_place_is_as_well_known_as_it_says(flat):
    """Eight seeds, lenses that err by their deviations: 95 % intervals hold 144 numbers, but for 15 (99.9 %)."""
    outside = 0
    for seed in range(8):
        cameras, lenses, xyz, uv = scene(seed, flat=flat)
        for found, true in zip(place_cameras(lenses, xyz, uv), cameras, strict=True):
            moved = found.camera.position_m - true.position_m
            turned = Rotation.from_matrix(found.camera.rotation @ true.rotation.T).as_rotvec()
            outside += np.count_nonzero(np.abs(moved) > found.t95 * found.position_sd_m)
            outside += np.count_nonzero(np.abs(turned) > found.t95 * found.turn_sd_rad)
    assert outside <= 15


def test_a_place_beside_opencv():
    """``solvePnP`` refined by its own Levenberg-Marquardt on the same points: the same place to a micrometre."""
    _, lenses, xyz, uv = scene(5)
    found = place_camera(lenses[0], xyz, uv[0])
    lens = lenses[0].lens
    _, rvec, tvec = cv2.solvePnP(xyz, uv[0], lens.intrinsic, lens.coefficients, flags=cv2.SOLVEPNP_ITERATIVE)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-14)
    rvec, tvec = cv2.solvePnPRefineLM(xyz, uv[0], lens.intrinsic, lens.coefficients, rvec, tvec, stop)
    place = -cv2.Rodrigues(rvec)[0].T @ tvec.ravel()
    np.testing.assert_allclose(found.camera.position_m, place, atol=1e-6)


def test_a_wrong_click_is_left_out_and_named():
    """One of ten clicks 20 px away: it alone is left out, and the place is that of the other nine."""
    _, lenses, xyz, uv = scene(2)
    clean = place_camera(lenses[1], np.delete(xyz, 4, axis=0), np.delete(uv[1], 4, axis=0))
    uv[1, 4] += [20.0, -3.0]
    found = place_camera(lenses[1], xyz, uv[1])
    assert found.left_out == (4,)
    np.testing.assert_allclose(found.camera.position_m, clean.camera.position_m, atol=1e-9)


def test_places_that_points_do_not_tell_are_refused():
    """Too few points, a line, rows from below, other points, and a plane seen from afar: each in words of its own."""
    _, lenses, xyz, uv = scene(4)
    with pytest.raises(CalibrationError, match="3 different known points were clicked, and 4 are needed"):
        place_camera(lenses[0], xyz[:3], uv[0, :3])
    line = np.linspace(0, 1, 10)[:, None] * [1.0, 0, 0]
    with pytest.raises(CalibrationError, match="lie on one line"):
        place_camera(lenses[0], line, uv[0])
    below = uv[0] * [1, -1] + [0, SIZE[1] - 1]
    with pytest.raises(CalibrationError, match=r"by 0\.\d+ px if rows are counted from below: give `origin`"):
        place_camera(lenses[0], xyz, below)
    with pytest.raises(CalibrationError, match="list the same points"):
        place_camera(lenses[0], xyz, uv[0, ::-1])
    small = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 0.2, 0]]) * 0.02
    noise = np.random.default_rng(1).normal(0, 0.3, (5, 2))
    camera = rig(3)[0]
    with pytest.raises(CalibrationError, match=r"fit two places alike|leave its position open"):
        place_camera(replace(lenses[0], lens=camera.lens), small, camera.record(small) + noise)


def test_pictures_of_other_times_under_the_same_names():
    """Two cameras that filmed the board one after the other, their pictures numbered alike: the reason is named."""
    cameras, rng = rig(2), np.random.default_rng(7)
    views = {}
    for camera in cameras:
        boards = {str(i): T for i, T in enumerate(poses(rng, camera, 10))}
        views |= seen(rng, (camera,), boards)
    with pytest.raises(CalibrationError, match=r"do not fit one scene: not of one instant.*share 10 names"):
        calibrate_boards(views, BOARD, choices=("brown2",))


def test_tables_of_clicks(tmp_path):
    """A row a click, a row a point with names or numbers of cameras: the same pixels; mistakes named."""
    known, points = ("left", "right"), ("a", "b")
    uv = np.array([[[1.0, 2], [3, 4]], [[5, 6], [np.nan, np.nan]]])
    tables = {
        "long": "camera,point,x,y\nright,a,5,6\nleft,a,1,2\nleft,b,3,4\n",
        "named": "point,left_x,left_y,right_x,right_y\nb,3,4,,\na,1,2,5,6\n",
        "numbered": "cam2_u,cam2_v,cam1_u,cam1_v\n5,6,1,2\nNaN,NaN,3,4\n",
    }
    for name, text in tables.items():
        (tmp_path / name).write_text(text)
        np.testing.assert_array_equal(read_clicks(tmp_path / name, known, points), uv)
    (tmp_path / "wrong").write_text("camera,point,x,y\nleft,c,1,2\n")
    with pytest.raises(FormatError, match="there is no point 'c'"):
        read_clicks(tmp_path / "wrong", known, points)
    (tmp_path / "scene").write_text("point,x_mm,y_mm,z_mm\na,1000,0,2\n")
    assert read_scene(tmp_path / "scene", None)[1].tolist() == [[1.0, 0.0, 0.002]]
    with pytest.raises(FormatError, match="its titles state mm"):
        read_scene(tmp_path / "scene", "cm")


def test_lenses_come_back_as_written(tmp_path):
    """Numbers and covariance to rounding; a calibration without covariance is a lens taken as exact."""
    _, lenses, _, _ = scene(1)
    write_lenses(tmp_path / "lenses.toml", lenses)
    for a, b in zip(lenses, read_lenses(tmp_path), strict=True):
        np.testing.assert_allclose(a.numbers, b.numbers, rtol=1e-15)
        np.testing.assert_array_equal(a.cov, b.cov)
    assert len(read_calibration(tmp_path / "lenses.toml")) == 3
    with pytest.raises(FormatError, match=r"contains no lenses.toml and no calibration.toml"):
        read_lenses(tmp_path.parent)


def small_rig():
    """Two cameras of 480 x 360 px with lenses."""
    lens = BrownLens.of((450.0, 452.0), (238.0, 181.0), (-0.15, 0.03, 0.0, 0.0, 0.0))
    out = []
    for name, at in (("left", [1.5, -0.8, 1.3]), ("right", [1.4, 0.9, 1.2])):
        rotation = look_at(np.array(at))
        shift = -rotation @ np.array(at)
        out.append(
            pinhole_camera(
                name, intrinsic=lens.intrinsic, rotation=rotation, translation_m=shift, lens=lens, size_px=(480, 360)
            )
        )
    return out


def test_pictures_a_film_and_clicks_as_a_user_has_them(tmp_path, monkeypatch, capfd):
    """Own pictures of one camera and a film of the other; then clicked points, then a board on the floor: the rig."""
    import av

    def mocap(*words):
        monkeypatch.setattr(sys, "argv", ["mocap", "calibrate", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        told = capfd.readouterr()
        return int(ended.value.code or 0), told.out, told.err

    cameras, board = small_rig(), Board(columns=7, rows=6, square_m=0.09)
    own, floor = tmp_path / "own", tmp_path / "floor"
    own.mkdir()
    floor.mkdir()
    for i, camera in enumerate(cameras):
        write_board_session(board_session([camera], board, seed=i, n_frames=9), tmp_path / camera.name)
        shutil.move(tmp_path / camera.name / "images" / camera.name, own / camera.name)
    with av.open(str(own / "right.mp4"), "w") as film:
        stream = film.add_stream("libx264", rate=30, options={"crf": "10"})
        stream.width, stream.height, stream.pix_fmt = 480, 360, "yuv420p"
        for path in sorted((own / "right").iterdir()):
            film.mux(
                stream.encode(av.VideoFrame.from_ndarray(np.asarray(cv2.imread(str(path)), np.uint8), format="bgr24"))
            )
        film.mux(stream.encode())
    shutil.rmtree(own / "right")
    size = ("--checkerboard", "6x5", "--square-mm", "90")
    code, out, err = mocap("lenses", own, *size, "--lens", "brown2", "--out", tmp_path / "lenses", "--json")
    assert code == 0, err
    for found in json.loads(out)["cameras"].values():
        assert abs(found["f_px"][0] - 450) < 4 * found["sd"][0]
        assert abs(found["distortion"][0] + 0.15) < 4 * found["sd"][4]

    rng = np.random.default_rng(1)
    xyz = rng.uniform(-0.3, 0.3, (8, 3))
    uv = record(cameras, xyz) + rng.normal(0, 0.3, (2, 8, 2))
    rows = [f"p{i},{x},{y},{z}" for i, (x, y, z) in enumerate(1e3 * xyz)]
    (tmp_path / "scene.csv").write_text("\n".join(["name,x,y,z", *rows]) + "\n")
    rows = [f"{c.name},p{i},{u},{v}" for c, per in zip(cameras, uv, strict=True) for i, (u, v) in enumerate(per)]
    (tmp_path / "clicks.csv").write_text("\n".join(["camera,point,x,y", *rows]) + "\n")
    words = ("--lenses", tmp_path / "lenses", "--points", tmp_path / "scene.csv", "--pixels", tmp_path / "clicks.csv")
    code, out, err = mocap("places", *words, "--unit", "mm", "--out", tmp_path / "points", "--json")
    assert code == 0, err
    report = json.loads(out)
    for camera in cameras:
        found = report["cameras"][camera.name]
        off = np.abs(np.array(found["position_m"]) - decompose(camera).position_m)
        assert (off < 2 * found["t95"] * np.array(found["position_sd_m"])).all()
    assert max(report["triangulated_mm"].values()) < 12  # 4 sd of 0.3 px at 2.1 m, f 450 px, depth at 50 degrees

    lying = np.diag([1.0, -1.0, -1.0])
    for camera in cameras:
        picture = photograph(
            viewfinder(camera), board, board.texture(), rotation=lying, translation_m=np.array([-0.3, 0.27, 0.0]),
            rng=rng, blur_px=0.7, noise=1.5,
        )  # fmt: skip
        assert picture is not None
        assert cv2.imwrite(str(floor / f"{camera.name}.png"), picture)  # pyright: ignore
    code, _, err = mocap("places", "--lenses", tmp_path / "lenses", "--board", floor, *size, "--out", tmp_path / "two")
    assert code == 0, err
    found = [decompose(c).position_m for c in read_calibration(tmp_path / "two" / "calibration.toml")]
    true = [decompose(c).position_m - [-0.3 + 0.09, 0.27 - 0.09, 0.0] for c in cameras]
    np.testing.assert_allclose(found, true, atol=0.01)
    code, _, err = mocap("places", "--lenses", tmp_path / "lenses", "--out", tmp_path / "no")
    assert code == 1
    assert "--points and --pixels, or --board" in err
