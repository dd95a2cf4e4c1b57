"""The frequency of a recording against simulated times of turning points."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.datasets.linkage import draw_wander

from mocap.kinematics.frequency import frequencies
from mocap.kinematics.records import DOUBTFUL, Cycle
from mocap.plots.kinematics import plot_cycle_values


def beats(times, sds, of="wing_l", keep=None):
    """Beats from the (2 n + 1) times of upper and lower turning points."""
    out = []
    for k in range(len(times) // 2):
        start, lower, end = times[2 * k : 2 * k + 3]
        own = {"start_sd_s": sds[2 * k], "middle_sd_s": sds[2 * k + 1], "end_sd_s": sds[2 * k + 2]}
        more = {"downstroke_fraction": (lower - start) / (end - start), "filled": 0.0}
        row = Cycle(
            recording="", kind="wing_beat", of=of, number=k + 1, start_s=start, end_s=end, duration_s=end - start,
            frequency_hz=1 / (end - start), **own, **more,
        )  # fmt: skip
        out += [row] if keep is None or keep(k) else []
    return out


def drawn(rng):
    """Beats of two wings of one animal, some lost, and the true frequency from the first to the last of them."""
    n, period = int(rng.integers(2, 12)), float(rng.uniform(0.05, 0.5))
    wander, jitter = period * rng.choice([0, 0.01, 0.03, 0.06]), period * rng.choice([0.001, 0.01, 0.03])
    true = period * np.arange(2 * n + 1) / 2
    true[1:] += np.cumsum(rng.normal(0, wander / np.sqrt(2), 2 * n))
    rows = []
    for of, shift in (("wing_l", 0.0), ("wing_r", rng.normal(0, 0.05 * period))):
        sds = rng.uniform(0.3, 2, 2 * n + 1) * jitter
        times = true + shift + sds * rng.standard_normal(2 * n + 1) + 0.04 * period * (np.arange(2 * n + 1) % 2)
        lost = rng.random(n) < 0.2
        rows += beats(times, sds, of, keep=lambda k, lost=lost: k == 0 or not lost[k])
    first, last = min(row.number for row in rows) - 1, max(row.number for row in rows)
    return rows, (last - first) / (true[2 * last] - true[2 * first])


@pytest.mark.rare
def test_its_interval_holds_the_true_one():
    """Of 200 recordings 93 to 99 %, with a root mean square of error over SD of 0.85 to 1.1.

    Binomially 200 intervals of 95 % hold 92 to 98 %; the priors of wander and jitter are wider than half of the draws.
    """
    rng = np.random.default_rng(5)
    z = []
    for _ in range(200):
        rows, true = drawn(rng)
        (one,) = frequencies(rows)
        z.append((one.value_hz - true) / one.sd_hz)
    assert 0.92 <= np.mean(np.abs(z) < 1.96) <= 0.99
    assert 0.85 < np.sqrt(np.mean(np.square(z))) < 1.1


@pytest.mark.rare
@pytest.mark.parametrize("kind", ["even", "slow", "each"])
def test_it_holds_of_even_and_of_uneven_beats(kind):
    """Even beats, a rate that wanders slowly by 6 %, periods that differ by 4 %: 89 to 100 of 100 intervals.

    Binomially 100 intervals of 95 % hold 91 to 99 (two standard errors), of one kind of beats 2 more or less: they are
    of all kinds together. Turning points stray by 0.4 % of a beat beyond their stated deviation in every other one.
    """
    rng = np.random.default_rng(["even", "slow", "each"].index(kind))
    period, inside = 0.11, []
    for draw in range(100):
        n = (3, 7)[draw // 2 % 2]
        halves = np.full(2 * n, period / 2)
        if kind == "each":
            halves += 0.04 * period * np.sqrt(0.5) * rng.standard_normal(2 * n)
        if kind == "slow":
            t_s, wander = period / 2 * np.arange(2 * n), draw_wander(rng, band_hz=(0.3, 2.0))
            halves *= 1 + 0.06 * wander.value(t_s)
        true = np.concatenate([[0.0], np.cumsum(halves)])
        rows = []
        for of in ("wing_l", "wing_r"):
            error = np.hypot(4e-4, 0.004 * period * (draw % 2)) * rng.standard_normal(2 * n + 1)
            rows += beats(true + error, np.full(2 * n + 1, 4e-4), of)
        (one,) = frequencies(rows)
        inside.append(one.low_hz <= n / true[-1] <= one.high_hz)
    assert 0.89 <= np.mean(inside) <= 1.0


def test_all_turning_points_tell_more_than_a_pair():
    """Equal beats whose turning points are known to 2 ms: the mean of ten is known better than its two ends say."""
    rng = np.random.default_rng(0)
    sds = np.full(21, 0.002)
    times = 0.05 * np.arange(21) + sds * rng.standard_normal(21)
    (one,) = frequencies(beats(times, sds))
    ends_alone = 10.0 * np.hypot(*sds[:2]) / 1.0
    assert one.value_hz == pytest.approx(10, abs=3 * one.sd_hz)
    assert 0.3 * ends_alone < one.sd_hz < 0.8 * ends_alone
    assert one.n_cycles == 10
    known = replace(one, value_hz=9.00031, high_hz=9.00271, spread_hz=0.176)  # both to the same decimal place
    assert known.number == "9.0003 ± 0.0024 Hz"
    assert replace(one, value_hz=9.0, high_hz=10.3).number == "9.00 ± 1.30 Hz"
    assert known.meaning.endswith("(10 cycles), single cycles differ by SD 0.18 Hz")


def test_doubtful_cycles_are_no_part_of_it():
    """A beat of half the rate in the middle, doubtful: the beats that it hides are counted, as time tells."""
    sds = np.full(21, 1e-4)
    rows = beats(0.05 * np.arange(21), sds, keep=lambda k: k not in (4, 5))
    wrong = beats(np.array([0.4, 0.5, 0.6]), sds[:3])[0]
    wrong = Cycle(**{**wrong.__dict__, "status": DOUBTFUL, "reason": "x"})
    (one,) = frequencies([*rows, wrong])
    assert one.value_hz == pytest.approx(10, abs=1e-3)
    assert (one.n_cycles, one.n_doubtful) == (8, 1)
    assert frequencies([wrong]) == []


def test_a_long_recording_is_cut_and_joined():
    """400 beats, in parts: the same frequency, with a deviation that falls."""
    rng = np.random.default_rng(1)
    (short,), (long,) = (
        frequencies(
            beats(0.05 * np.arange(2 * n + 1) + 1e-3 * rng.standard_normal(2 * n + 1), np.full(2 * n + 1, 1e-3))
        )
        for n in (40, 400)
    )
    assert abs(long.value_hz - 10) < 4 * long.sd_hz
    assert long.sd_hz < 0.5 * short.sd_hz


def test_no_line_leads_across_cycles_that_are_left_out():
    """Of ten beats the fifth and sixth are not counted: the line of the figure is broken there."""
    rows = beats(0.05 * np.arange(21), np.full(21, 1e-4), keep=lambda k: k not in (4, 5))
    ax = plot_cycle_values(rows, "frequency_hz", unit="Hz")
    line = ax.lines[0].get_ydata()
    assert np.flatnonzero(np.isnan(line)).tolist() == [4]
    assert len(line) == len(rows) + 1 == 9
