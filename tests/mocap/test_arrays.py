"""Recordings of numbers in memory: the same as those of files, and wrong arguments say what is expected."""

import shutil
from functools import cache

import numpy as np
import pandas as pd
import pytest
from mocap.datasets import make_bat, write_recording

import mocap
from mocap.batches.trial import Options
from mocap.cameras.camera import Camera, dlt_coefficients
from mocap.cleaning.cleaning import clean
from mocap.errors import FormatError
from mocap.io.contents import point_recording
from mocap.io.movement import write_movement
from mocap.io.netcdf import read_netcdf
from mocap.io.registry import read as read_file
from mocap.reading.decided import Decided
from mocap.skeleton import Bone, Joint, write_skeleton
from mocap.skeleton_files import read_skeleton

FPS = 200.0
NAMES = ("hip", "knee", "ankle")
RIG = [[800, 0, 0, 500, 0, 800, 0, 400, 0, x, 0.5] for x in (0, 0.1)]
"""Coefficients of two cameras."""


@pytest.fixture
def xyz():
    """(T, M, 3) a leg that swings, in millimetres, with a gap and noise."""
    rng, t = np.random.default_rng(0), np.arange(120) / FPS
    bend = 0.6 * np.sin(12 * t)
    knee = np.stack([200 * np.sin(bend), 0 * t, -200 * np.cos(bend)], axis=1)
    ankle = knee + np.stack([150 * np.sin(2 * bend), 0 * t, -150 * np.cos(2 * bend)], axis=1)
    out = np.stack([np.zeros_like(knee), knee, ankle], axis=1) + rng.normal(scale=0.3, size=(len(t), 3, 3))
    out[40:50, 2] = np.nan
    return out


@pytest.fixture(scope="module")
def bat(tmp_path_factory):
    recording = make_bat(seed=0, n_frames=40)
    return recording, write_recording(recording, tmp_path_factory.mktemp("bat"))


cleaned = cache(clean)
"""Of a recording that several others are compared with, once."""


def same(one, other, rtol=1e-9):
    """Whether two recordings are cleaned to the same numbers."""
    a, b = cleaned(one), cleaned(other)
    assert a.names == b.names
    for part in ("t_s", "xyz_m", "cov_m2", "uv_px", "ray_sd_px"):
        np.testing.assert_allclose(getattr(a, part), getattr(b, part), rtol=rtol, atol=1e-12)


def alike(one, other, rtol=1e-9):
    """Whether two recordings of pixels are the same before they are cleaned: clicks, lenses and projections."""
    assert (one.names, one[Decided].rows.pixels) == (other.names, other[Decided].rows.pixels)
    np.testing.assert_array_equal(one.data["pixels"], other.data["pixels"])
    assert [camera.lens for camera in one.cameras] == [camera.lens for camera in other.cameras]
    np.testing.assert_allclose(one.matrices, other.matrices, rtol=rtol, atol=1e-9)


def test_an_array_is_tracked_in_two_lines(xyz):
    """No file and no skeleton; the gap of ten frames is filled."""
    recording = mocap.from_arrays(xyz, names=NAMES, fps=FPS, unit="mm")
    tracked = mocap.track(recording, model="constant_velocity", validate=False)
    found = tracked.markers.position.values
    assert found.shape == (120, 3, 3, 1)
    assert np.isfinite(found).all()
    assert np.nanmedian(np.abs(1e3 * found[..., 0] - np.moveaxis(xyz, 1, 2))) < 0.5


