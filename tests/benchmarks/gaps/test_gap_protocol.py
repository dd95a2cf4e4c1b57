"""The gap benchmark judges as it says: gaps where it was measured, and numbers that follow from the errors put in."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from benchmarks.gaps.hide import GAPS, MARGIN, SCENARIOS, SPACING, cells, hide
from benchmarks.gaps.method import Estimate, Trial
from benchmarks.gaps.protocol import choose, evaluate, run_fold, shown_trials, tune, validation

LIMBS = (("a", "b", "c"), ("d", "e", "f"))
NAMES = ("root", "a", "b", "c", "d", "e", "f")


def make_trial(*, n_frames=400, name="one", lost=0.0, seed=0, limbs=LIMBS):
    """Markers that walk at random; a share of frames of each is lost in bursts of ten."""
    rng = np.random.default_rng(seed)
    xyz = np.cumsum(rng.normal(size=(n_frames, len(NAMES), 3)), axis=0) * 1e-3
    bursts = rng.random((n_frames // 10 + 1, len(NAMES))) < lost
    xyz[np.repeat(bursts, 10, axis=0)[:n_frames]] = np.nan
    return Trial(
        name=name,
        names=NAMES,
        t_s=np.arange(n_frames) / 100,
        xyz_m=xyz,
        sd_m=np.full(len(NAMES), 1e-4),
        trunk=("root",),
        limbs=limbs,
    )


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000), lost=st.sampled_from([0.0, 0.03, 0.2]), n_frames=st.sampled_from([60, 163, 400]))
def test_gaps_lie_where_it_was_measured(seed, lost, n_frames):
    """Scored samples and their margins were measured and stay shown; scenarios hide what they say; gaps are apart."""
    trial = make_trial(n_frames=n_frames, lost=lost, seed=seed)
    seen = np.isfinite(trial.xyz_m[..., 0])
    limbs = [np.isin(NAMES, limb) for limb in LIMBS]
    for shown in hide(trial, cells(), np.random.default_rng(seed)):
        given_m = shown.shown.xyz_m
        masked = np.zeros(seen.shape, dtype=bool)
        for gap in shown.gaps:
            masked[gap.frames] |= gap.hidden
            around = slice(gap.start - MARGIN, gap.start + gap.length + MARGIN)
            assert gap.start >= MARGIN
            assert seen[around, gap.scored].shape[0] == gap.length + 2 * MARGIN
            assert seen[around, gap.scored].all()
            assert np.isnan(given_m[gap.frames, gap.hidden]).all()
            edges = [*range(gap.start - MARGIN, gap.start), *range(gap.start + gap.length, around.stop)]
            assert np.isfinite(given_m[edges][:, gap.scored]).all()
            touched = [i for i, limb in enumerate(limbs) if (gap.hidden & limb).any()]
            if gap.kind in ("single", "pair"):
                assert gap.hidden.sum() == {"single": 1, "pair": 2}[gap.kind]
                assert len(touched) == 1
                np.testing.assert_array_equal(gap.scored, gap.hidden)
            else:
                whole = limbs[touched[0]] if gap.kind == "limb" else limbs[0] | limbs[1]
                np.testing.assert_array_equal(gap.hidden, whole)
                assert 2 * gap.scored.sum() >= gap.hidden.sum()
        np.testing.assert_array_equal(np.isnan(given_m[..., 0]), masked | ~seen)
        ends = [(gap.start, gap.start + gap.length) for gap in shown.gaps]
        assert all(after[0] - before[1] >= SPACING for before, after in pairwise(ends))


def test_a_complete_trial_holds_every_kind():
    """400 frames of everything have room for a gap of each scenario and length, as often as it is wanted."""
    shown = hide(make_trial(), cells(), np.random.default_rng(0))
    found = [(gap.kind, gap.length) for copy in shown for gap in copy.gaps]
    assert set(found) == {(scenario, length) for scenario in SCENARIOS for length in GAPS}
    assert all(found.count(cell) >= cells().count(cell) for cell in cells())


def test_gaps_are_the_same_for_all_methods_and_other_for_other_seeds():
    """Gaps depend on the trial and the seed only."""
    trial = make_trial()
    one, again, other = (shown_trials(trial, seed, cells()) for seed in (3, 3, 4))
    assert [[(g.start, g.length) for g in copy.gaps] for copy in one] == [
        [(g.start, g.length) for g in copy.gaps] for copy in again
    ]
    assert [[g.start for g in copy.gaps] for copy in one] != [[g.start for g in copy.gaps] for copy in other]
    np.testing.assert_array_equal(one[0].shown.xyz_m, again[0].shown.xyz_m)


@dataclass(frozen=True)
class Oracle:
    """Knows the truth, errs by normal noise, and states a covariance."""

    truths: dict
    sd_m: float
    stated: np.ndarray | None
    name: str = "oracle"

    def learn(self, training):
        """Nothing to learn."""
        del training
        return self

    def __call__(self, trial):
        """The truth and its noise, the same for every copy of a trial."""
        truth = self.truths[trial.name.partition("@")[0]].xyz_m
        rng = np.random.default_rng(0)
        cov = None if self.stated is None else np.broadcast_to(self.stated, (*truth.shape, 3))
        return Estimate(truth + self.sd_m * rng.standard_normal(truth.shape), cov)


def test_scores_follow_from_the_errors_put_in():
    """Noise of sd s: RMSE sqrt(3) s, 95 % inside, NLL ln(s sqrt(2 pi e)) a coordinate, for any number of folds.

    With n coordinates the standard errors are sqrt(3/2) s / sqrt(n), sqrt(0.05 0.95 / n), 1 / sqrt(2 n): 4 of them.
    """
    trials = [make_trial(seed=k, name=str(k), n_frames=400) for k in range(3)]
    sd = 2e-3
    oracle = Oracle({t.name: t for t in trials}, sd, sd**2 * np.eye(3))
    scores = [
        score
        for left_out in range(3)
        for outcome in run_fold(oracle, trials, left_out, seeds=(0, 1, 2), wanted=cells())
        for score in outcome.scores
    ]
    samples = np.array([score.samples for score in scores])
    n = 3 * samples.sum()
    mean_square = np.sum(samples * np.array([score.rmse_mm for score in scores]) ** 2) / samples.sum()
    # copies of a trial repeat its noise (it has a seed): counted as independent only once
    n_independent = 3 * 400 * len(NAMES) * 3 / 2
    assert n > n_independent / 4
    assert np.sqrt(mean_square) == pytest.approx(np.sqrt(3) * 2, rel=4 / np.sqrt(2 * n_independent / 3))
    inside = np.sum(samples * [score.coverage95 for score in scores]) / samples.sum()
    assert inside == pytest.approx(0.95, abs=4 * np.sqrt(0.05 * 0.95 / (n_independent / 3)))
    nll = np.sum(samples * [score.nll for score in scores]) / samples.sum()
    assert nll == pytest.approx(np.log(2 * np.sqrt(2 * np.pi * np.e)), abs=4 / np.sqrt(2 * n_independent / 3))


def test_the_trial_that_is_left_out_is_not_learned_from():
    """``learn`` is handed the others, each whole; the trial itself comes with gaps only."""
    trials = [make_trial(seed=k, name=str(k)) for k in range(3)]
    handed = []

    class Spy:
        name = "spy"

        def learn(self, training):
            handed.extend(training)

            def fill(trial):
                assert np.isnan(trial.xyz_m).any()
                return Estimate(np.nan_to_num(trial.xyz_m), None)

            return fill

    run_fold(Spy(), trials, 1, seeds=(0,), wanted=cells())
    assert [trial.name for trial in handed] == ["0", "2"]


def test_likelihood_uses_the_whole_covariance():
    """An error along the long axis of a slanting covariance is judged as scipy judges it, per coordinate, in mm."""
    trial = make_trial(n_frames=60)
    cov = np.array([[4.0, 3.5, 0], [3.5, 4.0, 0], [0, 0, 1.0]]) * 1e-6
    shift = np.array([2e-3, 2e-3, 0.5e-3])
    filled = Estimate(trial.xyz_m + shift, np.broadcast_to(cov, (*trial.xyz_m.shape, 3)))
    shown = hide(trial, [("single", 10)], np.random.default_rng(0))
    (score,) = evaluate(lambda _: filled, shown).scores
    assert score.nll == pytest.approx(-multivariate_normal(cov=cov * 1e6).logpdf(shift * 1e3) / 3, rel=1e-9)
    assert score.rmse_mm == pytest.approx(1e3 * np.linalg.norm(shift), rel=1e-9)
    assert score.coverage95 == 1.0
    far = Estimate(trial.xyz_m + shift * [1, 1, 4.0], filled.cov_m2)  # 2.0 mm at an sd of 1 mm is outside
    (score,) = evaluate(lambda _: far, shown).scores
    assert score.coverage95 == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda xyz, cov: (np.full_like(xyz, np.nan), cov), "have no value"),
        (lambda xyz, cov: (xyz[:-1], cov), "have shape"),
        (lambda xyz, cov: (xyz, -cov), "is not positive definite"),
        (lambda xyz, cov: (xyz, cov - 0.999e-6 + 1e-6 * np.eye(3) * 0.1), "is not positive definite"),
        (lambda xyz, cov: (xyz, np.full_like(cov, np.nan)), "is not positive definite"),
    ],
)
def test_a_method_that_does_not_answer_is_an_error(change, message):
    """A hidden sample without a value is a failure, never left out of the mean."""
    trial = make_trial(n_frames=100)
    filled = Estimate(*change(np.array(trial.xyz_m), np.tile(1e-6 * np.eye(3), (*trial.xyz_m.shape[:2], 1, 1))))
    with pytest.raises(ValueError, match=message):
        evaluate(lambda _: filled, hide(trial, cells(), np.random.default_rng(0)))


def test_tuning_takes_the_best_and_sees_training_only():
    """Of three noise levels the least is chosen, failing candidates lose, and only training trials are handed on."""
    trials = [make_trial(seed=k, name=str(k)) for k in range(4)]
    truths = {t.name: t for t in trials}
    handed = []

    def learn(sd_m, training):
        handed.append({t.name for t in training})
        if sd_m == 0:
            return lambda trial: Estimate(np.full_like(trial.xyz_m, np.nan), None)
        return lambda trial: Oracle({k: excerpt_of(v, trial) for k, v in truths.items()}, sd_m, None)(trial)

    def excerpt_of(truth, trial):
        start = int(trial.name.partition("@")[2] or 0)
        return replace(truth, xyz_m=truth.xyz_m[start : start + len(trial.t_s)])

    training = trials[:3]
    assert choose([5e-3, 0, 1e-3, 2e-3], training, learn) == 1e-3
    assert {"3"} not in handed
    assert all(names < {"0", "1", "2"} for names in handed)
    filler = tune([5e-3, 1e-3], training, learn)
    assert handed[-1] == {"0", "1", "2"}
    assert filler(trials[0]).xyz_m.shape == trials[0].xyz_m.shape
    handed.clear()
    tune([5e-3], training, learn)
    assert handed == [{"0", "1", "2"}]


def test_validation_of_one_trial_learns_from_what_it_shows():
    """With a single training trial the hidden samples are hidden from learning, too."""
    trial = make_trial()
    folds = validation([trial])
    assert folds
    for fold in folds:
        (shown,), (rest,) = fold.shown, fold.rest
        for gap in shown.gaps:
            assert np.isnan(rest.xyz_m[gap.frames, gap.hidden]).all()
