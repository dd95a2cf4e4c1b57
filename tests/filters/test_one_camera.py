"""A whole recording from one camera with a learned prior."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from mocap.filters import one_camera
from mocap.filters.errors import FilterError
from mocap.filters.misfit import Misfit
from mocap.filters.one_camera import LeftOut, jitter_px, left_out, shown, track_views
from mocap.filters.one_view import Poses, Recorded, Views
from mocap.filters.pose_prior import PosePrior, learn_prior, marker_sd, size_spread
from mocap.filters.poses import MarkerTrial
from mocap.filters.rays_and_bones import about
from mocap.filters.velocities import RatePoints
from scipy.spatial.transform import Rotation

from tests.filters.flapping_trials import MATRIX, NAMES, TRUNK, filmed, flapping


@pytest.fixture(scope="module")
def prior() -> PosePrior:
    """Of three trials."""
    return learn_prior([flapping(k) for k in (1, 2, 3)], [NAMES.index(m) for m in TRUNK])


def views_of(uv_px):
    """Of half a pixel."""
    return Views(matrices=MATRIX[None], uv_px=uv_px, sd_px=np.full(uv_px.shape[:3], 0.5))


@pytest.fixture(scope="module")
def found(prior):
    """A fourth trial, seen by one camera, with a wing tip hidden for 20 frames."""
    trial = flapping(9)
    uv = filmed(trial, np.random.default_rng(0))
    uv[:, 50:70, NAMES.index("tip_l")] = np.nan
    asked = RatePoints(names=NAMES, pairs=((0, 1),))
    return trial, track_views(prior, views_of(uv), rate_points=asked)


def test_poses_and_places_are_found_without_a_start(found):
    """Within 2 % of the distance of 1.5 m, and of the animal of 0.4 m relative to its mean: no mirror image."""
    trial, result = found
    error = result.estimate.xyz_m - trial.xyz_m
    relative = error - error.mean(axis=1, keepdims=True)
    assert np.sqrt(np.mean(np.sum(error**2, axis=-1))) < 0.03
    assert np.median(np.linalg.norm(relative, axis=-1)) < 0.005
    assert (np.linalg.norm(relative, axis=-1).max(axis=1) < 0.05).all()


def test_intervals_hold(found):
    """Of 95 % intervals at least 90 % hold the truth; depth is the coordinate that is known worst."""
    trial, result = found
    sd = np.sqrt(np.einsum("tmii->tmi", result.estimate.cov_m2))
    assert np.mean(np.abs(result.estimate.xyz_m - trial.xyz_m) < 1.96 * sd) > 0.9
    assert np.median(sd[..., 2]) > 5 * np.median(sd[..., :2])


def test_the_cost_falls_to_its_end(found):
    """No step was taken that did not lower the cost."""
    assert (np.diff(found[1].costs) <= 0).all()


def test_velocities_are_those_of_the_positions(found):
    """Central differences, with deviations that hold the truth."""
    trial, result = found
    rates = result.estimate.rates
    assert rates is not None
    truth = np.gradient(flapping(9).xyz_m, trial.t_s, axis=0)
    sd = np.sqrt(np.einsum("tmii->tmi", rates.own)[..., 3:])
    inner = slice(2, -2)
    known = np.abs(rates.velocity_m_s - truth)[inner] < 1.96 * np.hypot(sd, 3e-4 / np.sqrt(2) * 200)[inner]
    assert known.mean() > 0.9
    assert np.allclose(rates.own[:, 0, :3, :3], result.estimate.cov_m2[:, 0], rtol=1e-3)


def test_covariances_of_velocities_are_those_of_the_differences():
    """G C G' with C of all frames together and G of ``np.gradient``, also at both ends, where that is one-sided."""
    steps, rng = 5, np.random.default_rng(4)
    root = rng.normal(size=(3 * steps, 3 * steps))
    of_all = (root @ root.T).reshape(steps, 3, steps, 3)
    lags = [np.array([of_all[t + lag, :, t] for t in range(steps - lag)]) for lag in range(3)]
    rates = one_camera._rates(RatePoints(names=("tip",)), np.zeros((steps, 1, 3)), lags, 0.1)
    assert rates is not None
    slope = np.kron(np.gradient(np.eye(steps), 0.1, axis=0), np.eye(3))
    for t in range(steps):
        both = np.concatenate([np.kron(np.eye(steps)[t], np.eye(3)), slope[3 * t : 3 * t + 3]])
        assert np.allclose(rates.own[t, 0], both @ root @ root.T @ both.T, rtol=1e-5)


