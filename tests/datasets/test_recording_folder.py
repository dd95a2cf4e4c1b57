"""A recording written and read back through the readers that users' files take."""

import json

import numpy as np
import pytest
from mocap.datasets import PERFECT, make_bat, make_lizard, read_truth, write_recording
from mocap.datasets.folder import write_project

from mocap.cameras.camera import project, record, stacked, undistorted
from mocap.cameras.triangulate import linear
from mocap.errors import FormatError
from mocap.io.anipose import read_calibration
from mocap.io.csv_table import read_table
from mocap.io.dltdv import read_coefficients, read_pixels, read_points
from mocap.io.dvproject import read_project
from mocap.io.profile import with_profile
from mocap.io.registry import read
from mocap.skeleton import Skeleton, write_skeleton
from mocap.skeleton_files import read_skeleton


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_files_read_back_as_written(make, tmp_path):
    recording = make(seed=4, n_frames=60, start_spread_frames=0.5)
    paths = write_recording(recording, tmp_path / "new" / "folder")
    pixels = read_pixels(paths["pixels"], fps=recording.fps)
    assert pixels.names == recording.pixels.names
    np.testing.assert_array_equal(pixels.seen, recording.pixels.seen)
    # %.6f
    np.testing.assert_allclose(pixels.uv_px, recording.pixels.uv_px, atol=5.1e-7, rtol=0)
    np.testing.assert_allclose(pixels.t_s, recording.truth.t_s, atol=1e-15)

    cameras = with_profile(read_coefficients(paths["coefficients"]), paths["profile"])
    assert [c.size_px for c in cameras] == [c.size_px for c in recording.cameras]
    # coefficients have 12 decimals: u changes by at most 1e-12 / 2 (|x| + |y| + |z| + 1)(1 + u) / depth ratio
    exact = record(recording.cameras, recording.truth.xyz_m)
    np.testing.assert_allclose(record(cameras, recording.truth.xyz_m), exact, atol=1e-8, rtol=0)

    assert read_skeleton(paths["skeleton"]) == recording.skeleton
    truth = read_truth(paths["truth"])
    assert truth.names == recording.truth.names
    np.testing.assert_array_equal(truth.xyz_m, recording.truth.xyz_m)
    with np.load(paths["truth"]) as table:
        assert table["fps"] == recording.fps
        for name in ("start_s", "occluded", "lost", "outlier", "contact"):
            np.testing.assert_array_equal(table[name], getattr(recording, name))
    titles, offsets = read_table(paths["offsets"])
    assert titles[:2] == ["cam1_offset", "cam2_offset"]
    assert offsets.shape == (60, len(cameras))
    # %.6f
    np.testing.assert_allclose(offsets, np.tile(-recording.start_s * recording.fps, (60, 1)), atol=5.1e-7)
    assert json.loads(paths["card"].read_text()) == json.loads(json.dumps(recording.card))
    assert sorted(p.name for p in paths["card"].parent.iterdir()) == sorted(p.name for p in paths.values())


def test_undistorted_pixels_of_the_files_are_the_ideal_ones(tmp_path):
    """Without faults, what is read, undistorted, is the pinhole projection of the truth: files and truth agree."""
    recording = make_bat(seed=4, n_frames=20, digitiser=PERFECT)
    paths = write_recording(recording, tmp_path)
    pixels = read_pixels(paths["pixels"], fps=recording.fps)
    cameras = with_profile(read_coefficients(paths["coefficients"]), paths["profile"])
    got, ideal = undistorted(cameras, pixels.uv_px), project(stacked(cameras), read_truth(paths["truth"]).xyz_m)
    # 5e-7 px of rounding, stretched by the inverse of the lens (its slope is above 0.8 here)
    np.testing.assert_allclose(got[pixels.seen], ideal[pixels.seen], atol=1e-6, rtol=0)


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_same_seed_same_bytes(make, tmp_path):
    first = write_recording(make(seed=5, n_frames=40), tmp_path / "a")
    again = write_recording(make(seed=5, n_frames=40), tmp_path / "b")
    other = write_recording(make(seed=6, n_frames=40), tmp_path / "c")
    for kind in first:
        assert first[kind].read_bytes() == again[kind].read_bytes()
    for kind in ("pixels", "truth", "card"):
        assert first[kind].read_bytes() != other[kind].read_bytes()


