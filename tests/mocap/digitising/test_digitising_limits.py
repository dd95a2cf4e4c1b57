"""Each threshold of digitising, with a case just below and one just above it."""

from types import SimpleNamespace

import numpy as np
import pytest

from mocap.digitising import dots, engine, observer, register, texture, videos
from mocap.digitising.clicks import Click
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
def test_clicks_do_not_fit_from_six_pixels(monkeypatch, misfits, said):
    """In the order that was given; another one is named that fits, and three times as well."""
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


def states(*places, sd_m=0.0):
    """At rest, known so well, without velocity and acceleration."""
    n = len(places)
    mean, cov = np.zeros((n, 9)), np.zeros((n, 9, 9))
    mean[:, :3], cov[:, range(3), range(3)] = np.array(places), np.broadcast_to(sd_m, (3, n)).T ** 2
    return State(mean, cov)


@pytest.mark.parametrize(
    ("moved", "wider", "alike"), [(0.04, 1.0, True), (0.06, 1.0, False), (0.0, 1.04, True), (0.0, 1.06, False)]
)
def test_states_are_alike_to_a_twentieth_of_a_deviation(moved, wider, alike):
    eye = np.eye(9)[None]
    assert engine._alike(State(np.zeros((1, 9)), eye), State(np.full((1, 9), moved), wider**2 * eye)) == alike


def test_at_first_speeds_are_those_that_are_tried_and_accelerations_half_of_them():
    """Standard deviations, in a frame and in a frame squared."""
    found = engine.first_state(np.zeros((1, 3)), np.eye(3)[None], 0.2)
    np.testing.assert_allclose(np.sqrt(np.diag(found.cov[0])), np.repeat([1.0, 0.2, 0.1], 3))


@pytest.mark.parametrize(("sd", "away", "at"), [(0.45, 0.9, 0.9), (0.55, 0.9, 0.9), (0.55, 1.1, 0.0)])
def test_a_marker_is_lost_at_half_a_length_and_then_near_the_others(sd, away, at):
    """In lengths of the animal, 2 m: the deviation of its distance; one that is a length off begins in their middle."""
    length = 2.0
    given = states([0.0, 0, 0], [length * away, 0, 0], sd_m=np.array([0.0, length * sd / np.sqrt(3)]))
    this = SimpleNamespace(density=np.zeros(2), observer=SimpleNamespace(length_m=length))
    found = engine.Engine._ahead(this, given)
    assert found.mean[1, 0] == length * at
    wide = np.repeat([0.25, 0.05, 0.02], 3) if sd > 0.5 else np.repeat([sd / np.sqrt(3), 0, 0], 3)
    np.testing.assert_allclose(np.sqrt(np.diag(found.cov[1])), length * wide)


@pytest.mark.parametrize(
    ("rays", "surprise", "factor"), [(2, 0.0, 0.96), (2, 3.0, 1.3), (2, 20.0, 3.0), (0, np.nan, 1.3), (1, np.nan, 1.0)]
)
def test_a_surprised_marker_is_expected_to_move_more(rays, surprise, factor):
    """Fast up and slowly down, by 0.15 and 0.04 of what the surprise differs from 1; three times at most."""
    named = SimpleNamespace(rays=np.array([rays]), surprise=np.array([surprise]))
    observer_ = SimpleNamespace(length_m=1.0, measure_bones=lambda _: None)
    this = SimpleNamespace(
        tracks=SimpleNamespace(forward=np.full((1, 1, 90), np.nan), density=np.ones((1, 1))),
        density=np.full(1, 1e-4), most=np.zeros(1), fastest=1.0, own_poses=False, observer=observer_,
        _observed=lambda _, state: (named, state), _take=lambda *_: None,
    )  # fmt: skip
    engine.Engine._forward(this, 0, states([0.0, 0, 0]))
    np.testing.assert_allclose(this.density, factor * 1e-4)


