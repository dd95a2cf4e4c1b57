"""Gaps hidden in trials: what models see of them, and where they are."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.anatomy import Anatomy
from mocap.filters.hidden_gaps import Effort, HiddenGaps, hidden_gaps
from mocap.filters.hide import Hidden
from mocap.filters.models.constant_velocity import MarkerSettings
from mocap.filters.models.pose import PoseSettings
from mocap.filters.poses import MarkerTrial

from tests.filters.test_learned_models import DT_S, flapping


def trial_of(seed, n_frames=120, lost=None):
    """A flapping animal with noise of 0.1 mm."""
    rng = np.random.default_rng(seed)
    xyz = flapping(np.random.default_rng(1), n_frames=n_frames) + rng.normal(0, 1e-4, (n_frames, 8, 3))
    if lost is not None:
        xyz[lost] = np.nan
    sd = np.full(xyz.shape[:2], 1e-4)
    return MarkerTrial(name=f"flap{seed}", t_s=np.arange(n_frames) * DT_S, xyz_m=xyz, sd_m=sd)


@pytest.mark.rare
def test_nothing_of_a_hidden_sample_reaches_learning():
    """Hidden samples that lie a metre off are filled in the same places, to the last bit, with the same covariance.

    The miss moves by that metre, to its rounding.
    """
    trials = [trial_of(seed) for seed in (1, 2)]
    search = hidden_gaps(trials, Anatomy((0, 1, 2, 3)), np.random.default_rng(0), effort=Effort(validated=1))
    index, hidden = search.hidden[0]
    search = replace(search, hidden=search.hidden[:1])
    moved = replace(hidden.trial, xyz_m=hidden.trial.xyz_m + np.where(hidden.mask, 1.0, 0.0)[..., None])
    others = [moved if i == index else trial for i, trial in enumerate(trials)]
    changed = HiddenGaps(
        trials=others,
        anatomy=search.anatomy,
        hidden=[(index, Hidden(trial=moved, gaps=hidden.gaps))],
    )
    for kind in (MarkerSettings(), PoseSettings(ranks=(2,))):
        (before,), (after,) = search.fill([kind]), changed.fill([kind])
        np.testing.assert_array_equal(after.variance, before.variance)
        np.testing.assert_allclose(after.error_m, before.error_m - 1, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(after.length, hidden.length[hidden.mask])


def test_every_length_is_hidden_often_enough():
    """A trial of 150 frames has room for a gap of 100 or for the others: hidden in turns, each length is there.

    Trials take turns, too.
    """
    search = hidden_gaps([trial_of(seed, 150) for seed in (1, 2, 3)], Anatomy((0, 1, 2, 3)), np.random.default_rng(0))
    for length in (10, 25, 50, 100):
        assert sum(hidden.count(length) for _, hidden in search.hidden) >= 1
    assert {index for index, _ in search.hidden} == {0, 1, 2}
    assert sum(hidden.count(10) for _, hidden in search.hidden) >= 4


def test_validated_is_where_most_is_seen():
    """Of three trials those with most samples, of a long one the stretch with most: against counting every stretch."""
    trials = [trial_of(1, 90), trial_of(2, 150, lost=slice(0, 70)), trial_of(3, 30)]
    search = hidden_gaps(trials, Anatomy((0, 1, 2)), np.random.default_rng(0), effort=Effort(most_frames=60))
    assert [index for index, _ in search.hidden[:2]] == [0, 1]
    for index, hidden in search.hidden:
        whole = trials[index]
        n = min(60, len(whole.t_s))
        counts = [whole.seen[s : s + n].sum() for s in range(len(whole.t_s) - n + 1)]
        assert hidden.trial.seen.sum() == max(counts)
        start = int(np.searchsorted(whole.t_s, hidden.trial.t_s[0]))
        np.testing.assert_array_equal(hidden.trial.xyz_m, whole.xyz_m[start : start + n])
        np.testing.assert_array_equal(hidden.trial.sd_m, whole.sd_m[start : start + n])
    dark = replace(trials[2], xyz_m=np.full_like(trials[2].xyz_m, np.nan))
    assert hidden_gaps([dark], Anatomy(()), np.random.default_rng(0)).hidden == []
