"""The peer of the importers' benchmark solves what ours solves."""

import numpy as np

from benchmarks.importers import CAMERAS, MARKERS, make, ours, peer
from mocap.cameras.camera import stacked
from mocap.cleaning.triangulate_file import linear_in_blocks
from mocap.io.dltdv import read_coefficients
from mocap.io.registry import read


def test_the_loop_and_ours_agree(tmp_path):
    """Least squares by normal equations with one refinement, and by SVD: 1e-12 of a metre; residuals differ in kind.

    dlt_reconstruct takes the residual of the linear equations, each off by its ray's depth from pixels; ours is in
    pixels. Blocks of frames give what all frames at once give.
    """
    path = tmp_path / "a_xypts.csv"
    make(path, 30)
    theirs, rmse = peer(path, 30)
    points = ours(path)
    assert points.shape == (30, MARKERS, 3)
    np.testing.assert_allclose(points, theirs, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(np.isnan(rmse), np.isnan(theirs[..., 0]))
    pixels = read(path).pixels
    assert pixels.uv_px.shape == (CAMERAS, 30, MARKERS, 2)
    matrices = stacked(read_coefficients(path.with_name("dltCoefs.csv")))
    for once, blocks in zip(
        linear_in_blocks(matrices, pixels.uv_px), linear_in_blocks(matrices, pixels.uv_px, frames=7), strict=True
    ):
        np.testing.assert_allclose(once, blocks, rtol=0, atol=1e-12)
