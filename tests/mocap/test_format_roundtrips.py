"""What is written comes back: names of any kind, one marker, one frame, all missing, exactly zero, 66,000 frames."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap.cameras.camera import Camera, dlt_camera, pinhole_camera, project, stacked
from mocap.cameras.lens import BrownLens, FisheyeLens, RationalLens
from mocap.errors import FormatError
from mocap.io.c3d import _MOST_FRAMES as MOST_FRAMES
from mocap.io.contents import FILLED
from mocap.io.registry import formats, identify, read, write
from mocap.records import Status
from tests.mocap.recordings import pixel_recordings, point_recordings, points

NANOMETRE, MICROMETRE = 1e-9, 1e-6
FILES = {
    "csv-wide": ("a.csv", 0.0),  # shortest digits that come back to the last bit
    "csv-long": ("a_long.csv", 0.0),
    "parquet": ("a.parquet", 0.0),
    "movement": ("a.nc", 1e-14),  # a product with 1 m
    "trc": ("a.trc", 0.5 * NANOMETRE + 1e-14),  # nine decimals of a metre, half of the last one
    "c3d": ("a.c3d", 50 * 2**-24 + 1e-12),  # 24 bits of at most 50 m
}
"""Of each writer of points: a file's name, and how far a coordinate may come back from where it was."""
KEEPS_ORIGIN = {"csv-wide", "csv-long", "parquet", "movement", "c3d"}


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("roundtrip")


def test_each_writer_is_tested_here():
    """A writer that this file does not know would be untested."""
    elsewhere = {"deeplabcut-csv", "deeplabcut-h5", "sleap-analysis", "sleap-anipose-3d"}  # test_keypoint_exports.py
    elsewhere |= {"nwb"}  # test_nwb.py
    written = {format.name for format in formats() if format.write is not None}
    assert written == {*FILES, "dltdv", "anipose-calibration", *elsewhere}


@pytest.mark.parametrize("name", FILES)
def test_a_word_that_means_missing_can_be_a_name(tmp_path, name):
    """A cell of numbers may say NaN; a marker may be called so."""
    names = ["NaN", "nan", "NA", "null", "None"]
    path = tmp_path / FILES[name][0]
    write(points(names, np.ones((2, 5, 3))), path, name)
    assert read(path).names == tuple(names)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("least", [0.0, 1e-87, 4e-10, -4e-10])
def test_a_place_that_is_rounded_to_zero_is_no_gap(tmp_path, name, least):
    """Zero means missing in some formats, and less than half of what they can say is zero there."""
    xyz = np.array([[[0.0, 0.0, least], [1.0, 2.0, 3.0]], [[np.nan] * 3, [1.0, 2.0, 3.0]]])
    path = tmp_path / FILES[name][0]
    write(points(["a", "b"], xyz), path, name)
    found = read(path).points.xyz_m
    np.testing.assert_allclose(found, xyz, rtol=0, atol=FILES[name][1] + NANOMETRE)


@pytest.mark.parametrize("name", FILES)
@given(data=st.data())
@settings(max_examples=10)
def test_points_come_back(scratch, name, data):
    """Names, frame numbers, rate, positions to the stated digits, gaps as gaps, and the origin where it can be said."""
    recording = data.draw(point_recordings())
    path = scratch / FILES[name][0]
    write(recording, path, name)
    assert identify(path).name == name
    back = read(path)
    assert back.names == recording.names
    assert back.unit == "m"
    np.testing.assert_array_equal(back.frames, recording.frames)
    if len(recording.frames) > 1 or name in ("trc", "c3d", "movement", "parquet"):  # one time tells no rate
        assert back.fps == 250.0
        np.testing.assert_allclose(back.points.t_s, recording.points.t_s, rtol=0, atol=1e-9)
    expected = recording.points.xyz_m
    if name not in KEEPS_ORIGIN:
        expected = np.where(np.isin(recording.points.status, FILLED)[..., None], np.nan, expected)
    moved = NANOMETRE if name in ("trc", "c3d") else 0.0  # a point at (0, 0, 0) is set beside it
    np.testing.assert_allclose(back.points.xyz_m, expected, rtol=0, atol=FILES[name][1] + moved)
    if name == "c3d":  # its residuals know: not seen, filled, measured
        kinds = np.where(np.isin(recording.points.status, FILLED), Status.INTERPOLATED, recording.points.status)
        if (kinds == Status.MEASURED).any():  # without any, a file records no residuals
            np.testing.assert_array_equal(back.points.status, kinds)
    elif name in KEEPS_ORIGIN:
        np.testing.assert_array_equal(back.points.status, recording.points.status)