def test_gradient_is_that_of_the_cost(prior):
    """By differences of 1e-6 along random directions; the relative error of the second order is below 1e-4."""
    trial, rng = flapping(9, frames=20), np.random.default_rng(1)
    views = views_of(filmed(trial, rng))
    problem = Recorded(prior=prior, views=views)
    at = Poses(
        position_m=trial.xyz_m.mean(axis=1),
        rotation=np.linalg.qr(rng.normal(size=(20, 3, 3)))[0] * 1.0,
        z=0.01 * rng.normal(size=(20, prior.rank)),
    )
    at = replace(at, rotation=at.rotation * np.linalg.det(at.rotation)[:, None, None])
    at = replace(at, rotation=np.repeat(at.rotation[:1], 20, axis=0))
    form = problem.quadratic(at)
    step = 1e-6 * rng.normal(size=form.gradient.shape)
    change = (problem.cost(problem.moved(at, step)) - problem.cost(problem.moved(at, -step))) / 2
    assert np.sum(form.gradient * step) == pytest.approx(change, rel=1e-4)


def test_noise_of_rays_is_no_unknown_pose():
    """Trials of the same motion: 4 px, several times what shapes leave, make no more frames unlike them than 0.5 px do.

    Of 0.5 px see `test_phases_that_trials_lack_are_said`.
    """
    noise_px, trunk, trials = 4.0, [NAMES.index(m) for m in TRUNK], [flapping(k) for k in (1, 2)]
    rng, prior = np.random.default_rng(0), learn_prior(trials, trunk)
    uv = filmed(flapping(9), rng)
    uv += rng.normal(scale=np.sqrt(noise_px**2 - 0.25), size=uv.shape)
    views = Views(matrices=MATRIX[None], uv_px=uv, sd_px=np.full(uv.shape[:3], noise_px))
    assert track_views(prior, views, doubt=partial(left_out, trials=trials, trunk=trunk)).unlike.mean() < 0.05


def test_bones_that_lead_nowhere_leave_the_poses_of_rays(prior, found, monkeypatch):
    """A search with bones that does not end takes no result away, and is told."""

    def endless(*_):
        raise FilterError("not found")

    monkeypatch.setattr(one_camera, "held_by_bones", endless)
    trial = flapping(9)
    result = track_views(prior, views_of(filmed(trial, np.random.default_rng(0))))
    assert result.loose
    assert not found[1].loose
    assert np.median(np.linalg.norm(result.estimate.xyz_m - trial.xyz_m, axis=-1)) < 0.03


def test_too_few_markers_are_refused(prior):
    """A pose has six numbers of place and orientation."""
    uv = filmed(flapping(9), np.random.default_rng(0))
    uv[:, :, 3:] = np.nan
    with pytest.raises(FilterError, match="no frame shows 4 markers"):
        track_views(prior, views_of(uv))


def test_jitter_is_that_of_the_tracks():
    """White noise of 0.5 px on a motion of 0.3 mm at 1000 px per m: 0.58 px, to three errors of a median of 2400."""
    assert jitter_px(filmed(flapping(9), np.random.default_rng(0))) == pytest.approx(0.58, rel=0.06)


