"""Each threshold of cleaning, with a case just below and one just above it, on rays and paths made for it."""

import numpy as np
import pytest
from scipy.optimize import root_scalar
from scipy.special import chdtri

from mocap.cameras.camera import project, stacked
from mocap.cameras.triangulate import linear, residual_px, robust
from mocap.cleaning import swap_states, swaps
from mocap.cleaning.bias import hand_sd, lasting_share, persistent_px
from mocap.cleaning.camera_health import camera_health
from mocap.cleaning.click_noise import _most_likely_dof, student_t
from mocap.cleaning.likelihoods import likelihood_noise
from mocap.cleaning.positions import stretched
from mocap.cleaning.swap_states import settle
from mocap.cleaning.swapped_rays import _Rays, _runs, agreement, extent_px
from mocap.cleaning.swaps import BoneLength, pair_evidence, runs_of, unbroken
from tests.mocap.rigs import cloud, ring


def scene(n_cameras, n_frames, n_markers, noise_px=0.0, seed=0):
    """Projections, points (T, M, 3) that stand still, and their pixels."""
    rng = np.random.default_rng(seed)
    matrices = stacked(ring(n_cameras))
    xyz = np.tile(cloud(rng, n_markers), (n_frames, 1, 1))
    uv = project(matrices, xyz)
    return matrices, xyz, uv + noise_px * rng.standard_normal(uv.shape)


@pytest.mark.parametrize(("off", "rejected"), [(4.2, False), (5.8, True)])
def test_a_ray_misses_by_five_deviations(off, rejected):
    """The residual sqrt(sum r^2 / (2 n - 3)) of a point with one ray off, that ray scaled until it is so many."""
    matrices, _, uv = scene(4, 1, 1)
    wrong = uv.copy()
    wrong[0, 0, 0, 0] += 1.0
    one = float(robust(matrices, wrong, sd_px=1.0).residual_px[0, 0])
    wrong[0, 0, 0, 0] += off / one - 1.0  # linear in it: 1 px and 20 px of 1200
    found = robust(matrices, wrong, sd_px=1.0)
    assert found.rejected[0, 0, 0] == rejected
    assert not found.rejected[1:].any()
    clicks = np.concatenate([uv, wrong], axis=1)
    assert hand_sd(matrices, clicks, usual_px=1.0)[1][:, 0].tolist() == [False, rejected]


def test_no_pixel_is_known_better_than_a_hundredth():
    """Of exact pixels the scale is that; of noisy ones it is theirs."""
    matrices, xyz, uv = scene(4, 3, 5)
    scale = student_t(matrices, uv, xyz, sd_px=1.0)[3]
    np.testing.assert_allclose(scale, 0.01)


def test_thirty_errors_of_the_usual_size_are_added_to_few():
    """Closed forms: 30 clicks that miss by more than twice the usual, and what lasts of 28 and 35 redundant errors."""
    matrices, _, uv = scene(3, 1, 30)
    matrices, uv = matrices[:2], uv[:2]
    uv[0, :, :, 1] += 3.5  # two rays: one redundant error a point
    missed = residual_px(matrices, uv, linear(matrices, uv))
    assert np.median(missed) > 2
    assert hand_sd(matrices, uv, usual_px=1.0)[0] == pytest.approx(np.sqrt((30 + np.sum(missed**2)) / 60))
    for n_frames, known in ((3 + 4, False), (3 + 5, True)):  # 10 - 3 redundant errors of five rays, 3 frames apart
        matrices, xyz, uv = scene(5, n_frames, 1, noise_px=0.5)
        found = persistent_px(matrices, uv, xyz, relative=np.ones(uv.shape[:3]))
        assert np.isfinite(found[0]) == known


def test_what_cameras_share_of_an_error_is_twice_what_differs():
    """(1 + 2) s^2 / s0^2 of errors that are known to last, 2 where all do."""
    np.testing.assert_allclose(lasting_share(np.array([0.5, np.nan]), np.array([1.0, 1.0])), [0.75, 2.0])


@pytest.mark.parametrize(("evidence", "found"), [(30.5, 0), (34.0, 1)])
def test_a_run_pays_for_two_changes_and_a_margin(evidence, found):
    """12 for each change and 8 over, of two markers in one place, whose ways tell nothing; holes part the run."""
    xyz = np.zeros((60, 2, 3))
    xyz[25:30], xyz[35:40] = np.nan, np.nan
    alike = np.full(60, -5.0)
    alike[25:40] = 0.0
    alike[30:35] = evidence / 5
    runs, _ = runs_of(xyz, np.full(2, 1e-3), (0, 1), alike)
    assert len(runs) == found


