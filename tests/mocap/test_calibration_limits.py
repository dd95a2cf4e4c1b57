"""Each threshold of calibration, with a case just below and one just above it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from mocap.calibration import board_rig, intrinsics, places, refine, wand
from mocap.calibration.chain import first_stands, rigid
from mocap.calibration.dlt import fit_dlt
from mocap.calibration.places import place_camera
from mocap.calibration.scene import distinct, turn
from mocap.cameras import lens_of_tracks
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


def board_result(**given):
    """What boards gave of two cameras with focal lengths of 1000 px, a metre apart, in images 1000 px wide."""
    lens = BrownLens.of((1000.0, 1000.0), (500.0, 500.0), np.zeros(5))
    places = [np.array([1.0, 0, 0]), np.array([1.0 + given.get("apart", 1.0), 0, 0])]
    cameras = [SimpleNamespace(name=name, lens=lens, position_m=at) for name, at in zip("ab", places, strict=True)]
    return SimpleNamespace(
        cameras=cameras,
        f_sd_px=[given.get("sd_px", 1.0)] * 2,
        camera_px={name: (0.0, given.get("median_px", 0.1)) for name in "ab"},
    ), {name: SimpleNamespace(size_px=(1000, 800)) for name in "ab"}


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ({"sd_px": 26.0}, None),  # 3 % of the focal length
        ({"sd_px": 34.0}, "do not determine its focal length"),
        ({"median_px": 1.7}, None),  # two pixels in a thousand
        ({"median_px": 2.3}, "median error of corners"),
        ({"apart": 2.4e-6}, None),  # a millionth of their distances from the origin, 2 m
        ({"apart": 1.7e-6}, "at the same place"),
    ],
)
def test_what_no_rig_of_boards_is(given, found):
    if found is None:
        board_rig._refuse(*board_result(**given))
    else:
        with pytest.raises(CalibrationError, match=found):
            board_rig._refuse(*board_result(**given))


@pytest.mark.parametrize(("off", "odd"), [(0.13, 0), (0.17, 1)])
@pytest.mark.parametrize("turned", [True, False])
def test_views_of_a_board_agree_to_015(off, odd, turned):
    """Radians, or a share of its distance, in the third of three cameras."""
    ahead = rigid(np.eye(3), np.array([0.0, 0, 2.0]))
    other = (
        rigid(turn(np.array([0.0, 0, off])), ahead[:3, 3]) if turned else rigid(np.eye(3), np.array([2 * off, 0, 2.0]))
    )
    seen = {(0, "s"): ahead, (1, "s"): ahead, (2, "s"): other}
    assert len(board_rig._boards(seen, [np.eye(4)] * 3, None)[2]) == odd


def known(camera, size_px=SIZE):
    return KnownLens(name="a", lens=camera.lens, size_px=size_px)


def placed(monkeypatch, *, points=20, rms_px=0.1, wrong=0, loose=0.0, size_px=None):
    """Place a camera where fits have such residuals, find so many points wrong, and leave the place so loose."""
    camera, xyz, left = rig(1)[0], cloud(np.random.default_rng(1), points), iter(range(wrong))
    fits = []

    def best(_lens, own, _uv):
        fits.append(len(own))
        error = np.full((len(own), 2), rms_px / np.sqrt(2))
        return places._Fit(camera=camera, error_px=error, slopes=np.zeros((2 * len(own), 6)), other=None)

    monkeypatch.setattr(places, "_best", best)
    monkeypatch.setattr(places, "_wrong", lambda _: 0 if next(left, None) is not None else None)
    cov = np.diag([loose**2, 0, 0, 0, 0, 0])
    monkeypatch.setattr(places, "_place", lambda *_: SimpleNamespace(cov=cov))
    try:
        place_camera(known(camera, size_px), xyz, camera.record(xyz))
    except CalibrationError as error:
        return str(error), fits
    return "", fits


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ({"rms_px": 2.6}, ""),  # pixels
        ({"rms_px": 3.4}, "RMS reprojection error"),
        ({"rms_px": 8.6, "size_px": (2000, 1000)}, ""),  # or five in a thousand of an image
        ({"rms_px": 11.5, "size_px": (2000, 1000)}, "RMS reprojection error"),
        ({"wrong": 5}, ""),  # a quarter of the points
        ({"wrong": 6}, "RMS reprojection error"),
        ({"loose": 0.17}, ""),  # a tenth of the distance, 2 m
        ({"loose": 0.23}, "leave its position open"),
    ],
)
def test_what_no_place_is(monkeypatch, given, found):
    assert found in (said := placed(monkeypatch, **given)[0])
    assert bool(found) == bool(said)


def test_five_points_are_kept(monkeypatch):
    """However many are wrong: 20 less 15."""
    assert min(placed(monkeypatch, wrong=100)[1]) == 5


@pytest.mark.parametrize(("share", "line"), [(0.85e-3, True), (1.15e-3, False)])
def test_points_on_a_line_place_no_camera(monkeypatch, share, line):
    """Second over first singular value of their places."""
    monkeypatch.setattr(places, "_best", reached)
    xyz = np.array([[-1.0, share, 0], [1.0, share, 0], [-1.0, -share, 0], [1.0, -share, 0]])
    with pytest.raises(CalibrationError if line else Reached):
        place_camera(known(rig(1)[0]), xyz, np.arange(8.0).reshape(4, 2))


@pytest.mark.parametrize(("level", "wrong"), [(0.85e-3, True), (1.15e-3, False)])
def test_a_point_is_wrong_that_one_camera_in_a_thousand_has(monkeypatch, level, wrong):
    """Of eight points."""
    monkeypatch.setattr(places.stats.f, "sf", lambda *_: level / 8)
    fit = places._Fit(camera=None, error_px=np.ones((8, 2)), slopes=np.eye(16, 6), other=None)
    assert (places._wrong(fit) is not None) == wrong


@pytest.mark.parametrize(("chance", "alike"), [(0.0045, False), (0.0055, True), (0.9945, True), (0.9955, False)])
def test_cameras_are_clicked_alike_by_an_f_test_at_one_percent(chance, alike):
    sd = float(np.sqrt(stats.f.ppf(chance, 10, 12)))
    a, b = SimpleNamespace(sd_px=sd, freedom=10), SimpleNamespace(sd_px=1.0, freedom=12)
    assert places._alike(a, b) == alike


@pytest.mark.parametrize(("more", "turned", "open_"), [(8.0, 0.058, True), (10.0, 0.058, False), (8.0, 0.043, False)])
def test_another_place_is_as_likely_within_three_deviations(monkeypatch, more, turned, open_):
    """Its sum of squares is larger by less than nine variances, and it is turned by a twentieth of a radian."""
    camera, xyz = rig(1)[0], cloud(np.random.default_rng(1), 5)
    other = replace(camera, rotation=turn(np.array([0.0, 0, turned])) @ camera.rotation)
    costs = iter([4.0, 4.0 + more])  # of 10 - 6 degrees of freedom
    monkeypatch.setattr(places, "_starts", lambda *_: [camera, other])
    monkeypatch.setattr(
        places,
        "least_squares",
        lambda *_args, **_options: SimpleNamespace(x=np.zeros(6), cost=next(costs) / 2, fun=np.zeros(10)),
    )
    assert (places._best(known(camera), xyz, camera.record(xyz)).other is not None) == open_


@pytest.mark.parametrize(("other_px", "flipped"), [(0.3, True), (0.37, False)])
def test_rows_are_counted_from_below_where_residuals_fall_to_a_third(monkeypatch, other_px, flipped):
    monkeypatch.setattr(places, "_best", lambda *_: SimpleNamespace(rms_px=other_px))
    said = places._misfit(known(rig(1)[0]), np.zeros((4, 3)), np.zeros((4, 2)), 1.0, [])
    assert ("counted from below" in said) == flipped
