"""Wands, known points and self-calibration: against truth, against easyWand's own results, on real bats."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat

from mocap.calibration.dlt import fit_dlt
from mocap.calibration.refine import KnownDistance, refine_cameras
from mocap.calibration.scene import in_world, similarity, turn
from mocap.calibration.wand import calibrate_wand, wand_lengths, wand_score
from mocap.cameras.camera import project, record, stacked, undistorted
from mocap.cameras.triangulate import linear
from mocap.errors import CalibrationError
from mocap.io.dltdv import read_coefficients, read_pixels
from mocap.io.easywand import EasyWand, read_easywand
from tests.mocap.board_scenes import SIZE, rig
from tests.mocap.rigs import cloud, ring
from tests.real_data import real

EASYWAND = {
    "cave": (
        "bat_cave_dltdv7",
        "2018-07-28_wand_and_detections",
        "video_calibration_data",
        "round3_2018-07-28_easyWandData.mat",
    ),
    "tunnel": ("bat_windtunnel_dltdv8", "windtunnelCalibration2", "extrinsicCalib_20230228_easyWandData.mat"),
}


def waved(seed, cameras, n=40, length_m=0.4, noise_px=0.3):
    """Pixels (C, n, 2, 2) of a wand held at random, and its true ends."""
    rng = np.random.default_rng(seed)
    middle, along = cloud(rng, n), rng.normal(size=(n, 3))
    along *= length_m / 2 / np.linalg.norm(along, axis=1)[:, None]
    ends = np.stack([middle - along, middle + along], axis=1)
    uv = np.stack([c.record(ends) for c in cameras])
    return uv + rng.normal(0, noise_px, uv.shape), ends


def no_background(cameras):
    """No points but the wand's."""
    return np.full((len(cameras), 0, 1, 2), np.nan)


@pytest.mark.parametrize("n_cameras", [2, 4])
def test_a_wand_gives_the_rig(n_cameras):
    """Points of the true rig are found within 1 mm (0.3 px at 600 px a metre is 0.5 mm), scale included."""
    cameras = rig(4)[:n_cameras]
    uv, ends = waved(1, cameras)
    lenses = [c.lens for c in cameras]
    found = calibrate_wand(lenses, [SIZE] * n_cameras, uv, no_background(cameras), length_m=0.4, moves="none", folds=4)
    exact = np.stack([c.record(ends) for c in cameras])
    ours = [c.camera() for c in found.cameras]

    xyz = linear(stacked(ours), undistorted(ours, exact)).reshape(-1, 3)
    T = similarity(xyz, ends.reshape(-1, 3), scaled=False)
    assert np.linalg.norm(xyz @ T[:3, :3].T + T[:3, 3] - ends.reshape(-1, 3), axis=1).max() < 2e-3
    assert abs(np.median(wand_lengths(ours, exact)) - 0.4) < 4e-4
    assert found.score < 0.5
    assert found.held_out_score < 2 * found.score


def test_wrong_clicks_and_a_wrong_focal_length_are_mended():
    """5 % of the ends elsewhere and focal lengths 3 % off: the wand's length varies by less than half a percent."""
    rng = np.random.default_rng(2)
    cameras = rig(4)
    uv, ends = waved(2, cameras, n=80)
    bad = rng.random(uv.shape[:3]) < 0.05
    uv[bad] += rng.normal(0, 60, (bad.sum(), 2))
    lenses = [type(c.lens).of((1164.0, 1175.6), c.lens.centre_px, c.lens.coefficients) for c in cameras]
    found = calibrate_wand(lenses, [SIZE] * 4, uv, no_background(cameras), length_m=0.4, moves="focal", folds=0)
    np.testing.assert_allclose([c.lens.f_px[0] for c in found.cameras], 1200.0, rtol=5e-3)
    exact = np.stack([c.record(ends) for c in cameras])
    assert wand_score(wand_lengths([c.camera() for c in found.cameras], exact)) < 0.5


def test_wands_that_cannot_be_are_refused():
    """Too few instants; ends exchanged in one camera; cameras that share nothing."""
    cameras = rig(3)
    uv, _ = waved(3, cameras)
    lenses, sizes = [c.lens for c in cameras], [SIZE] * 3
    with pytest.raises(CalibrationError, match="both ends of the wand at 5 instants, and 10 are needed"):
        calibrate_wand(lenses, sizes, uv[:, :5], no_background(cameras), length_m=0.4)
    alone = uv.copy()
    alone[2, :, 0] = np.nan
    alone[2, 3:] = np.nan
    with pytest.raises(CalibrationError, match="camera 'cam3' shares 3 points with the others and needs 6"):
        calibrate_wand(lenses, sizes, alone, no_background(cameras), length_m=0.4)
    with pytest.raises(CalibrationError, match="`free` 'all': expected one of"):
        calibrate_wand(lenses, sizes, uv, no_background(cameras), length_m=0.4, moves="all")


def easywand(name: str) -> tuple[EasyWand, np.ndarray]:
    """A real set, and its wand pixels without the frames that its authors removed."""
    path = real(*EASYWAND[name])
    wand = read_easywand(path)
    removed = loadmat(path, simplify_cells=True)["easyWandData"]["rmpts"].any(axis=1)
    return wand, np.where(removed[None, :, None, None], np.nan, wand.wand_px)


