"""The peer of the importers' benchmark solves what ours solves."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.importers import CAMERAS, MARKERS, by_opencv, format_of, make, ours, peer, strangers
from mocap.cameras.camera import stacked
from mocap.cameras.lens import BrownLens, FisheyeLens
from mocap.cleaning.triangulate_file import linear_in_blocks
from mocap.io.contents import FileContents
from mocap.io.dltdv import read_coefficients
from mocap.io.registry import read
from tests.mocap.rigs import ring


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


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("kind", [BrownLens, FisheyeLens])
def test_lenses_before_cameras_are_as_opencv_has_them(tmp_path, own, mirrored, kind):
    """Of DLT coefficients, too: the lens has another centre than the matrix, and the world may be mirrored."""
    from mocap.cameras.camera import decompose

    cameras = []
    for camera in ring(2):
        f, c = decompose(camera).intrinsic[[0, 1], [0, 1]], decompose(camera).intrinsic[:2, 2]
        coefficients = [-0.1, 0.03, 0.0, 0.0, 0.0][: 4 if kind is FisheyeLens else 5]
        lens = kind.of(f.tolist(), (c + (9.0 if own else 0.0)).tolist(), coefficients)
        flip = np.diag([1.0, 1.0, -1.0 if mirrored else 1.0, 1.0])
        cameras.append(replace(camera, matrix=camera.matrix @ flip, lens=lens))
    found = FileContents(
        format="x",
        paths=(tmp_path,),
        names=(),
        frames=np.zeros(0),
        fps=None,
        cameras=tuple(cameras),
        camera_names=tuple(one.name for one in cameras),
    )
    assert by_opencv(tmp_path, found) is True
    assert by_opencv(tmp_path, replace(found, cameras=tuple(replace(one, lens=None) for one in cameras))) is None


def test_files_of_no_format_are_no_sound_files_that_are_refused(tmp_path):
    """A table that says nothing of itself is in none of the formats; a cut one of DLTdv is DLTdv's, and refused."""
    (tmp_path / "a.csv").write_text("1,2,3,4\n5,6,7,8\n")
    (tmp_path / "b_xypts.csv").write_text("pt1_cam1_X,pt1_cam1_Y\n1,2\n3\n4,5\n")
    assert (format_of(tmp_path / "a.csv"), format_of(tmp_path / "b_xypts.csv")) == ("", "dltdv-xypts")
    assert [row["verdict"] for row in strangers(tmp_path)] == ["of no format", "refused"]