def test_phases_that_trials_lack_are_said():
    """Wings that are never lowered in trials, then are: half of the frames are flagged; 1 % of a trial like them.

    Intervals of 95 % hold 90 % of all frames, by errors of trials that were left out and by the misfit (without both
    73 % where wings are never lowered in trials).
    """
    trial, trunk = flapping(9, frames=60), [NAMES.index(m) for m in TRUNK]
    views = views_of(filmed(trial, np.random.default_rng(0)))
    for lift, least, most in (((-0.6, 0.9), 0.0, 0.05), ((0.15, 0.9), 0.4, 1.0)):
        trials = [flapping(k, lift=lift) for k in (1, 2, 3)]
        trials[0].xyz_m[0, 1:] = np.nan  # of one marker nothing is relative
        prior = learn_prior(trials, trunk)
        found = track_views(prior, views, doubt=partial(left_out, trials=trials, trunk=trunk))
        assert least <= found.unlike.mean() <= most
        sd = np.sqrt(np.einsum("tmii->tmi", found.estimate.cov_m2))
        assert np.mean(np.abs(found.estimate.xyz_m - trial.xyz_m) < 1.96 * sd) > 0.9


@pytest.mark.parametrize(("seed", "least", "most"), [(1, 0.2, 1.0), (3, 0.0, 0.05)])
def test_one_trial_is_believed_where_its_stated_deviations_hold(seed, least, most):
    """One leads to poses that are lost, which nothing but the misfit tells; the other to 2 mm, in its intervals.

    Of the first 14 of 30 frames were told on one processor and 15 or more on another.
    """
    trial, trunk = flapping(9, frames=30), [NAMES.index(m) for m in TRUNK]
    views = views_of(filmed(trial, np.random.default_rng(0)))
    found = track_views(learn_prior([flapping(seed)], trunk), views)
    assert least <= found.unlike.mean() <= most
    z = (found.estimate.xyz_m - trial.xyz_m) / np.sqrt(np.einsum("tmii->tmi", found.estimate.cov_m2))
    assert np.mean(np.abs(z)[~found.unlike] < 1.96) > 0.9


def test_halves_of_one_trial_tell_no_limit():
    """What they lack of each other is no measure of another trial; of two trials there is one."""
    trunk, trials = [NAMES.index(m) for m in TRUNK], [flapping(k, frames=40) for k in (1, 2)]
    for some, finite in ((trials[:1], False), (trials, True)):
        found = left_out(learn_prior(some, trunk), 5e-4, Misfit(), np.eye(3), trials=some, trunk=trunk)
        assert np.isfinite(found.most) == finite
        assert (np.diff(found.wider) >= 0).all()
        assert (found.wider >= 1).all()


def test_a_ray_costs_what_is_fair_where_deviations_are_right():
    """Student's t of two coordinates, 200,000 draws: 7/5, of which the standard error is 0.2 %."""
    rng, count = np.random.default_rng(0), 200_000
    miss = 0.5 * rng.normal(size=(count, 2)) / np.sqrt(rng.chisquare(5, size=(count, 1)) / 5)
    views = views_of(MATRIX[:2, 2] + miss[None, None])
    cost = views.cost(np.broadcast_to([0.0, 0.0, 1.0], (1, count, 3)))
    assert cost[0] / count == pytest.approx(views.fair, rel=0.01)


def test_wrong_clicks_are_no_unknown_pose(prior):
    """One ray in forty is off by 80 px: of a trial like those that taught 3 % are called unlike (41 if each counts)."""
    trial, rng = flapping(9), np.random.default_rng(0)
    uv = filmed(trial, rng)
    wrong = rng.random(uv.shape[:3]) < 0.025
    uv[wrong] += 80.0 * rng.normal(size=(int(wrong.sum()), 2))
    found = one_camera.track_views(prior, views_of(uv))
    assert found.unlike.mean() < 0.05


