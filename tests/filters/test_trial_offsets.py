"""Poses of several trials: one subspace, an offset of each trial in every dimension."""

import numpy as np
import pytest
from mocap.filters.subspace import hide_blocks, principal_components

from tests.filters.test_pose_subspace import low_rank, principal_angle

TRIALS, FRAMES, MARKERS, RANK, NOISE, OFFSET = 6, 200, 8, 3, 1e-3, 0.02


@pytest.fixture(scope="module")
def trials():
    """Noisy poses, clean ones, their basis, offsets (mean included) of each trial, and the trial of each pose.

    Every trial goes through whole cycles, so that its scores have no mean and offsets are what they are said to be.
    """
    rng = np.random.default_rng(2)
    size = 3 * MARKERS
    t, basis = np.arange(FRAMES) / FRAMES, np.linalg.qr(rng.normal(size=(size, RANK)))[0]
    offset = rng.normal(0, 0.3, size) + OFFSET * rng.normal(size=(TRIALS, size))
    phase = rng.uniform(0, 1, (TRIALS, 1, RANK))
    scores = 0.2 * np.sin(2 * np.pi * (t[:, None] * [2, 3, 5] + phase)) * [1, 0.8, 0.6]
    clean = (offset[:, None] + scores @ basis.T).reshape(-1, size)
    return clean + NOISE * rng.normal(size=clean.shape), clean, basis, offset, np.repeat(np.arange(TRIALS), FRAMES)


def test_offsets_and_loadings_are_recovered(trials):
    """Loadings to noise / amplitude, offsets to noise / sqrt(frames) where the scores do not reach, poses to the noise.

    Within the span of the loadings an offset of a trial is a mean of its scores as well: only their sum is known. A
    pose has three scores from 24 coordinates and an offset from 200 frames: noise sqrt(3 / 24 + 1 / 200).
    """
    y, clean, basis, offset, trial = trials
    found = principal_components(y, RANK, trial=trial)
    assert principal_angle(found.loading, basis) < 0.005
    off = found.mean + found.trial_offset - offset
    outside = off - off @ basis @ basis.T
    assert np.sqrt(np.mean(outside**2)) < 1.2 * NOISE / np.sqrt(FRAMES)
    assert np.sqrt(np.mean((found.poses - clean) ** 2)) < 1.1 * NOISE * np.sqrt(3 / 24 + 1 / 200)
    assert np.sqrt(found.noise) == pytest.approx(NOISE, rel=0.02)
    assert np.sqrt(np.mean(found.trial_sd**2)) == pytest.approx(OFFSET, rel=0.3)  # of 6 trials: 1 / sqrt(12), span lost
    without = principal_components(y, RANK)
    assert np.sqrt(without.noise) > 10 * NOISE


def test_gaps_of_a_trial_are_filled_about_its_own_mean(trials):
    """A third of all samples hidden: completed to the noise, as in a single trial."""
    y, clean, basis, _, trial = trials
    seen = ~hide_blocks(np.ones((len(y), MARKERS), dtype=bool), np.random.default_rng(3), share=0.35, length=15)
    seen = np.repeat(seen, 3, axis=1)
    found = principal_components(np.where(seen, y, np.nan), RANK, trial=trial)
    assert principal_angle(found.loading, basis) < 0.01
    assert np.sqrt(np.mean((found.poses - clean)[~seen] ** 2)) < NOISE


def test_a_marker_that_a_trial_lacks_is_where_the_others_have_it(trials):
    """Without a sighting a trial's offset is zero: the marker is wrong by as much as trials differ."""
    y, clean, _, _, trial = trials
    gappy = y.copy()
    gappy[trial == 4, :3] = np.nan
    found = principal_components(gappy, RANK, trial=trial)
    np.testing.assert_array_equal(found.trial_offset[4, :3], 0)
    error = found.poses - clean
    assert np.abs(error[trial == 4, :3]).max() < 4 * OFFSET * np.sqrt(1 + 1 / 5)
    assert np.sqrt(np.mean(error[:, 3:] ** 2)) < NOISE


def test_the_order_of_trials_does_not_matter(trials):
    """Trials turned round and renumbered have the same poses: sums in another order, through 30 rounds."""
    y, _, _, _, trial = trials
    found = principal_components(y, RANK, trial=trial)
    order = np.argsort(-trial, kind="stable")
    turned = principal_components(y[order], RANK, trial=TRIALS - 1 - trial[order])
    np.testing.assert_allclose(turned.poses, found.poses[order], atol=1e-9)
    np.testing.assert_allclose(turned.trial_offset, found.trial_offset[::-1], atol=1e-9)


def test_trials_that_do_not_differ_have_no_offsets():
    """One recording cut in two: offsets are a fraction of the noise, poses those of the whole."""
    y, _, _ = low_rank(np.random.default_rng(4), n_frames=400)
    whole = principal_components(y, 3)
    cut = principal_components(y, 3, trial=np.repeat([0, 1], 200))
    assert np.abs(cut.trial_offset).max() < 0.5e-3
    assert np.sqrt(np.mean((cut.poses - whole.poses) ** 2)) < 0.2e-3


def test_one_trial_has_none():
    """Named or not, a single trial is principal components as ever: no offset, no deviation of offsets."""
    y, _, _ = low_rank(np.random.default_rng(5))
    y[50:80, :6] = np.nan
    plain, named = principal_components(y, 3), principal_components(y, 3, trial=np.zeros(len(y), dtype=np.int64))
    for name in ("mean", "loading", "scores", "certainty", "noise"):
        np.testing.assert_array_equal(getattr(named, name), getattr(plain, name))
    assert not plain.trial_offset.any()
    assert not plain.trial_sd.any()