def test_tables_and_datasets_are_the_arrays_they_hold(xyz, tmp_path):
    """A table with plain titles, one with two levels, and what movement saves and loads."""
    want = mocap.from_arrays(xyz, names=NAMES, fps=FPS, unit="mm")
    assert want.fps == FPS
    columns = [(name, axis) for name in NAMES for axis in "xyz"]
    flat = pd.DataFrame(xyz.reshape(len(xyz), -1), columns=[f"{n}_{a}" for n, a in columns])
    same(mocap.from_arrays(flat, fps=FPS, unit="mm"), want)
    timed = flat.assign(t_s=np.arange(len(xyz)) / FPS, comment="seen")
    found = mocap.from_arrays(timed, unit="mm")
    same(found, want)
    assert "columns that are not used: comment" in found.source.unusual
    leveled = pd.DataFrame(xyz.reshape(len(xyz), -1), columns=pd.MultiIndex.from_tuples(columns))
    same(mocap.from_arrays(leveled, fps=FPS, unit="mm"), want)
    other = mocap.from_arrays(flat[reversed(flat.columns)], names=NAMES[::-1], fps=FPS, unit="mm")
    np.testing.assert_array_equal(other.points.xyz_m, want.points.xyz_m[:, ::-1])
    file = tmp_path / "leg.nc"
    write_movement(file, point_recording(file, "array", names=NAMES, xyz=xyz, unit="mm", fps=FPS))
    same(mocap.from_arrays(read_netcdf(file, again="")), want)


def test_pixels_in_memory_are_those_of_files(bat):
    """Of the coefficients' array, of projections, of their file, of cameras with lenses: the recording of the files."""
    recording, files = bat
    want = mocap.read(files["pixels"], fps=FPS, calibration=files["coefficients"], profile=files["profile"])
    read = read_file(files["pixels"])
    lenses = want.cameras
    stated = {"names": read.names, "fps": FPS, "origin": "upper-left", "unit": "m"}
    of_cameras = mocap.from_pixels(read.pixels.uv_px, lenses, **stated)
    same(of_cameras, want)
    bare = [dlt_coefficients(camera) for camera in lenses]
    plain = mocap.from_pixels(read.pixels.uv_px, bare, **stated)
    alike(mocap.from_pixels(read.pixels.uv_px, np.stack([c.matrix for c in lenses]), **stated), plain)
    alike(mocap.from_pixels(read.pixels.uv_px, files["coefficients"], **stated), plain)
    shrunk = [Camera(name=c.name, matrix=c.matrix @ np.diag([1e-3, 1e-3, 1e-3, 1]), lens=c.lens) for c in lenses]
    found = mocap.from_pixels(read.pixels.uv_px, shrunk, **{**stated, "unit": "mm"})
    assert (found[Decided].unit, found[Decided].unit_from) == ("mm", "file")
    alike(found, of_cameras)
    assert recording.fps


def test_reading_is_done_when_read_returns(bat, tmp_path):
    """A recording is numbers: its files can go before it is tracked."""
    _, files = bat
    folder = tmp_path / "gone"
    shutil.copytree(files["pixels"].parent, folder)
    there = {key: folder / path.name for key, path in files.items()}
    stated = {"calibration": there["coefficients"], "profile": there["profile"], "skeleton": there["skeleton"]}
    recording = mocap.read(there["pixels"], fps=FPS, **stated)
    shutil.rmtree(folder)
    tracked = mocap.track(recording, model="constant_velocity", validate=False)
    assert set(tracked.joints) == {joint.name for joint in read_skeleton(files["skeleton"]).joints}