def test_a_frame_that_shows_too_little_is_as_strange_as_those_around(prior, monkeypatch):
    """Nothing is seen for 10 of 30 frames, longer than what shapes leave lasts: they are as the others."""
    uv = filmed(flapping(9, frames=30), np.random.default_rng(0))
    uv[:, 10:20] = np.nan
    doubted = LeftOut(most=0.0, strange=np.zeros(1), wider=np.full(1, 4.0))
    monkeypatch.setattr(Views, "fair", 0.0)
    found = track_views(prior, views_of(uv), doubt=lambda *_: doubted)
    assert prior.lasts < 10
    assert found.unlike.all()
    assert (found.wider == 2.0).all()


def test_a_single_trial_may_lack_its_first_half(prior):
    """What it leaves is learned from halves of the frames that it shows."""
    trial = flapping(1)
    late = np.arange(len(trial.t_s)) > len(trial.t_s) // 2
    half = replace(trial, xyz_m=np.where(late[:, None, None], trial.xyz_m, np.nan))
    found = learn_prior([half], [NAMES.index(m) for m in TRUNK])
    assert np.isfinite(found.left_sd).all()
    assert found.dt_s == prior.dt_s


def rays_and_bones(prior, at, trial, rng):
    """A problem about some poses, with rays of half a pixel."""
    views = views_of(filmed(trial, rng))
    wide = replace(views, sd_px=np.full(views.sd_px.shape, 5.0))
    return about(Recorded(prior=prior, views=wide), views, at)


def test_gradient_with_bones_is_that_of_the_cost(prior):
    """As above, of an animal that turns by 0.3 rad a frame: by each state's random directions, to 1e-4."""
    trial, rng = flapping(9, frames=20), np.random.default_rng(1)
    turn = Rotation.from_rotvec(0.3 * np.arange(20)[:, None] * [0.6, 0.0, 0.8] + 0.002 * rng.normal(size=(20, 3)))
    at = Poses(position_m=trial.xyz_m.mean(axis=1), rotation=turn.as_matrix(), z=prior.shapes[50:70])
    problem = rays_and_bones(prior, at, trial, rng)
    gradient = problem.quadratic(at).gradient
    assert np.abs(problem.offset).max() > 0.005
    for state in range(gradient.shape[1]):
        step = np.zeros(gradient.shape)
        step[:, state] = 1e-7 * rng.normal(size=20)
        change = (problem.cost(problem.moved(at, step)) - problem.cost(problem.moved(at, -step))) / 2
        assert np.sum(gradient * step) == pytest.approx(change, rel=1e-4)


def test_what_shapes_leave_is_integrated_out(prior):
    """Linear rows (no bone bends, all rays are far): the cost is the least over e of its own squares and rows'."""
    trial, rng = flapping(9, frames=3), np.random.default_rng(2)
    at = Poses(position_m=trial.xyz_m.mean(axis=1), rotation=np.tile(np.eye(3), (3, 1, 1)), z=np.zeros((3, prior.rank)))
    problem = rays_and_bones(prior, at, trial, rng)
    missed, rays, unit = problem.rows_missed(at)
    change = problem.changed(rays, unit, np.tile(np.eye(len(prior.mean)), (3, 1, 1)))
    wide = problem.views
    weight = (wide.dof + 2) / (wide.dof + np.sum(wide.missed(problem.markers(at)) ** 2, axis=-1))[0]
    own = np.repeat(weight, 3, axis=1) / prior.left_sd**2
    noise = np.concatenate([np.repeat(weight, 2, axis=1) / 0.25, np.tile(1 / prior.bones.sd_m**2, (3, 1))], axis=1)
    for frame in range(3):
        a = np.vstack([np.diag(np.sqrt(own[frame])), np.sqrt(noise[frame])[:, None] * change[frame]])
        y = np.concatenate([np.zeros(len(own[frame])), np.sqrt(noise[frame]) * missed[frame]])
        least = np.linalg.lstsq(a, y, rcond=None)[1]
        assert problem.apart(at)[frame] - prior.hold.value(at.z)[frame] == pytest.approx(0.5 * least[0], rel=1e-6)


