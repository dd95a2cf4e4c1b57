"""Where pixel rows are counted from, told by the rays; and stored points that do not follow from their pixels."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from mocap.datasets import make_bat, write_recording

from mocap.audit import stale_points
from mocap.cameras import origin
from mocap.cameras.camera import dlt_coefficients, flipped, may_be_cropped, picture_size, record
from mocap.cameras.origin import OriginError, PixelOptions, decide_origin
from mocap.cameras.triangulate import linear
from mocap.cleaning.cleaning import clean
from mocap.errors import CalibrationError
from mocap.io.profile import write_profile
from mocap.reading.decided import Decided
from mocap.reading.reading import of_session, read
from mocap.records import MarkerTracks, Status
from tests.mocap.rigs import cloud, ring
from tests.mocap.test_audit import moving

HEIGHT = 1024.0


def filmed(lens, seed=1, noise=0.5):
    """A rig and its pixels from the upper left, with noise."""
    rng = np.random.default_rng(seed)
    cameras, points = ring(4, lens=lens), cloud(rng, 60).reshape(20, 3, 3)
    uv = record(cameras, points)
    return cameras, points, uv + rng.normal(0, noise, uv.shape)


@pytest.mark.parametrize("pixels", ["upper-left", "lower-left"])
def test_a_flipped_file_is_told(pixels):
    """Rows counted from the other corner than the coefficients: found by the residual, points as if never flipped.

    Without a lens only the difference of the two matters: equal corners give the same points, and are not told apart.
    """
    cameras, points, uv = filmed(False)
    if pixels == "lower-left":
        uv = flipped(uv, HEIGHT)
    found = decide_origin(cameras, uv, PixelOptions(image_height_px=HEIGHT))
    assert (found.pixels == found.coefficients) == (pixels == "upper-left")
    assert found.residual_px < 1.0
    assert found.next_px > 3 * found.residual_px
    ideal = found.ideal(cameras, uv)
    matrices = np.stack([c.matrix for c in cameras])
    assert np.abs(linear(matrices, ideal) - points).max() < 5e-3  # 0.5 px at 600 px a metre, 5 deviations


def test_a_lens_that_looks_the_same_upside_down_is_not_guessed():
    """A lens in the middle of the picture fits both ways up, with other points: the user is asked, then believed."""
    cameras, _, uv = filmed(True)
    with pytest.raises(CalibrationError, match=r"the pixel origin cannot be determined: .* state `origin`"):
        decide_origin(cameras, uv, PixelOptions(image_height_px=HEIGHT))
    stated = decide_origin(cameras, uv, PixelOptions(origin="upper-left", image_height_px=HEIGHT))
    assert (stated.pixels, stated.stated) == ("upper-left", True)


def test_flipping_twice_is_nothing():
    """The flip v -> H - v is its own inverse, and leaves u; without a height it is refused."""
    uv = np.random.default_rng(2).uniform(0, 1000, (2, 3, 2))
    np.testing.assert_allclose(flipped(flipped(uv, HEIGHT), HEIGHT), uv, atol=1e-12)
    np.testing.assert_array_equal(flipped(uv, HEIGHT)[..., 0], uv[..., 0])
    with pytest.raises(CalibrationError, match="give `image_height_px`"):
        flipped(uv, None)


def test_coefficients_of_another_rig_are_told():
    """Rays that miss by hundreds of pixels in every convention belong to other cameras: an error that says so."""
    cameras, _, uv = filmed(False)
    turned = np.array([[1, -0.6, 0], [0.6, 1, 0], [0, 0, 1]])
    other = (uv - [640, 512]) @ turned[:2, :2] + np.array([[300, 40], [-200, 90], [90, -300], [-100, -80]])[
        :, None, None
    ]
    with pytest.raises(CalibrationError, match="belong to these pixels"):
        decide_origin(cameras, other, PixelOptions(image_height_px=HEIGHT))


def test_a_stated_origin_is_checked():
    """The wrong statement about a flipped file is refused, the right one taken."""
    cameras, _, uv = filmed(True)
    turned = flipped(uv, HEIGHT)
    stated = PixelOptions(origin="lower-left", calibration_origin="upper-left", image_height_px=HEIGHT)
    right = decide_origin(cameras, turned, stated)
    assert (right.pixels, right.coefficients, right.stated) == ("lower-left", "upper-left", True)
    with pytest.raises(CalibrationError):
        decide_origin(cameras, turned, replace(stated, origin="upper-left"))


def test_stale_points_are_listed():
    """Stored points off by more than the tolerance, or without two rays, are listed by frame (from 1) and marker."""
    xyz = np.random.default_rng(3).normal(size=(5, 2, 3))
    stored = xyz.copy()
    stored[2, 1, 0] += 3e-3
    stored[3, 0] += 0.5e-6
    xyz[4, 0] = np.nan
    stored[0, 0] = np.nan
    tracks = MarkerTracks(
        names=("a", "b"),
        t_s=np.arange(5.0),
        xyz_m=stored,
        cov_m2=np.full((5, 2, 3, 3), np.nan),
        status=np.full((5, 2), Status.MEASURED),
    )
    found = stale_points(xyz, tracks)
    assert [(p.frame, p.marker) for p in found] == [(3, "b"), (5, "a")]
    assert found[0].off_m == pytest.approx(3e-3)
    assert found[1].off_m is None
    with pytest.raises(ValueError, match="do not belong together"):
        stale_points(xyz[:4], tracks)


def test_programs_own_corner_is_a_prior():
    """A lens that fits both ways up: the corner of the program that wrote the file decides; a clear misfit does not."""
    cameras, _, uv = filmed(True)
    found = decide_origin(cameras, uv, PixelOptions(image_height_px=HEIGHT, usual="upper-left"))
    assert (found.pixels, found.coefficients, found.guessed) == ("upper-left", "upper-left", False)
    cameras, _, uv = filmed(False)
    found = decide_origin(cameras, flipped(uv, HEIGHT), PixelOptions(image_height_px=HEIGHT, usual="upper-left"))
    assert (found.pixels != found.coefficients, found.guessed) == (True, True)


def test_files_of_one_session_decide_together(tmp_path):
    """A trial that cannot tell takes the corner of one that can; alone it is refused, by its name."""
    cameras, _, _ = filmed(True)
    low = [
        replace(c, lens=replace(c.lens, centre_px=(640.0, y)))
        for c, y in zip(cameras, (380.0, 600, 420, 630), strict=True)
    ]
    made = []
    for name, rig, seed in (("clear", low, 1), ("doubtful", cameras, 2)):
        rng = np.random.default_rng(seed)
        uv = record(rig, moving(np.arange(60)) * 3)
        table = (uv + rng.normal(0, 0.3, uv.shape)).transpose(1, 2, 0, 3).reshape(60, -1)
        head = ",".join(f"pt{m + 1}_cam{c + 1}_{x}" for m in range(5) for c in range(4) for x in "XY")
        np.savetxt(tmp_path / f"{name}_xypts.csv", table, "%.6f", ",", header=head, comments="")
        np.savetxt(tmp_path / f"{name}.csv", np.stack([dlt_coefficients(c) for c in rig], axis=1), "%.12g", ",")
        write_profile(tmp_path / f"{name}.txt", rig)
        how = {"calibration": tmp_path / f"{name}.csv", "profile": tmp_path / f"{name}.txt"}
        made.append(partial(read, tmp_path / f"{name}_xypts.csv", fps=200, **how))
    with pytest.raises(OriginError, match=r"^doubtful_xypts\.csv: the pixel origin cannot be determined"):
        list(of_session(made[1:]))
    for order in (made, made[::-1]):
        clear, doubtful = of_session(order)
        assert (clear.name, doubtful.name) == ("clear", "doubtful")
        assert doubtful[Decided].rows.pixels == clear[Decided].rows.pixels == "upper-left"
        assert (
            str(doubtful[Decided].of_pixels[0]) == "pixel origin upper-left, as in the other recordings of this session"
        )


def test_our_own_recordings_carry_their_corner(tmp_path):
    """A bat whose pixels fit both ways up: refused without its card, read from the upper left with it."""
    files = write_recording(make_bat(seed=0, n_frames=60, manoeuvre="turn"), tmp_path)
    stated = {"fps": 240, "calibration": files["coefficients"], "profile": files["profile"]}
    assert read(files["pixels"], **stated)[Decided].rows.pixels == "upper-left"
    files["card"].unlink()
    with pytest.raises(OriginError, match="the pixel origin cannot be determined"):
        read(files["pixels"], **stated)


def test_reading_decides_and_cleaning_does_not(tmp_path, monkeypatch):
    """Corner, ideal pixels and the sentence of it are there after ``read``; cleaning and tracking ask nothing again."""
    files = write_recording(make_bat(seed=0, n_frames=60), tmp_path)
    stated = {"fps": 240, "calibration": files["coefficients"], "profile": files["profile"]}
    recording = read(files["pixels"], **stated)
    assert recording[Decided].rows.pixels == "upper-left"
    assert recording.values("ideal").shape == recording.values("pixels").shape
    assert "pixel origin upper-left" in repr(recording)
    monkeypatch.setattr("mocap.reading.ideal_pixels.decide_origin", lambda *_: pytest.fail("decided again"))
    assert clean(recording)[Decided].rows == recording[Decided].rows


def test_a_calibration_that_does_not_fit_is_refused_by_read(tmp_path):
    """The calibration of another session: the error comes where it was named."""
    files = write_recording(make_bat(seed=0, n_frames=60), tmp_path / "a")
    other = write_recording(make_bat(seed=5, n_frames=60, n_cameras=4), tmp_path / "b")
    table = np.loadtxt(other["coefficients"], delimiter=",")[:, ::-1]
    np.savetxt(tmp_path / "other.csv", table, delimiter=",")
    with pytest.raises(CalibrationError):
        read(files["pixels"], fps=240, calibration=tmp_path / "other.csv")


@pytest.mark.parametrize(
    ("ratio", "corners"), [(1.45, ("upper-left", "upper-left")), (1.55, ("upper-left", "lower-left"))]
)
def test_one_corner_is_taken_unless_two_fit_one_and_a_half_times_as_well(monkeypatch, ratio, corners):
    """Residuals of the four choices as they are tried: one corner, then two of a kind that fit better, then one."""
    cameras, _, uv = filmed(False)
    misses = iter([ratio, 1.0, 1.0, ratio])
    monkeypatch.setattr(origin, "median_miss", lambda *_: next(misses))
    monkeypatch.setattr(origin, "find_arrangement", lambda *_, **__: None)
    found = decide_origin(cameras, uv, PixelOptions(image_height_px=HEIGHT))
    assert (found.pixels, found.coefficients) == corners


@pytest.mark.parametrize(
    ("span_px", "miss_px", "fits"),
    [(1000.0, 29.0, True), (1000.0, 31.0, False), (100.0, 9.5, True), (100.0, 10.5, False)],
)
def test_pixels_belong_to_a_calibration_that_they_fit_to_three_percent_and_ten_pixels(
    monkeypatch, span_px, miss_px, fits
):
    """Of what the points span; corners are stated, so that nothing else is tried."""
    cameras, _, uv = filmed(False)
    uv = uv * span_px / np.nanmax(uv)
    monkeypatch.setattr(origin, "median_miss", lambda *_: miss_px)
    monkeypatch.setattr(origin, "find_arrangement", lambda *_, **__: None)
    stated = PixelOptions(origin="upper-left", calibration_origin="upper-left")
    if fits:
        assert decide_origin(cameras, uv, stated).residual_px == miss_px
    else:
        with pytest.raises(CalibrationError, match="median triangulation residual"):
            decide_origin(cameras, uv, stated)


@pytest.mark.parametrize(("ratio", "clear"), [(1.15, False), (1.25, True)])
def test_a_corner_is_clear_where_the_other_fits_a_fifth_worse(monkeypatch, ratio, clear):
    """Of a lens, with which the two corners give different points; two corners in one file do not fit at all."""
    cameras, _, uv = filmed(True)
    misses = iter([1.0, 9.0, 9.0, ratio])
    monkeypatch.setattr(origin, "median_miss", lambda *_: next(misses))
    monkeypatch.setattr(origin, "find_arrangement", lambda *_, **__: None)
    if clear:
        assert decide_origin(cameras, uv, PixelOptions(image_height_px=HEIGHT)).pixels == "upper-left"
    else:
        with pytest.raises(OriginError, match="cannot be determined"):
            decide_origin(cameras, uv, PixelOptions(image_height_px=HEIGHT))


@pytest.mark.parametrize(("share", "cropped"), [(0.73, True), (0.77, False)])
def test_pixels_within_three_quarters_of_the_image_may_be_of_a_window(share, cropped):
    """In both directions and all cameras."""
    cameras = filmed(True)[0]
    size = np.min([picture_size(camera) for camera in cameras], axis=0)
    uv = np.stack([np.zeros(2), share * size])[None].repeat(len(cameras), axis=0)
    assert (may_be_cropped(cameras, uv) is not None) == cropped
