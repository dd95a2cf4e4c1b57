"""Each threshold of digitising, with a case just below and one just above it."""

from types import SimpleNamespace

import numpy as np
import pytest

from mocap.digitising import observer, register, texture, videos
from mocap.digitising.errors import RayErrors, lasting_covariance, ray_errors
from mocap.digitising.motion import State
from mocap.digitising.naming import _assigned, seen_from
from mocap.digitising.pose import PoseGaussian
from mocap.errors import CalibrationError
from tests.mocap.digitising.test_errors import matrices
from tests.mocap.digitising.test_texture import skin


def assigned(away, sd_px=1.0):
    """Whether one marker of one camera has a dot so many deviations away; of two the nearer."""
    s = sd_px**2 * np.eye(2)[None, None]
    dots = sd_px * np.stack([away, np.zeros(len(away))], axis=-1)[None]
    nothing = np.zeros((1, 1, len(away)), dtype=bool)
    none = np.full((1, 1), -1)
    found, _ = _assigned(np.zeros((1, 1, 2)), s, dots, none, nothing, nothing[0, :, 0], None, reach_px=1.0)
    return found[0, 0] == 0


@pytest.mark.parametrize(("squared", "found"), [(18.2, True), (18.7, False)])
def test_a_window_loses_a_right_dot_in_ten_thousand(squared, found):
    """Squared deviations: chi-square of two degrees of freedom."""
    assert assigned(np.sqrt([squared])) == found


@pytest.mark.parametrize(("squared", "found"), [(6.2, False), (7.8, True)])
def test_another_dot_is_less_likely_by_seven(squared, found):
    """Squared deviations of the second, the first being at the prediction."""
    assert assigned(np.sqrt([0.0, squared])) == found


@pytest.mark.parametrize(("sd_px", "found"), [(4.8, True), (5.3, False)])
def test_a_dot_at_the_edge_of_a_window_of_five_pixels_is_none(sd_px, found):
    """18.3 squared deviations from the prediction, just inside of the window."""
    assert assigned(np.sqrt([18.3]), sd_px) == found


@pytest.mark.parametrize(("rival", "sure"), [(11.0, False), (13.0, True)])
def test_an_animal_is_recognised_where_other_names_cost_twelve(monkeypatch, rival, sure):
    """A point that is no marker's costs the first marker so much more than its own."""
    cost = np.full((4, 5), 100.0)
    cost[range(4), range(4)], cost[0, 4] = 0.0, rival
    monkeypatch.setattr(register, "unlikely", lambda *_: cost)
    poses = SimpleNamespace(given=lambda *_: (np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1))))
    assert register._sure(np.zeros((5, 3)), poses, np.arange(4)).tolist() == [sure, True, True, True]


def test_a_pose_misses_by_students_t_of_five_degrees():
    """-2 log of its density in three dimensions, ten squared deviations away."""
    found = register.unlikely(np.array([1e-2, 0, 0]), 1e-5 * np.eye(3))
    assert found == pytest.approx(8 * np.log1p(10 / 5) + 3 * np.log(10))


@pytest.mark.parametrize(("squared", "named"), [(16.0, True), (16.5, False)])
def test_recognition_loses_a_right_point_in_a_thousand(squared, named):
    """Squared deviations: chi-square of three degrees of freedom, of the last of five markers."""
    at = 100.0 * np.arange(15).reshape(5, 3)
    poses = SimpleNamespace(mean=at, given=lambda *_: (at, np.tile(np.eye(3), (5, 1, 1))))
    points = at.copy()
    points[4, 0] += np.sqrt(squared)
    found, _ = register.settled(points, poses, np.arange(5))
    assert found.tolist() == [0, 1, 2, 3, 4 if named else -1]


@pytest.mark.parametrize(("seen", "turned"), [(3, False), (4, True)])
def test_a_pose_is_turned_onto_four_markers(seen, turned):
    rng = np.random.default_rng(0)
    mean = rng.normal(size=(6, 3))
    poses = PoseGaussian(mean, np.zeros((6, 3, 1)), 1e-4, np.full(6, 1e-4), np.ones(6, dtype=bool))
    assert (poses.given(mean, np.arange(6) < seen) is not None) == turned


def test_twenty_redundant_errors_of_the_mean_are_added_to_a_markers():
    """Of one frame of four rays each has 5: where rays meet, the variance is 10 / (5 + 10) of the other marker's."""
    uv, _ = seen_from(matrices(), np.array([[0.02, -0.03, 0.01], [-0.05, 0.02, 0.0]]))
    uv[:, 0] += 0.2 * np.random.default_rng(0).normal(size=(4, 2))
    found = ray_errors(matrices(), uv[:, None], sd_px=0.3)
    assert found.variance[1] / found.variance[0] == pytest.approx(10 / 15)