def test_skeleton_with_aliases_and_odd_names_reads_back(tmp_path):
    skeleton = Skeleton(
        name='a "bat"', markers=("öl", "b c", "\\d"), aliases={"pt 1": "öl"}, trunk=("b c",), max_speed_m_s=12
    )
    write_skeleton(tmp_path / "s.toml", skeleton)
    assert read_skeleton(tmp_path / "s.toml") == skeleton


def test_what_is_no_truth_is_an_error(tmp_path):
    np.savez(tmp_path / "x.npz", other=np.zeros(3))
    with pytest.raises(FormatError, match=r"x\.npz: .*not the truth of a synthetic recording"):
        read_truth(tmp_path / "x.npz")
    (tmp_path / "y.npz").write_text("text")
    with pytest.raises(FormatError, match="not the truth"):
        read_truth(tmp_path / "y.npz")


def test_a_project_of_dltdv8_reads_back_as_written(tmp_path):
    """Pixels, cameras, lenses and offsets to the last bit; the stored points are what DLTdv would triangulate."""
    recording = make_bat(seed=4, n_frames=60, start_spread_frames=0.5)
    write_project(tmp_path / "bat_dvProject.mat", recording)
    project = read_project(tmp_path / "bat_dvProject.mat")
    np.testing.assert_array_equal(project.pixels.uv_px, recording.pixels.uv_px)
    assert project.pixels.names == recording.pixels.names
    assert project.fps == recording.fps
    assert [c.lens for c in project.cameras] == [c.lens for c in recording.cameras]
    assert [c.size_px for c in project.cameras] == [c.size_px for c in recording.cameras]
    exact = record(recording.cameras, recording.truth.xyz_m)
    np.testing.assert_allclose(record(project.cameras, recording.truth.xyz_m), exact, atol=1e-9, rtol=0)
    np.testing.assert_array_equal(project.tables["offset_frames"], np.tile(-recording.start_s * recording.fps, (60, 1)))
    ideal = undistorted(project.cameras, project.pixels.uv_px, iterations=3)
    np.testing.assert_allclose(linear(stacked(project.cameras), ideal), project.points.xyz_m, atol=1e-9)
    head = (tmp_path / "bat_dvProject.mat").read_bytes()[:128]
    assert head.startswith(b"MATLAB 7.3 MAT-file")
    assert head[124:] == b"\x00\x02IM"


def test_a_fisheye_is_no_lens_of_dltdv(tmp_path):
    recording = make_bat(n_frames=2, lens="fisheye")
    with pytest.raises(ValueError, match="'cam1': a DLTdv8 project holds Brown lenses"):
        write_project(tmp_path / "x.mat", recording)


@pytest.mark.parametrize("lens", ["brown", "fisheye"])
def test_other_programs_files_hold_the_same(lens, tmp_path):
    """Each through the reader of its format: cameras, and positions that are the linear ones of the pixels."""
    recording = make_bat(seed=4, n_frames=40, lens=lens)
    paths = write_recording(recording, tmp_path, others=True)
    cameras = read_calibration(paths["calibration"])
    exact = record(recording.cameras, recording.truth.xyz_m)
    np.testing.assert_allclose(record(cameras, recording.truth.xyz_m), exact, atol=1e-9, rtol=0)
    assert ("project" in paths) == ("profile" in paths) == (lens == "brown")
    expected = linear(stacked(cameras), undistorted(cameras, recording.pixels.uv_px))
    assert np.isfinite(expected[..., 0]).mean() > 0.8
    points = read_points(paths["points"], fps=recording.fps)
    # %.6f
    np.testing.assert_allclose(points.xyz_m, expected, atol=5.1e-7)
    stored = read(paths["c3d"])
    assert stored.fps == recording.fps
    assert stored.points.names == recording.pixels.names
    # 32-bit numbers in millimetres, of up to 600: 600 x 2^-24 = 4e-5 mm
    np.testing.assert_allclose(stored.points.xyz_m, expected, atol=5e-8)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(p.name for p in paths.values())
