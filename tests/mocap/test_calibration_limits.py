"""Each threshold of calibration, with a case just below and one just above it."""

from types import SimpleNamespace

import numpy as np
import pytest

from mocap.calibration import intrinsics, lens_of_tracks, refine, wand
from mocap.calibration.chain import first_stands
from mocap.calibration.dlt import fit_dlt
from mocap.calibration.places import place_camera
from mocap.calibration.scene import distinct
from mocap.cameras.camera import KnownLens, record
from mocap.cameras.lens import BrownLens
from mocap.errors import CalibrationError
from tests.mocap.board_scenes import SIZE, rig
from tests.mocap.rigs import cloud, ring
from tests.mocap.test_calibrate_wand import no_background, waved


class Reached(Exception):
    """What is asked of data is fulfilled, and they are solved."""


def reached(*_args, **_options):
    raise Reached


def asks(enough, words):
    """What a call does that has enough, or asks for more."""
    return pytest.raises(Reached) if enough else pytest.raises(CalibrationError, match=words)


@pytest.mark.parametrize(("apart", "places"), [(0.85e-3, 2), (1.15e-3, 3)])
def test_places_are_apart_by_a_thousandth_of_the_extent(apart, places):
    """Of three points on a line of unit length."""
    assert distinct(np.array([[0.0], [apart], [1.0]])).max() + 1 == places


def waves(monkeypatch, instants, apart_px=None):
    """Calibrate by a wand in two cameras; the last instant is that before it, moved by so many pixels."""
    monkeypatch.setattr(wand, "first_stands", reached)
    cameras = rig(4)[:2]
    uv, _ = waved(1, cameras, n=instants)
    if apart_px is not None:
        uv[:, -1] = uv[:, -2] + [apart_px, 0.0]
    wand.calibrate_wand([c.lens for c in cameras], [SIZE] * 2, uv, no_background(cameras), length_m=0.4)


@pytest.mark.parametrize(("instants", "enough"), [(9, False), (11, True)])
def test_a_wand_is_seen_at_ten_instants(monkeypatch, instants, enough):
    with asks(enough, "saw both ends of the wand at 9 instants, and 10 are needed"):
        waves(monkeypatch, instants)


@pytest.mark.parametrize(("apart_px", "enough"), [(1.7, False), (2.3, True)])
def test_a_wand_lies_still_within_two_pixels(monkeypatch, apart_px, enough):
    """At the last of ten instants."""
    with asks(enough, "in 9 different places at 10 instants"):
        waves(monkeypatch, 10, apart_px)


@pytest.mark.parametrize(
    ("f_ratio", "f_sd", "score", "found"),
    [
        (0.75, 0.0, 0.0, None),
        (0.65, 0.0, 0.0, "focal length went"),
        (1.3, 0.0, 0.0, None),
        (1.5, 0.0, 0.0, "focal length went"),
        (1.0, 0.08, 0.0, None),
        (1.0, 0.12, 0.0, "does not determine its focal length"),
        (1.0, 0.0, 9.0, None),
        (1.0, 0.0, 11.0, "length varies by 11 %"),
    ],
)
def test_what_no_wand_calibration_is(f_ratio, f_sd, score, found):
    """Focal lengths by 0.7 to 1.4 of what was stated, known to a tenth; a wand that varies by less than a tenth."""
    lens = BrownLens.of((1000.0, 1000.0), (640.0, 512.0), np.zeros(5))
    now = BrownLens.of((1000 * f_ratio, 1000.0), (640.0, 512.0), np.zeros(5))
    result = SimpleNamespace(cameras=[SimpleNamespace(lens=now)], f_sd_px=[f_sd * 1000 * f_ratio], good_score=score)
    if found is None:
        wand._refuse(result, [lens], ["a"])
    else:
        with pytest.raises(CalibrationError, match=found):
            wand._refuse(result, [lens], ["a"])