def test_a_skeleton_needs_no_file(xyz, tmp_path):
    """Of texts, pairs and triples it is what its file reads as; names of the recording are checked."""
    skeleton = mocap.Skeleton(
        name="leg",
        markers=list(NAMES),
        bones=[("hip", "knee"), ["knee", "ankle", "soft"]],
        joints={"knee_joint": ("hip", "knee", "ankle")},
        trunk=["hip"],
        measures={"feet": ["ankle"]},
    )
    assert skeleton.bones == (Bone(a="hip", b="knee"), Bone(a="knee", b="ankle", rigid=False))
    assert skeleton.joints == (Joint(name="knee_joint", parent="hip", centre="knee", child="ankle"),)
    write_skeleton(tmp_path / "leg.toml", skeleton)
    assert read_skeleton(tmp_path / "leg.toml") == skeleton
    found = mocap.from_arrays(xyz, names=NAMES, fps=FPS, unit="mm", skeleton=skeleton)
    assert found.skeleton is skeleton
    same(found, mocap.from_arrays(xyz, names=NAMES, fps=FPS, unit="mm", skeleton=tmp_path / "leg.toml"))
    with pytest.raises(mocap.MocapError, match="'hip', but the recording has pt1, pt2, pt3"):
        mocap.from_arrays(xyz, fps=FPS, skeleton=skeleton)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"markers": "abc"}, "markers is 'abc', expected a list of texts"),
        ({"markers": ["a", 1]}, "expected a list of texts"),
        ({"markers": ["a", "b"], "bones": ["ab"]}, r'a bone is \["a", "b"\]'),
        ({"markers": ["a", "b"], "bones": [("a", "c")]}, "uses marker 'c', which is not in its markers"),
        ({"markers": ["a", "b"], "joints": [("a", "b", "a")]}, 'expected {"elbow": '),
        ({"markers": ["a", "b"], "joints": {"j": ("a", "b")}}, r"joint 'j' is between two names"),
        ({"markers": ["a", "b"], "trunk": "a"}, "trunk is 'a', expected a list"),
        ({"markers": ["a"], "measures": {"tail": 1}}, "tail"),
        ({"markers": ["a", "b"], "joints": {"j": ("a", "b", "a")}}, "joint j has a marker twice: a, b, a"),
        ({"markers": ["a"], "bones": [("a", "a")]}, "bone a-a has a marker twice: a, a"),
    ],
)
def test_skeletons_say_what_they_expect(stated, said):
    """Each part that is given otherwise."""
    with pytest.raises(mocap.MocapError, match=said):
        mocap.Skeleton(**stated)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"xyz": np.zeros((5, 6))}, r"shape \(5, 6\), expected \(frames, markers, 3\): .*xyz.reshape\("),
        ({"xyz": np.zeros((5, 2))}, r"shape \(5, 2\), expected \(frames, markers, 3\)$"),
        ({"xyz": np.zeros((0, 2, 3))}, r"shape \(0, 2, 3\)"),
        ({"xyz": np.zeros((5, 3, 2))}, r"shape \(5, 3, 2\), expected"),
        ({"xyz": "walk.csv"}, "is a path .*mocap.read"),
        ({"xyz": [["a"]]}, "is list, expected"),
        ({"xyz": np.full((5, 3, 3), np.inf)}, "infinite"),
        ({"xyz": np.full((5, 3, 3), 1j)}, "is ndarray, expected"),
        ({"name": ["a", "b", "c"]}, r"`name` is \['a', 'b', 'c'\], expected a text"),
        ({"xyz": pd.DataFrame({"a_x": [1.0]})}, "columns a_x; expected NAME_x, _y, _z"),
        ({"names": ["a", "b"]}, "2 names for 3 markers"),
        ({"names": ["a", "b", "b"]}, "'b'.* rename"),
        ({"names": "abc"}, "expected a list of texts"),
        ({"unit": "furlong"}, "'furlong', which is not a known unit \\(mm, cm"),
        ({"fps": None}, "give `fps`"),
        ({"fps": "fast"}, "`fps` must be a number above 0, but is 'fast'"),
        ({"fps": -1}, "`fps` must be a number above 0"),
    ],
)
def test_arrays_say_what_they_expect(xyz, changed, said):
    """Shapes, names, rates and units that are none."""
    stated = {"xyz": xyz, "fps": FPS, "unit": "mm"} | changed
    with pytest.raises(mocap.MocapError, match=said):
        mocap.from_arrays(stated.pop("xyz"), **stated)


