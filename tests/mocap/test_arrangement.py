"""Mirrored axes, cameras in another order and shifted films are found and named; clean recordings are not accused."""

import re
from dataclasses import replace

import numpy as np
import pytest

from mocap.audit import alarms, audited, fit_findings
from mocap.cameras.arrangement import ArrangementError, by_camera, find_arrangement
from mocap.cameras.camera import dlt_coefficients, record
from mocap.cameras.origin import PixelOptions, decide_origin
from mocap.errors import CalibrationError
from mocap.records import PixelTracks
from tests.mocap.rigs import look_at, ring
from tests.mocap.test_audit import moving
from tests.real_data import real

WIDTH, HEIGHT = 2048.0, 1024.0
FRAMES = np.arange(0, 200, 3)  # of a second


def scene(lens, seed=1, sized=False, noise=0.5):
    """Four cameras that stand in no regular order, and pixels of a swimming body."""
    rng = np.random.default_rng(seed)
    cameras = []
    for camera, position in zip(ring(4, lens=lens), rng.uniform([-2, -2, 0.3], [2, 2, 2.0], (4, 3)), strict=True):
        position = 2.5 * position / np.linalg.norm(position)
        intrinsic = np.array([[1200.0, 0, WIDTH / 2], [0, 1212.0, HEIGHT / 2], [0, 0, 1]])
        turned = look_at(position)
        matrix = intrinsic @ np.column_stack([turned, -turned @ position])
        own = None if camera.lens is None else replace(camera.lens, centre_px=(WIDTH / 2, HEIGHT / 2))
        size = (int(WIDTH), int(HEIGHT)) if sized else None
        cameras.append(replace(camera, matrix=matrix, size_px=size, lens=own))
    uv = record(cameras, moving(FRAMES))
    return tuple(cameras), uv + rng.normal(0, noise, uv.shape)


def mirrored(uv):
    """Columns from the right in two of four cameras."""
    uv[[0, 3], ..., 0] = WIDTH - uv[[0, 3], ..., 0]


def upside_down(uv):
    """Rows from below in one camera."""
    uv[2, ..., 1] = HEIGHT - uv[2, ..., 1]


def exchanged(uv):
    """Two cameras in each other's place."""
    uv[[1, 2]] = uv[[2, 1]]


def moved_round(uv):
    """Every camera in the place of the next."""
    uv[:] = np.roll(uv, 1, axis=0)


def below(uv):
    """The films of two cameras stood below the others'."""
    uv[[1, 2], ..., 1] += HEIGHT


FAULTS = {
    "mirrored": (mirrored, "mirrored pixels", {"cam1", "cam4"}, "u mirrored"),
    "upside down": (upside_down, "mirrored pixels", {"cam3"}, "v flipped"),
    "exchanged": (exchanged, "swapped cameras", {"cam2", "cam3"}, "pixels of 'cam2' with the calibration of 'cam3'"),
    "moved round": (moved_round, "swapped cameras", {"cam1", "cam2", "cam3", "cam4"}, "another order"),
    "below": (below, "shifted pixels", {"cam2", "cam3"}, "v -> v - "),
}


@pytest.mark.rare
@pytest.mark.parametrize(
    ("fault", "lens"), [*((fault, False) for fault in FAULTS), ("mirrored", True), ("exchanged", True)]
)
def test_what_was_done_to_the_pixels_is_named(fault, lens):
    """With a lens or without, the size of pictures not known: the change, its cameras and both residuals.

    Undone, rays meet as the noise lets them: the median of 4 cameras' residuals at 0.5 px is 0.45 px.
    """
    change, kind, names, words = FAULTS[fault]
    cameras, uv = scene(lens)
    assert find_arrangement(cameras, uv) is None
    change(uv)
    found = find_arrangement(cameras, uv)
    assert found is not None
    assert (found.kind, set(found.cameras)) == (kind, names)
    assert words in found.describe()
    assert found.undone_px == pytest.approx(0.45, abs=0.1)
    assert found.residual_px > 5
    with pytest.raises(ArrangementError, match=r"px as the files are"):
        decide_origin(cameras, uv)