@pytest.mark.parametrize("name", ["csv-long", "parquet", "movement"])
@given(recording=pixel_recordings())
@settings(max_examples=10)
def test_pixels_come_back(scratch, name, recording):
    """Every camera's pixels to the last bit, with their scores."""
    path = scratch / FILES[name][0]
    write(recording, path, name)
    back = read(path)
    assert back.names == recording.names
    assert back.camera_names == recording.camera_names
    np.testing.assert_array_equal(back.pixels.uv_px, recording.pixels.uv_px)
    if recording.score is None:
        assert back.score is None
    else:
        np.testing.assert_array_equal(back.score, recording.score)


@given(recording=point_recordings())
@settings(max_examples=10)
def test_points_come_back_from_a_workbook(scratch, recording):
    """The same table as a sheet of Excel: values to its 16 digits, gaps, origins and frame numbers."""
    pytest.importorskip("openpyxl")
    write(recording, scratch / "a.xlsx")
    back = read(scratch / "a.xlsx")
    assert back.names == recording.names
    np.testing.assert_array_equal(back.frames, recording.frames)
    np.testing.assert_allclose(back.points.xyz_m, recording.points.xyz_m, rtol=1e-15, atol=0)
    np.testing.assert_array_equal(back.points.status, recording.points.status)


@given(pixels=pixel_recordings())
@settings(max_examples=10)
def test_a_dltdv_set_comes_back(scratch, pixels):
    """All four files that DLTdv opens, to half of the sixth decimal; a coordinate of 0 is set a micrometre beside."""
    xyz = np.linspace(-1, 1, 3 * pixels.pixels.seen[0].size).reshape(*pixels.pixels.seen[0].shape, 3)
    xyz[0, 0] = 0.0
    tracks = points(list(pixels.names), xyz).points
    px = {"residual_px": np.full(xyz.shape[:2], 0.5)}
    recording = replace(pixels, points=replace(tracks, t_s=pixels.pixels.t_s), unit="m", tables=px)
    write(recording, scratch / "bat_xypts.csv")
    ends = ("xypts", "xyzpts", "xyzres", "offsets")
    two, three, residuals, offsets = (read(scratch / f"bat_{end}.csv") for end in ends)
    assert two.names == three.names == residuals.names == pixels.names
    np.testing.assert_allclose(two.pixels.uv_px, pixels.pixels.uv_px, rtol=0, atol=MICROMETRE + 1e-12)
    np.testing.assert_allclose(three.points.xyz_m, xyz, rtol=0, atol=MICROMETRE + 1e-12)
    assert (np.abs(three.points.xyz_m) >= MICROMETRE).all()
    assert len(offsets.frames) == len(residuals.frames) == len(pixels.frames)
    assert len(offsets.camera_names) == len(pixels.camera_names)


LENSES = (
    BrownLens(f_px=(1500.0, 1510.0), centre_px=(640.0, 512.0), k=(-0.3, 0.1, 0.02), p=(1e-3, -2e-3)),
    RationalLens(f_px=(900.0, 905.0), centre_px=(640.0, 512.0), k=(0.1, -0.05, 0.01, 0.02, 0.03, -0.01), p=(0.0, 1e-3)),
    FisheyeLens(f_px=(400.0, 401.0), centre_px=(640.0, 512.0), k=(0.01, -0.02, 0.003, 0.0)),
    None,
)


def test_a_calibration_comes_back(tmp_path):
    """Cameras written as calibration.toml see every point and bend every pixel as before.

    17 digits and a rotation vector for a matrix: pixels of some 1000 to a few units of the last place of the product.
    """
    rng = np.random.default_rng(3)
    cameras = []
    for number, lens in enumerate(LENSES):
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        rotation *= np.sign(np.linalg.det(rotation))
        intrinsic = lens.intrinsic if lens is not None else np.array([[800.0, 0, 640], [0, 800, 512], [0, 0, 1]])
        shift = rng.normal(size=3) + np.array([0.0, 0.0, 5.0])
        name = f'camera "{number}"'
        cameras.append(
            pinhole_camera(name, intrinsic=intrinsic, rotation=rotation, translation_m=shift, lens=lens, size_px=(9, 8))
        )
    path = tmp_path / "calibration.toml"
    recording = replace(points(["a"], np.zeros((1, 1, 3))), points=None, names=(), frames=np.zeros(0))
    recording = replace(recording, cameras=tuple(cameras), camera_names=tuple(c.name for c in cameras))
    write(recording, path)
    back = read(path)
    assert back.camera_names == recording.camera_names
    where = rng.normal(size=(50, 3)) * 0.3
    seen = project(stacked(cameras), where)
    np.testing.assert_allclose(project(stacked(back.cameras), where), seen, rtol=1e-11, atol=1e-8)
    for old, new, uv in zip(cameras, back.cameras, seen, strict=True):
        assert (new.lens is None) == (old.lens is None)
        if old.lens is not None:
            assert type(new.lens) is type(old.lens)
            np.testing.assert_allclose(new.lens.distort(uv), old.lens.distort(uv), rtol=1e-11, atol=1e-8)


