"""The mean of what several models say."""

from dataclasses import replace

import numpy as np
import pytest

from filters.models.average import Average, averaged
from filters.models.base import TrajectoryModel, TrialSet, estimate
from filters.observations import PositionObservations
from filters.score import Residuals, residuals_of
from filters.tune import SHARP, Effort, Search, of_two_ranks, other_rank, search_on
from tests.filters.test_tuning import trial_of

POSE = replace(SHARP, ranks=(3,), mechanics="linear")


def test_two_are_averaged_by_how_sure_they_are():
    """Against a mixture of two normal densities by hand: deviations of 1 and 2, so weights of 16 to 1."""
    means = np.array([[[0.0, 0.0, 0.0]], [[1.7, 0.0, 0.0]]])
    covs = np.array([[np.eye(3)], [4 * np.eye(3)]])
    mean, cov = averaged(means, covs)
    np.testing.assert_allclose(mean, [[0.1, 0.0, 0.0]])
    within = (16 * 1 + 4) / 17
    np.testing.assert_allclose(cov[0], np.diag([within + (16 * 0.1**2 + 1.6**2) / 17, within, within]))


@pytest.fixture
def search():
    """Gaps hidden in one of two trials."""
    search = search_on(
        [trial_of(seed) for seed in (1, 2)], [0, 1, 2, 3], np.random.default_rng(0), effort=Effort(validated=1)
    )
    return replace(search, hidden=search.hidden[:1], again=[])


def test_a_search_says_of_several_what_a_tracker_does(search: Search):
    """Averaged over hidden samples, or tracked and then compared: the same to rounding, and between the members.

    Progress runs through all members, to the end.
    """
    both = Average((POSE, replace(POSE, ranks=(5,))))
    index, hidden = search.hidden[0]
    fitting = TrialSet([*(trial for i, trial in enumerate(search.trials) if i != index), hidden.shown], search.trunk)
    seen: list[float] = []
    positions = PositionObservations(xyz_m=hidden.shown.xyz_m, sd_m=hidden.shown.sd_m)
    tracked = estimate(both, fitting, positions, progress=seen.append)
    direct, found = residuals_of(hidden, tracked.xyz_m, tracked.cov_m2), search.fill(both)
    np.testing.assert_allclose(found.error_m, direct.error_m, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.variance, direct.variance, rtol=1e-9)
    each = np.array([search.fill(one).error_m for one in both.members])
    assert (found.error_m >= each.min(axis=0) - 1e-15).all()
    assert (found.error_m <= each.max(axis=0) + 1e-15).all()
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)


@pytest.mark.parametrize(("miss", "kept"), [(-0.5, True), (-2.5, True), (-3.5, False)])
def test_two_ranks_only_where_their_mean_errs_less(miss, kept):
    """The best errs by 1, the other of rank 16 by so much: their mean errs by 0.25, 0.75, 1.25."""
    pose, number = replace(SHARP, ranks=(4,)), np.ones(1, dtype=int)
    both = Average((pose, replace(pose, ranks=(16,))))
    tried: list[tuple[TrajectoryModel, Residuals]] = [
        (
            one,
            Residuals(
                error_m=np.full((1, 3), m), variance=np.ones((1, 3)), noise=np.zeros(1), gap=number, length=number
            ),
        )
        for one, m in zip(both.members, (1.0, miss), strict=True)
    ]
    assert of_two_ranks(Search(trials=[], trunk=[], hidden=[], tried=tried), pose) == (both if kept else pose)


@pytest.mark.parametrize(("rank", "other"), [((8,), (16,)), ((16,), (8,)), (SHARP.ranks, (16,))])
def test_the_other_rank_is_another(rank, other):
    """Whatever a model's rank is, only that changes."""
    pose = replace(SHARP, ranks=rank)
    assert other_rank(pose) == replace(pose, ranks=other)
