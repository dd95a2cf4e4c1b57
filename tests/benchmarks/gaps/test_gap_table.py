"""Tables of the gap benchmark, against numbers worked out by hand."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.gaps.table import FOLDS, TABLE, against_best, as_sentence, as_text, draws, pooled, ratios, summary


def make_folds(rmse):
    """Rows of ``folds.csv``; ``rmse``: {(set, gap, method, seed, trial): (samples, mm)}."""
    rows = []
    for (name, gap, method, seed, trial), (samples, mm) in rmse.items():
        row = {"set": name, "scenario": "limb", "gap": gap, "method": method, "seed": seed, "trial": trial}
        row |= {"rays": 0, "trained_on": "same"}
        rows.append(
            row | {"samples": samples, "rmse_mm": mm, "coverage95": 0.9, "nll": 1.0, "seconds": 2, "frames": 500}
        )
    return pd.DataFrame(rows)[FOLDS]


TWO_TRIALS = make_folds(
    {
        ("bat", 10, "good", 0, "x"): (30, 1.0),
        ("bat", 10, "good", 0, "y"): (10, 3.0),
        ("bat", 10, "bad", 0, "x"): (30, 2.0),
        ("bat", 10, "bad", 0, "y"): (10, 6.0),
        ("bat", 50, "good", 0, "x"): (50, 8.0),
        ("bat", 50, "bad", 0, "x"): (50, 4.0),
    }
)


def test_trials_are_pooled_by_samples():
    """sqrt((30 x 1 + 10 x 9) / 40) = sqrt(3); 2 s + 2 s over 1000 frames are 4 ms, each trial counted once."""
    table = pooled(TWO_TRIALS)
    assert list(table) == TABLE
    cell = table[(table["gap"] == 10) & (table["method"] == "good")].iloc[0]
    assert cell["rmse_mm"] == pytest.approx(np.sqrt(3))
    assert cell["coverage95"] == pytest.approx(0.9)
    assert cell["ms_per_frame"] == pytest.approx(4)


def test_ranks_wins_and_ratios():
    """Each method wins one cell; the bad one is twice as far off in both trials of the first, without scatter."""
    lines = summary(TWO_TRIALS)
    assert set(lines["wins"]) == {1}
    assert set(lines["rank"]) == {1.5}
    assert lines.loc["good", "ln_mm"] == pytest.approx(np.mean(np.log([np.sqrt(3), 8])))
    assert lines.loc["good", "mm_50"] == pytest.approx(8)
    against = ratios(TWO_TRIALS).set_index(["gap", "method"])
    assert against.loc[(10, "bad"), "best"] == "good"
    assert against.loc[(10, "bad"), "ln_ratio"] == pytest.approx(np.log(2))
    assert against.loc[(10, "bad"), "error"] == pytest.approx(0, abs=1e-12)
    assert against.loc[(50, "good"), "ln_ratio"] == pytest.approx(np.log(2))
    assert np.isnan(against.loc[(50, "good"), "error"])


def test_a_failure_is_last_and_spares_the_others():
    """A method without a number in one trial has none in that cell, is last there, and is counted as failed."""
    folds = TWO_TRIALS.copy()
    folds.loc[0, ["rmse_mm", "coverage95", "nll", "seconds", "frames"]] = np.nan
    table = pooled(folds)
    assert table["rmse_mm"].isna().sum() == 1
    lines = summary(folds)
    assert lines.loc["good", "failed"] == 1
    assert lines.loc["good", "rank"] == 2
    assert lines.loc["bad", "wins"] == 2
    assert lines.loc["bad", "rank"] == 1
    assert "failed" in as_text(lines)


def test_the_best_of_many_is_chosen_by_the_other_seeds():
    """Peer a is lucky with seed 0, b with seed 1: each is met where it was not chosen; one seed alone says nothing."""
    mm = {("ours", 0): 2.0, ("ours", 1): 2.0, ("a", 0): 1.0, ("a", 1): 4.0, ("b", 0): 8.0, ("b", 1): 1.0}
    folds = make_folds({("bat", 50, method, seed, "x"): (10, value) for (method, seed), value in mm.items()})
    found = against_best(folds, "ours", ["a", "b"]).set_index("seed")
    assert list(found["best"]) == ["b", "a"]
    np.testing.assert_allclose(found["ln_ratio"], [np.log(2 / 8), np.log(2 / 4)])
    said = as_sentence(found.reset_index(), "ours")
    assert "-65% on average; of 1 cells 1 more than 3 % better with every seed, 0 worse" in said
    assert said.endswith("; 1 better by more than two standard errors, 0 worse")  # -1.04 with 0.35
    assert against_best(folds[folds["seed"] == 0], "ours", ["a", "b"]).empty


def test_the_best_of_many_is_chosen_by_the_other_trials():
    """Two seeds a trial, geometric means 2 of ours, 1 and 4 of peer a, 8 and 1 of b: as if a trial had one seed."""
    mm = {("ours", "x"): 2.0, ("ours", "y"): 2.0, ("a", "x"): 1.0, ("a", "y"): 4.0, ("b", "x"): 8.0, ("b", "y"): 1.0}
    folds = make_folds(
        {
            ("bat", 50, method, seed, trial): (10 + seed, value * 3.0 ** (1 - 2 * seed))
            for (method, trial), value in mm.items()
            for seed in (0, 1)
        }
    )
    found = against_best(folds, "ours", ["a", "b"], by="trial").set_index("trial")
    assert found["best"].to_dict() == {"x": "b", "y": "a"}
    np.testing.assert_allclose(found["ln_ratio"], [np.log(2 / 8), np.log(2 / 4)])
    assert "with every trial" in as_sentence(found.reset_index(), "ours")


def test_spreads_over_draws():
    """Two draws at 1 and e^2 mm: their mean e, SD of logarithms sqrt(2), standard error 1; both trials 2 s a draw."""
    known = {("bat", 10, "one", k, t): (30, np.exp(2 * k)) for k in (0, 1) for t in "xy"}
    line = draws(make_folds(known)).iloc[0]
    assert (line["set"], line["method"], line["draws"]) == ("bat", "one", 2)
    np.testing.assert_allclose([line["mm"], line["sd"], line["error"], line["seconds"]], [np.e, np.sqrt(2), 1, 4])
