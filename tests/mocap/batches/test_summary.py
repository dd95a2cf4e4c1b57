"""Tables of a batch: cycles of all trials, and the sentence that a page makes of them."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t

import mocap
from mocap.batches.summary import FIGURES, write_summary
from mocap.batches.trial import Record
from mocap.errors import MocapError
from mocap.kinematics.cycles import Cycle, cycles_table
from mocap.kinematics.extremes import COLUMNS
from mocap.kinematics.records import COUNTED, DOUBTFUL

PAGE = Path(__file__).resolve().parents[3] / "docs" / "howto" / "sentence.md"


def write_trial(out, name, animal, hz, kind="wing_beat", status=COUNTED):
    """What a tracked trial leaves: its tables of cycles; returns how it went."""
    rows = [
        Cycle(
            recording="file", kind=kind, of="wing_l", number=n + 1, start_s=n / 9, end_s=(n + 1) / 9,
            duration_s=1 / f, frequency_hz=f, filled=0.0, status=status,
        )
        for n, f in enumerate(hz)
    ]  # fmt: skip
    (out / name).mkdir(parents=True)
    cycles_table(rows).to_csv(out / name / "cycles.csv", index=False)
    angles = pd.DataFrame({"kind": kind, "number": range(len(hz)), f"{kind}_deg": 1.0})
    angles.to_csv(out / name / "angles.csv", index=False)
    # the peak of each beat is ten degrees more than its frequency
    peak = {c: "" for c in COLUMNS} | {"trial": name, "kind": kind, "of": "wing_l", "side": "left", "statistic": "peak"}
    peak |= {"quantity": "elbow_flexion_deg", "sd": 0.1, "status": "measured" if status == COUNTED else status}
    peaks = pd.DataFrame([peak | {"cycle": n + 1, "value": f + 10} for n, f in enumerate(hz)], columns=list(COLUMNS))
    peaks.to_csv(out / name / "peaks.csv", index=False)
    return Record(trial=name, status="done", row=dict.fromkeys(FIGURES) | {"animal": animal, "version": "1"})


def test_cycles_of_all_trials_are_one_table(tmp_path):
    """A row a cycle with trial and animal, whatever columns a trial lacks; names that act come back."""
    records = [
        write_trial(tmp_path, "a/t1", "07", [9.0, 9.5]),
        write_trial(tmp_path, "a/t2", "=1+1", [3.0], kind="stride"),
        write_trial(tmp_path, "b", "NA", []),
        Record(trial="c", status="failed", error="cut", row={"animal": "08"}),
    ]
    write_summary(records, tmp_path)
    found = mocap.load_batch(tmp_path)
    cycles = found.cycles
    assert list(cycles.columns[:4]) == ["trial", "animal", "kind", "of"]
    assert "recording" not in cycles
    assert list(zip(cycles["trial"], cycles["animal"], cycles["frequency_hz"], strict=True)) == [
        ("a/t1", "07", 9.0), ("a/t1", "07", 9.5), ("a/t2", "=1+1", 3.0)
    ]  # fmt: skip
    assert "=1+1" not in re.findall(r"[^,\n]+", (tmp_path / "cycles.csv").read_text())
    assert list(found.angles["wing_beat_deg"].isna()) == [False, False, True]
    assert list(found.table["animal"]) == ["07", "=1+1", "NA", "08"]


def test_a_batch_without_trials_has_empty_tables(tmp_path):
    """A table without rows, and no error."""
    write_summary([], tmp_path)
    assert mocap.load_batch(tmp_path).cycles.empty


def test_the_page_makes_a_sentence_whose_interval_is_over_animals(tmp_path, monkeypatch, capsys):
    """Of balanced trials the mixed model is the t interval of the animals' means: a closed form.

    REML of nested normal effects (Searle, Casella, McCulloch 1992, section 4.4). It is stated to 0.1 Hz.
    """
    pytest.importorskip("statsmodels")
    rng, records, means = np.random.default_rng(1), [], []
    for animal in range(6):
        flights = 11 + rng.normal(0, 0.6) + rng.normal(0, 0.3, (10, 1)) + rng.normal(0, 0.25, (10, 8))
        means.append(flights.mean())
        records += [
            write_trial(tmp_path / "results", f"bat{animal}/t{k}", f"bat0{animal}", hz) for k, hz in enumerate(flights)
        ]
    records.append(write_trial(tmp_path / "results", "gap", "bat00", [99.0], status=DOUBTFUL))
    write_summary(records, tmp_path / "results")
    monkeypatch.chdir(tmp_path)
    block, bats, second = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    page: dict = {}
    exec(compile(block, PAGE.name, "exec"), page)
    mean, error = np.mean(means), np.std(means, ddof=1) / np.sqrt(6)
    low, high = mean - t.ppf(0.975, 5) * error, mean + t.ppf(0.975, 5) * error
    assert page["error"] == pytest.approx(error, rel=1e-3)  # where the optimiser of statsmodels stops
    said = capsys.readouterr().out
    assert (
        f"{mean:.1f} Hz (95 % interval over animals {low:.1f} to {high:.1f} Hz; 6 bats, 60 flights, 480 beats" in said
    )
    exec(compile(bats.splitlines()[0], PAGE.name, "exec"), page)  # the rest is run on a quantity of both sides
    exec(compile(second, PAGE.name, "exec"), page)
    fit = page["model"].fit()
    assert len(page["peaks"]) == 480  # the doubtful beat is none of them
    old, young = np.mean(means[1:4]), np.mean([means[0], *means[4:]])
    assert fit.params["group[T.young]"] == pytest.approx(young - old, abs=1e-3)
    assert fit.params["Intercept"] == pytest.approx(10 + old, abs=1e-3)


def test_cycles_of_a_batch_can_be_asked_for_peaks(tmp_path):
    """Those of the rows that are picked, with trial and animal; who asks for another quantity is told what there is."""
    records = [write_trial(tmp_path, "a", "x", [9.0, 9.5]), write_trial(tmp_path, "b", "y", [7.0])]
    write_summary(records, tmp_path)
    cycles = mocap.load_batch(tmp_path).cycles
    table = cycles.peaks("elbow_flexion_deg")
    assert list(zip(table["trial"], table["animal"], table["cycle"], table["value"], strict=True)) == [
        ("a", "x", 1, 19.0), ("a", "x", 2, 19.5), ("b", "y", 1, 17.0)
    ]  # fmt: skip
    assert list(cycles.query("trial == 'b'").peaks("elbow_l_flexion_deg")["value"]) == [17.0]
    with pytest.raises(MocapError, match="no quantity 'knee_deg': it has elbow_flexion_deg"):
        cycles.peaks("knee_deg")
    with pytest.raises(MocapError, match="come from no recording"):
        type(cycles)({"kind": []}).peaks()
