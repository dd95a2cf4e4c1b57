"""Regression on delayed poses: what it says of missing markers, and what it learns of the trial itself."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.anatomy import Anatomy
from mocap.filters.models import delayed_poses
from mocap.filters.models.base import TrialSet
from mocap.filters.models.delayed_poses import Delayed, Neighbours, body_itself, completed, fill_delayed, gaps_of
from mocap.filters.poses import MarkerTrial
from mocap.filters.records import Estimate

from tests.filters.test_gaps_in_trials import trial_of

RANKS = (2,)
TRUNK = [0, 1, 2, 3]


def lost(trial, marker, frames):
    """The trial without some frames of a marker."""
    xyz = trial.xyz_m.copy()
    xyz[frames, marker] = np.nan
    return replace(trial, xyz_m=xyz)


def known_of(trial):
    """Poses of a trial and of two others, and what is known of their shapes."""
    return TrialSet([trial_of(1), trial_of(2), trial], Anatomy(tuple(TRUNK))).shapes(RANKS)


def filled(trial, *law) -> Estimate:
    """What the regression says of a trial, learned from others; its covariance too where none is given."""
    return fill_delayed(trial.seen, *known_of(trial), *law)


@pytest.fixture(scope="module")
def law():
    """The covariance that trials without gaps teach: learning it takes nine tenths of the time of filling gaps."""
    return tuple(Delayed(*known_of(trial_of(3))).covariance().logarithms.tolist())


def test_it_speaks_of_gaps_alone(law):
    """Where the trial has a measurement it says nothing; in gaps, those at both ends among them, it has positions.

    Their covariances are symmetric and positive definite.
    """
    trial = lost(lost(lost(trial_of(3), 5, slice(40, 70)), 6, slice(0, 12)), 7, slice(100, 120))
    found = filled(trial, law)
    np.testing.assert_array_equal(np.isfinite(found.xyz_m[..., 0]), ~trial.seen)
    cov = found.cov_m2[~trial.seen]
    np.testing.assert_allclose(cov, np.swapaxes(cov, -1, -2), rtol=0, atol=1e-12 * np.abs(cov).max())
    assert (np.linalg.eigvalsh(cov) > 0).all()


@pytest.fixture(scope="module")
def one_gap():
    """A wing hidden for 30 frames: the trial, and what is said of it."""
    trial = lost(trial_of(3), 5, slice(40, 70))
    return trial, filled(trial).xyz_m


def test_a_marker_that_moves_with_others_is_found(one_gap):
    """All wings are on one loop of shapes: what the others show says where the hidden one is.

    Three wings of four are seen. The ridge, a tenth of the mean variance, takes less than a tenth of the 20 mm that a
    wing deviates by; smoothing at a cutoff of 4 takes 1 / 4^4 of it; noise is 0.1 mm.
    """
    miss = (one_gap[1] - trial_of(3).xyz_m)[40:70, 5]
    assert np.sqrt(np.mean(np.sum(miss**2, axis=1))) < 2e-3


def test_all_hidden_at_once_are_as_in_the_mean(law):
    """Nothing is left to look at: far from the edges it is the mean pose, as wide as the motion, and finite."""
    trial = trial_of(3)
    for marker in range(8):
        trial = lost(trial, marker, slice(30, 90))
    found = filled(trial, law)
    middle = found.xyz_m[60] - found.xyz_m[60, :1]
    recorded = trial_of(3).xyz_m[:30] - trial_of(3).xyz_m[:30, :1]
    extent = np.linalg.norm(np.ptp(recorded, axis=0), axis=-1)
    assert (np.linalg.norm(middle - recorded.mean(axis=0), axis=-1) < 0.5 * extent + 2e-3).all()
    sd = np.sqrt(np.trace(found.cov_m2[60], axis1=-2, axis2=-1))
    assert (sd[4:] > 0.2 * extent[4:]).all()
    assert sd[4:].min() > 1.5 * sd[:4].max()


def test_turned_and_moved_worlds_change_nothing_else(one_gap):
    """Rotation and translation of a recording carry over to what is filled, to the rounding of its subspace."""
    rng = np.random.default_rng(4)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    trial, found = one_gap
    moved = replace(trial, xyz_m=trial.xyz_m @ turn.T + [3.0, -1.0, 0.5])
    one, other = found[40:70, 5], filled(moved).xyz_m[40:70, 5]
    np.testing.assert_allclose(other, one @ turn.T + [3.0, -1.0, 0.5], rtol=0, atol=2e-5)


def test_a_trial_has_its_own_offset():
    """A wing tip that was marked 15 mm further out in this trial: what its seen frames say holds in the gap as well.

    The others say 15 mm less; a trial's own constant takes it in all frames, not only near the edges.
    """

    def placed(frames=slice(0, 0)):
        trial = trial_of(3)
        xyz = trial.xyz_m.copy()
        xyz[:, 5] += [0.0, 0.0, 0.015]
        return lost(replace(trial, xyz_m=xyz), 5, frames)

    gap = slice(30, 90)
    miss = (filled(placed(gap)).xyz_m - placed().xyz_m)[gap, 5]
    assert np.sqrt(np.mean(np.sum(miss**2, axis=1))) < 3e-3


def test_intervals_are_of_the_size_of_errors(law):
    """Each wing lost once for 20 frames: of 240 coordinates 90 to 100 in 100 lie in 95 % intervals."""
    truth = trial = trial_of(3)
    for marker in range(4, 8):
        trial = lost(trial, marker, slice(25 * marker - 85, 25 * marker - 65))
    found = filled(trial, law)
    variance = np.diagonal(found.cov_m2, axis1=2, axis2=3) + 1e-8
    inside = (np.abs(found.xyz_m - truth.xyz_m) < 1.96 * np.sqrt(variance))[~trial.seen]
    assert 0.9 < np.mean(inside) <= 1  # binomial deviation 1.4 %


def test_a_marker_that_nobody_saw_has_no_position(law):
    """Not in this trial, not in the others: nothing is said, rather than anything."""
    gone = [lost(trial_of(seed), 6, slice(None)) for seed in (1, 2, 3)]
    fitting = TrialSet(gone, Anatomy(tuple(TRUNK)))
    found = fill_delayed(gone[-1].seen, *fitting.shapes(RANKS), law)
    assert np.isnan(found.xyz_m).all()


def test_regressors_are_delayed_poses_whose_ends_are_held():
    """Against a loop over frames and delays, centred and scaled, of markers that move as one with the asked.

    All weights are then alike. From the neighbours all delays are in the frame of the row itself.
    """
    poses, shapes = TrialSet([trial_of(1), trial_of(2)], Anatomy(tuple(TRUNK))).shapes(RANKS)
    known = Delayed(poses, shapes)
    known._apart[:] = 0.0
    frames = np.array([[0, 0], [0, 60], [1, 119]])
    others = np.isin(np.arange(8), (1, 4, 6))
    whole = [pose.reshape(-1, 8, 3) for pose in completed(poses, shapes)]
    near = Neighbours.of(others, known._at(frames), np.zeros(3))
    from_body, from_near = known._tasks(5, others, frames, frames[:0])
    for task, frames_of in ((from_body, lambda _: body_itself(1)), (from_near, near.frames)):
        expected = np.zeros((3, len(known._lags), 8, 3))
        for row, (k, frame) in enumerate(frames):
            at = frames_of(whole[k][[frame]])
            for column, lag in enumerate(known._lags):
                delayed = whole[k][min(max(frame + lag, 0), 119)][others]
                expected[row, column, others] = (delayed - at.position_m[0]) @ at.rotation[0]
        expected = (expected - expected.mean(axis=0)).reshape(3, -1)
        expected /= np.sqrt(np.mean(np.sum(expected**2, axis=1)))
        np.testing.assert_allclose(task.rows.x, expected, atol=1e-12)


def test_gaps_are_found_with_their_edges():
    """Against a table written by hand: gaps inside, at the ends, of a frame, and one frame between two of them."""
    text = ["..xxxx..x.xx", "xx..........", "............"]
    seen = np.array([[c == "." for c in line] for line in text]).T
    found = [(gap.marker, list(gap.inside), sorted(gap.edges), list(gap.others)) for gap in gaps_of(seen)]
    assert found == [
        (0, [2, 3, 4, 5], [0, 1, 6, 7, 9], [False, True, True]),
        (0, [8], [6, 7, 9], [False, True, True]),
        (0, [10, 11], [1, 6, 7, 9], [False, True, True]),
        (1, [0, 1], [2, 3, 4, 5, 7, 10], [True, False, True]),
    ]


def test_poses_are_completed_where_they_are_not_seen():
    """Measured entries stay to the last bit; a hidden wing is put where the subspace has it, within 2 mm of 60."""
    trial = lost(trial_of(3), 5, slice(40, 70))
    poses, shapes = TrialSet([trial_of(1), trial], Anatomy(tuple(TRUNK))).shapes(RANKS)
    whole = completed(poses, shapes)[-1].reshape(*trial.seen.shape, 3)
    measured = poses[-1].y.reshape(whole.shape)
    np.testing.assert_array_equal(whole[trial.seen], measured[trial.seen])
    truth = poses[-1].frames.to_body(trial_of(3).xyz_m)
    assert np.linalg.norm(whole[40:70, 5] - truth[40:70, 5], axis=-1).max() < 2e-3


def test_a_short_trial_alone_is_filled(monkeypatch):
    """Five frames and a lag that reaches beyond them all: numbers, and no error."""
    rng = np.random.default_rng(6)
    xyz = rng.normal(0, 0.1, (5, 4, 3))
    xyz[2, 1] = np.nan
    trial = MarkerTrial(name="short", t_s=0.01 * np.arange(5), xyz_m=xyz, sd_m=np.full((5, 4), 1e-4))
    poses, shapes = TrialSet([trial], Anatomy(tuple(TRUNK))).shapes((1,))
    monkeypatch.setattr(delayed_poses, "LAGS", np.array((-300.0, 0.0, 300.0)))
    found = fill_delayed(trial.seen, poses, shapes)
    assert np.isfinite(found.xyz_m[2, 1]).all()