@pytest.mark.parametrize(
    ("most", "least"), [([1.0, 1.0], 0.05), ([0.1, 1.0], 0.05 * 0.3 * 0.91), ([1e-12, 1e-12], 1e-10)]
)
def test_a_calm_marker_may_move_as_a_twentieth_of_what_it_did(most, least):
    """Or of three tenths of what others do, their 90 % quantile; or as a hundred thousandth of the animal's length."""
    named = SimpleNamespace(rays=np.array([1, 1]), surprise=np.full(2, np.nan))
    this = SimpleNamespace(
        tracks=SimpleNamespace(forward=np.full((1, 2, 90), np.nan), density=np.ones((1, 2))),
        density=np.zeros(2), most=np.array(most), fastest=1.0, own_poses=False,
        observer=SimpleNamespace(length_m=1.0, measure_bones=lambda _: None),
        _observed=lambda _, state: (named, state), _take=lambda *_: None,
    )  # fmt: skip
    engine.Engine._forward(this, 0, states([0.0, 0, 0], [0.0, 0, 0]))
    assert this.density[0] == pytest.approx(least)


def test_density_is_a_hundred_times_that_of_third_differences(monkeypatch):
    """Of the marker's fast times, their 90 % quantile."""
    found = np.array([[0.0], [1.0]])
    monkeypatch.setattr(engine, "jerk_density", lambda *_: found)
    tracks = SimpleNamespace(
        rays=np.ones((2, 1)), xyz_m=np.zeros((2, 1, 3)), cov_m2=np.zeros((2, 1, 3, 3)), density=np.full((2, 1), 1e9)
    )
    engine.Engine._limit_density(SimpleNamespace(tracks=tracks))
    np.testing.assert_allclose(tracks.density, [[90.0], [100.0]])


def windows(*sd_px):
    """Of one camera 1000 px wide that looks at markers in its middle, known to so many pixels; dots of 3 px."""
    camera = np.array([[1000.0, 0, 500, 0], [0, 1000, 500, 0], [0, 0, 1, 0]])
    given = states(*[[0.0, 0, 1]] * len(sd_px), sd_m=np.array(sd_px) / 1000)
    this = SimpleNamespace(
        matrices=camera[None], sizes=[(1000, 1000)], cameras=[SimpleNamespace(lens=None)],
        observer=SimpleNamespace(sd_px=0.0), look=SimpleNamespace(radius_px=3.0),
    )  # fmt: skip
    return engine.Engine._windows(this, given)[0]


@pytest.mark.parametrize(("sd_px", "half_px"), [([0.0], 24), ([10.0], 64), ([10.0, 1e3], 264)])
def test_a_window_is_four_deviations_and_24_pixels_wide(sd_px, half_px):
    """12 px and four radii of a dot; a marker of which nothing is known is looked for within 240 px."""
    assert windows(*sd_px) == (499 - half_px, 499 - half_px, 499 + half_px, 499 + half_px)


@pytest.mark.parametrize(
    ("sd_px", "anywhere"), [([58.0], False), ([62.0], True), ([1, 1e3], False), ([1, 1, 1, 1e3, 1e3, 1e3, 1e3], True)]
)
def test_all_of_an_image_is_searched_where_half_the_markers_are_unknown(sd_px, anywhere):
    """To 60 px."""
    assert (windows(*sd_px) is None) == anywhere


@pytest.mark.parametrize(("gap", "groups"), [(19, 1), (21, 2)])
def test_clicks_twenty_frames_apart_are_named_one_after_the_other(gap, groups):
    seen = []
    this = SimpleNamespace(_about=lambda first, last, _: seen.append((first, last)) or (first, last))
    assert engine.Engine._all_about(this, [5, 5 + gap], False) == (5, 5 + gap)
    assert len(seen) == groups


def test_a_texture_is_looked_for_in_ten_frames_more(monkeypatch):
    """After which it is given up, where it is not found."""
    asked = []
    gone = texture.FollowedTexture(uv=np.zeros(2), sd_px=1.0, template=None, before=None)
    monkeypatch.setattr(engine, "begun", lambda *_: gone)
    monkeypatch.setattr(engine, "followed", lambda *_: asked.append(1) or gone)
    click = Click(camera=0, frame=0, marker=0, uv_px=(1.0, 1.0))
    this = SimpleNamespace(
        tracks=SimpleNamespace(xyz_m=np.full((40, 1, 3), np.nan)), clicks=[click], by_frame={},
        observer=SimpleNamespace(textured=[True]), videos=SimpleNamespace(picture=lambda *_: 0),
        _one_film=lambda *_: ((frame, 0) for frame in range(1, 40)),
    )  # fmt: skip
    assert engine.Engine._follow_from(this, [click], ahead=True) == []
    assert len(asked) == 11


