"""Our triangulation and the programs that the benchmark times beside it give the same points."""

import numpy as np
import pytest
from mocap.datasets import PERFECT

from benchmarks.triangulation import (
    SD_PX,
    Views,
    bat_views,
    lstsq_loop,
    methods,
    scipy_loop,
)
from eal.arrays import Array
from mocap.cameras.camera import stacked
from mocap.cameras.triangulate import linear, refine


@pytest.fixture(scope="module")
def noisy() -> Views:
    return bat_views(6, 4)


def points(views: Views) -> tuple[Array, Array, Array]:
    """(C, 3, 4) projections, (C, K, 2) pixels of the points seen by two or more, and the (K, 3) truth."""
    uv = views.uv_px.reshape(len(views.uv_px), -1, 2)
    seen = np.isfinite(uv[..., 0]).sum(axis=0) >= 2
    return stacked(views.cameras), uv[:, seen], views.true_m.reshape(-1, 3)[seen]


def test_every_program_finds_the_truth_from_perfect_pixels():
    """With exact pixels all methods have the same answer; undistortion stops at 1e-12 of the picture.

    1e-8 px / 880 px times 1 m of distance is 1e-11 m; near-parallel pairs of rays magnify that up to 1000 times.
    """
    views = bat_views(2, 4, digitiser=PERFECT)
    _, uv, truth = points(views)
    for name, method in methods(views.cameras, sample=10).items():
        found = method.run(uv[:, :30])
        np.testing.assert_allclose(found, truth[:30], atol=1e-8, err_msg=name)


def test_linear_equals_the_least_squares_of_numpy(noisy):
    """Normal equations with one refinement are as accurate as LAPACK's SVD: 1e-16 of 1 m, times their condition 1e4."""
    matrices, uv, _ = points(noisy)
    np.testing.assert_allclose(linear(matrices, uv), lstsq_loop(matrices, uv), rtol=0, atol=1e-11)


def test_refined_points_are_those_of_scipy(noisy):
    """At a minimum an error d in the point costs d^2: programs that stop on the cost agree to sqrt(1e-16) of 1 m."""
    matrices, uv, _ = points(noisy)
    uv = uv[:, :40]
    start = linear(matrices, uv)
    ours, _ = refine(matrices, uv, start, sd_px=SD_PX)
    np.testing.assert_allclose(ours, scipy_loop(matrices, uv, start), rtol=0, atol=1e-8)
