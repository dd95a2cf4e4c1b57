"""Tracked points in the files of the programs that people came from, read as these programs read them."""

import h5py
import numpy as np
import pandas as pd
import pytest
from mocap.datasets import make_bat, write_recording

import mocap as library
from mocap.cameras.camera import project as ideal
from mocap.cameras.camera import record, stacked
from mocap.errors import FormatError
from mocap.io.contents import pixel_recording
from mocap.io.registry import identify, read, write
from mocap.results.keypoints import NEAR_PX, contents_of
from tests.mocap.recordings import points

N = 24


@pytest.fixture(scope="module")
def scene():
    return make_bat(seed=3, n_frames=N, n_cameras=3)


@pytest.fixture(scope="module")
def tracked(scene, tmp_path_factory):
    """A run with lenses, saved and loaded, and the folder of its exports."""
    folder = tmp_path_factory.mktemp("keypoints")
    files = write_recording(scene, folder)
    source = library.read(
        files["pixels"],
        calibration=files["coefficients"],
        profile=files["profile"],
        fps=240,
        skeleton=files["skeleton"],
    )
    fresh = library.track(source, model="constant_velocity", validate=False)
    fresh.save(folder / "run")
    loaded = library.load(folder / "run")
    (folder / "out").mkdir()
    assert not loaded.write_kinematics(folder / "out", exports=["deeplabcut", "sleap"], pictures=False)
    return fresh, loaded, folder / "out"


@pytest.mark.slow
def test_pixels_are_those_that_the_cameras_recorded(scene, tracked):
    """Lens and image rows included: half of the measured points lie within the clicks' own noise, about 1 px."""
    _, loaded, out = tracked
    for c, camera in enumerate(scene.pixels.cameras):
        table = pd.read_hdf(out / f"markers_{camera}.dlc.h5")
        assert table.columns.names == ["scorer", "bodyparts", "coords"]
        assert list(table.columns.get_level_values("coords")[:3]) == ["x", "y", "likelihood"]
        assert list(table.index) == list(range(N))
        values = table.to_numpy().reshape(N, -1, 3)  # as keypoint-moseq does
        order = [scene.pixels.names.index(n) for n in table.columns.get_level_values("bodyparts").unique()]
        away = np.linalg.norm(values[..., :2] - scene.pixels.uv_px[c][:, order], axis=-1)
        assert np.nanmedian(away) < 1.5
        assert scene.cameras[c].lens is not None
        straight = ideal(stacked(loaded.cameras), loaded.tracks.xyz_m)[c]
        bent = np.linalg.norm(values[..., :2] - straight, axis=-1)
        assert np.nanmax(bent) > 3  # the lens moves pixels at the edge by more than the test's tolerance
        same = pd.read_csv(out / f"markers_{camera}.dlc.csv", header=[0, 1, 2], index_col=0)
        np.testing.assert_allclose(same.to_numpy(), table.to_numpy(), rtol=1e-12)


def test_a_likelihood_is_the_probability_of_being_near(tracked):
    """Of positions drawn from a covariance, the share that each camera sees within 17 px, where that is about half.

    4 standard deviations of 4000 draws; a slope that is straight over 17 px and a lens that turns nothing: 0.02.
    """
    run = tracked[0]
    rng, markers = np.random.default_rng(0), run.tracks
    at, marker = N // 2, int(np.flatnonzero(markers.seen[N // 2])[0])
    eight_mm = np.broadcast_to(np.eye(3) * 8e-3**2, markers.cov_m2.shape)
    wide = run.having(covariance=eight_mm)
    told = contents_of(wide).score[:, at, marker]
    drawn = rng.normal(markers.xyz_m[at, marker], 8e-3, (4000, 3))
    away = np.linalg.norm(record(run.cameras, drawn) - record(run.cameras, markers.xyz_m[at, marker])[:, None], axis=-1)
    share = (away < NEAR_PX).mean(axis=1)
    assert (np.abs(share - 0.5) < 0.45).all()
    np.testing.assert_allclose(told, share, atol=0.02 + 4 * np.sqrt(0.25 / 4000))


