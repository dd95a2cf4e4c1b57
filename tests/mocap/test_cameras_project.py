"""Cameras: projection, lenses, and the way between DLT and pinhole."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mocap.cameras.camera import (
    Camera,
    decompose,
    dlt_camera,
    dlt_coefficients,
    pinhole_camera,
    project,
    record,
    stacked,
    undistorted,
)
from mocap.cameras.lens import BrownLens
from tests.mocap.rigs import cloud, look_at, ring
from tests.reference.triangulation import pixel

ROUNDING_PX = 1e-9
"""Pixels of 1e3 in double precision (1e-13), times the ten operations and the cancellation of a projection."""

FIXED_POINT_PX = 1e-8
"""OpenCV stops its iteration at 1e-12 of a focal length of 1e3, where each step still gains a factor of two or more."""


def opencv(camera, points):
    """Pixels by OpenCV, its lens included."""
    pinhole = decompose(camera)
    lens = camera.lens
    distortion = np.zeros(5) if lens is None else np.array([lens.k[0], lens.k[1], *lens.p, lens.k[2]])
    rotation = cv2.Rodrigues(pinhole.rotation)[0]
    pixels, _ = cv2.projectPoints(points, rotation, pinhole.translation_m, pinhole.intrinsic, distortion)
    return pixels[:, 0]


def test_recorded_pixels_are_opencvs():
    """Projection and Brown's distortion agree with ``cv2.projectPoints`` for every camera of a rig."""
    cameras, points = ring(5, lens=True), cloud(np.random.default_rng(1), 200)
    for camera, uv in zip(cameras, record(cameras, points), strict=True):
        np.testing.assert_allclose(uv, opencv(camera, points), rtol=0, atol=ROUNDING_PX)


def test_ideal_pixels_are_the_textbooks():
    """Batched projection is the formula with the twelve numbers, a camera and a point at a time, of any shape."""
    cameras, points = ring(3), cloud(np.random.default_rng(2), 6).reshape(2, 3, 3)
    uv = project(stacked(cameras), points)
    assert uv.shape == (3, 2, 3, 2)
    for index in np.ndindex(3, 2, 3):
        expected = pixel(cameras[index[0]].matrix, points[index[1:]])
        np.testing.assert_allclose(uv[index], expected, rtol=0, atol=ROUNDING_PX)
    np.testing.assert_allclose(project(stacked(cameras), points[0, 0]), uv[:, 0, 0], rtol=0, atol=ROUNDING_PX)


def test_the_scale_of_a_projection_says_nothing():
    """Twice, and minus, the matrix is the same camera."""
    points = cloud(np.random.default_rng(3), 10)
    matrix = ring(1)[0].matrix
    for factor in (2.0, -1.0, 1e-6):
        np.testing.assert_allclose(
            project(factor * matrix[None], points), project(matrix[None], points), rtol=0, atol=ROUNDING_PX
        )


def test_missing_points_have_no_pixels():
    """NaN goes through projection, lens and its inverse, and disturbs nobody else."""
    cameras = ring(2, lens=True)
    points = np.array([[0.1, 0.0, 0.0], [np.nan] * 3])
    uv = record(cameras, points)
    ideal = undistorted(cameras, uv)
    for values in (uv, ideal, undistorted(cameras, uv, iterations=3)):
        assert np.isnan(values[:, 1]).all()
        assert np.isfinite(values[:, 0]).all()
    np.testing.assert_allclose(ideal[:, 0], project(stacked(cameras), points[0]), rtol=0, atol=FIXED_POINT_PX)
    assert np.isnan(undistorted(cameras, np.full((2, 3, 2), np.nan))).all()


@given(
    k=st.tuples(st.floats(-0.25, 0.1), st.floats(-0.05, 0.1), st.floats(-0.02, 0.02)),
    p=st.tuples(st.floats(-0.002, 0.002), st.floats(-0.002, 0.002)),
)
def test_undistortion_is_the_inverse_of_distortion(k, p):
    """Ideal, to recorded, and back, over a picture of +- 34 degrees: the identity, with different focal lengths too."""
    lens = BrownLens(f_px=(1000.0, 1040.0), centre_px=(650.0, 500.0), k=k, p=p)
    u, v = np.meshgrid(np.linspace(0, 1280, 9), np.linspace(0, 1024, 9))
    uv = np.stack([u, v], axis=-1)
    np.testing.assert_allclose(lens.undistort(lens.distort(uv)), uv, rtol=0, atol=FIXED_POINT_PX)