def test_ten_frames_of_a_wrong_length_count_as_one():
    """A bone from 0 to 2, and the marker 1 that lies three deviations off its end."""
    xyz = np.tile(np.array([[0.0, 0, 0], [1.3, 0, 0], [1.0, 0, 0]]), (4, 1, 1))
    found = pair_evidence(xyz[:, [0, 1, 2]], [BoneLength(0, 2, 1.0, 0.1)], (1, 2), set())
    np.testing.assert_allclose(found, -0.5 * (4 + 1) * np.log1p(9 / 4) / 10)  # Student's t of four degrees of freedom


@pytest.mark.parametrize(("frames", "unlost"), [(3, True), (4, False)])
def test_a_way_goes_on_over_three_frames(frames, unlost):
    """A marker that stands still is seen alone, so many frames after the one before and before the next."""
    xyz = np.full((3 + 2 * frames, 2, 3), np.nan)
    both = np.array([0, 1, 2, 2 + 2 * frames])
    xyz[both], xyz[2 + frames, 0] = [[0.0, 0, 0], [1.0, 0, 0]], 0.0
    assert unbroken(xyz, both, np.full(2, 1e-3))[-1] == unlost


def settled(matrices, uv, extent_px=400.0):
    ones = np.ones(uv.shape[:3])
    return settle(matrices, uv, np.zeros((*uv.shape[1:3], 3)), (0, 1), sd_px=1.0, relative=ones, extent_px=extent_px)


def test_names_in_a_camera_change_once_in_a_thousand_frames():
    """Of unseen markers: two chains of two states, exp(-7) for a change and exp(-0.03) for each exchanged frame."""
    odds = settled(stacked(ring(2)), np.full((2, 400, 2, 2), np.nan)).odds
    step = np.array([[1, np.exp(-7)], [np.exp(-7), 1]]) * np.exp([0, -0.03])  # from rows to columns
    first = np.linalg.matrix_power(step, 399).sum(axis=1) * np.exp([0, -0.03])
    right = (first[0] / first.sum()) ** 2
    assert odds[0] == pytest.approx(np.log(right / (1 - right)), rel=1e-6)


def test_four_frames_of_a_ray_count_as_one():
    """One frame of two markers side by side, in two cameras: of four states two and two fit alike."""
    matrices, _, uv = scene(3, 1, 2)
    matrices, uv = matrices[:2], uv[:2]
    uv[:, :, 1] = uv[:, :, 0] + [1.0, 1.2]
    uv[0, :, 1] += [0.0, 0.8]
    other = uv.copy()
    other[1] = uv[1][:, ::-1]
    detail = np.log(400 / np.sqrt(2 * np.pi))
    own, swapped = (
        agreement(matrices, one, np.ones((2, 1, 2)), sd_px=1.0, detail=detail)[0][0] / 4 for one in (uv, other)
    )
    every = np.exp([own, own - 0.06, swapped - 0.03, swapped - 0.03])
    best = every.max() / every.sum()
    assert abs(own - swapped) > 0.01
    assert settled(matrices, uv).odds[0] == pytest.approx(np.log(best / (1 - best)), rel=1e-9)


@pytest.mark.parametrize(("off", "suspected"), [(3.4, False), (4.6, True)])
def test_a_ray_is_suspected_from_four_deviations(off, suspected):
    """One ray of one marker, in four cameras: so far from its point that robust keeps."""
    matrices, _, uv = scene(4, 1, 3)
    one, found = uv.copy(), robust(matrices, uv, sd_px=1.0)
    one[0, 0, 0] += [0.0, off]
    rays = _Rays(matrices, one, found, np.ones(uv.shape[:3]))
    assert rays.suspect[0, 0].tolist() == [suspected, False, False]


