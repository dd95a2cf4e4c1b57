"""Dots to a fraction of a pixel, their look from clicks, and lenses by a table."""

import struct

import cv2
import numpy as np
import pytest
from mocap.datasets.rig import tunnel_cameras
from scipy.spatial.distance import cdist

from mocap.digitising.dots import DotLook, Strength, dot_at, find_dots, look_of, strength_of
from mocap.digitising.straight import straightening_of
from mocap.digitising.videos import grey_levels
from mocap.io.movies import listed, open_movie, pyav
from tests.mocap.digitising.filmed import drawn


@pytest.fixture(scope="module")
def picture():
    """A picture with 40 dots that are not near each other, and their places."""
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(np.arange(30, 300, 35), np.arange(25, 225, 40)), axis=-1).reshape(-1, 2)
    at = grid + rng.uniform(-5, 5, grid.shape)
    return drawn(at, rng, 2.0), at - 1


def test_look_is_that_of_the_dots(picture):
    """Radius of 2.5 px within the steps of the scales, bright; of the negative picture dark."""
    grey, at = picture
    look = look_of([grey], [at + 0.7])
    assert look is not None
    assert look.bright
    assert 1.5 <= look.radius_px <= 3.0
    negative = look_of([255 - grey], [at])
    assert negative is not None
    assert not negative.bright
    assert look_of([np.full_like(grey, 90)], [at]) is None


def test_strengths_are_a_log_normal():
    """Median and lower deviation of 4000 log-normal responses to 5 %, and squared deviations below the median alone.

    The 16th percentile of 4000 has the standard deviation sqrt(0.16 x 0.84 / 4000) / 0.243 = 0.024 deviations.
    """
    rng = np.random.default_rng(0)
    found = np.stack([30 * np.exp(0.3 * rng.standard_normal(4000)), np.full(4000, np.nan)])
    before = Strength(log_median=np.log([50.0, 50.0]), log_sd=np.array([0.2, 0.2]))
    got = strength_of(found, before)
    np.testing.assert_allclose(got.log_median, np.log([30.0, 50.0]), atol=0.02)
    np.testing.assert_allclose(got.log_sd, [0.3, 0.2], rtol=0.05)
    costs = before.faintness(np.array([[50 * np.exp(-0.4), 80.0, np.nan], [50.0, 50 * np.exp(-0.6), 0.0]]))
    np.testing.assert_allclose(costs[:, :2], [[4.0, 0.0], [0.0, 9.0]], atol=1e-9)
    assert costs[0, 2] == 0
    assert costs[1, 2] > 100


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_dots_are_where_they_were_drawn(picture, dtype):
    """All of them, none twice, without bias, to a twentieth of a pixel: noise of 2 on contrast of 180."""
    grey, at = picture
    grey = grey.astype(dtype) * (256 if dtype == np.uint16 else 1)
    look = look_of([grey], [at])
    found = find_dots(grey, look)
    away = cdist(found[:, :2], at)
    assert len(found) == len(at)
    error = (found[away.argmin(axis=0), :2] - at).ravel()
    assert np.abs(error.mean()) < 0.02
    assert error.std() < 0.06


def test_a_window_is_a_part_of_the_picture(picture):
    """Dots well inside of a window are those of the whole picture there."""
    grey, _ = picture
    look = DotLook(radius_px=2.5, bright=True, least=15.0)
    whole = find_dots(grey, look)
    part = find_dots(grey[40:200, 60:250], look, corner=(60, 40))
    inside = part[(part[:, 0] > 75) & (part[:, 0] < 235) & (part[:, 1] > 55) & (part[:, 1] < 185)]
    assert len(inside) > 10
    assert cdist(inside[:, :2], whole[:, :2]).min(axis=1).max() < 0.01


def test_the_table_is_the_lens():
    """Bilinear in steps of 4 px: 0.0055 px of the lens's own inverse at most, as the square of steps: 0.003 of 3 px."""
    camera = tunnel_cameras(2)[0]
    rng = np.random.default_rng(0)
    uv = rng.uniform(0, camera.size_px, (500, 2))
    table = straightening_of(camera, camera.size_px)
    assert 0.0042 < np.abs(table(uv) - camera.lens.undistort(uv)).max() < 0.007


@pytest.mark.parametrize("kind", ["gray", "yuv420p", "yuvj420p", "rgb24", "bgr24", "gray16le", "gray12le"])
def test_grey_levels_of_every_film(kind):
    """8 bits stay as they are, more become 16; colours by their luminance (within rounding of the conversion)."""
    ramp = np.tile(np.arange(16, 232, 3, dtype=np.uint8), (36, 1))
    library = pyav()
    deep = "1" in kind
    source = ramp.astype(np.uint16) * 257 if deep else ramp
    frame = library.VideoFrame.from_ndarray(source, format="gray16le" if deep else "gray").reformat(format=kind)
    got = grey_levels(frame).astype(float)
    assert got.shape == ramp.shape
    # limited range (16 to 235) squeezes by 219/255; what counts is that grey levels are linear
    slope, offset = np.polyfit(ramp.ravel(), got.ravel(), 1)
    scale = 256 if deep else 1
    assert 0.8 * scale < slope < 1.2 * scale
    assert np.abs(got - slope * ramp - offset).max() < 2 * scale