def test_bones_tell_how_far_an_animal_is():
    """Marker noise of 5 mm that shapes leave: with bones of 0.5 mm its depth is known better than without."""
    trials = [flapping(k) for k in (1, 2, 3)]
    own = learn_prior(trials, [NAMES.index(m) for m in TRUNK])
    left = replace(own, left_sd=np.full(own.left_sd.shape, 5e-3), size_sd=0.0)
    none = replace(left.bones, ends=left.bones.ends[:0], length_m=left.bones.length_m[:0], sd_m=left.bones.sd_m[:0])
    views = views_of(filmed(flapping(9), np.random.default_rng(0)))
    sd = [track_views(prior, views).estimate.cov_m2[:, 0, 2, 2] for prior in (left, replace(left, bones=none))]
    assert len(left.bones.ends) > 0
    assert np.median(np.sqrt(sd[0] / sd[1])) < 0.9


def test_deviations_of_markers_hold_in_trials_to_come():
    """Offsets of markers, each of its own size, in three trials and a fourth: its mean square is what was said.

    By the mean square of each marker in three trials alone it is 1.31 times what was said. 400 draws of 15 markers know
    that to 2 %.
    """
    rng, ratio = np.random.default_rng(0), []
    for _ in range(400):
        sizes = np.exp(0.4 * rng.normal(size=15))
        offsets = sizes[:, None] * rng.normal(size=(4, 15, 3))
        said = marker_sd([np.tile(one.ravel(), (5, 1)) for one in offsets[:3]])
        ratio.append(np.mean(offsets[3] ** 2, axis=-1) / said**2)
    assert 0.9 < np.mean(ratio) < 1.1


def scaled(trial: MarkerTrial, log_size: float) -> MarkerTrial:
    """An animal of another size."""
    return replace(trial, xyz_m=np.exp(log_size) * trial.xyz_m, sd_m=np.exp(log_size) * trial.sd_m)


def test_sizes_of_trials_are_those_of_their_bones():
    """Of two animals of e^0.1: sqrt(3/2 (0.02^2 + 2 0.05^2) / 2), also where a marker sits elsewhere.

    Lengths of bones are known to 0.5 %, one of 11 or so moves a median by less.
    """
    one, two = flapping(1), flapping(2)
    large = scaled(two, 0.1)
    moved = replace(large, xyz_m=large.xyz_m + np.where(np.arange(len(NAMES))[:, None] == 0, [0.0, 0.01, 0.0], 0.0))
    assert size_spread([one, two]) == pytest.approx(0.02 * np.sqrt(1.5 / 2), rel=0.02)
    for other in (large, moved):
        assert size_spread([one, other]) == pytest.approx(np.sqrt(1.5 * (0.02**2 + 2 * 0.05**2) / 2), rel=0.05)
    assert size_spread([one]) == pytest.approx(0.02 * np.sqrt(2))


@pytest.mark.parametrize("trials", [1, 2, 3])
def test_a_trial_to_come_is_as_large_as_few_trials_say(trials):
    """Sizes that spread as those of animals do: the next one is off the mean of few by what these state.

    150 draws: root mean squares of errors are known to 1 / sqrt(300), of deviations of one more trial to as much.
    """
    rng = np.random.default_rng(trials)
    known, off, stated = [flapping(seed, frames=60) for seed in range(1, 1 + trials)], [], []
    for _ in range(150):
        *sizes, coming = 0.02 * rng.normal(size=trials + 1)
        stated.append(size_spread([scaled(trial, size) for trial, size in zip(known, sizes, strict=True)]))
        off.append(coming - np.mean(sizes))
    assert np.sqrt(np.mean(np.square(off)) / np.mean(np.square(stated))) == pytest.approx(1.0, abs=0.16)


def test_frames_before_enough_is_seen_are_not_tracked():
    """From the first to the last frame of which a camera sees four markers; those between may show fewer."""
    seen = np.zeros((2, 10, 6), dtype=bool)
    seen[0, 1:9, :2] = True
    seen[1, [3, 7], :4] = True
    assert shown(seen) == slice(3, 8)
    assert shown(seen[:1]) == slice(0, 0)
