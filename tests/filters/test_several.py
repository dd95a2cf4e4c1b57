"""The mean of what several models say."""

from dataclasses import replace

import numpy as np
import pytest

from filters.fitting import Fitting
from filters.hidden import Fill, fill_of
from filters.observations import PositionObservations
from filters.several import Several, averaged, averaged_fills
from filters.tune import SHARP, Search, of_two_ranks, search_on
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
    search = search_on([trial_of(seed) for seed in (1, 2)], [0, 1, 2, 3], np.random.default_rng(0), validated=1)
    return replace(search, hidden=search.hidden[:1], again=[])


def test_a_search_says_of_several_what_a_tracker_does(search: Search):
    """Averaged over hidden samples, or tracked and then compared: the same to rounding, and between the members.

    Progress runs through all members, to the end.
    """
    both = Several((POSE, replace(POSE, ranks=(5,))))
    index, hidden = search.hidden[0]
    fitting = Fitting([*(trial for i, trial in enumerate(search.trials) if i != index), hidden.shown], search.trunk)
    seen: list[float] = []
    positions = PositionObservations(xyz_m=hidden.shown.xyz_m, sd_m=hidden.shown.sd_m)
    tracked = fitting.fill(both, positions, progress=seen.append)
    direct, found = fill_of(hidden, tracked.xyz_m, tracked.cov_m2), search.fill(both)
    np.testing.assert_allclose(found.miss_m, direct.miss_m, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.variance, direct.variance, rtol=1e-9)
    each = np.array([search.fill(one).miss_m for one in both.members])
    assert (found.miss_m >= each.min(axis=0) - 1e-15).all()
    assert (found.miss_m <= each.max(axis=0) + 1e-15).all()
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)


class Two(Search):
    """A search in which rank 4 errs by 1, any other by -0.5 or so much more."""

    def fill(self, kind):
        """One sample; of several the mean."""
        if isinstance(kind, Several):
            return averaged_fills([self.fill(one) for one in kind.members])
        miss = np.full((1, 3), 1.0 if kind.ranks == (4,) else self.trunk[0] * -0.5)
        number = np.ones(1, dtype=int)
        return Fill(miss_m=miss, variance=np.ones((1, 3)), noise=np.zeros(1), gap=number, length=number)


@pytest.mark.parametrize(("wrong", "kept"), [(1, True), (5, True), (7, False)])
def test_two_ranks_only_where_their_mean_errs_less(wrong, kept):
    """Errors of 1 and -0.5, -2.5, -3.5: their mean errs by 0.25, 0.75, 1.25. The second has rank 16."""
    pose = replace(SHARP, ranks=(4,))
    both = Several((pose, replace(pose, ranks=(16,))))
    assert of_two_ranks(Two(trials=[], trunk=[wrong], hidden=[]), pose) == (both if kept else pose)
