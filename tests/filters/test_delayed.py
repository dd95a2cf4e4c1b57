"""Regression on delayed poses: what it says of missing markers, and how it joins what was measured."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from filters.delayed import DelaySettings, Filled, carried, completed, delayed, fill_delayed, gaps_of, regression
from filters.fitting import Fitting
from filters.observations import PositionObservations
from filters.poses import MarkerTrial
from tests.filters.test_tuning import trial_of

SETTINGS = DelaySettings(ranks=(2,))
TRUNK = [0, 1, 2, 3]


def lost(trial, marker, frames):
    """The trial without some frames of a marker."""
    xyz = trial.xyz_m.copy()
    xyz[frames, marker] = np.nan
    return replace(trial, xyz_m=xyz)


def filled(trial, *, others=(1, 2), settings=SETTINGS) -> Filled:
    """What the regression says of a trial, learned from others."""
    fitting = Fitting([*(trial_of(seed) for seed in others), trial], TRUNK)
    return fitting.fill(settings, PositionObservations(xyz_m=trial.xyz_m, sd_m=trial.sd_m))


def test_it_speaks_of_gaps_alone():
    """Where the trial has a measurement it says nothing; in gaps, those at both ends among them, it has positions.

    Their covariances are symmetric and positive definite.
    """
    trial = lost(lost(lost(trial_of(3), 5, slice(40, 70)), 6, slice(0, 12)), 7, slice(100, 120))
    found = filled(trial)
    np.testing.assert_array_equal(np.isfinite(found.xyz_m[..., 0]), ~trial.seen)
    cov = found.cov_m2[~trial.seen]
    np.testing.assert_allclose(cov, np.swapaxes(cov, -1, -2), rtol=0, atol=1e-12 * np.abs(cov).max())
    assert (np.linalg.eigvalsh(cov) > 0).all()


@pytest.mark.parametrize("lags", [(0.0,), (-0.7, -0.35, 0.0, 0.35, 0.7)])
def test_a_marker_that_moves_with_others_is_found(lags):
    """All wings are on one loop of shapes: what the others show says where the hidden one is.

    Three wings of four are seen. The ridge, a tenth of the mean variance, takes less than a tenth of the 20 mm that a
    wing deviates by; smoothing at a cutoff of 4 takes 1 / 4^4 of it; noise is 0.1 mm.
    """
    trial = lost(trial_of(3), 5, slice(40, 70))
    miss = (filled(trial, settings=replace(SETTINGS, lags=lags)).xyz_m - trial_of(3).xyz_m)[40:70, 5]
    assert np.sqrt(np.mean(np.sum(miss**2, axis=1))) < 2e-3


def test_all_hidden_at_once_are_as_in_the_mean():
    """Nothing is left to look at: far from the edges it is the mean pose, as wide as the motion, and finite."""
    trial = trial_of(3)
    for marker in range(8):
        trial = lost(trial, marker, slice(30, 90))
    found = filled(trial)
    middle = found.xyz_m[60] - found.xyz_m[60, :1]
    recorded = trial_of(3).xyz_m[:30] - trial_of(3).xyz_m[:30, :1]
    extent = np.linalg.norm(np.ptp(recorded, axis=0), axis=-1)
    assert (np.linalg.norm(middle - recorded.mean(axis=0), axis=-1) < 0.5 * extent + 2e-3).all()
    sd = np.sqrt(np.trace(found.cov_m2[60], axis1=-2, axis2=-1))
    assert (sd[4:] > 0.2 * extent[4:]).all()
    assert sd[4:].min() > 1.5 * sd[:4].max()


def test_turned_and_moved_worlds_change_nothing_else():
    """Rotation and translation of a recording carry over to what is filled, to the rounding of its subspace."""
    rng = np.random.default_rng(4)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    trial = lost(trial_of(3), 5, slice(40, 70))
    moved = replace(trial, xyz_m=trial.xyz_m @ turn.T + [3.0, -1.0, 0.5])
    one, other = filled(trial).xyz_m[40:70, 5], filled(moved).xyz_m[40:70, 5]
    np.testing.assert_allclose(other, one @ turn.T + [3.0, -1.0, 0.5], rtol=0, atol=2e-5)


def test_the_regression_is_the_conditional_mean():
    """Two markers at two delays from a known Gaussian: against its density on a line, whose top and width it is."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(12, 12))
    cov = (root @ root.T).reshape(2, 6, 2, 6)
    mean = rng.normal(size=(2, 6))
    rows = rng.normal(size=(3, 2, 6))
    said, left = regression(rows, np.array([True, False]), np.array([1]), np.array([0, 4]), mean, cov)
    known, asked = [0, 1, 2, 6, 7, 8], [3, 4, 5]
    square, centre = cov.reshape(12, 12), mean.ravel()
    law = multivariate_normal(centre[known + asked], square[np.ix_(known + asked, known + asked)])
    for row, point in zip(rows.reshape(3, 12), said[:, 0], strict=True):

        def log_density(x, row=row):
            return law.logpdf(np.concatenate([row[known], x]))

        step = 1e-4
        for axis in np.eye(3) * step:
            slope = (log_density(point + axis) - log_density(point - axis)) / (2 * step)
            assert abs(slope) < 1e-5
        directions = np.linalg.cholesky(left[0, 0])
        for direction in directions.T:  # one deviation from the top a normal density is lower by 1/2
            assert log_density(point) - log_density(point + direction) == pytest.approx(0.5, abs=1e-8)


