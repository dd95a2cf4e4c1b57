"""Many markers in groups: what a pose filter makes of each, beside one filter of all."""

from types import SimpleNamespace

import numpy as np
import pytest
from mocap.datasets import make_bat
from mocap.filters.anatomy import anatomy_of
from mocap.filters.groups import MOST_MARKERS, groups_of, part_of, smooth_in_groups
from mocap.filters.models.base import TrialSet
from mocap.filters.models.pose import FittedGroups, PoseSettings, likely_noise
from mocap.filters.motion.pose import PoseMotion
from mocap.filters.observations import PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.track import smooth
from mocap.filters.velocities import RatePoints

T = 40


@pytest.fixture(scope="module")
def bat():
    """A pose model of a bat of 34 markers, what is seen of it, and the truth."""
    film = make_bat(n_frames=T, n_cameras=2)
    rng = np.random.default_rng(0)
    xyz = film.truth.xyz_m + 3e-4 * rng.standard_normal(film.truth.xyz_m.shape)
    xyz[18:30, 3::4] = np.nan
    trial = MarkerTrial(name="bat", t_s=film.truth.t_s, xyz_m=xyz, sd_m=np.full(xyz.shape[:2], 3e-4))
    anatomy = anatomy_of(film.truth.names, film.skeleton.trunk, film.skeleton.rigid)
    model = PoseSettings(ranks=(6,), regression=0.0).fit(TrialSet([trial], anatomy)).motion
    return model, PositionObservations(xyz_m=xyz, sd_m=trial.sd_m), film.truth


@pytest.mark.rare
def test_groups_are_all_markers_once(bat):
    """About equal in size; limbs that fit stay together."""
    model, _, _ = bat
    groups = groups_of(model, 12)
    assert sorted(np.concatenate(groups).tolist()) == list(range(34))
    assert max(map(len, groups)) <= 14
    assert len(groups_of(model, 34)) == 1


def test_more_markers_are_no_cheaper_than_sixty():
    """Work is the cube of a filter's states, 9 a marker and 63 of rank 15, over that of the 34 markers of a bat."""

    def work(markers: int) -> float:
        model = SimpleNamespace(subspace=SimpleNamespace(mean=np.zeros(3 * markers)), potentials=(), bones=None)
        sizes = [len(group) for group in groups_of(model)] if markers > MOST_MARKERS else [markers]
        return sum((63 + 9 * size) ** 3 for size in sizes) / (63 + 9 * 34) ** 3

    assert work(60) <= min(1.8, work(100))
    assert max(work(markers) for markers in range(34, 101)) <= 2.4
    assert work(300) <= 9


@pytest.mark.rare
def test_one_group_is_the_filter_of_all(bat):
    """The same operations on arrays that lie otherwise in memory: equal to rounding."""
    model, seen, truth = bat
    asked = RatePoints(names=(*truth.names, "mean"), weights=((1 / 34,) * 34,), pairs=((0, 1), (0, 34)))
    whole = smooth(model, seen, truth.t_s, rate_points=asked)
    one = smooth_in_groups(model, seen, truth.t_s, groups=[np.arange(34)], smooth=smooth, rate_points=asked)
    np.testing.assert_allclose(one.xyz_m, whole.xyz_m, atol=1e-12)
    np.testing.assert_allclose(one.cov_m2, whole.cov_m2, rtol=1e-7, atol=1e-15)
    np.testing.assert_allclose(one.log_likelihood, whole.log_likelihood)
    np.testing.assert_allclose(one.rates.velocity_m_s, whole.rates.velocity_m_s, atol=1e-12)
    np.testing.assert_allclose(one.rates.own, whole.rates.own, atol=1e-12)
    np.testing.assert_allclose(one.rates.cross, whole.rates.cross, atol=1e-12)
    np.testing.assert_allclose(one.rates.kept, whole.rates.kept, rtol=1e-3)
    assert set(one.own) == set(whole.own)
    assert one.own["limb"].tolist() == whole.own["limb"].tolist()
    for name in set(whole.own) - {"limb"}:
        np.testing.assert_allclose(one.own[name], whole.own[name], rtol=1e-4, atol=1e-6, err_msg=name)


