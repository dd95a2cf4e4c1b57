"""Films cropped by a window: offsets from MATLAB files, DeepLabCut and tables put pixels into the whole picture."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from typer.testing import CliRunner

import mocap
from mocap.cameras.camera import project, stacked
from mocap.cleaning.cleaning import clean
from mocap.cli.main import app
from mocap.errors import FormatError
from mocap.io.crop import crops_of, matched, read_crops
from mocap.io.dltdv import read_points, write_coefficients
from tests.mocap.rigs import cloud, ring
from tests.real_data import real

N_FRAMES = 30
NAMES = ("a", "b", "c", "d", "e")
ARENA = "bat_arena_two_digitisers"


def write_views(folder: Path, uv: np.ndarray) -> list[Path]:
    """A file of DeepLabCut a camera, film names as a camera's number and a date."""
    paths = []
    for camera, tracks in enumerate(uv, start=1):
        path = folder / f"Cam{camera}_2020-06-25_10{camera}DLC_resnet50_shuffle1.csv"
        cells = [f"{x:.6f},{y:.6f},1" for row in tracks for x, y in row]
        rows = [",".join([str(t), *cells[t * len(NAMES) : (t + 1) * len(NAMES)]]) for t in range(len(tracks))]
        heads = [
            ["scorer", *["net"] * (3 * len(NAMES))],
            ["bodyparts", *[name for name in NAMES for _ in range(3)]],
            ["coords", *["x", "y", "likelihood"] * len(NAMES)],
        ]
        path.write_text("\n".join([*map(",".join, heads), *rows]) + "\n")
        paths.append(path)
    return paths


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """Points that move, windows that follow them, files of cropped pixels, and the calibration of whole pictures."""
    folder = tmp_path_factory.mktemp("flight")
    rng = np.random.default_rng(0)
    cameras = ring(3)
    body = cloud(rng, len(NAMES), radius_m=0.05)
    xyz = body + np.linspace([-0.3, 0.1, 0.0], [0.3, -0.2, 0.1], N_FRAMES)[:, None]
    uv = project(stacked(cameras), xyz)
    windows = np.rint(uv.mean(axis=2) - 200)
    write_coefficients(folder / "dltCoefs.csv", cameras)
    cropped = uv - windows[:, :, None]
    return xyz, windows, write_views(folder, cropped), folder / "dltCoefs.csv", cropped


def save_windows(folder: Path, windows: np.ndarray) -> None:
    """As the films are named."""
    folder.mkdir(exist_ok=True)
    for camera, window in enumerate(windows, start=1):
        savemat(folder / f"Cam{camera}_2020-06-25_10{camera}.mat", {"XYtop_left": window})


def test_points_of_cropped_films_are_those_of_the_whole_ones(flight, tmp_path):
    """With XYtop_left, a row a frame, triangulation gives the true points to what six digits of a pixel say."""
    xyz, windows, views, calibration, _ = flight
    save_windows(tmp_path / "crops", windows)
    recording = mocap.read(views, calibration=calibration, fps=100, crop=tmp_path / "crops")
    prepared = clean(recording)
    np.testing.assert_allclose(prepared.xyz_m, xyz, atol=1e-6)
    assert any("crop offsets" in said.text and "129" not in said.text for said in prepared.findings)


def test_the_command_adds_offsets_and_finds_them_beside_the_films(flight, tmp_path):
    """--crop, and the same without it where the files lie beside the tracks under the films' names."""
    xyz, windows, _, calibration, cropped = flight
    views = write_views(tmp_path, cropped)
    save_windows(tmp_path / "crops", windows)
    common = ["triangulate", *map(str, views), "--calibration", str(calibration), "--fps", "100"]
    given = CliRunner().invoke(app, [*common, "--crop", str(tmp_path / "crops"), "--out", str(tmp_path / "one.csv")])
    assert given.exit_code == 0, given.output
    save_windows(tmp_path, windows)
    beside = CliRunner().invoke(app, [*common, "--out", str(tmp_path / "two.csv")])
    assert beside.exit_code == 0, beside.output
    for name in ("one.csv", "two.csv"):
        np.testing.assert_allclose(read_points(tmp_path / name, fps=100).xyz_m, xyz, atol=1e-6)


