"""One film without a calibration: tracked in its picture, in pixels or with a scale; z is nowhere."""

import csv
import json

import numpy as np
import pytest
from mocap.datasets.lizards import make_lizard

import mocap
from mocap.cameras.camera import record
from mocap.errors import MocapError
from mocap.io.dltdv import write_pixels
from mocap.records import PixelTracks, Status


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A lizard's markers as one camera sees them, clicked to 0.5 px, with 20 gaps: the file and the truth."""
    lizard, rng = make_lizard(seed=3, n_frames=150), np.random.default_rng(3)
    truth = record(lizard.cameras, lizard.truth.xyz_m)[0][:, :10]
    uv = np.where(lizard.pixels.seen[0][:, :10, None], truth + rng.normal(0, 0.5, truth.shape), np.nan)
    for _ in range(20):
        start = rng.integers(10, 130)
        uv[start : start + rng.integers(3, 10), rng.integers(10)] = np.nan
    names = lizard.pixels.names[:10]
    pixels = PixelTracks(names=names, cameras=("film",), t_s=lizard.pixels.t_s, uv_px=uv[None])
    path = tmp_path_factory.mktemp("film") / "clicks_xypts.csv"
    write_pixels(path, pixels)
    return path, truth, 1 / float(np.diff(lizard.pixels.t_s)[0])


@pytest.fixture(scope="module")
def tracked(film):
    """It, tracked by constant velocity in pixels."""
    return mocap.track(mocap.read(film[0], fps=film[2]), model="constant_velocity")


def test_intervals_hold_in_the_picture(film, tracked):
    """Of 3000 coordinates 93 to 98 % lie inside their 95 % intervals where seen, of the 200 filled ones 88 % at least.

    Errors of neighbouring frames go together, which is why the second bound is low.
    """
    _, truth, _ = film
    markers = tracked.tracks
    error = 1e3 * markers.xyz_m[..., :2] - truth
    sd = 1e3 * np.sqrt(np.diagonal(markers.cov_m2, axis1=-2, axis2=-1)[..., :2])
    share = {s: np.mean(np.abs(error) < 1.96 * sd, where=(markers.status == s)[..., None]) for s in (1, 4)}
    assert 0.93 < share[Status.MEASURED] < 0.98
    assert share[Status.SMOOTHED] > 0.88
    assert (
        np.sqrt(np.mean(error[markers.status == Status.MEASURED] ** 2)) < 0.4
    )  # smoothed: below the 0.5 px of a click


def test_files_speak_of_pixels(film, tracked, tmp_path):
    """Two coordinates and their unit in every file; no third coordinate, no millimetre, nothing of space."""
    _, truth, _ = film
    tracked.save(tmp_path / "out")
    with (tmp_path / "out" / "markers.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    name = tracked.tracks.names[0]
    fields = ("x_px", "y_px", "sd_px", "origin")
    assert [c for c in rows[0] if c.startswith(f"{name}_")] == [f"{name}_{f}" for f in fields]
    found = np.array([[float(row[f"{name}_x_px"]), float(row[f"{name}_y_px"])] for row in rows])
    assert np.nanmedian(np.abs(found - truth[:, 0])) < 0.5
    report, text = (
        json.loads((tmp_path / "out" / "report.json").read_text()),
        (tmp_path / "out" / "report.md").read_text(),
    )
    assert report["plane"] == {"unit": "px", "mm_per_px": None}
    assert report["validation"]["methods"]["constant_velocity"]["rmse_px"] > 0
    assert "pixels of its image" in text
    for word in (" mm", " m/s", "3D", "joints.csv"):
        assert word not in text.split("## Command")[0]
    assert tracked.markers.sizes["space"] == 2
    assert tracked.markers["position"].attrs["units"] == "px"
    assert sorted(p.name for p in (tmp_path / "out" / "figures").glob("*.png")) == [
        "paths.png",
        "x_over_time.png",
        "y_over_time.png",
    ]
    with pytest.raises(MocapError, match="kinematics needs positions in space"):
        _ = tracked.kinematics


def test_a_scale_makes_metres(film, tracked):
    """0.05 mm a pixel: the same track times 0.00005, in metres, as far as the floors of noise allow."""
    path, _, fps = film
    scaled = mocap.track(mocap.read(path, fps=fps, mm_per_px=0.05), model="constant_velocity", validate=False)
    a, b = (r.markers["position"].values for r in (tracked, scaled))
    np.testing.assert_allclose(b, 5e-5 * a, rtol=0, atol=5e-5 * 0.2)
    assert scaled.markers["position"].attrs["units"] == "m"
    assert "0.05 mm per pixel" in scaled.report_text


def test_what_one_film_cannot_give_is_refused(film):
    """A scale for positions, a skeleton proposed from lengths in a picture, learning: each named."""
    path, _, fps = film
    one = mocap.read(path, fps=fps)
    with pytest.raises(MocapError, match="a skeleton needs positions in space"):
        mocap.propose_skeleton(one)
    with pytest.raises(MocapError, match="learning needs positions in space"):
        mocap.learn([one, mocap.read(path, fps=fps), mocap.read(path, fps=fps)])
    with pytest.raises(MocapError, match="`mm_per_px` must be a number above 0"):
        mocap.read(path, fps=fps, mm_per_px=-1.0)


def test_clicks_that_a_network_doubts_are_not_used(tmp_path):
    """DeepLabCut's likelihoods below 0.6 are rejected and counted, the rest tracked."""
    t = np.arange(60)
    rows = ["scorer,net,net,net", "bodyparts,nose,nose,nose", "coords,x,y,likelihood"]
    rng = np.random.default_rng(0)
    for i in t:
        doubted = i % 20 == 7
        x, y = 100 + 2.0 * i + rng.normal(0, 0.3), 50 + 10 * np.sin(i / 9) + rng.normal(0, 0.3)
        rows.append(f"{i},{x + 40 * doubted},{y},{0.2 if doubted else 0.99}")
    (tmp_path / "film.csv").write_text("\n".join(rows) + "\n")
    found = mocap.track(mocap.read(tmp_path / "film.csv", fps=50), model="constant_velocity", validate=False)
    assert "3 clicks (5.0%) have a likelihood below 0.6" in found.report_text
    x = found.markers["position"].values[:, 0, 0, 0]
    assert np.abs(x - (100 + 2.0 * t)).max() < 3
