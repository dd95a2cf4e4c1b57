"""DLTdv's flat files: what is written is what is read, whatever the markers are called."""

import csv

import numpy as np
import pytest

from mocap.cameras.camera import dlt_camera, dlt_coefficients, project, stacked
from mocap.io.csv_table import read_table
from mocap.io.dltdv import (
    read_coefficients,
    read_pixels,
    read_points,
    write_coefficients,
    write_pixels,
    write_points,
    write_residuals,
)
from mocap.records import MarkerTracks, PixelTracks, Status

HALF_DIGIT = 0.5000001e-6
"""Files carry six decimals: a value comes back within half of the last."""


def make_pixels(names, uv_px):
    n_cameras, n_frames = np.shape(uv_px)[:2]
    cameras = tuple(f"cam{c + 1}" for c in range(n_cameras))
    return PixelTracks(names=tuple(names), cameras=cameras, t_s=np.arange(n_frames) / 100.0, uv_px=uv_px)


def make_points(names, xyz_m, sd_m=np.nan):
    xyz_m = np.asarray(xyz_m, dtype=float)
    return MarkerTracks(
        names=tuple(names),
        t_s=np.arange(len(xyz_m)) / 100.0,
        xyz_m=xyz_m,
        cov_m2=np.broadcast_to(sd_m, xyz_m.shape[:2])[..., None, None] ** 2 * np.eye(3),
        status=np.where(np.isnan(xyz_m[..., 0]), Status.MISSING, Status.MEASURED),
    )


def test_the_origin_of_the_world_is_a_position(tmp_path):
    """A marker at exactly (0, 0, 0) and a pixel at exactly (0, 0) are seen, not missing."""
    write_points(tmp_path / "xyzpts.csv", make_points(["a"], np.zeros((2, 1, 3))))
    write_pixels(tmp_path / "xypts.csv", make_pixels(["a"], np.zeros((2, 2, 1, 2))))
    points, pixels = read_points(tmp_path / "xyzpts.csv", fps=1), read_pixels(tmp_path / "xypts.csv", fps=1)
    assert points.seen.all()
    assert pixels.seen.all()
    assert not points.xyz_m.any()
    assert not pixels.uv_px.any()


def test_never_seen_markers_stay_without_value(tmp_path):
    """A table of nothing but NaN is a recording in which nothing was seen."""
    write_pixels(tmp_path / "xypts.csv", make_pixels(["a", "b"], np.full((2, 3, 2, 2), np.nan)))
    write_points(tmp_path / "xyzpts.csv", make_points(["a"], np.full((3, 1, 3), np.nan)))
    assert not read_pixels(tmp_path / "xypts.csv", fps=1).seen.any()
    assert not read_points(tmp_path / "xyzpts.csv", fps=1).seen.any()


def test_standard_deviations_come_back(tmp_path):
    """With ``sd`` the file holds the root mean square deviation, nine decimals of a metre: half a nanometre."""
    xyz, sd = np.random.default_rng(1).normal(size=(5, 2, 3)), np.array([[1e-3, 2e-4]]) * np.arange(1, 6)[:, None]
    write_points(tmp_path / "xyz.csv", make_points(["a", "b"], xyz, sd), sd=True)
    back = read_points(tmp_path / "xyz.csv", fps=100)
    np.testing.assert_allclose(back.xyz_m, xyz, rtol=0, atol=0.6e-9)
    np.testing.assert_allclose(back.sd_m, sd, rtol=0, atol=0.6e-9)


def test_columns_are_found_by_name(tmp_path):
    """The order of the columns carries nothing: any permutation of a file reads as the same tracks.

    Names keep the order in which they first appear; cameras are in the order of their numbers, past ten too.
    """
    rng = np.random.default_rng(2)
    pixels = make_pixels(["tail", "nose"], rng.uniform(0, 1000, (11, 3, 2, 2)))
    write_pixels(tmp_path / "straight.csv", pixels)
    rows = [line.split(",") for line in (tmp_path / "straight.csv").read_text().splitlines()]
    order = rng.permutation(len(rows[0]))
    (tmp_path / "mixed.csv").write_text("\n".join(",".join(row[i] for i in order) for row in rows) + "\n")
    back = read_pixels(tmp_path / "mixed.csv", fps=100)
    assert back.cameras == tuple(f"cam{i}" for i in range(1, 12))
    same = [back.names.index(name) for name in pixels.names]
    np.testing.assert_allclose(back.uv_px[:, :, same], pixels.uv_px, rtol=0, atol=HALF_DIGIT)

    write_points(tmp_path / "xyz.csv", make_points(["a"], [[[1.0, 2.0, 3.0]]]))
    (tmp_path / "zyx.csv").write_text("a_Z,a_X,a_Y\n3,1,2\n")
    np.testing.assert_array_equal(
        read_points(tmp_path / "zyx.csv", fps=1).xyz_m, read_points(tmp_path / "xyz.csv", fps=1).xyz_m
    )