def test_convert_adds_offsets(flight, tmp_path):
    """DLTdv's set of cropped films with --crop triangulates to the true points without it; they need a calibration."""
    xyz, windows, _, calibration, cropped = flight
    views = write_views(tmp_path, cropped)
    save_windows(tmp_path / "crops", windows)
    crop, out = ["--crop", str(tmp_path / "crops")], tmp_path / "all_xypts.csv"
    done = CliRunner().invoke(app, ["convert", *map(str, views), str(calibration), str(out), *crop])
    assert done.exit_code == 0, done.output
    recording = mocap.read(out, calibration=tmp_path / "all_dltCoefs.csv", fps=100)
    np.testing.assert_allclose(clean(recording).xyz_m, xyz, atol=1e-5)
    bare = CliRunner().invoke(app, ["convert", *map(str, views), str(tmp_path / "b_xypts.csv"), *crop])
    assert "crop offsets are added to pixels of calibrated cameras" in str(bare.exception)


def test_cropped_films_without_offsets_are_recognised(flight, tmp_path):
    """The refusal names the case and the option, with both sizes."""
    _, _, _, calibration, cropped = flight
    views = write_views(tmp_path, cropped)
    with pytest.raises(mocap.MocapError, match=r"pixels span \d+ x \d+, the calibration 1280 x 1024: cropped\? give"):
        mocap.read(views, calibration=calibration, fps=100)


def test_offsets_beside_that_do_not_help_are_left(flight, tmp_path):
    """Pixels of whole pictures beside a file of offsets: rays meet without them, and the report says so."""
    xyz, windows, _, calibration, cropped = flight
    views = write_views(tmp_path, cropped + windows[:, :, None])
    save_windows(tmp_path, windows)
    prepared = clean(mocap.read(views, calibration=calibration, fps=100))
    np.testing.assert_allclose(prepared.xyz_m, xyz, atol=1e-6)
    assert any("were not added" in said.text for said in prepared.findings)


@pytest.mark.parametrize("given", [True, False])
def test_of_one_camera_no_residual_tells_of_offsets(flight, tmp_path, given):
    """Given, they are added; beside the tracks, they are not, and what to state is said: rays of one never meet."""
    _, windows, _, _, cropped = flight
    views = write_views(tmp_path, cropped[:1])
    write_coefficients(tmp_path / "dltCoefs.csv", ring(3)[:1])
    save_windows(tmp_path / "crops" if given else tmp_path, windows[:1])
    options = {"crop": tmp_path / "crops"} if given else {"origin": "upper-left"}
    recording = mocap.read(views[0], calibration=tmp_path / "dltCoefs.csv", fps=100, **options)
    (said,) = (one.text for one in recording.findings if "crop offsets" in one.text)
    assert "no marker is seen by two cameras" in said
    assert "inf" not in said
    assert ("were added" in said) == given
    assert ("give `crop`" in said) != given


