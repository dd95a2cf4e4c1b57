"""A lens that nobody gave: estimated from the tracks, or what it does to positions stated; refused where it is open."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets.bats import make_bat_wind_tunnel

import mocap
from mocap.batches.one import track_trial
from mocap.batches.trial import Options, read_manifest
from mocap.cameras.camera import Camera, project, stacked, undistorted
from mocap.cameras.lens import BrownLens
from mocap.cameras.lens_of_tracks import lens_of_tracks
from mocap.cameras.origin import PixelOptions
from mocap.cameras.triangulate import linear
from mocap.cleaning.cleaning import clean as cleaned
from mocap.errors import CalibrationError
from mocap.io.dltdv import write_coefficients, write_pixels
from mocap.io.profile import write_profile
from mocap.reading.decided import Decided
from mocap.reading.ideal_pixels import of_pixels
from mocap.recording import Recording
from mocap.records import PixelTracks
from mocap.skeleton import Skeleton
from mocap.tracking.tracking import lasting_cov
from tests.mocap.rigs import cloud, ring


@pytest.fixture(scope="module")
def bat():
    """A bat in a wind tunnel whose lenses have k1 -0.14 that no file states, without and with the lens; its truth."""
    flight = make_bat_wind_tunnel(seed=3, n_frames=150)
    ideal = undistorted(flight.cameras, flight.pixels.uv_px)
    bent = [
        view if c.lens is None else replace(c.lens, k=(-0.14, 0.0, 0.0), p=(0.0, 0.0)).distort(view)
        for c, view in zip(flight.cameras, ideal, strict=True)
    ]
    cameras = tuple(replace(c, lens=None) for c in flight.cameras)
    names, some = flight.pixels.names[::3], np.stack(bent)[:, :75, ::3]
    pixels = PixelTracks(names=names, cameras=flight.pixels.cameras, t_s=flight.pixels.t_s[:75], uv_px=some)
    found = []
    for fit_lens in (False, True):
        film = of_pixels(
            pixels,
            cameras,
            Skeleton(name="bat", markers=names),
            name="bat",
            options=PixelOptions(origin="upper-left", calibration_origin="upper-left", fit_lens=fit_lens),
        )
        found.append(cleaned(film))
    return *found, flight.truth.xyz_m[:75, ::3]


def inside(found: Recording, truth: np.ndarray) -> tuple[float, float]:
    """Share of coordinates of points inside their 95 % intervals, and the median error in mm."""
    error = found.xyz_m - truth
    sd = np.sqrt(np.diagonal(found.cov_m2 + lasting_cov(found), axis1=-2, axis2=-1))
    seen = np.isfinite(error[..., 0])
    return float(np.mean(np.abs(error[seen]) < 1.96 * sd[seen])), 1e3 * float(
        np.median(np.linalg.norm(error[seen], axis=-1))
    )


def test_an_estimated_lens_brings_positions_back(bat):
    """The coefficient within 3 of its deviations of -0.14; errors a third of before at most; intervals hold."""
    without, with_lens, truth = bat
    found = with_lens[Decided].lens
    assert found is not None
    assert (np.abs(found.k1 + 0.14) < 3 * found.sd).all()
    assert found.after_px < found.before_px
    (held, mm), (_, mm_before) = inside(with_lens, truth), inside(without, truth)
    assert mm < 0.5 * mm_before
    assert held > 0.93
    assert any("estimated from the recording itself: k1 -0.1" in f.text for f in with_lens.findings)
    assert not any("no lens is given" in f.text for f in with_lens.findings)


def test_a_lens_that_is_not_corrected_widens_intervals(bat):
    """Without it 95 % intervals hold all the same, and the report says by how much positions are moved."""
    found, _, truth = bat
    held, _ = inside(found, truth)
    assert held > 0.93
    assert any("the lens that is not corrected moves positions by" in f.text for f in found.findings)
    narrow = np.diagonal(found.cov_m2, axis1=-2, axis2=-1)
    assert np.nanmedian(np.diagonal(lasting_cov(found), axis1=-2, axis2=-1) / narrow) > 1


def scene(rng, spread_m):
    """300 points of a cloud of this radius in three cameras with k1 -0.2, clicked to 0.5 px, and the bare cameras."""
    cameras = ring(3)
    points = cloud(rng, 300, radius_m=spread_m)
    ideal = project(stacked(cameras), points)
    lens = BrownLens(f_px=(1200.0, 1212.0), centre_px=(640.0, 512.0), k=(-0.2, 0.0, 0.0))
    bare = [Camera(name=c.name, matrix=c.matrix, size_px=c.size_px) for c in cameras]
    return bare, (lens.distort(ideal) + rng.normal(0, 0.5, ideal.shape)).reshape(3, 30, 10, 2)


@pytest.mark.rare
def test_the_coefficient_is_as_well_known_as_it_says():
    """Five seeds: errors of k1 within 2.36 deviations (Student's t of seven degrees) but for one at most."""
    z = []
    for seed in range(5):
        found = lens_of_tracks(*scene(np.random.default_rng(seed), 0.4), each=False)
        z.append(abs(found.k1[0] + 0.2) / found.sd[0])
    assert np.count_nonzero(np.array(z) > 2.36) <= 1


def test_a_lens_that_the_recording_does_not_show_is_refused():
    """Points in the middle of all pictures, too few points, and pixels without any distortion."""
    rng = np.random.default_rng(1)
    cameras, uv = scene(rng, 0.03)
    with pytest.raises(CalibrationError, match=r"`fit_lens`: (no lens reduces|this recording does not)"):
        lens_of_tracks(cameras, uv, each=False)
    with pytest.raises(CalibrationError, match="50 points are seen by two cameras, and 60 are needed"):
        lens_of_tracks(cameras, uv[:, :5])
    straight = project(stacked(cameras), cloud(rng, 300, radius_m=0.4)).reshape(3, 30, 10, 2)
    with pytest.raises(CalibrationError, match="no lens reduces the reprojection error"):
        lens_of_tracks(cameras, straight + rng.normal(0, 0.5, straight.shape), each=False)


def test_cameras_that_have_lenses_keep_them():
    """What a file states of lenses is not fitted again."""
    uv = project(stacked(ring(3, lens=True)), cloud(np.random.default_rng(2), 80)).reshape(3, 8, 10, 2)
    names = tuple(f"m{i}" for i in range(10))
    pixels = PixelTracks(names=names, cameras=("cam1", "cam2", "cam3"), t_s=np.arange(8) / 100, uv_px=uv)
    options = PixelOptions(origin="upper-left", calibration_origin="upper-left", fit_lens=True)
    with pytest.raises(CalibrationError, match="`fit_lens`: the cameras have lenses already"):
        of_pixels(pixels, ring(3, lens=True), name="a", options=options)


@pytest.mark.rare
def test_a_fitted_lens_is_a_profile_that_other_trials_take(tmp_path):
    """Written with the result; with it the pixels need no lens: the same points to a tenth of a millimetre."""
    bent_flight(tmp_path)
    stated = {"calibration": tmp_path / "rig.csv", "fps": 500, "unit": "m", "origin": "upper-left"}
    fitted = mocap.read(tmp_path / "t_xypts.csv", fit_lens=True, **stated)
    mocap.track(fitted, model="constant_velocity", validate=False).save(tmp_path / "out")
    again = mocap.read(tmp_path / "t_xypts.csv", profile=tmp_path / "out" / "camera_profile.txt", **stated)
    a, b = (linear(one.matrices, one.ideal_px) for one in (fitted, again))
    assert np.nanmedian(np.linalg.norm(a - b, axis=-1)) < 1e-4
    assert not [one for one in cleaned(again).findings if one.alarm and one.kind == "distortion"]


def bent_flight(folder):
    """A flight whose four cameras have k1 = -0.14, and coefficients without a lens."""
    flight = make_bat_wind_tunnel(seed=3, n_frames=60)
    ideal = undistorted(flight.cameras, flight.pixels.uv_px)
    bent = [
        view if c.lens is None else replace(c.lens, k=(-0.14, 0.0, 0.0), p=(0.0, 0.0)).distort(view)
        for c, view in zip(flight.cameras, ideal, strict=True)
    ]
    names = flight.pixels.names[::3]
    pixels = replace(flight.pixels, names=names, uv_px=np.stack(bent)[:, :, ::3])
    write_pixels(folder / "t_xypts.csv", pixels)
    write_coefficients(folder / "rig.csv", [replace(c, lens=None) for c in flight.cameras])
    return flight


def test_a_batch_estimates_lenses_where_none_is_known(tmp_path, mocap):
    """Its result holds the profile, which a trial with one beside it has already; one video has no lens to estimate."""
    flight = bent_flight(tmp_path)
    for name in ("bare", "known", "video"):
        (tmp_path / "lab" / name).mkdir(parents=True)
    for name in ("bare", "known"):
        for file in ("t_xypts.csv", "rig.csv"):
            shutil.copy(tmp_path / file, tmp_path / "lab" / name / file)
    write_profile(tmp_path / "lab" / "known" / "camera_profile.txt", flight.cameras)
    rows = [f"{k},{k / 500:.3f},{100 + k},{200 + k % 7}" for k in range(40)]
    (tmp_path / "lab" / "video" / "v.csv").write_text("\n".join(["frame,time,pt1_x,pt1_y", *rows]) + "\n")
    stated = ["--fit-lens", "--fps", "500", "--unit", "m"]
    code, _, said = mocap("batch", tmp_path / "lab", "--out", tmp_path / "plan", "--dry-run", *stated)
    assert code == 0, said
    trials = {trial.name.partition("/")[0]: trial for trial in read_manifest(tmp_path / "plan" / "manifest.csv")}
    assert {name: trial.arguments.get("fit_lens") for name, trial in trials.items()} == {
        "bare": True, "known": None, "video": None,
    }  # fmt: skip
    bare = trials["bare"]
    track_trial(bare, Options(model="constant_velocity", validate=False), tmp_path / "out")
    assert (tmp_path / "out" / bare.name / "camera_profile.txt").is_file()