def test_what_is_missed_at_the_edges_is_carried_in():
    """Without noise it is met at the edges and dies with the memory; without edges nothing is carried.

    A Matern-3/2 process has lost 99 % of its memory after 6.6 / sqrt(3) = 3.8 memories.
    """
    edges, inside = np.array([8, 9, 60, 61]), np.arange(10, 60)
    miss = np.array([[1.0, 0, 0], [1.0, 0, 0], [0, -2.0, 0], [0, -2.0, 0]])
    shift, share = carried(edges, miss, inside, memory=4.0, noise=1e-9)
    assert shift[0] == pytest.approx([1, 0, 0], abs=0.15)
    assert shift[-1] == pytest.approx([0, -2, 0], abs=0.3)
    assert np.abs(shift[16:-16]).max() < 0.05
    assert share[25] == pytest.approx(1, abs=1e-3)
    assert share[0] < 0.2
    at_edges, none_left = carried(edges, miss, edges, memory=4.0, noise=1e-9)
    np.testing.assert_allclose(at_edges, miss, atol=1e-6)
    assert none_left.max() < 1e-5
    nothing, all_left = carried(np.zeros(0, dtype=int), np.zeros((0, 3)), inside, memory=4.0, noise=0.1)
    assert not nothing.any()
    assert (all_left == 1).all()


def test_delays_are_shifts():
    """Row t, delay k is the pose at t + lag, and nothing beyond the ends, also where a lag is longer than the trial."""
    y = np.arange(10.0).reshape(5, 2)
    found = delayed(y, np.array([-7, -1, 0, 2]))
    assert np.isnan(found[:, 0]).all()
    np.testing.assert_array_equal(found[1:, 1], y[:-1])
    np.testing.assert_array_equal(found[:, 2], y)
    np.testing.assert_array_equal(found[:3, 3], y[2:])
    assert np.isnan(found[0, 1]).all()
    assert np.isnan(found[3:, 3]).all()


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
    poses, shapes = Fitting([trial_of(1), trial], TRUNK).shapes(SETTINGS)
    whole = completed(poses, shapes)[-1].reshape(*trial.seen.shape, 3)
    measured = poses[-1].y.reshape(whole.shape)
    np.testing.assert_array_equal(whole[trial.seen], measured[trial.seen])
    truth = poses[-1].frames.to_body(trial_of(3).xyz_m)
    assert np.linalg.norm(whole[40:70, 5] - truth[40:70, 5], axis=-1).max() < 2e-3


def test_a_short_trial_alone_is_filled():
    """Five frames and a lag that reaches beyond them all: numbers, and no error."""
    rng = np.random.default_rng(6)
    xyz = rng.normal(0, 0.1, (5, 4, 3))
    xyz[2, 1] = np.nan
    trial = MarkerTrial(name="short", t_s=0.01 * np.arange(5), xyz_m=xyz, sd_m=np.full((5, 4), 1e-4))
    poses, shapes = Fitting([trial], TRUNK).shapes(DelaySettings(ranks=(1,)))
    found = fill_delayed(trial, poses, shapes, DelaySettings(ranks=(1,), lags=(-300.0, 0.0, 300.0)))
    assert np.isfinite(found.xyz_m[2, 1]).all()
