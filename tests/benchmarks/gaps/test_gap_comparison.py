"""The comparison of the gap benchmark, against numbers worked out by hand."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.gaps.comparison import as_lines, comparison, overall
from benchmarks.gaps.table import FOLDS

PLACE = {"scenario": "limb", "samples": 10, "coverage95": 0.9, "nll": 1.0, "seconds": 1, "frames": 100}


def make_folds(errors, *, name="bat", rays=0, trained_on="same"):
    """Rows of ``folds.csv``; ``errors``: {(trial, seed, gap): {method: mm}}."""
    rows = [
        PLACE | {"set": name, "rays": rays, "trained_on": trained_on, "trial": trial, "seed": seed, "gap": gap}
        | {"method": method, "rmse_mm": mm}
        for (trial, seed, gap), found in errors.items()
        for method, mm in found.items()
    ]  # fmt: skip
    return pd.DataFrame(rows)[FOLDS]


def test_against_the_best_peer_of_each_cell_and_the_controls():
    """At 50 frames EAL errs half as much as the best peer in one trial and as much in another: sqrt(1/2) of it.

    The standard error of the two log ratios, -ln 2 and 0, is ln 2 / 2; in per cent times the ratio.
    """
    rows = comparison(
        make_folds(
            {
                ("x", 0, 50): {"EAL": 2.0, "a": 4.0, "b": 40.0, "EAL quadratic": 2.5, "EAL oracle": 1.0},
                ("y", 0, 50): {"EAL": 4.0, "a": 4.0, "b": 5.0, "EAL quadratic": 5.0, "EAL oracle": 2.0},
                ("x", 0, 10): {"EAL": 3.0, "a": 3.0, "b": 2.0, "EAL quadratic": 3.0, "EAL oracle": 3.0},
            }
        ),
        ["a", "b"],
    ).set_index("frames")
    long, short = rows.loc[">= 25"], rows.loc["10"]
    assert long["eal_mm"] == pytest.approx(np.sqrt(8))
    assert long["over_peer"] == pytest.approx(100 * (np.sqrt(0.5) - 1))
    assert long["over_peer_se"] == pytest.approx(100 * np.sqrt(0.5) * np.log(2) / 2)
    assert long["over_quadratic"] == pytest.approx(-20)
    assert long["over_quadratic_se"] == pytest.approx(0, abs=1e-9)
    assert long["over_oracle"] == pytest.approx(100)
    assert "over_none" not in rows
    assert short["best_peer"] == "b"
    assert short["over_peer"] == pytest.approx(50)
    assert np.isnan(short["over_peer_se"])


def test_what_differs_in_rays_or_training_is_kept_apart():
    """One ray and none, the same animal and another: four rows, each with the peer that is best there."""
    parts = [
        make_folds({("x", 0, 50): {"EAL": 1.0, "a": 2.0 + rays, "b": 2.5}}, rays=rays, trained_on=trained_on)
        for rays in (0, 1)
        for trained_on in ("same", "other animal")
    ]
    rows = comparison(pd.concat(parts), ["a", "b"])
    assert len(rows) == 4
    assert set(zip(rows["rays"], rows["best_peer"], strict=True)) == {(0, "a"), (1, "b")}


def test_sets_weigh_alike_in_all():
    """Half of the peer's error in one set and as much in another, by three trials: sqrt(1/2) over both."""
    one = make_folds({(trial, 0, 50): {"EAL": 1.0, "a": 1.0} for trial in "xyz"}, name="mouse")
    two = make_folds({("x", 0, 50): {"EAL": 1.0, "a": 2.0}})
    rows = overall(comparison(pd.concat([one, two]), ["a"]))
    total = rows[(rows["trained_on"] == "all") & (rows["rays"] == "all")].iloc[0]
    assert total["over_peer"] == pytest.approx(100 * (np.sqrt(0.5) - 1))
    assert total["over_peer_se"] == pytest.approx(100 * np.sqrt(0.5) * np.log(2) / 2)
    assert "over peer %" in as_lines(rows).splitlines()[0]


def test_a_run_without_eal_or_without_peers_has_no_comparison_with_them():
    """Peers alone give no rows; EAL alone has its error and no ratio."""
    assert not len(comparison(make_folds({("x", 0, 50): {"a": 1.0}}), ["a"]))
    (row,) = comparison(make_folds({("x", 0, 50): {"EAL": 1.0}}), []).to_dict("records")
    assert row["eal_mm"] == pytest.approx(1)
    assert np.isnan(row["over_peer"])


def test_a_set_that_peers_have_not_reached_has_no_best_one():
    """As where a run was gone on with by EAL alone: the others keep theirs."""
    folds = pd.concat(
        [make_folds({("x", 0, 50): {"EAL": 1.0, "a": 2.0}}), make_folds({("x", 0, 50): {"EAL": 3.0}}, name="other")]
    )
    rows = comparison(folds, ["a"]).set_index("set")
    assert rows.loc["other", "best_peer"] == ""
    assert rows.loc["other", "eal_mm"] == pytest.approx(3)
    assert np.isnan(rows.loc["other", "over_peer"])
    assert sorted(rows["best_peer"]) == ["", "a"]