def test_a_moved_camera_and_noise_are_no_arrangement():
    """A camera that was turned, and 6 px of noise: no flip is blamed; rays that miss by far are warned of."""
    cameras, uv = scene(False)
    bent = uv.copy()
    bent[1] += [25.0, -14.0]
    assert find_arrangement(cameras, bent) is None
    assert find_arrangement(*scene(False, noise=6.0)) is None
    turned = uv + (0.6 * np.array([[30.0, -5], [-22, 18], [9, -33], [-28, 14]]))[:, None, None]
    (found,) = alarms(fit_findings(cameras, turned))
    assert found.kind == "large residual"
    assert found.numbers["jitter_px"] == pytest.approx(0.5, abs=0.05)
    (noisy,) = [fit_findings(*scene(False, noise=12.0))]
    assert not noisy  # 12 px of clicks that are that careless are noise, not cameras


def test_corners_that_differ_unstated_are_told_loudly():
    """A picture height lets rows be flipped; a choice that nobody stated is an alarm, one that was stated is not."""
    cameras, uv = scene(False)
    uv[..., 1] = HEIGHT - uv[..., 1]
    for stated in (False, True):
        decision = decide_origin(
            cameras,
            uv,
            PixelOptions(
                origin="lower-left" if stated else None,
                calibration_origin="upper-left" if stated else None,
                image_height_px=HEIGHT,
            ),
        )
        flipped = uv * [1, -1] + [0, HEIGHT]
        tracks = PixelTracks(names=tuple("abcde"), cameras=tuple(c.name for c in cameras), t_s=FRAMES / 200, uv_px=uv)
        told = [f for f in alarms(audited(cameras, tracks, flipped, decision).findings) if f.kind == "pixel origin"]
        assert bool(told) == (not stated)


def paired(uv):
    """Left markers in the first two cameras alone, right ones in the other two, as beside a treadmill."""
    uv = uv.copy()
    uv[2:, :, :3] = np.nan
    uv[:2, :, 3:] = np.nan
    return uv


@pytest.mark.parametrize("which", [(2, 3), (0, 3), (1,), (0, 1, 2)])
def test_mirrored_pairs_are_named(which):
    """No marker is seen by three cameras: each pair is judged by its own points, and a good one hides no bad one.

    Which camera of a pair it was its rays cannot always tell; the pair that is wrong they do.
    """
    cameras, uv = scene(False)
    uv = paired(uv)
    assert find_arrangement(cameras, uv) is None
    decide_origin(cameras, uv)
    for c in which:
        uv[c, ..., 0] = WIDTH - uv[c, ..., 0]
    with pytest.raises(ArrangementError, match=r"px as the files are") as raised:
        decide_origin(cameras, uv)
    found = raised.value.arrangement
    assert {int(name[-1]) > 2 for name in found.cameras} == {c > 1 for c in which}
    assert found.undone_px < 1.5 < 3 < found.residual_px


def test_one_bad_pair_is_a_finding():
    """A camera that was turned makes its pair's points miss by 3 times as much: told, with both numbers.

    Cameras of which one is clicked 4 times as carelessly are not accused, nor are sound pairs.
    """
    cameras, uv = scene(False)
    uv = paired(uv)
    assert not fit_findings(cameras, uv)
    careless = uv.copy()
    careless[3] += np.random.default_rng(1).normal(0, 2.0, uv[3].shape)
    assert not fit_findings(cameras, careless)
    uv[3] += [14.0, 17.0]
    (found,) = fit_findings(cameras, uv)
    assert (found.kind, found.cameras) == ("uneven cameras", ("cam3", "cam4"))
    assert found.numbers["worst_px"] > 3 * found.numbers["best_px"]


@pytest.fixture
def files(tmp_path):
    """Pixels and coefficients of a rig as DLTdv writes them; two cameras mirrored."""
    cameras, uv = scene(False)
    mirrored(uv)
    names = [f"pt{m + 1}_cam{c + 1}_{x}" for m in range(5) for c in range(4) for x in "XY"]
    table = uv.transpose(1, 2, 0, 3).reshape(len(uv[0]), -1)
    pixels, coefficients = tmp_path / "trial_xypts.csv", tmp_path / "trial_dltCoefs.csv"
    np.savetxt(pixels, table, "%.6f", ",", header=",".join(names), comments="")
    np.savetxt(coefficients, np.stack([dlt_coefficients(c) for c in cameras], axis=1), "%.12g", ",")
    return pixels, coefficients


def test_mirrored_files_are_refused_and_described(mocap, files, tmp_path):
    """``triangulate`` writes nothing of them; ``info`` names the cameras, the formula, both residuals."""
    pixels, coefficients = files
    out = tmp_path / "x.csv"
    code, _, err = mocap("triangulate", pixels, "--calibration", coefficients, "--out", out)
    assert code == 1
    assert not out.exists()
    assert "u mirrored (u -> 20" in err
    assert "'cam1', 'cam4'" in err
    code, out, _ = mocap("info", pixels, coefficients)
    assert code == 0
    assert "u mirrored (u -> 20" in out