@pytest.mark.parametrize("name", EASYWAND)
def test_easywands_own_numbers(name):
    """Its undistorted points to 0.02 px (three iterations, as it does) and its score to 3 decimals by plain DLT."""
    wand, _ = easywand(name)
    ours = np.stack([u.undistort(px, iterations=3) for u, px in zip(wand.lenses, wand.wand_px, strict=True)])
    ours = np.moveaxis(ours, 0, 1).reshape(ours.shape[1], -1)
    theirs = np.moveaxis(wand.wand_ideal_px, 0, 1).reshape(wand.wand_ideal_px.shape[1], -1)
    ours = ours[np.isfinite(ours).any(axis=1)]
    for row in theirs[np.isfinite(theirs).any(axis=1)]:
        there = np.isfinite(row)
        apart = np.abs(ours[:, there] - row[there]).max(axis=1)
        assert np.nanmin(np.where(np.isnan(apart), np.inf, apart)) < 0.02
    ends = linear(stacked(wand.cameras), wand.wand_ideal_px)
    score = wand_score(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=-1))
    assert score == pytest.approx(wand.wand_score, abs=5e-4)


@pytest.mark.rare
def test_our_bundle_beside_easywands():
    """Wands that our fit did not see vary no more than in easyWand's calibration, which saw them.

    On what both saw ours varies less. The deviation of a score of 80 wands is 8 % of it.
    """
    wand, pixels = easywand("tunnel")
    found = calibrate_wand(
        wand.lenses, wand.sizes_px, pixels, wand.background_px, length_m=wand.wand_length, moves="focal+centre", folds=3
    )
    theirs = wand_score(wand_lengths(wand.cameras, pixels))
    assert found.score < theirs
    assert found.held_out_score < theirs


def test_known_points_give_the_coefficients():
    """Exact pixels give the exact projection; noisy ones the noise, and points left out miss by little more."""
    rng = np.random.default_rng(4)
    for camera in ring(2):
        points = cloud(rng, 20)
        exact = project(camera.matrix[None], points)[0]
        found = fit_dlt(camera.name, points, exact)
        np.testing.assert_allclose(project(found.camera.matrix[None], points)[0], exact, rtol=0, atol=1e-6)
        noisy = fit_dlt(camera.name, points, exact + rng.normal(0, 0.5, exact.shape))
        assert 0.25 < noisy.rms_px < 0.75  # chi with 29 degrees of freedom
        assert noisy.rms_px * np.sqrt(2) < noisy.left_out_px < 3


def test_known_points_that_say_nothing_are_refused():
    """Too few; all in one plane; of another order than the pixels."""
    rng = np.random.default_rng(5)
    camera, points = ring(1)[0], cloud(rng, 20)
    uv = project(camera.matrix[None], points)[0]
    with pytest.raises(CalibrationError, match="sees 5 different known points, and 6 are needed"):
        fit_dlt("c", points[:5], uv[:5])
    flat = points * [1, 1, 0]
    with pytest.raises(CalibrationError, match="lie in one plane"):
        fit_dlt("c", flat, project(camera.matrix[None], flat)[0])
    with pytest.raises(CalibrationError, match=r"do not determine the coefficients|both files list the same points"):
        fit_dlt("c", points, uv[::-1])


def knocked(rng, cameras, angle=0.01, place=0.01):
    """The same cameras after somebody touched their tripods."""
    return tuple(
        replace(
            c,
            matrix=c.matrix
            @ np.vstack([np.column_stack([turn(rng.normal(0, angle, 3)), rng.normal(0, place, 3)]), [0, 0, 0, 1]]),
        )
        for c in cameras
    )


@pytest.mark.parametrize("with_bone", [False, True])
def test_tracks_mend_cameras_that_were_knocked(with_bone):
    """A degree and a centimetre off: afterwards rays meet within the noise, and the wand in the scene has its length.

    Residuals of 4 cameras are sqrt(sum / 5) of 0.3 px noise: median 0.29 px.
    """
    rng = np.random.default_rng(6)
    true = ring(4)
    xyz = cloud(rng, 300).reshape(100, 3, 3)
    step = rng.normal(size=(100, 3))
    xyz[:, 1] = xyz[:, 0] + 0.25 * step / np.linalg.norm(step, axis=1)[:, None]
    uv = record(true, xyz) + rng.normal(0, 0.3, (4, 100, 3, 2))
    bad = knocked(rng, true)
    bones = [KnownDistance(first=0, second=1, length_m=0.25)] if with_bone else []
    found = refine_cameras(bad, uv, bones=bones)
    assert found.before_px > 3
    assert found.after_px < 0.4
    ends = linear(stacked(found.cameras), uv)
    length = np.median(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=-1))
    assert length == pytest.approx(0.25, rel=2e-3 if with_bone else 0.05)
    with pytest.raises(CalibrationError, match="refining does not help"):
        refine_cameras(true, record(true, xyz))


def test_a_real_bat_refines_its_rig():
    """A bat filmed through lenses that nobody applied: rays of points held out miss by less than half of 5.9 px."""
    folder = real("bat_windtunnel_dltdv8", "derived_csv", "078A3_F5")
    cameras = read_coefficients(folder / "078A3_F5_dltCoefs.csv")
    pixels = read_pixels(folder / "078A3_F5_xypts.csv", fps=700)
    found = refine_cameras(cameras, pixels.uv_px, most_points=1000)
    assert found.before_px == pytest.approx(5.9, abs=0.3)
    assert found.after_px < found.before_px / 2


def test_another_world_is_the_same_pixels():
    """A turned, shifted, scaled or mirrored world with its cameras moved along shows the same pixels."""
    rng = np.random.default_rng(8)
    cameras, points = rig(2), cloud(rng, 10)
    for linear_part in (turn(np.array([0.3, -0.2, 0.5])), 2.5 * turn(np.array([1.0, 0, 0])), np.diag([1.0, -1.0, 1.0])):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = linear_part, rng.normal(size=3)
        for a, b in zip(cameras, in_world(cameras, T), strict=True):
            np.testing.assert_allclose(b.record(points @ T[:3, :3].T + T[:3, 3]), a.record(points), rtol=0, atol=1e-8)