def cine(path, pictures):
    """Write a cine of 8 bits as Vision Research's Cine File Format describes it: the rows from the bottom up."""
    height, width = pictures[0].shape
    n, size, setup = len(pictures), height * width, 0x2000
    table = 44 + 40 + setup
    parts = [struct.pack("<2sHHHiIiIIIIQ", b"CI", 44, 0, 1, 0, n, 0, n, 44, 84, table, 0)]
    parts.append(struct.pack("<IiiHHIIiiII", 40, width, height, 1, 8, 0, size, 0, 0, 0, 0))
    settings = bytearray(setup)
    struct.pack_into("<2sH", settings, 140, b"ST", setup)
    struct.pack_into("<I", settings, 768, 1000)
    struct.pack_into("<I", settings, 896, 8)
    parts.append(bytes(settings))
    parts += [struct.pack("<q", table + 8 * n + k * (size + 8)) for k in range(n)]
    parts += [struct.pack("<II", 8, size) + picture[::-1].tobytes() for picture in pictures]
    path.write_bytes(b"".join(parts))


def test_cine_is_read(tmp_path):
    """Grey levels and order as they were written, the upper row first."""
    rng = np.random.default_rng(0)
    pictures = rng.integers(0, 255, (4, 24, 32), dtype=np.uint8)
    cine(tmp_path / "a.cine", pictures)
    movie = open_movie(tmp_path / "a.cine")
    assert movie.size_px == (32, 24)
    got = [grey_levels(frame) for frame in movie.frames(np.arange(4), threads=False)]
    np.testing.assert_array_equal(got, pictures)


@pytest.mark.parametrize(
    ("name", "codec", "kind"),
    [("a.avi", "mjpeg", "yuvj420p"), ("b.mp4", "libx264", "yuv420p"), ("c.mkv", "ffv1", "gray16le")],
)
def test_films_as_cameras_write_them(tmp_path, name, codec, kind):
    """A ramp that moves comes back in its order, linear within 2 levels of 255 on average (codecs round)."""
    ramp = np.tile(np.linspace(20, 200, 160), (48, 1))
    deep, library = "16" in kind, pyav()
    with library.open(str(tmp_path / name), "w") as container:
        stream = container.add_stream(codec, rate=100)
        stream.width, stream.height, stream.pix_fmt = 160, 48, kind
        for k in range(6):
            picture = ((ramp + 5 * k) * (257 if deep else 1)).astype(np.uint16 if deep else np.uint8)
            frame = library.VideoFrame.from_ndarray(picture, format="gray16le" if deep else "gray")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    movie = open_movie(tmp_path / name)
    got = [grey_levels(frame).astype(float) for frame in movie.frames(np.arange(6), threads=False)]
    assert len(got) == movie.n_frames == 6
    for k, grey in enumerate(got):
        grey = grey / (257 if deep else 1)
        slope, offset = np.polyfit((ramp + 5 * k).ravel(), grey.ravel(), 1)
        assert 0.8 < slope < 1.2
        assert np.abs(grey - slope * (ramp + 5 * k) - offset).mean() < 2
    means = [grey.mean() for grey in got]
    assert (np.diff(means) > 0).all()


def test_response_is_cv2_blurs():
    """Of a single bright pixel it is the difference of two normalised Gaussians, whatever OpenCV's border does."""
    grey = np.zeros((41, 41), dtype=np.uint8)
    grey[20, 20] = 200
    look = DotLook(radius_px=2.0, bright=True, least=1.0)
    found = find_dots(grey, look)
    assert cv2.countNonZero(grey) == 1
    np.testing.assert_allclose(found[0, :2], [20, 20], atol=1e-6)


@pytest.mark.parametrize("off", [(0.0, 0.0), (1.4, -1.4), (-2.0, 0.0)])
def test_a_click_means_the_dot_beside_it(off):
    """Of a dark or a bright dot, within its own accuracy; of noise alone, or 8 px away, none."""
    rng = np.random.default_rng(1)
    truth = np.array([[153.3, 92.2]])  # the centre of the first pixel is at (1, 1)
    bright = drawn(truth, rng, 2.0)
    for picture in (bright, 255 - bright):
        found = dot_at(picture, truth[0] - 1 + off)
        assert found is not None
        assert np.linalg.norm(found + 1 - truth[0]) < 0.2
        assert dot_at(picture, truth[0] - 1 + (8, 0)) is None
    assert all(dot_at(drawn((), rng, 2.0), truth[0] - 1) is None for _ in range(50))


def test_videos_are_found_among_other_files(tmp_path):
    """Sorted by their numbers, with a calibration, a table and a folder of results beside them."""
    for name in ("cam10.mp4", "cam2.mp4", "dltCoefs.csv", "skeleton.toml", "out/report.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert [path.name for path in listed([tmp_path])] == ["cam2.mp4", "cam10.mp4"]
    for camera in ("b", "a"):
        (tmp_path / "images" / camera).mkdir(parents=True)
        (tmp_path / "images" / camera / "1.png").touch()
    (tmp_path / "images" / "out").mkdir()
    assert [path.name for path in listed([tmp_path / "images"])] == ["a", "b"]
    assert listed([tmp_path / "images" / "a"]) == [tmp_path / "images" / "a"]
