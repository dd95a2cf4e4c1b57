"""DLT coefficients from known points: places are counted, not rows, and what they leave open is refused."""

import numpy as np
import pytest

from mocap.audit.inspect import inspect
from mocap.calibration.dlt import fit_dlt
from mocap.calibration.places import place_camera
from mocap.calibration.refine import refine_cameras
from mocap.calibration.scene import distinct
from mocap.calibration.wand import calibrate_wand
from mocap.cameras.camera import KnownLens, check_cameras, dlt_camera, project, record, stacked
from mocap.errors import CalibrationError
from mocap.io.format import Hints
from tests.mocap.board_scenes import SIZE, rig
from tests.mocap.rigs import cloud, ring
from tests.mocap.test_calibrate_wand import waved


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def clicked(rng, points, noise=0.3):
    """Pixels of known points in one camera, as a hand clicks them."""
    uv = record(ring(1), points)[0]
    return uv + rng.normal(0, noise, uv.shape)


@pytest.mark.parametrize("apart", [0.0, 1.0])
def test_points_listed_twice_are_one_place(rng, apart):
    """Five places in eleven rows are five, also where a hand clicked each of them again, a pixel away."""
    points = cloud(rng, 5)[[0, 0, 1, 2, 2, 3, 3, 4, 4, 4, 1]]
    uv = clicked(rng, cloud(np.random.default_rng(5), 5), 0.3)[[0, 0, 1, 2, 2, 3, 3, 4, 4, 4, 1]]
    with pytest.raises(CalibrationError, match=r"sees 5 different known points .*and 6 are needed"):
        fit_dlt("cam1", points, uv + apart * rng.normal(size=uv.shape))


def test_places_are_left_out_whole(rng):
    """Every row twice changes neither the error of what was left out nor, to rounding, the RMS."""
    points = cloud(rng, 12)
    uv = clicked(rng, points)
    once, twice = fit_dlt("a", points, uv), fit_dlt("a", np.repeat(points, 2, axis=0), np.repeat(uv, 2, axis=0))
    assert twice.places == once.places == 12
    assert twice.left_out_px == pytest.approx(once.left_out_px)
    assert twice.rms_px == pytest.approx(once.rms_px)
    assert once.left_out_px > once.rms_px


@pytest.mark.parametrize("seed", range(10))
def test_all_but_one_in_a_plane_are_refused(seed):
    """Eight unknowns of a plane and two of a point are ten of eleven: refused in one line, whatever the camera."""
    rng = np.random.default_rng(seed)
    points = cloud(rng, 12)
    points[1:, 2] = 0.1
    with pytest.raises(CalibrationError, match="do not determine the coefficients"):
        fit_dlt("cam1", points, clicked(rng, points))


@pytest.mark.parametrize("seed", range(10))
def test_places_beside_each_other_are_refused(seed):
    """Six places of which two nearly coincide, 1/500 of the extent apart: a fit through the clicks and nowhere else."""
    rng = np.random.default_rng(seed)
    points = cloud(rng, 6)
    points[5] = points[0] + 0.002 * np.ptp(points, axis=0).max() * np.array([0.6, -0.5, 0.6])
    with pytest.raises(CalibrationError, match=r"do not determine|reprojection error"):
        fit_dlt("cam1", points, clicked(rng, points))


@pytest.mark.rare
def test_the_gain_is_that_of_repeated_clicking(rng):
    """Between points pixels scatter over 200 clickings by the gain at most."""
    points = cloud(rng, 7)
    uv = record(ring(1), points)[0]
    fits = [fit_dlt("a", points, uv + rng.normal(0, 0.1, uv.shape)) for _ in range(200)]
    first, second = np.triu_indices(7, 1)
    middle = (points[first] + points[second]) / 2
    seen = np.stack([project(stacked([f.camera]), middle)[0] for f in fits])
    scatter = seen.std(axis=0).max() / 0.1
    assert scatter == pytest.approx(np.median([f.gain for f in fits]), rel=0.2)  # of 400 numbers, the largest of 21


def test_six_points_are_not_checked(rng):
    """Six places fit, but leave none out; eight do."""
    points = cloud(rng, 8)
    assert np.isnan(fit_dlt("a", points[:6], clicked(rng, points[:6], 0.01)).left_out_px)
    assert np.isfinite(fit_dlt("a", points, clicked(rng, points)).left_out_px)


def test_a_parallel_projection_is_named(rng):
    """Views along an axis: what they are is said, not that they project to a line."""
    points = cloud(rng, 20)
    with pytest.raises(CalibrationError, match="parallel projection"):
        fit_dlt("a", points, 1000 * points[:, :2])


def test_parallel_coefficients_are_named(tmp_path):
    """Views along two axes project to a plane, not to a line; ``info`` says so once, and goes on without cameras."""
    along = np.array([[1000.0, 0, 0, 0, 0, 1000, 0, 0, 0, 0, 0], [0, 1000, 0, 0, 0, 0, 1000, 0, 0, 0, 0]])
    cameras = [dlt_camera(f"cam{c + 1}", one) for c, one in enumerate(along)]
    with pytest.raises(CalibrationError, match=r"parallel projection .* mocap cannot use"):
        check_cameras(cameras, "x")
    line = dlt_camera("cam1", np.array([1000.0, 0, 0, 0, 2000, 0, 0, 0, 0, 0, 0]))
    with pytest.raises(CalibrationError, match="to a line or a point"):
        check_cameras([line], "x")
    np.savetxt(tmp_path / "dltCoefs.csv", along.T, delimiter=",")
    (found,) = inspect([tmp_path / "dltCoefs.csv"], Hints())
    assert sum("parallel projection" in said for said in found["findings"]) == 1
    assert not any("could not be completed" in said for said in found["findings"])


def test_a_wand_that_lies_still_is_one_place(rng):
    """Two hundred instants at five places are five, however often they were clicked; moved, they are what they were."""
    cameras = rig(3)
    uv, _ = waved(1, cameras, n=5, noise_px=0.0)
    still = np.repeat(uv, 40, axis=1) + rng.normal(0, 0.3, (3, 200, 2, 2))
    with pytest.raises(CalibrationError, match="in 5 different places at 200 instants"):
        calibrate_wand([c.lens for c in cameras], [SIZE] * 3, still, np.full((3, 0, 1, 2), np.nan), length_m=0.4)


def test_tracks_of_an_animal_that_stands_still_refine_nothing(rng):
    """Sixty frames of three markers that do not move are three points: no half can be judged by the other."""
    cameras = ring(3)
    uv = np.repeat(record(cameras, cloud(rng, 3))[:, None], 60, axis=1)
    with pytest.raises(CalibrationError, match="hardly move: 3 of 180 points"):
        refine_cameras(cameras, uv + rng.normal(0, 0.3, uv.shape))


def test_a_camera_is_not_placed_by_a_point_clicked_again(rng):
    """Three known points in nine rows are three."""
    (camera,) = rig(1)
    points = np.repeat(cloud(rng, 3), 3, axis=0)
    uv = camera.record(points) + rng.normal(0, 0.3, (9, 2))
    known = KnownLens(name="a", lens=camera.lens, size_px=SIZE)
    with pytest.raises(CalibrationError, match="3 different known points were clicked"):
        place_camera(known, points, uv)


def test_distinct_places_with_gaps():
    """Places are compared by what both have; what has nothing in common is apart."""
    nan = np.nan
    rows = np.array([[0.0, 1.0], [0.0, nan], [nan, 1.0], [5.0, 1.0], [nan, nan]])
    assert distinct(rows, within=0.1).tolist() == [0, 0, 0, 1, 2]