def test_groups_fill_gaps_as_well(bat, monkeypatch):
    """Half of the markers know the shape at most by the root of two less well than all; so do gaps that it fills."""
    model, seen, truth = bat
    asked = RatePoints(names=(*truth.names, "mean"), weights=((1 / 34,) * 34,))
    whole = smooth(model, seen, truth.t_s, rate_points=asked)
    monkeypatch.setattr("mocap.filters.groups.GROUP", 17)
    found = FittedGroups(model, truth.t_s).fill(seen, rate_points=asked)
    assert len(found.observed) == T
    assert sorted(found.observed[0].where[:, 1].tolist()) == list(range(34))
    lost = np.isnan(seen.xyz_m[..., 0])

    def rms(estimate) -> float:
        return float(np.sqrt(np.mean(np.sum((estimate.xyz_m - truth.xyz_m)[lost] ** 2, axis=1))))

    assert rms(found) < np.sqrt(2) * rms(whole)
    apart = np.abs(found.rates.velocity_m_s - whole.rates.velocity_m_s)[:, 34]
    sd = np.sqrt(np.einsum("tii->ti", whole.rates.own[:, 34].astype(float))[:, 3:])
    assert np.median(apart / sd) < 2.0  # the mean's velocity, from both groups together


def test_limbs_are_whole_in_a_group_and_said_by_all_markers(bat, monkeypatch):
    """Two wings of 12 markers in groups of 17: each on its own markers, where one filter of all has it."""
    model, seen, truth = bat
    monkeypatch.setattr("mocap.filters.groups.GROUP", 17)
    few = PositionObservations(xyz_m=seen.xyz_m[:5], sd_m=seen.sd_m[:5])
    asked = RatePoints(names=truth.names)
    whole = smooth(model, few, truth.t_s[:5], rate_points=asked).own
    found = FittedGroups(model, truth.t_s[:5]).fill(few, rate_points=asked).own
    order = [found["limb"].tolist().index(name) for name in whole["limb"].tolist()]
    assert len(order) == len(found["limb"]) == 3
    np.testing.assert_array_equal(found["limb_marker"][order], whole["limb_marker"])
    np.testing.assert_array_equal(np.isnan(found["limb_pull"][:, order]), np.isnan(whole["limb_pull"]))
    np.testing.assert_array_equal(found["limb_samples"][order], whole["limb_samples"])


@pytest.mark.rare
def test_the_process_noise_is_judged_by_groups(bat, monkeypatch):
    """Of half of the markers each, it is within a factor of 4, one step of the search, of what all say together."""
    model, seen, truth = bat
    trial = MarkerTrial(name="bat", t_s=truth.t_s, xyz_m=seen.xyz_m, sd_m=seen.sd_m)
    trials = TrialSet([trial], anatomy_of(truth.names, truth.names[:4], ()))
    whole = likely_noise(model, trials).factor
    sizes = []
    monkeypatch.setattr("mocap.filters.models.pose.MOST_MARKERS", 30)
    monkeypatch.setattr("mocap.filters.groups.GROUP", 17)
    monkeypatch.setattr(
        "mocap.filters.models.pose.part_of", lambda of, some: sizes.append(len(some)) or part_of(of, some)
    )
    found = likely_noise(model, trials).factor
    assert sorted(sizes) == [17, 17]
    assert 1 / 4 < found / whole < 4


def test_a_part_of_a_model_says_the_same_of_its_markers(bat):
    """Markers of a state of the part are those of the state of the whole with the same shape, body and residuals."""
    model, _, _ = bat
    some = np.array([2, 9, 20, 33])
    part = part_of(model, some)
    assert isinstance(part, PoseMotion)
    rng = np.random.default_rng(0)
    shared = rng.normal(size=model.chains)
    residual = rng.normal(size=(2, 34, 3))  # and its rate
    whole = model.markers(np.concatenate([shared, residual.ravel()])[None], 5)
    few = part.markers(np.concatenate([shared, residual[:, some].ravel()])[None], 5)
    np.testing.assert_allclose(few, whole[:, some], atol=1e-12)
