"""Peers that know poses: exact where their model holds, blind to what is hidden, the same in every world frame."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from benchmarks.gaps.peers import gaussian, gplvm, interpolation, intervals, kalman, low_rank, manifold, neighbours, pca
from benchmarks.gaps.peers.edges import Blend
from benchmarks.gaps.peers.gaussian import Choice, ConditionalGaussian
from benchmarks.gaps.peers.low_rank import LowRank, RandomWalk
from benchmarks.gaps.peers.pca import PcaReconstruction
from tests.benchmarks.gaps.peer_trials import LIMBS, hidden, in_subspace, make_trial

GAP = np.arange(60, 100)


@pytest.fixture
def untuned(monkeypatch):
    """Methods take their first candidate, at once."""
    monkeypatch.setattr(intervals, "choose", lambda candidates, *_: candidates[0])
    monkeypatch.setattr(intervals, "validation", lambda _: [])


def subspace_trials():
    """Three trials whose poses lie in one subspace of three dimensions, the last with two gaps, and its truth."""
    rng = np.random.default_rng(5)
    loading = 0.02 * rng.normal(size=(3, 18))
    trials = [make_trial(in_subspace(rng, loading), name=f"t{k}") for k in range(3)]
    shown = replace(trials[2], xyz_m=hidden(trials[2], ("a", "b", "e"), GAP))
    return trials[:2], shown, trials[2]


@pytest.mark.parametrize(
    ("method", "tolerance_m"),
    [
        (ConditionalGaussian("g", (Choice(ridge=1e-11, own=1.0),)), 1e-6),
        (PcaReconstruction("p", (1e6,)), 1e-4),
        (LowRank("l", (3,), (1.0,), residual_noise=True), 1e-5),
        (LowRank("e", (3,), (1.0,), residual_noise=False), 1e-5),
    ],
)
def test_poses_of_a_subspace_are_filled(untuned, method, tolerance_m):  # noqa: ARG001
    """Three of ten markers are missing, six columns of a rank of three are seen: the model leaves nothing open.

    Poses deviate by 0.03 m. A ridge of 1e-11 of the variance over the smallest direction costs less than 1e-6; weights
    of 0.02 leave (0.02)^2 of a deviation, blended down at the edges; a walk believes a sample of 1e-6 m.
    """
    training, shown, truth = subspace_trials()
    filler = replace(method.learn(training), blend=Blend(10.0, None))
    np.testing.assert_allclose(filler(shown).xyz_m, truth.xyz_m, atol=tolerance_m)


def test_a_delayed_gaussian_knows_motion():
    """One marker is another one of ten frames before: the pose alone cannot tell, the delayed pose can."""
    rng = np.random.default_rng(0)

    def trial(name):
        walk = np.cumsum(rng.normal(size=(400, 6, 3)), axis=0) * 1e-3
        walk = walk - walk.mean(axis=0)
        walk[10:, 0] = walk[:-10, 3]
        return make_trial(walk, name=name)

    training, truth = [trial("t0"), trial("t1")], trial("t2")
    shown = replace(truth, xyz_m=hidden(truth, ("a",), np.arange(200, 260)))
    delay = ConditionalGaussian("d", (Choice(ridge=1e-9, own=0.0, lags=(-10, 0, 10)),))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(intervals, "choose", lambda candidates, *_: candidates[0])
        patch.setattr(intervals, "validation", lambda _: [])
        filler = replace(delay.learn(training), blend=Blend(10.0, None))
    np.testing.assert_allclose(filler(shown).xyz_m, truth.xyz_m, atol=1e-5)


def test_random_walk_smoother_is_the_joint_gaussian():
    """Means, covariances and likelihood of 12 frames with missing entries against conditioning of all at once."""
    rng = np.random.default_rng(1)
    walk = RandomWalk(
        rng.normal(size=4), rng.normal(size=(4, 2)), rng.uniform(0.1, 1, 4), 0.3 * np.eye(2), 2 * np.eye(2)
    )
    y = rng.normal(size=(12, 4))
    y[3:6, :2], y[7], y[9, 3] = np.nan, np.nan, np.nan
    z, cov, likelihood = walk.smooth(y)
    steps = np.minimum.outer(np.arange(12), np.arange(12))
    prior = np.kron(np.ones((12, 12)), walk.start_cov) + np.kron(steps, walk.step_cov)
    look = np.kron(np.eye(12), walk.loading)
    seen = np.isfinite(y).ravel()
    total = look @ prior @ look.T + np.diag(np.tile(walk.noise, 12))
    total, cross = total[np.ix_(seen, seen)], (prior @ look.T)[:, seen]
    innovation = (y - walk.mean).ravel()[seen]
    np.testing.assert_allclose(z.ravel(), cross @ np.linalg.solve(total, innovation), atol=1e-10)
    left = prior - cross @ np.linalg.solve(total, cross.T)
    np.testing.assert_allclose(cov, [left[2 * t : 2 * t + 2, 2 * t : 2 * t + 2] for t in range(12)], atol=1e-10)
    assert likelihood == pytest.approx(multivariate_normal(cov=total).logpdf(innovation), rel=1e-10)


@pytest.mark.rare
@pytest.mark.parametrize(
    "method",
    [
        m
        for family in (interpolation, kalman, low_rank, pca, neighbours, gaussian, manifold, gplvm)
        for m in family.peers()
    ],
    ids=lambda method: method.name,
)
def test_every_peer_fills_and_only_looks_at_what_is_shown(untuned, method):  # noqa: ARG001
    """No value is missing, inputs stay as they are, twice is the same, covariances are positive."""
    rng = np.random.default_rng(6)
    loading = 0.02 * rng.normal(size=(3, 18))
    trials = [
        make_trial(in_subspace(rng, loading) + 1e-4 * rng.normal(size=(160, 6, 3)), sd_m=1e-4, name=f"t{k}")
        for k in range(3)
    ]
    ragged = replace(trials[1], xyz_m=hidden(trials[1], ("c", "f"), np.arange(20, 50)))
    shown = replace(trials[2], xyz_m=hidden(trials[2], LIMBS[0] + ("e",), np.r_[0:6, 60:100, 120:123]))
    before = shown.xyz_m.copy()
    filler = method.learn([trials[0], ragged])
    filled = filler(shown)
    assert np.isfinite(filled.xyz_m).all()
    np.testing.assert_array_equal(shown.xyz_m, before)
    np.testing.assert_array_equal(filler(shown).xyz_m, filled.xyz_m)
    if filled.cov_m2 is not None:
        assert (np.linalg.eigvalsh(filled.cov_m2) > 0).all()


@pytest.mark.parametrize("method", gaussian.peers()[:1] + pca.peers()[:1] + neighbours.peers(), ids=lambda m: m.name)
def test_a_fill_turns_with_the_world(untuned, method):  # noqa: ARG001
    """The test trial is turned and moved as a whole: so is its fill, to the rounding of alignments (1e-7 m)."""
    training, shown, _ = subspace_trials()
    filler = method.learn(training)
    turn = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = replace(shown, xyz_m=shown.xyz_m @ turn.T + [1.0, -2.0, 3.0])
    np.testing.assert_allclose(filler(moved).xyz_m, filler(shown).xyz_m @ turn.T + [1.0, -2.0, 3.0], atol=1e-7)