def test_one_click_in_a_hundred_lands_anywhere():
    """Two rays exchanged in one of four cameras: each is an outlier, and takes two directions of agreement with it."""
    matrices, _, uv = scene(4, 1, 4)
    one = uv.copy()
    one[0, 0, :2] = uv[0, 0, 1::-1]
    rays = _Rays(matrices, one, robust(matrices, one, sd_px=1.0), np.ones(uv.shape[:3]))
    (gain,) = rays.gains(*(np.array([k]) for k in (0, 0, 0, 1)))
    detail = np.log(extent_px(one) / np.sqrt(2 * np.pi))
    assert gain == pytest.approx(4 * detail - 2 * np.log(0.01), rel=1e-6)


@pytest.fixture(scope="module")
def watched():
    """Six cameras, 40 markers and 200 frames with errors of half a pixel."""
    return scene(6, 200, 40, noise_px=0.5)


def worse(watched, levels):
    """The health of the cameras where the errors of the first are so many times as large in some frames."""
    matrices, xyz, uv = watched
    exact, uv = project(matrices, xyz), uv.copy()
    for start, stop, level in levels:
        uv[0, start:stop] = exact[0, start:stop] + level * (uv - exact)[0, start:stop]
    return camera_health(matrices, uv).bad


@pytest.mark.parametrize(("level", "named"), [(2.5, 0), (3.6, 1)])
def test_a_camera_is_bad_at_three_times_its_level(watched, level, named):
    """Levels of five frames of 40 markers err by some 5 %."""
    assert len(worse(watched, [(80, 140, level)])) == named


@pytest.mark.parametrize(("before", "start"), [(1.7, 120), (2.35, 80)])
def test_it_is_bad_from_twice_its_level(watched, before, start):
    """It gets worse, and 40 frames later bad: the run begins where it is beyond twice the good level."""
    (bad,) = worse(watched, [(80, 120, before), (120, 160, 6.0)])
    assert abs(bad.start - start) <= 4


@pytest.mark.parametrize(("frames", "closed"), [(17, True), (23, False)])
def test_gaps_of_16_frames_are_closed(watched, frames, closed):
    """Levels of five frames feel a change two frames ahead, which a gap that is closed counts to what is bad."""
    first, _ = worse(watched, [(60, 100, 6.0), (100 + frames, 140 + frames, 6.0)])
    assert (first.stop > 102) == closed


def likelihoods(share, off_px):
    """What is learned where clicks of little likelihood in one camera are off in a share of them."""
    matrices, _, uv = scene(4, 40, 25, noise_px=0.5)
    rng = np.random.default_rng(5)
    likelihood = np.full(uv.shape[:3], 0.9) + 0.05 * rng.random(uv.shape[:3])
    low = rng.random(uv.shape[1:3]) < 0.3
    likelihood[0, low] = 0.1
    wrong = low & (rng.random(uv.shape[1:3]) < share)
    angle = rng.uniform(0, 2 * np.pi, wrong.sum())
    uv[0, wrong] += off_px * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return likelihood_noise(matrices, uv, likelihood)


@pytest.mark.parametrize(("share", "believed"), [(0.28, True), (0.39, False)])
def test_likelihoods_of_which_a_third_is_wrong_are_not_believed(share, believed):
    """Of 300 clicks a share is known to 3 %."""
    assert (likelihoods(share, 100.0).least < 0.1) == believed


@pytest.mark.parametrize(("deviations", "believed"), [(5.0, True), (7.0, False)])
def test_a_click_is_wrong_from_six_deviations(deviations, believed):
    """All clicks of little likelihood are off by so many, to one: of a sixth of them it is more than one further."""
    plain = likelihoods(0.0, 0.0)
    assert (likelihoods(1.0, deviations * plain.scale_px * 1.2).least < 0.1) == believed


@pytest.mark.parametrize(("points", "enough"), [(18, False), (22, True)])
def test_likelihoods_are_learned_from_twice_forty_clicks(points, enough):
    """Four cameras that see all points: four clicks each, all of which the others predict."""
    matrices, _, uv = scene(4, 1, points, noise_px=0.5)
    likelihood = np.full(uv.shape[:3], 0.9)
    likelihood[0] = np.linspace(0.5, 0.95, points)
    assert (likelihood_noise(matrices, uv, likelihood) is not None) == enough


def test_tails_are_of_three_to_sixty_degrees():
    """Squared distances of Cauchy's law and alike ones; the last step is a fifth beyond the grid."""
    cauchy = np.random.default_rng(0).standard_cauchy(4000) ** 2
    assert _most_likely_dof(cauchy) == pytest.approx(3.0)
    assert _most_likely_dof(np.full(4000, 2.0)) == pytest.approx(1.2 * 60)


