"""A whole recording from one camera with a learned prior."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.errors import FilterError
from mocap.filters.motion.bones import Bones
from mocap.filters.one_camera import jitter_px, most_strange, track_views
from mocap.filters.one_view import Poses, Recorded, Views
from mocap.filters.pose_prior import PosePrior, kept_by_shapes, learn_prior, marker_sd
from mocap.filters.velocities import Asked

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
    asked = Asked(names=NAMES, pairs=((0, 1),))
    return trial, track_views(prior, views_of(uv), asked=asked)


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
    """Wings that are never lowered in trials, then are: most frames are flagged; 1 % of those of a trial like them."""
    trunk, views = [NAMES.index(m) for m in TRUNK], views_of(filmed(flapping(9), np.random.default_rng(0)))
    for lift, least, most in (((-0.6, 0.9), 0.0, 0.05), ((0.15, 0.9), 0.7, 1.0)):
        trials = [flapping(k, lift=lift) for k in (1, 2, 3)]
        found = track_views(learn_prior(trials, trunk), views, limit=most_strange(trials, trunk))
        assert least <= found.unlike.mean() <= most


def test_bones_are_as_long_as_shapes_have_them():
    """A bar of 82 mm that turns by 1.2 rad either way, as one shape shows it: shorter in the middle, and it varies."""
    turn = np.linspace(-1.2, 1.2, 200)
    bar = 0.082 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    chord = np.column_stack([np.full(200, 0.082 * np.mean(np.cos(turn))), bar[:, 1:]])
    raw = Bones(ends=np.array([[0, 1]]), length_m=np.array([0.082]), sd_m=np.array([3e-4]))
    seen = np.concatenate([np.zeros((200, 3)), chord], axis=1)
    seen[0] = np.nan
    kept = kept_by_shapes(raw, seen)
    length = np.linalg.norm(chord[1:], axis=1)
    assert kept.length_m == pytest.approx(length.mean())
    assert kept.sd_m == pytest.approx(np.hypot(length.std(), 3e-4))
    assert len(kept_by_shapes(raw, np.full((5, 6), np.nan)).ends) == 0


def test_shorter_bones_cost_what_they_say(prior):
    """Alone of all that a frame costs, bones change with the length that they should have."""
    at = Poses(position_m=np.zeros((1, 3)), rotation=np.eye(3)[None], z=np.zeros((1, prior.rank)))
    views = views_of(np.full((1, 1, prior.markers, 2), np.nan))
    a, b = prior.bones.ends.T
    length = np.linalg.norm(prior.mean.reshape(-1, 3)[a] - prior.mean.reshape(-1, 3)[b], axis=1)
    exact, longer = (replace(prior, bones=replace(prior.bones, length_m=by * length)) for by in (1.0, 1.1))
    more = Recorded(prior=longer, views=views).apart(at) - Recorded(prior=exact, views=views).apart(at)
    assert len(a) > 0
    assert more[0] == pytest.approx(0.5 * np.sum((0.1 * length / prior.bones.sd_m) ** 2))


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