def test_a_saved_run_knows_its_lenses(tracked):
    """What is exported after loading is what was exported before, to the digits of stored pixels."""
    fresh, loaded, _ = tracked
    before, after = contents_of(fresh), contents_of(loaded)
    assert all(a.lens == b.lens and a.lens is not None for a, b in zip(fresh.cameras, loaded.cameras, strict=True))
    np.testing.assert_allclose(after.pixels.uv_px, before.pixels.uv_px, atol=1e-3)


def test_sleap_files_are_read_by_sleap_io_and_by_keypoint_moseq(tracked):
    """Pixels and scores through sleap-io, positions as keypoint-moseq's loader of sleap-anipose takes them."""
    sleap_io = pytest.importorskip("sleap_io")
    if not hasattr(sleap_io, "load_analysis_h5"):
        pytest.skip("this sleap-io reads no analysis files")
    _, loaded, out = tracked
    found = contents_of(loaded)
    labels = sleap_io.load_analysis_h5(str(out / "markers_cam2.analysis.h5"), video="cam2.mp4")
    assert [node.name for node in labels.skeleton.nodes] == list(found.names)
    uv = np.stack([frame.instances[0].numpy(scores=True) for frame in labels.labeled_frames])
    np.testing.assert_allclose(uv[..., :2], found.pixels.uv_px[1], rtol=1e-9)
    np.testing.assert_allclose(uv[..., 2], found.score[1], rtol=1e-9)
    with h5py.File(out / "markers.points3d.h5") as file:
        coordinates = file["tracks"][()][:, 0]
    np.testing.assert_allclose(coordinates, loaded.tracks.xyz_m)
    assert identify(out / "markers_cam2.analysis.h5").name == "sleap-analysis"


def test_positions_come_back(tracked, tmp_path):
    """DeepLabCut's 3D tables and sleap-anipose's points: every position, filled ones too."""
    _, loaded, out = tracked
    for name in ("markers.dlc.h5", "markers.dlc.csv", "markers.points3d.h5"):
        back = read(out / name)
        np.testing.assert_allclose(back.points.xyz_m, loaded.tracks.xyz_m, rtol=1e-12)
    two = points(["a", "b"], np.arange(12.0).reshape(2, 2, 3))
    assert any("names" in remark for remark in write(two, tmp_path / "a.points3d.h5"))


def test_without_pytables_the_message_says_what_to_install(tmp_path, monkeypatch):
    """One line, with the CSV as a way out."""
    monkeypatch.setitem(__import__("sys").modules, "tables", None)
    with pytest.raises(FormatError, match=r"PyTables.*pip install .*\[deeplabcut\]"):
        write(points(["a"], np.zeros((2, 1, 3))), tmp_path / "a.dlc.h5")


@pytest.mark.parametrize("name", ["deeplabcut-csv", "deeplabcut-h5", "sleap-analysis"])
def test_cameras_animals_scores_and_frames_come_back(tmp_path, name):
    """A file a camera, two animals of three and two parts, frames from 4 with one left out, samples not seen."""
    rng = np.random.default_rng(0)
    uv, score = rng.uniform(0, 900, (2, 3, 5, 2)), rng.uniform(0.7, 1, (2, 3, 5))
    uv[1, 0, 2] = np.nan
    score[1, 0, 2] = np.nan if name == "sleap-analysis" else 0.0  # DeepLabCut has a likelihood of every sample
    animals = (("m1", "nose"), ("m2", "nose"), ("m1", "tail"), ("m2", "tail"), ("m1", "ear"))
    recording = pixel_recording(
        tmp_path / "a", "a", names=["_".join(pair) for pair in animals], cameras=["top", "side"], uv_px=uv,
        frames=np.array([4, 5, 7]), first=0, animals=animals, score=score,
    )  # fmt: skip
    end = "analysis.h5" if name == "sleap-analysis" else f"dlc.{name.rsplit('-', 1)[1]}"
    write(recording, tmp_path / f"a.{end}", name)
    for c, camera in enumerate(recording.camera_names):
        back = read(tmp_path / f"a_{camera}.{end}")
        rows = np.isin(back.frames, recording.frames)
        assert rows.sum() == 3
        assert set(back.names) >= set(recording.names)
        at = [back.names.index(marker) for marker in recording.names]
        np.testing.assert_allclose(back.pixels.uv_px[0, rows][:, at], uv[c], rtol=1e-12)
        np.testing.assert_allclose(back.score[0, rows][:, at], score[c], rtol=1e-12)