def test_more_frames_than_a_c3d_counts_come_back(tmp_path):
    """66,000 frames of two markers: in Parquet they come back; C3D counts to 65535 and says so."""
    t = np.arange(66_000) / 250
    xyz = np.stack([np.sin(t), np.cos(t), 0.01 * t], axis=-1)[:, None] + np.array([[[0, 0, 0], [0.1, 0.2, 0.3]]])
    recording = points(["hip joint", "knee, left"], xyz)
    for name in ("parquet", "c3d"):
        file, tolerance = FILES[name]
        if name == "c3d":
            with pytest.raises(
                FormatError, match="66000 frames, but a C3D file can contain 65535: split the recording"
            ):
                write(recording, tmp_path / file, name)
            short = slice(0, MOST_FRAMES)
            recording = points(list(recording.names), xyz[short])
        write(recording, tmp_path / file, name)
        back = read(tmp_path / file)
        assert back.names == recording.names
        assert back.fps == 250.0
        np.testing.assert_allclose(back.points.xyz_m, recording.points.xyz_m, rtol=0, atol=tolerance)


def test_what_is_lost_is_listed(tmp_path):
    """A conversion names each part that the format cannot hold; filled samples are gaps unless asked for."""
    xyz = np.ones((4, 1, 3))
    origin = np.array([[Status.MEASURED], [Status.SMOOTHED], [Status.MEASURED], [Status.MEASURED]])
    recording = replace(points(["a"], xyz, origin=origin, first=30), score=np.full((4, 1), 0.5))
    losses = write(recording, tmp_path / "a.trc")
    assert any("scores" in text for text in losses)
    assert any("1 filled sample is left as a gap; `filled` writes it" in text for text in losses)
    np.testing.assert_array_equal(read(tmp_path / "a.trc").points.seen[:, 0], [True, False, True, True])
    losses = write(recording, tmp_path / "a.trc", filled=True)
    assert any("written like measured" in text for text in losses)
    assert read(tmp_path / "a.trc").points.seen.all()
    assert any("the number of the first frame, 30" in text for text in write(recording, tmp_path / "a_xyzpts.csv"))
    assert not any("scores" in text for text in write(recording, tmp_path / "a.parquet"))


def test_what_a_format_cannot_hold_at_all_is_refused(tmp_path):
    """Pixels are no C3D, positions no calibration; a rate or unit that nobody stated is asked for; nothing is left."""
    recording = points(["a"], np.ones((2, 1, 3)))
    camera = dlt_camera("cam1", np.arange(11.0))
    pixels = replace(recording, points=None, cameras=(camera,), camera_names=("cam1",))
    cases = [
        (recording, "a.toml", "cannot store what made.csv contains"),
        (pixels, "a.c3d", "cannot store what made.csv contains"),
        (replace(recording, fps=None), "a.trc", "needs the frame rate .give `fps`."),
        (replace(recording, unit=None), "a.c3d", "needs the unit of lengths .give `unit`."),
        (recording, "a.xyz", "no format is written to files with this ending"),
        (points(["a\tb"], np.ones((2, 1, 3))), "a.trc", "contains a tab"),
        (points(["x" * 121], np.ones((2, 1, 3))), "a.c3d", "longer than 120 bytes"),
    ]
    for held, file, message in cases:
        with pytest.raises(FormatError, match=message):
            write(held, tmp_path / file)
    mirror = Camera(name="cam1", matrix=np.array([[800.0, 0, 0, 1], [0, -800, 0, 1], [0, 0, 1, 5]]), size_px=(9, 9))
    with pytest.raises(FormatError, match="has a mirrored"):
        write(replace(pixels, cameras=(mirror,)), tmp_path / "a.toml")
    assert list(tmp_path.iterdir()) == []
