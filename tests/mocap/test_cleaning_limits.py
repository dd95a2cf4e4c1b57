"""Each threshold of cleaning, with a case just below and one just above it, on rays and paths made for it."""

import numpy as np
import pytest

from mocap.cameras.camera import project, stacked
from mocap.cameras.triangulate import linear, residual_px, robust
from mocap.cleaning import swap_states
from mocap.cleaning.bias import hand_sd, lasting_share, persistent_px
from mocap.cleaning.camera_health import camera_health
from mocap.cleaning.click_noise import _most_likely_dof, student_t
from mocap.cleaning.likelihoods import likelihood_noise
from mocap.cleaning.swap_states import settle
from mocap.cleaning.swapped_rays import _Rays, agreement, extent_px
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
        agreement(matrices, one, np.ones((2, 1, 2)), sd_px=1.0, detail=detail, outliers=0.05)[0][0] / 4
        for one in (uv, other)
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