@pytest.mark.parametrize(("n_cameras", "sets"), [(4, True), (5, False)])
def test_sets_of_exchanged_cameras_are_those_of_four(monkeypatch, n_cameras, sets):
    """A ray that is exchanged is one of a set that is judged, or is believed."""
    way = []

    def goes(name):
        def gone(*_args, **_options):
            way.append(name)
            raise StopIteration

        return gone

    monkeypatch.setattr(swap_states, "exchanged_rays", lambda *_args, **_options: [None])
    monkeypatch.setattr(swap_states, "settle_all", goes("sets"))
    monkeypatch.setattr(swap_states, "exchange_rays", goes("rays"))
    matrices, _, uv = scene(n_cameras, 1, 2)
    found, ones = robust(matrices, uv, sd_px=1.0), np.ones(uv.shape[:3])
    with pytest.raises(StopIteration):
        swap_states.names_put_right(
            matrices, uv, found, bones=np.zeros((0, 2), dtype=int), edited=np.zeros((1, 2), dtype=bool), relative=ones
        )
    assert way == ["sets" if sets else "rays"]


@pytest.mark.parametrize(("jumps", "straight", "evidence", "found"), [
    (True, False, 9.0, 0), (True, False, 12.0, 1), (False, True, 86.0, 0), (False, True, 100.0, 1)
])  # fmt: skip
def test_a_change_is_likely_at_a_jump_and_hardly_beside_a_straight_way(monkeypatch, jumps, straight, evidence, found):
    """Each costs 12, less 11 or more 30, and 8 to win; 0.02 for each of five frames."""
    monkeypatch.setattr(swaps, "jumped", lambda _, frames, *__: np.full(len(frames), jumps))
    monkeypatch.setattr(swaps, "unbroken", lambda _, frames, *__: np.full(len(frames), straight))
    xyz = np.zeros((60, 2, 3))
    xyz[25:30], xyz[35:40] = np.nan, np.nan
    alike = np.full(60, -100.0)
    alike[25:40] = 0.0
    alike[30:35] = evidence / 5
    assert len(runs_of(xyz, np.full(2, 1e-3), (0, 1), alike)[0]) == found


@pytest.mark.parametrize(("share", "known"), [(0.08, 1.0), (0.12, 5.0)])
def test_a_path_bends_by_its_90_percent_quantile(share, known):
    """Of second differences of 2.5 and a few of 12.5: 2.5 deviations, as of chi of three degrees of freedom."""
    away = np.full(100, 2.5)
    away[: round(100 * share)] = 12.5
    xyz = np.zeros((102, 1, 3))
    xyz[2:, 0, 0] = np.cumsum(np.cumsum(away))
    assert swaps.bend_scales(xyz)[0] == pytest.approx(known)
    assert np.sqrt(chdtri(3, 0.1)) == pytest.approx(2.5, rel=1e-3)


@pytest.mark.parametrize(("samples", "known"), [(9, False), (11, True)])
def test_what_is_usual_is_told_by_ten_samples(samples, known):
    """Lengths and bends; a length varies by a twentieth of itself, or what half of its samples are within."""
    path = np.zeros((samples + 2, 1, 3))
    assert np.isfinite(swaps.bend_scales(path)[0]) == known
    assert (swaps.usual_length(np.ones(samples)) == (1.0, 0.05)) == known
    far = np.where(np.arange(samples) % 2 == 0, 1.0, 1.2)
    far[0] = 1.1
    found = swaps.usual_length(far)
    assert (found is not None) == known
    assert found is None or found[1] == pytest.approx(1.4826 * 0.1 if found[0] == 1.1 else 1.4826 * 0.2)


@pytest.mark.parametrize(("varies", "frames", "pairs"), [(0.18, 31, 2), (0.22, 31, 0), (0.18, 29, 0)])
def test_a_steady_pair_varies_by_a_fifth(varies, frames, pairs):
    """In thirty frames that show both: half of the lengths are one deviation of 1 / 1.4826 off, up or down."""
    off = varies / 1.4826 * np.array([-1, 0, 1, 0, -1, 0, 1])
    xyz = np.zeros((frames, 2, 3))
    xyz[:, 1, 0] = 1 + np.resize(off * [1, 0, 1, 0, 1, 1, 1], frames)
    assert len(swaps.steady_pairs(xyz, np.zeros((0, 2), dtype=int))) == pairs