@pytest.mark.parametrize(("apparent", "sd_px"), [(0.1, 0.15), (0.2, 0.2), (1.8, 1.8), (2.5, 2.0)])
def test_a_dot_errs_by_a_seventh_of_a_pixel_to_two(monkeypatch, apparent, sd_px):
    """In ten pieces of twenty frames; textures err by half more than is stated of them, or more."""
    monkeypatch.setattr(engine.triangulate, "apparent_sd", lambda *_: apparent)
    monkeypatch.setattr(engine, "ray_errors", lambda _, uv, **_options: uv.shape[1])
    this = SimpleNamespace(
        cameras=[0], names=["a"], matrices=None, strength=None, videos=SimpleNamespace(n_frames=1000),
        observer=SimpleNamespace(textured=np.array([False]), sd_px=0.5),
        tracks=SimpleNamespace(dot=np.full((1, 1000, 1), -1), ideal=[np.zeros((1, 0, 2))] * 1000),
    )  # fmt: skip
    engine.Engine._estimate_sd(this, 0)
    assert (this.observer.sd_px, this.errors) == (sd_px, 200)


@pytest.mark.parametrize(("apparent", "variance"), [(0.7, 1.5**2), (0.8, 1.6**2)])
def test_textures_err_by_half_more_than_is_stated(monkeypatch, apparent, variance):
    """Stated: half a pixel."""
    monkeypatch.setattr(engine.triangulate, "apparent_sd", lambda *_: apparent)
    this = SimpleNamespace(
        observer=SimpleNamespace(textured=np.array([True]), sd_px=0.3), names=["a"], matrices=None, errors=None,
        tracks=SimpleNamespace(owner=[np.zeros((1, 1))]), _sd_px=lambda _: np.full((1, 1), 0.5),
    )  # fmt: skip
    engine.Engine._texture_errors(this, np.zeros((1, 1, 1, 2)), np.array([0]))
    assert this.errors.variance[0] == pytest.approx(variance)


@pytest.mark.parametrize(("n", "known"), [(29, False), (31, True)])
def test_strengths_of_thirty_dots_are_known_to_a_seventh(n, known):
    """The deviation of the logarithm is 0.15 at least: here dots are all alike."""
    before = dots.Strength(log_median=np.zeros(1), log_sd=np.ones(1))
    found = dots.strength_of(np.full((1, n), np.e), before)
    assert (found.log_median[0], found.log_sd[0]) == (pytest.approx((1.0, 0.15)) if known else (0.0, 1.0))


def disc(radius_px, level, size=80):
    """A disc in the middle of an image, its edge as wide as a pixel."""
    v, u = np.mgrid[:size, :size] - size // 2
    return np.rint(60 + level * np.clip(radius_px + 0.5 - np.hypot(u, v), 0, 1)).astype(np.uint8)


@pytest.mark.parametrize("radius_px", [1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.5, 8.5, 11.0])
def test_a_disc_has_the_radius_that_is_tried_next_to_its_own(radius_px):
    """Responses of radii that are a fifth apart differ by less than the tenth for which a larger one is taken."""
    found = dots.look_of([disc(radius_px, 100)], [np.array([[40.0, 40.0]])])
    assert 0.6 * radius_px < found.radius_px <= 1.2 * radius_px


@pytest.mark.parametrize(("off_px", "found"), [(3.4, True), (5.0, False)])
def test_a_dot_is_three_pixels_from_its_click(off_px, found):
    """Where the response of a disc of 1.5 px falls to nothing within two pixels; half a pixel is rounding."""
    look = dots.look_of([disc(1.0, 180)], [np.array([[40.0 + off_px, 40.0]])])
    strong = dots.look_of([disc(1.0, 180)], [np.array([[40.0, 40.0]])])
    assert (look is not None and look.least > 0.8 * strong.least) == found