def test_version_8_4_names_its_axes_u_and_v(tmp_path):
    """DLTdv 8.4 writes user names and _U, _V; the same numbers under _X, _Y are the same tracks."""
    numbers = "\n".join(["1.5,2.5,3.5,4.5", "NaN,NaN,7,8"])
    (tmp_path / "old.csv").write_text(
        "left_cam_1_cam1_X,left_cam_1_cam1_Y,left_cam_1_cam2_X,left_cam_1_cam2_Y\n" + numbers
    )
    (tmp_path / "new.csv").write_text(
        "left_cam_1_cam1_U,left_cam_1_cam1_V,left_cam_1_cam2_U,left_cam_1_cam2_V\n" + numbers
    )
    old, new = read_pixels(tmp_path / "old.csv", fps=1), read_pixels(tmp_path / "new.csv", fps=1)
    assert old.names == new.names == ("left_cam_1",)
    np.testing.assert_array_equal(old.uv_px, new.uv_px)
    np.testing.assert_array_equal(new.uv_px[:, 0, 0], [[1.5, 2.5], [3.5, 4.5]])


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("last", [True, False])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_line_endings_and_byte_order_marks_change_nothing(tmp_path, ending, last, mark):
    """Files of Windows, old Macs and spreadsheets read alike, with or without a last line end."""
    lines = ["p_cam1_X,p_cam1_Y", "1,2", "NaN,NaN", ",", "NA,NA", "5.25,6.5"]
    text = mark + ending.join(lines) + (ending if last else "")
    (tmp_path / "x.csv").write_bytes(text.encode())
    uv = read_pixels(tmp_path / "x.csv", fps=1).uv_px[0, :, 0]
    np.testing.assert_array_equal(uv, [[1, 2], [np.nan] * 2, [np.nan] * 2, [np.nan] * 2, [5.25, 6.5]])


def test_half_a_pixel_is_not_seen(tmp_path):
    """A pixel whose one coordinate is missing, or a point whose one coordinate is, says nothing."""
    (tmp_path / "xy.csv").write_text("p_cam1_X,p_cam1_Y\n1,NaN\n1,2\n")
    (tmp_path / "xyz.csv").write_text("p_X,p_Y,p_Z\n1,2,NaN\n1,2,3\n")
    np.testing.assert_array_equal(read_pixels(tmp_path / "xy.csv", fps=1).seen[0, :, 0], [False, True])
    np.testing.assert_array_equal(read_points(tmp_path / "xyz.csv", fps=1).seen[:, 0], [False, True])


def test_the_header_is_what_dltdv_writes(tmp_path):
    """Point-major, then camera, then X, Y; a name with a comma is quoted, so that any CSV reader agrees."""
    write_pixels(tmp_path / "x.csv", make_pixels(["pt1", "wing, left"], np.zeros((2, 1, 2, 2))))
    with open(tmp_path / "x.csv", newline="") as stream:
        header, row = list(csv.reader(stream))
    assert header == [f"{p}_cam{c}_{a}" for p in ("pt1", "wing, left") for c in (1, 2) for a in "XY"]
    assert row == ["0.000000"] * 8


def test_residuals_come_back(tmp_path):
    """Residuals are a column a marker, NaN where there is no point."""
    residual = np.array([[0.123456, np.nan], [0.0, 12.5]])
    write_residuals(tmp_path / "r.csv", ["a", "b"], residual)
    np.testing.assert_allclose(read_table(tmp_path / "r.csv")[1], residual, atol=HALF_DIGIT, rtol=0)


def test_coefficients_come_back_to_a_millionth_of_a_pixel(tmp_path):
    """Twelve decimals of DLT coefficients keep pixels to 1e-6.

    L9..L11 are about 0.3 a metre here, their rounding 5e-13 moves the depth by 1e-12 of itself: 1e-9 px of 1000.
    """
    rng = np.random.default_rng(3)
    cameras = [
        dlt_camera(f"cam{i + 1}", np.r_[rng.normal(0, 400, 3), 640, rng.normal(0, 400, 3), 512, rng.normal(0, 0.3, 3)])
        for i in range(4)
    ]
    write_coefficients(tmp_path / "c.csv", cameras)
    back = read_coefficients(tmp_path / "c.csv")
    assert [c.name for c in back] == ["cam1", "cam2", "cam3", "cam4"]
    points = rng.uniform(-0.5, 0.5, (50, 3))
    np.testing.assert_allclose(project(stacked(back), points), project(stacked(cameras), points), rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        [dlt_coefficients(c) for c in back], [dlt_coefficients(c) for c in cameras], atol=5.1e-13
    )