def test_a_marker_has_three_steady_ones():
    """The nearest to steady of four."""
    xyz = np.tile(np.arange(5.0)[:, None] * [1.0, 0, 0], (40, 1, 1))
    pairs = swaps.steady_pairs(xyz, np.zeros((0, 2), dtype=int))
    assert np.bincount(pairs[:, 0]).tolist() == [3] * 5


def test_a_way_goes_on_straight_within_five_deviations_of_each_coordinate():
    """A curvature of one a frame squared makes gap (gap + step) / 2 of it: of a gap of 3 after a step of 2."""
    xyz = np.full((6, 1, 3), np.nan)
    xyz[[0, 2, 5]] = 0.0
    limit = swaps.straight_on(xyz, np.array([0.1]))[1]
    assert limit[5, 0] == pytest.approx(np.sqrt(25 + 25 + 25) * 0.1 * 3 * (3 + 2) / 2)


@pytest.mark.parametrize(("share", "crossed"), [(0.3, True), (0.37, False)])
def test_ways_cross_where_each_is_three_times_as_near_to_the_others(share, crossed):
    """Two markers at rest that change places but for a share of the way."""
    xyz = np.zeros((4, 2, 3))
    xyz[:, 1, 0] = 1.0
    apart = share / (1 + share)  # from the other's place, of what it is from its own
    xyz[3, :, 0] = [1 - apart, apart]
    found = swaps.crossing_pairs(xyz, np.full(2, 1e-3))
    assert (found == {(0, 1)}) == crossed


@pytest.mark.parametrize(("near", "over"), [(0.3, True), (0.37, False)])
@pytest.mark.parametrize(("bend", "certain"), [(0.05, True), (0.065, False)])
def test_a_marker_went_over_that_is_three_times_as_near_to_the_others_way(near, over, bend, certain):
    """And where one way is known to half of the usual distance: 5 sqrt(3) deviations."""
    xyz = np.zeros((5, 2, 3))
    xyz[:, 1, 0] = 1.0
    xyz[3, 1] = np.nan
    xyz[3, 0, 0] = 1 - near / (1 + near)
    found = swaps.jumped(xyz, np.array([0, 1, 2, 4]), np.full(2, bend))
    assert found[-1] == (over and certain)


@pytest.mark.parametrize(("bend", "unlost"), [(0.052, True), (0.064, False)])
def test_a_way_that_goes_on_is_known_to_half_of_the_distance_of_both(bend, unlost):
    """One marker is seen all the time: 5 sqrt(3) deviations of a bend in a frame."""
    xyz = np.zeros((5, 2, 3))
    xyz[:, 1, 0] = 1.0
    xyz[3, 1] = np.nan
    assert unbroken(xyz, np.array([0, 1, 2, 4]), np.full(2, bend))[-1] == unlost


@pytest.mark.parametrize(("off", "near"), [(0.45, True), (0.6, False)])
def test_a_ray_is_another_markers_that_is_twice_as_near(off, near):
    """Two rays some 13 px from their points, and 0.41 or 0.51 of that from the other's."""
    matrices, _, uv = scene(4, 1, 3)
    found = robust(matrices, uv, sd_px=1.0)
    one = uv.copy()
    other = found.xyz_m.copy()
    at = project(matrices[:1], other)[0, 0]
    rays = _Rays(matrices, one, found, np.ones(uv.shape[:3]))
    rays.at = rays.at.copy()
    rays.at[0, 0] = at
    rays.at[0, 0, :2] = [[0.0, 0.0], [12.0, 0.0]]
    rays.uv = rays.uv.copy()
    rays.uv[0, 0, :2] = [[12.0, 12.0 * off], [0.0, 12.0 * off]]
    rays.miss = np.linalg.norm(rays.uv - rays.at, axis=-1)
    rays.suspect = np.zeros_like(rays.suspect)
    rays.suspect[0, 0, :2] = True
    assert (len(rays.suspected_pairs()[0]) == 1) == near


