"""Lens models against OpenCV, against their own inverses and derivatives."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap.cameras.camera import record, undistorted
from mocap.cameras.lens import MODELS, BrownLens, FisheyeLens, Lens, RationalLens
from mocap.cameras.triangulate import linear
from tests.mocap.rigs import cloud, ring

LENSES = [
    BrownLens.of((1000.0, 1040.0), (650.0, 500.0), (-0.2, 0.05, 1e-3, -5e-4, 0.01)),
    BrownLens.of((762.0, 765.0), (639.5, 511.5), (-0.3, 0.1, 0.0, 0.0, -0.01)),
    RationalLens.of((1000.0, 1040.0), (650.0, 500.0), (2.0, 0.5, 1e-3, -5e-4, 0.01, 2.2, 0.9, 0.05)),
    FisheyeLens.of((600.0, 610.0), (650.0, 500.0), (-0.03, 0.01, -0.005, 0.001)),
]
"""Lenses of 70 to 150 degrees, as calibrations of real cameras have them."""

SAME_PX = 1e-9
"""Both compute one formula in double precision: 1e3 px x 2e-16 x some tens of operations, amplified by the inverse."""


def picture() -> np.ndarray:
    """(9, 12, 2) pixels over a picture, the principal point of a lens among them."""
    uv = np.stack(np.meshgrid(np.linspace(0, 1280, 12), np.linspace(0, 1024, 9)), axis=-1)
    uv[4, 5] = (650.0, 500.0)
    return uv


def opencv(lens: Lens, uv: np.ndarray) -> np.ndarray:
    """Recorded pixels of ideal ones, by OpenCV."""
    xyz = np.concatenate([lens.normalised(uv), np.ones((*uv.shape[:-1], 1))], axis=-1).reshape(-1, 1, 3)
    project = cv2.fisheye.projectPoints if isinstance(lens, FisheyeLens) else cv2.projectPoints
    return project(xyz, np.zeros(3), np.zeros(3), lens.intrinsic, lens.coefficients)[0].reshape(uv.shape)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_distortion_is_opencvs(lens):
    """Every model records the pixel that OpenCV records; its inverse is one that OpenCV's own model sends back."""
    uv = picture()
    np.testing.assert_allclose(lens.distort(uv), opencv(lens, uv), rtol=0, atol=SAME_PX)
    np.testing.assert_allclose(opencv(lens, lens.undistort(uv)), uv, rtol=0, atol=SAME_PX)


@pytest.mark.parametrize("lens", LENSES[:3], ids=lambda lens: lens.model)
def test_undistortion_is_opencvs(lens):
    """OpenCV's fixed-point iteration, let run to rounding, ends at the same ideal pixel."""
    stop = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, 1000, 1e-15)
    k = lens.intrinsic
    undistort = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # its name for this until OpenCV 5
    theirs = undistort(picture().reshape(-1, 1, 2), k, lens.coefficients, R=np.eye(3), P=k, criteria=stop)
    np.testing.assert_allclose(lens.undistort(picture()).reshape(-1, 1, 2), theirs, rtol=0, atol=SAME_PX)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_derivatives_are_those_of_the_bend(lens):
    """Central differences of step h agree to h^2 f''' / 6 + rounding / h, both below 1e-8 at h = 1e-5."""
    xy, h = lens.normalised(picture()), 1e-5
    for j, e in enumerate(h * np.eye(2)):
        numeric = (lens.bend(xy + e) - lens.bend(xy - e)) / (2 * h)
        np.testing.assert_allclose(lens.by_xy(xy)[..., j], numeric, rtol=0, atol=1e-8)
    for j, e in enumerate(h * np.eye(lens.n_coefficients)):
        plus, minus = (lens.of(lens.f_px, lens.centre_px, lens.coefficients + s * e) for s in (1, -1))
        numeric = (plus.bend(xy) - minus.bend(xy)) / (2 * h)
        np.testing.assert_allclose(lens.by_coefficients(xy)[..., j], numeric, rtol=0, atol=1e-8)


@given(k=st.tuples(*[st.floats(-0.05, 0.05)] * 4), r=st.floats(0.0, 20.0), angle=st.floats(0.0, 6.2))
def test_a_fisheye_comes_back_to_ninety_degrees(k, r, angle):
    """Ideal, to recorded, and back, out to 87 degrees from the axis, wherever the model is one to one."""
    lens = FisheyeLens(f_px=(400.0, 410.0), centre_px=(650.0, 500.0), k=k)
    reach = lens._reach_slope(np.linspace(0, np.pi / 2, 200))
    uv = np.array([650.0, 500.0]) + 400.0 * r * np.array([np.cos(angle), np.sin(angle)])
    if (reach > 0.2).all():
        # a relative error of 1e-12 in the angle is (1 + r^2) / r times as large in the ideal pixel
        np.testing.assert_allclose(lens.undistort(lens.distort(uv)), uv, rtol=0, atol=1e-8 * (1 + r * r))


def test_a_pixel_that_no_ray_reaches_has_no_ideal_one():
    """The cubic x - 0.3 x^3 turns at x = 1.054, at 0.703: pixels beyond that circle are NaN, within they are not."""
    lens = BrownLens(f_px=(1000.0, 1000.0), centre_px=(0.0, 0.0), k=(-0.3, 0.0, 0.0))
    edge = 1000.0 * np.sqrt(1 / 0.9) * 2 / 3
    ideal = lens.undistort(np.array([[edge - 1.0, 0.0], [edge + 1.0, 0.0]]))
    assert np.isfinite(ideal[0]).all()
    assert np.isnan(ideal[1]).all()
    wide = FisheyeLens(f_px=(400.0, 400.0), centre_px=(0.0, 0.0))
    assert np.isnan(wide.undistort(np.array([400 * np.pi / 2 + 1.0, 0.0]))).all()
    assert np.isfinite(wide.undistort(np.array([400 * np.pi / 2 - 1.0, 0.0]))).all()


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_every_model_fits_a_camera(lens):
    """Points filmed through any lens come back from the pixels, missing ones stay missing, whatever DLTdv would do."""
    rng = np.random.default_rng(3)
    points = cloud(rng, 30)
    cameras = tuple(
        replace(c, lens=type(lens).of((1200.0, 1212.0), (640.0, 512.0), lens.coefficients)) for c in ring(3)
    )
    uv = record(cameras, points)
    uv[0, 4] = np.nan
    ideal = undistorted(cameras, uv)
    assert np.isnan(ideal[0, 4]).all()
    np.testing.assert_allclose(linear(np.stack([c.matrix for c in cameras]), ideal), points, rtol=0, atol=1e-10)


def test_models_are_found_by_name():
    """Each model is under its own name and takes as many coefficients as it says."""
    for name, model in MODELS.items():
        lens = model.of((1.0, 2.0), (3.0, 4.0), np.arange(model.n_coefficients) / 10)
        assert (name, len(lens.coefficients)) == (lens.model, model.n_coefficients)
        np.testing.assert_array_equal(lens.coefficients, np.arange(model.n_coefficients) / 10)