def test_distortion_is_browns():
    """One point by hand: x = 0.5, y = 0, k1 = -0.1, p2 = 0.01 lands at 0.5 (1 - 0.1 / 4) + 0.01 (1/4 + 1/2)."""
    lens = BrownLens(f_px=(100.0, 100.0), centre_px=(10.0, 20.0), k=(-0.1, 0.0, 0.0), p=(0.0, 0.01))
    np.testing.assert_allclose(lens.distort(np.array([60.0, 20.0])), [10 + 100 * (0.5 * 0.975 + 0.0075), 20.0])
    lens = BrownLens(f_px=(100.0, 100.0), centre_px=(10.0, 20.0), k=(0.0, 0.0, 0.0), p=(0.01, 0.0))
    np.testing.assert_allclose(lens.distort(np.array([10.0, 70.0])), [10.0, 20 + 100 * (0.5 + 0.01 * 0.75)])


def test_the_centre_of_a_lens_stays():
    """At the principal point nothing is bent, by any coefficients."""
    lens = BrownLens(f_px=(900.0, 1000.0), centre_px=(3.0, 4.0), k=(-0.3, 0.2, 0.1), p=(0.01, 0.02))
    for move in (lens.distort, lens.undistort, lambda uv: lens.undistort(uv, iterations=3)):
        np.testing.assert_allclose(move(np.array([3.0, 4.0])), [3.0, 4.0], rtol=0, atol=1e-12)


def test_dltdvs_three_iterations_converge_to_the_inverse():
    """A fixed number of iterations nears the inverse geometrically: each at least halves the error of a mild lens."""
    lens = BrownLens(f_px=(1700.0, 1700.0), centre_px=(1280.0, 800.0), k=(-0.15, 0.1, 0.0))
    uv = np.stack(np.meshgrid(np.linspace(0, 2560, 7), np.linspace(0, 1600, 7)), axis=-1)
    distorted = lens.distort(uv)
    errors = [np.abs(lens.undistort(distorted, iterations=n) - uv).max() for n in range(1, 8)]
    assert all(b < 0.5 * a for a, b in pairwise(errors))
    assert errors[2] < 0.5  # what DLTdv leaves here, a fraction of a pixel


def test_dltdvs_iterations_by_hand():
    """Zero iterations leave the pixel; one divides by 1 + k1 r^2 at the distorted radius; f is the mean of fx, fy."""
    lens = BrownLens(f_px=(90.0, 110.0), centre_px=(0.0, 0.0), k=(0.1, 0.0, 0.0))
    uv = np.array([50.0, 0.0])
    np.testing.assert_allclose(lens.undistort(uv, iterations=0), uv)
    np.testing.assert_allclose(lens.undistort(uv, iterations=1), [50 / (1 + 0.1 * 0.25), 0.0])


def test_dlt_and_matrix_are_one_camera():
    """Eleven coefficients, to a camera, and back: the identity; pixels are those of the definition of the DLT."""
    rng = np.random.default_rng(4)
    numbers = np.r_[rng.normal(0, 400, 8), rng.normal(0, 0.3, 3)]
    camera = dlt_camera("c", numbers)
    np.testing.assert_array_equal(dlt_coefficients(camera), numbers)
    x, y, z = point = rng.uniform(-0.3, 0.3, 3)
    below = numbers[8] * x + numbers[9] * y + numbers[10] * z + 1
    u = (numbers[0] * x + numbers[1] * y + numbers[2] * z + numbers[3]) / below
    v = (numbers[4] * x + numbers[5] * y + numbers[6] * z + numbers[7]) / below
    np.testing.assert_allclose(project(camera.matrix[None], point)[0], [u, v], rtol=1e-12)