def stands(shared, further=None):
    """Stands of two cameras that share so many points, and of a third that sees so many of them."""
    points = cloud(np.random.default_rng(3), 20)
    cameras = ring(3 if further is not None else 2)
    xy = (record(cameras, points) - [640.0, 512.0]) / [1200.0, 1212.0]
    xy[0, shared:] = np.nan
    if further is not None:
        xy[2, further:] = np.nan
    return first_stands(xy, ["a", "b", "c"], [1200.0] * 3)[0]


@pytest.mark.parametrize(("shared", "enough"), [(7, False), (9, True)])
def test_a_pair_of_cameras_shares_eight_points(shared, enough):
    if enough:
        assert len(stands(shared)) == 2
    else:
        with pytest.raises(CalibrationError, match="no two cameras share 8 points"):
            stands(shared)


@pytest.mark.parametrize(("further", "enough"), [(5, False), (7, True)])
def test_a_further_camera_shares_six_points(further, enough):
    """With two that share twenty."""
    if enough:
        assert len(stands(20, further)) == 3
    else:
        with pytest.raises(CalibrationError, match="shares 5 points with the others and needs 6"):
            stands(20, further)


@pytest.mark.parametrize(("places", "checked"), [(7, False), (8, True)])
def test_places_are_left_out_in_turn_from_eight(places, checked):
    """The eleven parameters need six, and those that are left shall have one to spare."""
    points = cloud(np.random.default_rng(5), places)
    uv = record(ring(1), points)[0] + np.random.default_rng(6).normal(0, 0.3, (places, 2))
    assert np.isfinite(fit_dlt("a", points, uv).left_out_px) == checked


@pytest.mark.parametrize(("places", "enough"), [(5, False), (6, True)])
def test_coefficients_need_six_places(places, enough):
    points = cloud(np.random.default_rng(8), places)
    uv = record(ring(1), points)[0]
    if enough:
        assert fit_dlt("a", points, uv).places == 6
    else:
        with pytest.raises(CalibrationError, match="5 different known points, and 6 are needed"):
            fit_dlt("a", points, uv)


@pytest.mark.parametrize(("places", "enough"), [(3, False), (4, True)])
def test_a_place_needs_four_points(places, enough):
    """Three leave up to four poses."""
    camera = rig(1)[0]
    points = cloud(np.random.default_rng(1), places)
    known = KnownLens(name="a", lens=camera.lens, size_px=SIZE)
    if enough:
        found = place_camera(known, points, camera.record(points)).camera.position_m
        np.testing.assert_allclose(found, camera.position_m, atol=1e-6)
    else:
        with pytest.raises(CalibrationError, match="3 different known points were clicked, and 4 are needed"):
            place_camera(known, points, camera.record(points))


@pytest.mark.parametrize(("points", "enough"), [(28, False), (32, True)])
@pytest.mark.parametrize("still", [0, 40])
def test_cameras_are_refined_by_thirty_points(monkeypatch, points, enough, still):
    """Of a marker that moves in so many frames, and then lies still in others."""
    monkeypatch.setattr(refine, "_solve", reached)
    rng, cameras = np.random.default_rng(2), ring(2)
    xyz = cloud(rng, points)
    xyz = np.concatenate([xyz, np.tile(xyz[-1], (still, 1))])
    uv = record(cameras, xyz)[:, :, None]
    with asks(enough, "28 points are seen by two cameras|28 of 68 points are in different places"):
        refine.refine_cameras(cameras, uv + rng.normal(0, 0.3, uv.shape))


@pytest.mark.parametrize(("pictures", "enough"), [(4, False), (6, True)])
def test_a_lens_needs_five_pictures(monkeypatch, pictures, enough):
    monkeypatch.setattr(intrinsics, "_fit", reached)
    with asks(enough, "found in 4 images, and 5 are needed"):
        intrinsics.fit_intrinsics([None] * pictures, SIZE, name="a", choices=("brown",))