@pytest.mark.parametrize(("share", "found"), [(0.9, False), (1.1, True)])
def test_a_dot_responds_by_four_grey_levels(share, found):
    """Of a click on a disc; the least of its dots is a quarter of that."""
    (grey, places) = disc(3.0, 100), [np.array([[40.0, 40.0]])]
    level = 400 * dots.look_of([grey], places).least / 100  # of a grey level
    weak = 60 + (grey.astype(float) - 60) * share * 4 / level
    assert (dots.look_of([weak.astype(np.float32)], places) is not None) == found


def test_dots_of_a_frame_are_250_at_most():
    """Of 289."""
    v, u = np.mgrid[:340, :340] % 20 - 10
    grey = np.where(np.hypot(u, v) < 3, 200, 50).astype(np.uint8)
    assert len(dots.find_dots(grey, dots.DotLook(radius_px=3.0, bright=True, least=5.0))) == 250


def test_the_decoder_is_frames_ahead_whatever_their_number(monkeypatch):
    """``AHEAD`` is of speed and memory alone."""
    movie = SimpleNamespace(frames=lambda wanted, **_options: iter(wanted))
    monkeypatch.setattr(videos, "grey_levels", lambda frame: frame)
    for ahead in (1, 3, 50):
        monkeypatch.setattr(videos, "AHEAD", ahead)
        assert [*videos._ahead(movie, np.arange(7))] == [*range(7)]


def animal(n=10, noise_m=1e-3):
    """Poses of an animal that does not bend, 0.2 m long."""
    mean = 0.1 * np.random.default_rng(3).uniform(-1, 1, (n, 3))
    ones = np.ones(n, dtype=bool)
    return PoseGaussian(mean, np.zeros((n, 3, 1)), noise_m**2, np.full(n, noise_m**2), ones)


@pytest.mark.parametrize(("own", "found"), [(6, False), (7, True), (8, True)])
def test_an_animal_is_recognised_by_seven_tenths_of_its_markers(own, found):
    """Of ten, among points that are far from all of them; two more are far off."""
    poses = animal()
    points = np.concatenate([poses.mean[:own], 10 + 5 * np.random.default_rng(0).uniform(size=(10 - own, 3))])
    assert (register.recognise(points, poses) is not None) == found


def test_triples_are_ten_of_which_three_share_a_marker():
    """Of many markers; none in a line."""
    triples = register._triples(animal(16))
    assert len(triples) == 10
    used = np.bincount(np.ravel(triples))
    assert used.max() == 3


@pytest.mark.parametrize(("height", "n"), [(0.074, 0), (0.086, 1)])
def test_three_markers_in_a_line_are_no_triple(height, n):
    """Twice the area over the square of the longest side."""
    mean = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, height, 0]])
    poses = PoseGaussian(mean, np.zeros((3, 3, 1)), 1e-4, np.full(3, 1e-4), np.ones(3, dtype=bool))
    assert len(register._triples(poses)) == n


@pytest.mark.parametrize(("share", "matches"), [(2.9, True), (3.1, False)])
def test_points_match_a_triple_within_three_deviations(share, matches):
    """Of 1.5 of a distance's own deviation and a hundredth of it: here of the first side."""
    poses = animal(3)
    long, sd = register.distances(poses)
    far = long.copy()
    far[0, 1] = far[1, 0] = long[0, 1] + share * (1.5 * sd[0, 1] + 0.01 * long[0, 1])
    assert ((0, 1, 2) in register._matching(far, poses, (0, 1, 2))) == matches


@pytest.mark.parametrize(("density", "limited"), [(0.008, 0.008), (0.02, 0.01)])
def test_no_marker_jerks_by_more_than_a_twentieth_of_the_animal(density, limited):
    """In a frame: of an animal of 2 m."""
    this = SimpleNamespace(observer=SimpleNamespace(length_m=2.0))
    assert min(density, engine.Engine.fastest.fget(this)) == pytest.approx(limited)