def test_a_camera_above_the_origin_has_no_dlt():
    """Where the origin projects to infinity the eleven numbers do not exist, and that is said."""
    rotation = look_at((1.0, 0.0, 0.0), (1.0, 1.0, 0.0))
    camera = pinhole_camera("side", intrinsic=np.eye(3), rotation=rotation, translation_m=-rotation @ [1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"camera 'side' has no DLT coefficients.*move the origin"):
        dlt_coefficients(camera)


def random_camera(seed):
    rng = np.random.default_rng(seed)
    intrinsic = np.array([[rng.uniform(500, 2000), rng.normal(0, 3), 640], [0, rng.uniform(500, 2000), 512], [0, 0, 1]])
    position = rng.normal(size=3)
    position *= 3 / np.linalg.norm(position)
    rotation = look_at(position) @ Rotation.from_rotvec(rng.normal(0, 0.05, 3)).as_matrix()
    return intrinsic, rotation, -rotation @ position


@given(seed=st.integers(0, 10_000))
def test_decomposition_recovers_what_was_composed(seed):
    """Intrinsics, rotation and place come back from the DLT coefficients of a pinhole camera.

    The matrix has entries of 1e3, its small singular value is about 1: 1e-16 x 1e3 x 1e2 of slack.
    """
    intrinsic, rotation, translation = random_camera(seed)
    camera = pinhole_camera("c", intrinsic=intrinsic, rotation=rotation, translation_m=translation)
    pinhole = decompose(dlt_camera("c", dlt_coefficients(camera)))
    np.testing.assert_allclose(pinhole.intrinsic, intrinsic, rtol=0, atol=1e-8)
    np.testing.assert_allclose(pinhole.rotation, rotation, rtol=0, atol=1e-11)
    np.testing.assert_allclose(pinhole.translation_m, translation, rtol=0, atol=1e-10)
    np.testing.assert_allclose(pinhole.position_m, -rotation.T @ translation, rtol=0, atol=1e-10)
    assert not pinhole.mirrored


@pytest.mark.parametrize("y_up", [False, True])
@pytest.mark.parametrize("left_handed", [False, True])
def test_mirrored_worlds_are_told(y_up, left_handed):
    """A left-handed world, or pixel rows that count from below, is a mirror; both at once are none.

    In every case the parts compose to the same pixels, with positive focal lengths.
    """
    intrinsic, rotation, translation = random_camera(7)
    matrix = intrinsic @ np.column_stack([rotation, translation])
    if y_up:
        matrix = np.array([[1, 0, 0], [0, -1, 1024], [0, 0, 1.0]]) @ matrix
    if left_handed:
        matrix = matrix @ np.diag([1, -1, 1, 1.0])
    pinhole = decompose(dlt_camera("c", (matrix / matrix[2, 3]).ravel()[:11]))
    assert pinhole.mirrored == (y_up != left_handed)
    assert (np.diag(pinhole.intrinsic) > 0).all()
    points = cloud(np.random.default_rng(8), 5)
    again = pinhole.intrinsic @ np.column_stack([pinhole.rotation, pinhole.translation_m])
    np.testing.assert_allclose(project(again[None], points), project(matrix[None], points), rtol=0, atol=1e-8)
    depth = points @ pinhole.rotation[2] + pinhole.translation_m[2]
    assert (depth > 0).all()


def test_the_centre_of_projection_has_no_pixel():
    """The matrix takes the decomposed position to zero: that is what a centre of projection is."""
    camera = Camera(name="c", matrix=np.random.default_rng(9).normal(size=(3, 4)))
    position = decompose(camera).position_m
    np.testing.assert_allclose(camera.matrix @ np.append(position, 1), 0, atol=1e-12 * max(1, np.abs(position).max()))


def test_a_matrix_of_another_shape_is_refused():
    """A camera is 3 x 4, eleven coefficients make one."""
    with pytest.raises(ValueError, match="matrix must have shape"):
        Camera(name="c", matrix=np.eye(3))
    with pytest.raises(ValueError, match="coefficients must have shape"):
        dlt_camera("c", np.zeros(12))