@pytest.mark.parametrize(
    ("centre", "f_px", "found"),
    [
        ((0.25, 0.75), (1.0, 1.0), None),
        ((0.15, 0.5), (1.0, 1.0), "principal point"),
        ((0.5, 0.85), (1.0, 1.0), "principal point"),
        ((0.5, 0.5), (1.0, 0.85), None),
        ((0.5, 0.5), (1.0, 0.75), "times as wide"),
        ((0.5, 0.5), (1.0, 1.2), None),
        ((0.5, 0.5), (1.0, 1.3), "times as wide"),
        ((0.5, 0.5), (0.17, 0.17), None),
        ((0.5, 0.5), (0.13, 0.13), "focal length"),
        ((0.5, 0.5), (90.0, 90.0), None),
        ((0.5, 0.5), (110.0, 110.0), "focal length"),
    ],
)
def test_what_no_lens_is(centre, f_px, found):
    """In images 1000 px wide and high: shares of them."""
    lens = BrownLens.of(tuple(1000 * np.array(f_px)), tuple(1000 * np.array(centre)), np.zeros(5))
    said = intrinsics.lens_trouble(lens, (1000, 1000))
    assert said is None if found is None else found in said


def bent(monkeypatch, *, points=80, k1=0.1, off=0.0, after=0.8, own=1.0):
    """What is found where fits to all stretches but one give k1 + off or k1 - off, and residuals fall by factors."""
    fitted, medians = [], iter([1.0, after, own * after, own * after])
    monkeypatch.setattr(lens_of_tracks, "_median", lambda _parts: next(medians))

    def fit(_lenses, _matrices, _uv, start):
        fitted.append(start)
        one = k1 if len(fitted) == 1 or len(start) > 1 else k1 + off * (-1) ** len(fitted)
        return np.full(len(start), one)

    monkeypatch.setattr(lens_of_tracks, "_fitted", fit)
    cameras = ring(2)
    uv = record(cameras, cloud(np.random.default_rng(0), points))[:, :, None]
    return lens_of_tracks.lens_of_tracks(cameras, uv), fitted


@pytest.mark.parametrize(("points", "enough"), [(56, False), (64, True)])
def test_a_lens_is_fitted_to_sixty_points(monkeypatch, points, enough):
    if enough:
        assert (
            len(bent(monkeypatch, points=points)[1]) == 1 + 8 + 1
        )  # all, without each of eight stretches, each camera
    else:
        with pytest.raises(CalibrationError, match="56 points are seen by two cameras, and 60 are needed"):
            bent(monkeypatch, points=points)


@pytest.mark.parametrize(("own", "by_camera"), [(0.87, True), (0.93, False)])
def test_cameras_have_a_lens_each_where_residuals_fall_by_a_tenth(monkeypatch, own, by_camera):
    assert bent(monkeypatch, own=own)[0].by_camera == by_camera


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ({"after": 0.96}, None),
        ({"after": 0.98}, "no lens reduces"),
        ({"k1": 0.55}, None),
        ({"k1": 0.65}, "does not determine the lens"),
        ({"k1": 0.0, "off": 0.027}, None),
        ({"k1": 0.0, "off": 0.033}, "does not determine the lens"),
        ({"k1": 0.3, "off": 0.09}, None),
        ({"k1": 0.3, "off": 0.11}, "does not determine the lens"),
    ],
)
def test_what_no_lens_of_tracks_is(monkeypatch, given, found):
    """3 % less residual; k1 up to 0.6, known to 0.03 or a third; the jackknife of eight gives sqrt(7) of ``off``."""
    given = given | {"off": given.get("off", 0.0) / np.sqrt(7)}
    if found is None:
        bent(monkeypatch, **given)
    else:
        with pytest.raises(CalibrationError, match=found):
            bent(monkeypatch, **given)
