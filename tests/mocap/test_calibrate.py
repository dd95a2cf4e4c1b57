"""``mocap calibrate`` as a user has it: files in, files out, one line where it cannot be."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from mocap.datasets.calibration_session import Board, board_session, write_board_session
from mocap.datasets.rig import tank_cameras

from mocap.cameras.camera import Camera, decompose, project, record, stacked
from mocap.cli.main import main
from mocap.io.anipose import read_calibration
from mocap.io.dltdv import read_coefficients, write_coefficients, write_pixels
from mocap.io.profile import write_profile
from mocap.records import PixelTracks
from tests.mocap.board_scenes import rig
from tests.mocap.rigs import cloud, ring
from tests.mocap.test_calibrate_wand import waved


@dataclass(frozen=True)
class Done:
    """How the command ended."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def mocap(monkeypatch, capfd):
    """The command ``mocap calibrate``, in this process."""

    def run(*words: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["mocap", "calibrate", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        told = capfd.readouterr()
        return Done(int(ended.value.code or 0), told.out, told.err)

    return run


def wand_files(folder: Path, *, flip: bool = False):
    """A wand's pixels and lenses as files, rows counted from above or below."""
    cameras = rig(4)
    uv, _ = waved(1, cameras)
    lenses = [c.camera() for c in cameras]
    if flip:
        uv[..., 1] = 1024 - uv[..., 1]
    names = tuple(c.name for c in cameras)
    write_pixels(folder / "wand_xypts.csv", PixelTracks(names=("a", "b"), cameras=names, t_s=np.arange(40.0), uv_px=uv))
    write_profile(folder / "profile.txt", lenses)
    return cameras


@pytest.mark.rare
@pytest.mark.slow
def test_images_of_a_board_as_files(mocap, tmp_path):
    """Two cameras stand as far apart as they did, to 1 %; with known lenses these stay as they are."""
    cameras = tank_cameras(4, slope_rad=0.5)[:2]
    board = Board(columns=10, rows=7, square_m=0.012)
    write_board_session(board_session(cameras, board, seed=1, n_frames=14, depth=(0.85, 1.1)), tmp_path / "session")
    images = ("images", tmp_path / "session" / "images", "--checkerboard", "9x6", "--square-mm", 12, "--lens", "brown2")
    assert mocap(*images, "--out", tmp_path / "rig").returncode == 0
    found = read_calibration(tmp_path / "rig" / "calibration.toml")
    places = [-np.linalg.solve(p[:, :, :3], p[:, :, 3:])[..., 0] for p in map(stacked, (found, cameras))]
    apart = [np.linalg.norm(a - b) for a, b in places]
    assert apart[0] == pytest.approx(apart[1], rel=0.01)
    known = tmp_path / "rig" / "calibration.toml"
    assert mocap(*images, "--lenses", known, "--out", tmp_path / "again").returncode == 0
    again = read_calibration(tmp_path / "again" / "calibration.toml")
    assert [c.lens.f_px for c in again] == [pytest.approx(c.lens.f_px) for c in found]


@pytest.mark.parametrize("flip", [False, True])
def test_a_wand_as_files(mocap, tmp_path, flip):
    """The rig comes out right-handed whichever corner rows count from; all files agree; nothing is overwritten."""
    cameras = wand_files(tmp_path, flip=flip)
    out = tmp_path / "out"
    words = ["wand", tmp_path / "wand_xypts.csv", "--profile", tmp_path / "profile.txt", "--length-m", 0.4]
    words += ["--free", "none", "--out", out, "--json", *(["--origin", "lower-left"] if flip else [])]
    done = mocap(*words)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["wand_score"] < 0.5
    assert set(report["written"]) == {"dltCoefs.csv", "calibration.toml", "camera_profile.txt"}
    upright = read_calibration(out / "calibration.toml")
    assert not any(decompose(c).mirrored for c in upright)
    places = np.stack([decompose(c).position_m for c in upright])
    true = np.stack([c.position_m for c in cameras])
    triple = [np.linalg.det(p[1:] - p[0]) for p in (places, true)]  # signed volume: the hand of the world
    assert triple[0] == pytest.approx(triple[1], rel=0.02)
    coefficients = read_coefficients(out / "dltCoefs.csv")
    middle = np.zeros((1, 3))
    rows = project(stacked(upright), middle)[..., 1], project(stacked(coefficients), middle)[..., 1]
    np.testing.assert_allclose(rows[1], 1024 - rows[0] if flip else rows[0], atol=1e-3)
    again = mocap(*words)
    assert again.returncode == 1
    assert "give --force" in again.stderr
    assert len(again.stderr.strip().splitlines()) == 1


def test_known_points_and_refinement_as_files(mocap, tmp_path):
    """Coefficients from points in millimetres; knocked cameras refined from tracks; the input is never touched."""
    rng = np.random.default_rng(3)
    cameras, points = ring(3), cloud(rng, 20)
    uv = record(cameras, points)
    np.savetxt(tmp_path / "points.csv", 1e3 * points, delimiter=",", header="x,y,z", comments="")
    np.savetxt(tmp_path / "pixels.csv", np.concatenate(list(uv), axis=1), delimiter=",")
    done = mocap("dlt", tmp_path / "points.csv", tmp_path / "pixels.csv", "--unit", "mm", "--out", tmp_path / "dlt")
    assert done.returncode == 0, done.stderr
    found = read_coefficients(tmp_path / "dlt" / "dltCoefs.csv")
    np.testing.assert_allclose(project(stacked(found), points), uv, rtol=0, atol=1e-3)
    tracks = cloud(rng, 180).reshape(60, 3, 3)
    pixels = record(cameras, tracks) + rng.normal(0, 0.3, (3, 60, 3, 2))
    names = ("hip", "knee", "toe")
    write_pixels(
        tmp_path / "xypts.csv", PixelTracks(names=names, cameras=tuple("abc"), t_s=np.arange(60.0), uv_px=pixels)
    )
    knocked = [c.matrix.copy() for c in cameras]
    knocked[1][:, 3] += knocked[1][:, :3] @ [0.01, -0.01, 0.005]

    write_coefficients(tmp_path / "old.csv", [Camera(name=n, matrix=m) for n, m in zip("abc", knocked, strict=True)])
    before = (tmp_path / "old.csv").read_bytes()
    words = ["refine", tmp_path / "xypts.csv", "--dlt", tmp_path / "old.csv", "--bone", "hip,toe", "--json"]
    done = mocap(*words, "--out", tmp_path / "new")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["after_px"] < 0.5 < report["before_px"]
    assert (tmp_path / "old.csv").read_bytes() == before
    wrong = mocap(*words[:-3], "--bone", "hip,tail", "--out", tmp_path / "no")
    assert wrong.returncode == 1
    assert "expected two of hip, knee, toe" in wrong.stderr


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("images", ".", "--square-mm", 20, "--out", "x"), "state which board was filmed"),
        (("images", ".", "--checkerboard", "9by6", "--square-mm", 20, "--out", "x"), "expected columns x rows"),
        (("images", ".", "--charuco", "7x5", "--square-mm", 20, "--out", "x"), "give --marker-mm"),
        (("images", ".", "--charuco", "7x5", "--square-mm", 20, "--marker-mm", 30, "--out", "x"), "do not fit into"),
        (("wand", "nothing.csv", "--out", "x"), "give --length-m and --profile"),
        (("dlt", "a.csv", "b.csv", "--unit", "inch", "--out", "x"), "m, cm or mm"),
    ],
)
def test_wrong_words_are_one_line(mocap, tmp_path, words, says):
    """What is missing or cannot be is said in one line, exit code 1, and nothing is written."""
    words = [str(w).replace("x", str(tmp_path / "x")) if w == "x" else w for w in words]
    done = mocap(*words)
    assert done.returncode == 1
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "x").exists()
