"""How many shapes a recording alone has: of ranks that fill hidden samples alike, the likeliest."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from mocap.datasets import make_bat
from mocap.datasets.bats import bat_motion
from mocap.datasets.lizards import lizard_motion
from mocap.filters.anatomy import anatomy_of
from mocap.filters.models import pose
from mocap.filters.models.base import TrialSet
from mocap.filters.models.pose import Judged, PoseSettings, likely_noise
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.velocities import RatePoints

from eal.threads import one_blas_thread
from tests.filters.test_learned_models import flapping

SETTINGS = PoseSettings(ranks=(1, 2, 3, 4, 6), regression=0.0)


def trials_of(xyz, dt_s, sd_m, names, trunk, bones=()):
    """One recording."""
    trial = MarkerTrial(name="one", t_s=dt_s * np.arange(len(xyz)), xyz_m=xyz, sd_m=np.full(xyz.shape[:2], sd_m))
    return TrialSet([trial], anatomy_of(names, trunk, bones))


@pytest.fixture(scope="module")
def wings():
    """A motion of few shapes, noise of 2 mm."""
    rng = np.random.default_rng(3)
    xyz = flapping(np.random.default_rng(1), n_frames=150)
    return trials_of(xyz + rng.normal(0, 2e-3, xyz.shape), 0.01, 2e-3, [f"m{i}" for i in range(8)], ["m0", "m1", "m2"])


def test_the_likeliest_of_ranks_that_fill_alike_is_taken(wings, monkeypatch):
    """Whichever it is, and no rank that fills worse, however likely; the first of them is learned once."""
    good = wings.shapes(SETTINGS.ranks)[1].ranks
    assert len(good) > 1
    assert 1 not in good
    judged = []

    def likely(model, _trials, *, near, best):
        assert near == (2.0 + judged[-1] if judged else 1.0)  # where the rank before it was likeliest
        judged.append(model.rank)
        return Judged(factor=2.0 + model.rank, log_likelihood=1.0 if model.rank == best else 0.0)

    for best in (1, *good):
        judged.clear()
        monkeypatch.setattr(pose, "likely_noise", partial(likely, best=best))
        tuned = SETTINGS.tuned(wings)
        assert tuned.ranks == (best if best in good else good[0],)
        assert tuned.process_noise == 2.0 + tuned.ranks[0]
        assert judged == list(good)
    first = wings.shapes(good[:1])[1]
    assert first.subspace is wings.shapes(SETTINGS.ranks)[1].subspace
    assert first.ranks == good[:1]  # who asks for one rank is not given the others to weigh


@pytest.mark.parametrize("near", [1 / 64, 16.0, 4.0**4])
def test_the_likeliest_noise_is_found_from_anywhere(wings, near):
    with one_blas_thread():
        model = replace(SETTINGS, ranks=(wings.shapes(SETTINGS.ranks)[1].ranks[0],))._learned(wings)
        assert likely_noise(model, wings, near=near) == likely_noise(model, wings)


def test_the_search_goes_past_ranks_that_gain_nothing():
    """A lizard of 20 joint angles: of one draw 6 to 11 shapes gain nothing over 4, and 20 miss by half of it."""
    seed = 33
    t_s = np.arange(200) / 250
    xyz = lizard_motion(seed)(t_s).xyz_m
    xyz = xyz + np.random.default_rng(seed).normal(0, 2e-4, xyz.shape)
    names = [f"m{i}" for i in range(xyz.shape[1])]
    trials = trials_of(xyz, t_s[1], 2e-4, names, names[:4])
    with one_blas_thread():
        assert trials.shapes(PoseSettings().ranks)[1].ranks[0] >= 15


@pytest.mark.rare
def test_velocities_of_the_likeliest_rank_are_as_sure_as_they_say():
    """Errors over stated deviations 0.75 to 1.3 on truth; with a third of the shapes, which err more, under 0.75."""
    seed, step = 30, 1e-4
    film, scene = make_bat(seed=seed, n_frames=160), bat_motion(seed)
    names, noise = film.skeleton.markers, 2e-4
    order, t_s = [film.truth.names.index(name) for name in names], film.truth.t_s
    later, before = (scene(t_s + sign * step).xyz_m for sign in (1, -1))
    truth = (later - before)[:, order] / (2 * step)
    xyz = film.truth.xyz_m[:, order] + np.random.default_rng(seed).normal(0, noise, truth.shape)
    trials = trials_of(xyz, t_s[1] - t_s[0], noise, names, film.skeleton.trunk, film.skeleton.rigid)
    seen, asked = PositionObservations(xyz_m=xyz, sd_m=trials.trials[-1].sd_m), RatePoints(names=tuple(names))

    def missed(settings):
        with one_blas_thread():
            rates = settings.fit(trials).fill(seen, rate_points=asked).rates
        error = (rates.velocity_m_s - truth)[10:-10]
        sd = np.sqrt(np.einsum("tmii->tmi", rates.own.astype(float))[10:-10, :, 3:])
        return np.sqrt(np.mean((error / sd) ** 2)), np.sqrt(np.mean(error**2))

    with one_blas_thread():
        tuned = PoseSettings().tuned(trials)
    z, error = missed(tuned)
    few_z, few_error = missed(replace(tuned, ranks=(tuned.ranks[0] // 3,), process_noise=0.0, covariance=()))
    assert 0.75 < z < 1.3
    assert few_z < 0.75
    assert few_error > error
