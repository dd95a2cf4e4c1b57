"""The search on hidden gaps: what it sees, what it picks."""

from dataclasses import replace

import numpy as np
import pytest

from filters.hide import Hidden
from filters.models.constant_velocity import MarkerSettings
from filters.models.pose import PoseSettings
from filters.poses import MarkerTrial
from filters.score import Residuals
from filters.tune import SHARP, Effort, Search, bare_pose, free_pose, held_pose, search_on
from tests.filters.test_learned_models import DT_S, flapping


def trial_of(seed, n_frames=120, lost=None):
    """A flapping animal with noise of 0.1 mm."""
    rng = np.random.default_rng(seed)
    xyz = flapping(np.random.default_rng(1), n_frames=n_frames) + rng.normal(0, 1e-4, (n_frames, 8, 3))
    if lost is not None:
        xyz[lost] = np.nan
    sd = np.full(xyz.shape[:2], 1e-4)
    return MarkerTrial(name=f"flap{seed}", t_s=np.arange(n_frames) * DT_S, xyz_m=xyz, sd_m=sd)


def test_nothing_of_a_hidden_sample_reaches_learning():
    """Hidden samples that lie a metre off are filled in the same places, to the last bit, with the same covariance.

    The miss moves by that metre, to its rounding.
    """
    trials = [trial_of(seed) for seed in (1, 2)]
    search = search_on(trials, [0, 1, 2, 3], np.random.default_rng(0), effort=Effort(validated=1))
    index, hidden = search.hidden[0]
    search = replace(search, hidden=search.hidden[:1])
    moved = replace(hidden.trial, xyz_m=hidden.trial.xyz_m + np.where(hidden.mask, 1.0, 0.0)[..., None])
    others = [moved if i == index else trial for i, trial in enumerate(trials)]
    changed = Search(
        trials=others,
        trunk=search.trunk,
        hidden=[(index, Hidden(trial=moved, gaps=hidden.gaps))],
    )
    for kind in (MarkerSettings(), replace(SHARP, ranks=(2,), mechanics="linear")):
        before, after = search.fill(kind), changed.fill(kind)
        np.testing.assert_array_equal(after.variance, before.variance)
        np.testing.assert_allclose(after.error_m, before.error_m - 1, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(after.length, hidden.length[hidden.mask])


class Known(Search):
    """A search whose candidates cost what a law says."""

    def law(self, kind: PoseSettings) -> float:
        """Best: rank 8, axes that keep their direction, a field of forces, V_z of shapes, a soft one."""
        cost = {16: 0.2, 8: 0.0, 26: 0.3}.get(kind.ranks[0] if len(kind.ranks) == 1 else -1, 0.1)
        cost += {"free": 0.5, "linear": 0.2, "field": 0.1}[kind.mechanics]
        cost += {"none": 0.1, "motion": 0.05, "shape": 0.0}[kind.potential]
        return cost + 0.1 * kind.rotating + 0.05 * abs(np.log(kind.weight / (0.25 * SHARP.weight)))

    def fill(self, kind):
        """A fill of one sample with that cost: all of log rmse."""
        cost = self.law(kind)
        self.tried.append((kind, cost))
        miss = np.full((1, 3), np.exp(cost) / 3**0.25)
        number = np.ones(1, dtype=int)
        return Residuals(error_m=miss, variance=miss**2, noise=np.zeros(1), gap=number, length=number)


def test_the_best_of_independent_choices_is_found():
    """Where choices do not depend on each other, one after the other finds the best, and says why in order."""
    search = Known(trials=[], trunk=[], hidden=[])
    kind = replace(SHARP, ranks=(16,), weight=1.0)
    assert search.fill(kind).cost == pytest.approx(search.law(kind))
    free = free_pose(search)
    bare, held = bare_pose(search, free), held_pose(search, free)
    assert (free.ranks, free.rotating, free.mechanics, free.potential) == ((8,), False, "free", "none")
    assert bare == replace(free, mechanics="field")
    assert held == replace(bare, potential="shape", weight=0.25 * SHARP.weight)


def test_no_change_for_less_than_it_should_gain():
    """A candidate that is better by less than ``least`` leaves the start; a better one replaces it for those after."""
    search = Known(trials=[], trunk=[], hidden=[])
    start = replace(SHARP, ranks=(8,), mechanics="linear", potential="motion")
    changes = [{"potential": "shape"}, {"mechanics": "field"}]  # better by 0.05 and 0.1
    assert search.improve(start, changes, least=0.2) == start
    assert search.improve(start, changes, least=0.07) == replace(start, mechanics="field")
    assert search.improve(start, changes) == replace(start, mechanics="field", potential="shape")
    assert search.improve(start, [{"mechanics": "free"}]) == start


def test_a_candidate_is_tried_once():
    """Asked again the search answers from its notes, and tells nobody."""
    told = []
    search = search_on([trial_of(3, 40)], [], np.random.default_rng(0), tell=told.append)
    assert search.fill(MarkerSettings()) is search.fill(MarkerSettings())
    assert len(told) == 1
    assert told[0].startswith("candidate 1: constant velocity of each marker, accelerations x 1: error ")
    assert "Settings" not in told[0]


def test_every_length_is_hidden_often_enough():
    """A trial of 150 frames has room for a gap of 100 or for the others: hidden in turns, each length is there twice.

    For the mixture more is hidden, in trials that take turns.
    """
    search = search_on(
        [trial_of(seed, 150) for seed in (1, 2, 3)], [0, 1, 2, 3], np.random.default_rng(0), effort=Effort(validated=2)
    )
    for length in (10, 25, 50, 100):
        assert sum(hidden.count(length) for _, hidden in search.hidden) >= 2
    assert {index for index, _ in search.again} == {0, 1, 2}
    assert sum(hidden.count(10) for _, hidden in search.again) >= 8


def test_validated_is_where_most_is_seen():
    """Of three trials those with most samples, of a long one the stretch with most: against counting every stretch."""
    trials = [trial_of(1, 90), trial_of(2, 150, lost=slice(0, 70)), trial_of(3, 30)]
    search = search_on(trials, [0, 1, 2], np.random.default_rng(0), effort=Effort(validated=2, most_frames=60))
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
    assert search_on([dark], [], np.random.default_rng(0)).hidden == []