@pytest.mark.parametrize(
    ("uv", "cameras", "said"),
    [
        (np.zeros((2, 5, 3, 3)), np.ones((2, 11)), r"expected \(cameras, frames, markers, 2\)"),
        (np.zeros((2, 5, 3, 2)), np.ones((11, 2)), r"shape \(11, 2\), expected \(C, 11\) DLT coefficients"),
        (np.zeros((2, 5, 3, 2)), ["a", "b"], "`cameras` is list, expected"),
        (np.zeros((2, 5, 3, 2)), np.arange(33.0).reshape(3, 11), "2 cameras, but `cameras` has coefficients for 3"),
        (np.zeros((2, 5, 3, 2)), np.zeros((2, 11)), "describe no camera"),
    ],
)
def test_pixels_say_what_they_expect(uv, cameras, said):
    """Shapes of pixels and of cameras."""
    with pytest.raises(mocap.MocapError, match=said):
        mocap.from_pixels(uv, cameras, fps=FPS)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda _: mocap.track("f.csv"), r"mocap.track\(mocap.read\('f.csv', ...\)\)"),
        (lambda _: mocap.track(np.zeros((5, 3, 3))), r"mocap.track\(mocap.from_arrays\(...\)\)"),
        (lambda _: mocap.track(None), "takes a recording, not NoneType"),
        (lambda _: mocap.propose_skeleton("f.csv"), r"mocap.propose_skeleton\(mocap.read"),
        (lambda _: mocap.learn("f.csv"), "takes a list of recordings, not str"),
        (lambda _: mocap.learn(["f.csv"]), r"mocap.learn\(mocap.read\('f.csv'"),
        (lambda rec: mocap.learn(rec), "takes a list of recordings, not Recording"),
        (
            lambda rec: mocap.track(rec, model="ukf"),
            "`model` ukf: give auto, mixture, eal, .*constant_velocity, or",
        ),
        (lambda rec: mocap.track(rec, model=3), "`model` 3: give auto"),
        (lambda _: mocap.read(np.zeros((5, 3, 3)), fps=FPS), "`tracks` is ndarray, expected a file: mocap.from_arrays"),
        (lambda _: mocap.read("a.csv", calibration=np.ones((2, 11))), "`calibration` is ndarray, expected a file"),
        (
            lambda _: mocap.from_pixels(np.zeros((2, 5, 3, 2)), RIG, fps=FPS, origin="upper"),
            "`origin` is 'upper', expected upper-left or lower-left",
        ),
        (lambda rec: mocap.from_arrays(rec.points.xyz_m), "the frame rate is not stated: give `fps`"),
        (lambda rec: mocap.propose_skeleton(rec, names=["a"]), "1 names for 3 points"),
    ],
)
def test_verbs_say_what_they_take(xyz, call, said):
    """Paths, arrays and models that are none."""
    with pytest.raises(mocap.MocapError, match=said):
        call(mocap.from_arrays(xyz, names=NAMES, fps=FPS, unit="mm"))


def test_nothing_is_no_recording():
    """No file is told, not read as the folder that Python runs in."""
    with pytest.raises(mocap.MocapError, match=r"`tracks` is \[\], expected a file"):
        mocap.read([])


def test_one_marker_is_tracked_and_saved(tmp_path):
    """It has no bones, no pose and no phases: a figure of the animal is left out, all else is there."""
    walk = np.cumsum(np.random.default_rng(0).normal(0, 1e-3, (60, 1, 3)), axis=0) + 0.1
    mocap.track(mocap.from_arrays(walk, names=["tip"], fps=100, unit="m")).save(tmp_path / "out")
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.parametrize("kind", ["bool", "complex", "datetime64[s]", "timedelta64[s]"])
def test_what_numpy_turns_into_numbers_is_none(xyz, kind):
    """Truth values and dates became positions without a word; numbers of any size, or in a mask, are numbers."""
    with pytest.raises(FormatError, match=r"expected \(frames, markers, 3\) numbers"):
        mocap.from_arrays(np.nan_to_num(xyz).astype(kind), fps=FPS, unit="mm", names=NAMES)
    for dtype in (">f8", "f4", "i2", object):
        found = mocap.from_arrays(np.nan_to_num(xyz).astype(dtype), fps=FPS, unit="mm", names=NAMES)
        assert found.names == NAMES


@pytest.mark.parametrize("wrong", [{"seed": -1}, {"seed": 0.5}, {"seed": True}, {"seed": "1"}, {"validate": "no"}])
def test_a_seed_that_is_none_is_refused_before_the_work(xyz, wrong):
    """By its name, in ``mocap.track`` and for a batch; whole numbers of NumPy are seeds."""
    recording = mocap.from_arrays(xyz, fps=FPS, unit="mm", names=NAMES)
    (name,) = wrong
    for call in (lambda: mocap.track(recording, **wrong), lambda: Options(**wrong)):
        with pytest.raises(mocap.MocapError, match=f"`{name}` (must be|is)"):
            call()
    assert Options(seed=np.int64(3), validate=np.True_).seed == 3