def test_each_way_of_writing_offsets_is_read(tmp_path):
    """DeepLabCut's config.yaml and meta file hold a constant corner, tables one a frame or one a camera."""
    config = tmp_path / "config.yaml"
    config.write_text(
        "Task: bats\nvideo_sets:\n  C:\\videos\\cam1.avi:\n    crop: 0, 640, 0, 480\n  /videos/cam2.avi:\n"
        "    crop: 100, 551, 20, 521\nbodyparts:\n- a\n"
    )
    assert {k: v.tolist() for k, v in read_crops(config).items()} == {"cam1": [[0, 0]], "cam2": [[100, 20]]}
    meta = tmp_path / "cam1DLC_meta.pickle"
    meta.write_bytes(pickle.dumps({"data": {"cropping": True, "cropping_parameters": [7, 458, 9, 510]}}))
    assert read_crops(meta)["cam1DLC"].tolist() == [[7, 9]]
    (tmp_path / "cam3.csv").write_text("x,y\n1,2\n3,4\n")
    assert read_crops(tmp_path / "cam3.csv")["cam3"].tolist() == [[1, 2], [3, 4]]
    (tmp_path / "all.csv").write_text("camera,x,y\ncam1,1,2\ncam12,3,4\n")
    crops = crops_of([tmp_path / "all.csv"])
    both = matched(crops, [("trial cam12",), ("trial cam1",)])
    assert both is not None
    assert [offset.tolist() for offset in both] == [[[3, 4]], [[1, 2]]]  # cam1 is not in cam12


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.csv", "x,y\n1\n", "line 2 has 1 cells"),
        ("a.csv", "x,y\n1,nan\n", "expected finite x, y"),
        ("a.csv", "a,b\n1,2\n", "contains no crop offsets"),
        ("a_meta.pickle", "nothing", "contains no crop offsets"),
    ],
)
def test_what_is_no_offset_is_refused(tmp_path, name, text, said):
    """One line that says what is wrong."""
    (tmp_path / name).write_text(text)
    with pytest.raises(FormatError, match=said):
        read_crops(tmp_path / name)


def test_offsets_of_too_few_frames_are_refused(flight, tmp_path):
    """Ten rows for thirty frames."""
    _, windows, views, calibration, _ = flight
    save_windows(tmp_path / "crops", windows[:, :10])
    with pytest.raises(FormatError, match=r"have 10 rows, but it is seen in its frame 30"):
        clean(mocap.read(views, calibration=calibration, fps=100, crop=tmp_path / "crops"))


def test_two_digitisers_of_a_real_flight():
    """Clicks in windows of 451 x 501: a residual of 0.6 to 0.8 px with offsets and lens (PROVENANCE.md), 139 without.

    Without offsets the refusal names both sizes.
    """
    folder = real(ARENA)
    project_file = folder / "validation_files_1" / "103_103_100_val_AS_dvProject.mat"
    crop = folder / "crop_files" / "103_103_100"
    lens = next(folder.glob("*Tforms.mat"))
    stated = {"calibration": next(folder.glob("*easyWandData.mat")), "fps": 800.0, "profile": lens}
    prepared = clean(mocap.read(project_file, crop=crop, **stated))
    assert 0.4 < np.nanmedian(prepared.residual_px) < 1.0
    with pytest.raises(mocap.MocapError, match=r"pixels span 4\d\d x \d+, the calibration 1280 x 1024: cropped\?"):
        clean(mocap.read(project_file, **stated))


def test_deeplabcut_counts_pixels_from_0_and_matlab_from_1(flight, tmp_path):
    """Clicks whose first pixel is (0, 0) with an undistortion by easyWand, whose first is (1, 1): exact points, told.

    Without the pixel all points would be off the same way: by 1 px at 2 m and f = 1200 px, 2 mm.
    """
    xyz, windows, _, calibration, cropped = flight
    views = write_views(tmp_path, cropped + windows[:, :, None] - 1.0)
    lens = tmp_path / "cam1Tforms.mat"
    savemat(lens, {"camud": {"tdata": np.array([1200.0, 1212.0, 640.0, 512.0, 0.0, 0, 0, 0, 0, 3])}})
    prepared = clean(mocap.read(views, calibration=calibration, fps=100, profile=lens))
    np.testing.assert_allclose(prepared.xyz_m, xyz, atol=1e-6)
    assert any("counts pixels from 0" in said.text for said in prepared.findings)


def test_info_says_what_crop_offsets_are(tmp_path, mocap):
    """They are no recording: how to give them is told, and no format that is near; another MATLAB file has that."""
    savemat(tmp_path / "cam1.mat", {"XYtop_left": np.zeros((5, 2))})
    savemat(tmp_path / "other.mat", {"something": np.zeros((5, 2))})
    code, out, _ = mocap("info", tmp_path / "cam1.mat")
    assert code == 1
    assert "crop offsets of a cropped video: give them as --crop" in " ".join(out.split())
    assert "Nearest" not in out
    _, out, _ = mocap("info", tmp_path / "other.mat")
    assert "Nearest" in out