def test_images_share_three_tenths_of_lasting_variances():
    errors = RayErrors(sd_px=0.3, variance=np.ones(1), lasting=np.ones(1))
    _, jacobian = seen_from(matrices(), np.zeros((1, 3)))
    given = errors, jacobian, np.full((4, 1), 0.3), np.eye(3)[None] * 1e-6
    own, shared = (lasting_covariance(*given, shared=share) for share in (0.0, 1.0))
    np.testing.assert_allclose(lasting_covariance(*given), 0.7 * own + 0.3 * shared)


@pytest.mark.parametrize(("radii", "one"), [(2.0, True), (2.4, False)])
def test_dots_are_one_within_two_radii_and_a_fifth(radii, one):
    """Two markers that are predicted so near each other in each image, a dot at the first: whether it is its own."""
    cameras, radius_px = matrices()[:1], 4.0
    _, jacobian = seen_from(cameras, np.zeros((1, 3)))
    step = np.linalg.pinv(jacobian[0, 0]) @ [radii * radius_px, 0.0]
    places = np.array([np.zeros(3), step])
    uv, _ = seen_from(cameras, places)
    bones = SimpleNamespace(ends=np.zeros((0, 2), dtype=int), length_m=np.zeros(0), sd_m=np.zeros(0))
    of = observer.Observer(cameras, bones, np.zeros(0, dtype=int), np.zeros(2, dtype=bool), radius_px=radius_px)
    state = State(np.concatenate([places, np.zeros((2, 6))], axis=1), np.tile(1e-8 * np.eye(9), (2, 1, 1)))
    named, _ = of.observed(uv[:, :1], np.full((1, 1), 0.4), np.full(uv.shape, np.nan), state, owner=np.full((1, 1), -1))
    assert (named.dot[0, 0] < 0) == one


@pytest.mark.parametrize(
    ("misfits", "said"),
    [
        ([5.8], None),
        ([6.2, 6.2, 5.0], "do not fit the calibration"),
        ([15.0, 15.0, 4.3], "not in the order"),
        ([15.0, 15.0, 4.7], "do not fit the calibration"),
        ([60.0, 60.0, 5.8], "not in the order"),
        ([60.0, 60.0, 6.2], "do not fit the calibration"),
    ],
)
def test_clicks_do_not_fit_from_four_deviations(monkeypatch, misfits, said):
    """Of 1.5 px, in the order that was given; another one is named that fits, and three times as well."""
    each = iter(misfits)
    monkeypatch.setattr(videos, "_misfit", lambda *_: next(each))
    movies = [SimpleNamespace(path=SimpleNamespace(name=name)) for name in "ab"]
    given = [SimpleNamespace(name=name) for name in "cd"], np.zeros((2, 1, 2)), movies
    if said is None:
        videos.check_order(*given)
    else:
        with pytest.raises(CalibrationError, match=said):
            videos.check_order(*given)


def test_a_template_is_fifteen_pixels_with_thirteen_about_it_and_a_click_errs_by_half_a_pixel():
    point = texture.begun(skin([80.0, 60.0]), np.array([80.0, 60.0]))
    assert point.template.patch.shape == (15 + 26, 15 + 26)
    assert texture._middle(point.template.patch).shape == (15, 15)
    assert point.sd_px == 0.5


@pytest.mark.parametrize(
    ("best", "next_best", "found"), [(0.67, 0.0, False), (0.73, 0.0, True), (0.9, 0.82, False), (0.9, 0.78, True)]
)
def test_a_texture_is_where_it_correlates_by_seven_tenths_and_a_tenth_more(monkeypatch, best, next_best, found):
    """Than at any other place that is five pixels away or more."""
    score = np.zeros((21, 21), dtype=np.float32)
    score[10, 10], score[2, 2] = best, next_best
    monkeypatch.setattr(texture.cv2, "matchTemplate", lambda *_: score)
    point = texture.begun(skin([80.0, 60.0]), np.array([80.0, 60.0]))
    at = texture._searched(point.template, skin([80.0, 60.0]), np.array([80.0, 60.0]), 10.0)
    assert (at is not None) == found


@pytest.mark.parametrize(("away_px", "found"), [(57, True), (63, False)])
def test_a_texture_moves_by_sixty_pixels(away_px, found):
    """A point that was lost, at a place that may be 100 px off."""
    place = np.array([80.0, 60.0])
    point = texture.begun(skin(place), place)
    lost = texture.followed(point, np.full((120, 160), 60, dtype=np.uint8), place, 5.0)
    assert lost.before is None
    assert (texture.followed(lost, skin(place), place - [away_px, 0], 100.0).before is not None) == found