@pytest.mark.parametrize(("apart", "looked_at"), [(38.0, True), (42.0, False)])
def test_rays_forty_deviations_apart_are_tried(apart, looked_at):
    """Suspected or not."""
    matrices, _, uv = scene(4, 1, 3)
    rays = _Rays(matrices, uv, robust(matrices, uv, sd_px=1.0), np.ones(uv.shape[:3]))
    rays.uv = uv.copy()
    rays.uv[0, 0, 1] = rays.uv[0, 0, 0] + [apart, 0.0]
    assert rays._spoiled((0, 0, 1))[1][0] == looked_at


@pytest.mark.parametrize(("sure", "exchanged", "doubtful"), [(0.94, 0, 1), (0.994, 0, 1), (0.996, 1, 0), (0.04, 0, 0)])
@pytest.mark.parametrize(("apart_px", "tells"), [(2.7, False), (3.4, True)])
def test_an_exchange_is_certain_at_199_of_200_and_excluded_at_1_of_20(
    monkeypatch, sure, exchanged, doubtful, apart_px, tells
):
    """Of three cameras the first, in one frame between two that are right; nothing is told of clicks side by side."""
    probability = np.zeros((3, 8))
    probability[[0, 2], 0] = 1.0
    probability[1, 4], probability[1, 0] = sure, 1 - sure  # states count from the last camera
    monkeypatch.setattr(swap_states, "_posterior", lambda *_: probability)
    monkeypatch.setattr(swap_states, "_fits", lambda *_: (np.zeros((3, 8)), np.zeros((3, 8, 2, 3))))
    uv = np.zeros((3, 3, 2, 2))
    uv[:, :, 1, 0] = apart_px
    found = settled(stacked(ring(3)), uv)
    assert found.exchanged.sum() == exchanged
    assert found.doubtful.sum() == (doubtful and tells)


@pytest.mark.parametrize(
    ("off", "near", "doubted"), [(0.09, 0, True), (0.11, 0, False), (0.09, 3, True), (0.09, 5, False)]
)
def test_a_stretch_that_fills_a_hole_is_doubtful_where_its_marker_is_ten_times_as_far(off, near, doubted):
    """From a way along x: a metre in 80 frames, of which a twentieth may be nearer."""
    xyz = np.full((110, 2, 3), np.nan)
    xyz[:, 0] = np.arange(110)[:, None] * [1.0, 0, 0]
    xyz[:80, 1] = xyz[:80, 0] + [0.0, 1.0, 0.0]
    xyz[:near, 1, 1] = 0.5
    xyz[90:95, 1], xyz[90:95, 0] = xyz[90:95, 0] + [0.0, off, 0.0], np.nan
    _, doubtful = swaps.lone_runs(xyz, np.full(2, 0.1), [])
    assert doubtful[90:95, 1].all() == doubted
    assert doubtful.sum() == 5 * doubted


@pytest.mark.parametrize(("gain", "found"), [(19.0, 0), (21.0, 1)])
def test_a_run_in_one_camera_pays_for_a_change_and_a_margin(gain, found):
    """12 and 8 over, in two of ten frames."""
    each = np.full(10, -1.0)
    each[4:6] = gain / 2
    assert len(_runs((0, 0, 1), each, np.ones((10, 2), dtype=bool))) == found


@pytest.mark.parametrize(("distance", "count"), [(0.5, 40), (1.0, 20), (20.0, 1)])
def test_degrees_of_freedom_are_drawn_to_four_within_a_factor_of_e_to_the_half(distance, count):
    """Where the slopes of the density of so many equal distances and of the prior add up to 0, by SciPy, to 2 %."""

    def slope(log_nu):
        nu = np.exp(log_nu)
        by_log = count * nu * (-0.5 * np.log1p(distance / nu) + 0.5 * (nu + 2) * distance / (nu * (nu + distance)))
        return by_log - (log_nu - np.log(4.0)) / 0.5**2

    expected = np.exp(root_scalar(slope, bracket=(np.log(3.0), np.log(60.0))).root)
    assert _most_likely_dof(np.full(count, distance)) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("longer", "wrong"), [(0.23, False), (0.27, True)])
def test_a_bone_is_stretched_by_a_quarter_of_its_length(longer, wrong):
    """In one frame of thirty in which nothing else moves."""
    xyz = np.zeros((30, 2, 3))
    xyz[:, 1, 0] = 1.0
    xyz[10, 1, 0] = 1.0 + longer
    found = stretched(xyz, np.array([[0, 1]]))
    assert found.any() == wrong
    assert not np.delete(found, 10, axis=0).any()