def test_info_takes_the_corners_that_track_takes(mocap, files):
    """What is stated is what is printed."""
    pixels, coefficients = files
    table = np.loadtxt(pixels, delimiter=",", skiprows=1).reshape(-1, 5, 4, 2)
    table[:, :, [0, 3], 0] = WIDTH - table[:, :, [0, 3], 0]
    header = pixels.read_text().splitlines()[0]
    np.savetxt(pixels, table.reshape(len(table), -1), "%.6f", ",", header=header, comments="")
    for corner in ("upper-left", "lower-left"):
        _, out, _ = mocap("info", pixels, coefficients, "--origin", corner, "--image-height", HEIGHT)
        assert f"pixel origin {corner}" in out


@pytest.mark.slow
def test_a_real_bats_mirrored_columns_are_named():
    """FE404 F2 with u -> 2048 - u in two cameras: named, with the residuals; as it is, nothing is blamed."""
    from mocap.io.dltdv import read_coefficients, read_pixels
    from mocap.io.profile import with_profile

    folder = real("bat_windtunnel_dltdv8", "derived_csv", "FE404_F2")
    cameras = with_profile(read_coefficients(folder / "FE404_F2_dltCoefs.csv"), folder / "FE404_F2_camera_profile.txt")
    uv = read_pixels(folder / "FE404_F2_xypts.csv", fps=700).uv_px.copy()
    assert find_arrangement(cameras, uv) is None
    assert cameras[0].lens is not None
    uv[[0, 2], ..., 0] = 2 * cameras[0].lens.centre_px[0] - uv[[0, 2], ..., 0]
    found = find_arrangement(cameras, uv)
    assert found is not None
    assert "u mirrored" in found.change
    assert found.residual_px > 5 * found.undone_px


def odd_principal_points(cameras):
    """The same places, with principal points as coefficients of few points have them: heights from 400 to 1500."""
    found = []
    for camera, height in zip(cameras, (400.0, 1500.0, 900.0, 600.0), strict=True):
        shift = np.eye(3)
        shift[1, 2] = (height - HEIGHT) / 2
        found.append(replace(camera, matrix=shift @ camera.matrix))
    return tuple(found)


@pytest.mark.rare
def test_flipped_cameras_are_named_where_principal_points_tell_no_height():
    """Both of them, with the height that was found to 1 %, and what states it.

    The same cameras with sound pixels are not accused, nor with pixels of others, which ask for the height.
    """
    cameras, _ = scene(False, noise=0.0)
    cameras = odd_principal_points(cameras)
    uv = record(cameras, moving(FRAMES)) + np.random.default_rng(2).normal(0, 0.3, (4, len(FRAMES), 5, 2))
    assert decide_origin(cameras, uv).residual_px < 1
    bad = uv.copy()
    bad[[1, 2], ..., 1] = HEIGHT - bad[[1, 2], ..., 1]
    with pytest.raises(ArrangementError) as said:
        decide_origin(cameras, bad)
    assert said.value.arrangement.cameras == (cameras[1].name, cameras[2].name)
    (height,) = re.findall(r"v -> (\d+) - v", str(said.value))
    assert float(height) == pytest.approx(HEIGHT, rel=0.01)
    assert "put it at 400 to 1500; state `image_height_px`" in str(said.value)
    with pytest.raises(CalibrationError, match="put it at 400 to 1500") as other:
        decide_origin(cameras, np.random.default_rng(3).uniform(0, HEIGHT, uv.shape))
    assert not isinstance(other.value, ArrangementError)


def test_medians_by_camera_are_numpys():
    """Of many sets of points at once: to the last bit what ``np.median`` gives; NaN where a camera sees none."""
    rng = np.random.default_rng(0)
    residual, seen = rng.gamma(2.0, size=(5, 7, 11)), rng.random((3, 5, 7, 11)) < 0.6
    residual[rng.random(residual.shape) < 0.2] = np.nan
    seen[1, 2, 3] = False
    found = by_camera(residual, seen)
    for place in np.ndindex(found.shape):
        own = residual[place[1:]][seen[place] & np.isfinite(residual[place[1:]])]
        assert np.array_equal(found[place], np.median(own) if len(own) else np.nan, equal_nan=True)
    assert np.isnan(found[1, 2, 3])
    assert np.isnan(by_camera(residual[..., :0], seen[..., :0])).all()
