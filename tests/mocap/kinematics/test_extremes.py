"""Peaks of uncertain curves against curves whose peaks are known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from mocap.errors import MocapError
from mocap.kinematics import extremes
from mocap.kinematics.extremes import cycle_statistics, without_side
from mocap.kinematics.records import DOUBTFUL, Cycle, Kinematics, Quantity, Rests

T = np.arange(121) / 120


def beat(number=1, start=0.0, end=1.0, **more):
    row = Cycle(
        recording="r", kind="wing_beat", of="wing_l", number=number, start_s=start, end_s=end, duration_s=end - start,
        frequency_hz=1 / (end - start), filled=0.0,
    )  # fmt: skip
    return replace(row, **more)


def quantity(name, value, sd, rests=Rests.MEASURED):
    unit = "deg_s" if name.endswith("deg_s") else "deg"
    return Quantity(
        name=name, unit=unit, what="", kind="joint", markers=(), value=value, sd=np.broadcast_to(sd, T.shape),
        rests=np.full(len(T), rests),
    )  # fmt: skip


def elbow(value, sd, rate_sd, **more):
    rate = quantity("elbow_l_flexion_rate_deg_s", np.gradient(value, T), rate_sd)
    return Kinematics(recording="r", quantities=(quantity("elbow_l_flexion_deg", value, sd, **more), rate), t_s=T)


def value(table, statistic, column="value"):
    return float(table.set_index("statistic")[column][statistic])


def test_of_a_curve_that_is_known_all_is_exact():
    """A parabola with its peak of 80 at 0.25 s of a beat of one second."""
    curve = 80 - 100 * (T - 0.25) ** 2
    table = cycle_statistics(elbow(curve, 1e-6, 1e-6), [beat()], "elbow_flexion_deg")
    assert value(table, "peak") == pytest.approx(80, abs=1e-5)
    assert value(table, "trough") == pytest.approx(curve.min(), abs=1e-5)
    assert value(table, "range") == pytest.approx(np.ptp(curve), abs=1e-5)
    assert value(table, "mean") == pytest.approx(curve.mean(), abs=1e-5)
    assert value(table, "peak_time_s") == value(table, "peak_phase") == pytest.approx(0.25)
    assert value(table, "peak_time_s", "sd") == pytest.approx(1 / 120 / np.sqrt(12), rel=1e-6)
    assert set(table["side"]) == {"left"}
    assert set(table["quantity"]) == {"elbow_flexion_deg"}


def test_an_error_that_lasts_moves_peak_and_mean_and_no_range():
    """Rate known exactly: the curve is shifted as a whole. To the 5 % that 200 draws know a deviation to, twice."""
    table = cycle_statistics(elbow(40 * np.sin(2 * np.pi * T), 3.0, 0.0), [beat()], "elbow_l_flexion_deg")
    for name in ("peak", "trough", "mean"):
        assert value(table, name, "sd") == pytest.approx(3, rel=0.15)
    assert value(table, "range", "sd") < 0.05
    assert value(table, "peak") == pytest.approx(40, abs=0.01)


def test_short_errors_average_out_of_the_mean():
    """Errors that last for 1 / 60 of the cycle: the mean's deviation is that of 60 / sqrt(2 pi) independent ones."""
    table = cycle_statistics(elbow(40 * np.sin(2 * np.pi * T), 3.0, 180.0), [beat()], "elbow_l_flexion_deg")
    assert value(table, "mean", "sd") == pytest.approx(3 * np.sqrt(np.sqrt(2 * np.pi) / 60), rel=0.2)


def test_a_vague_frame_is_in_the_interval_and_does_not_make_the_peak():
    """Twenty frames known to 30 degrees beside a peak of 60: the interval reaches up, where the curve may be."""
    curve = 60 * np.sin(np.pi * T)
    sd = np.where((T > 0.6) & (T < 0.77), 30.0, 1.0)
    table = cycle_statistics(elbow(curve, sd, 10 * sd), [beat()], "elbow_l_flexion_deg")
    sure = cycle_statistics(elbow(curve, 1.0, 10.0), [beat()], "elbow_l_flexion_deg")
    assert value(table, "peak", "sd") > 5 * value(sure, "peak", "sd")
    assert value(table, "peak_time_s", "sd") > 0.05
    assert value(table, "peak") <= 60


def test_intervals_of_peaks_hold_the_truth():
    """Curves drawn about estimated ones with the stated errors: 93 to 98 % of 400 true peaks inside; bias < 0.5 SD.

    The bias of a peak taken from the mean of what may be is that of ``TAKEN`` and of the mean's own, which the
    simulated bats settle; the interval must hold all the same.
    """
    rng = np.random.default_rng(2)
    curve = 40 * np.sin(2 * np.pi * T)
    sd, rate_sd = 4.0, 60.0
    table = cycle_statistics(elbow(curve, sd, rate_sd), [beat()], "elbow_l_flexion_deg")
    lag = np.subtract.outer(T, T) * rate_sd / sd
    root = np.linalg.cholesky(np.exp(-0.5 * lag**2) + 1e-8 * np.eye(len(T)))
    true = curve + sd * rng.standard_normal((400, len(T))) @ root.T
    for name, of in (("peak", true.max(axis=1)), ("trough", true.min(axis=1)), ("mean", true.mean(axis=1))):
        inside = np.mean((of > value(table, name, "low")) & (of < value(table, name, "high")))
        assert 0.9 <= inside <= 0.98, name
    assert abs(value(table, "peak") - true.max(axis=1).mean()) < 0.7 * value(table, "peak", "sd")


def test_cycles_with_a_hole_are_left_out_and_doubtful_ones_say_so():
    """The first beat lacks a frame, the second is doubtful, the third rests on filled samples."""
    curve = 40 * np.sin(6 * np.pi * T)
    curve[10] = np.nan
    rows = [
        beat(1, 0.0, 0.33),
        beat(2, 0.34, 0.66, status=DOUBTFUL, reason="x"),
        beat(3, 0.67, 1.0),
    ]
    table = cycle_statistics(elbow(curve, 1.0, 5.0, rests=Rests.FILLED), rows)
    assert sorted(set(zip(table["cycle"], table["status"], strict=True))) == [(2, "doubtful"), (3, "filled")]


def test_a_quantity_is_taken_in_the_cycles_of_its_side():
    """The left elbow in beats of the left wing; who asks for a quantity that is not there is told so."""
    found = elbow(40 * np.sin(2 * np.pi * T), 1.0, 5.0)
    table = cycle_statistics(found, [beat(), beat(of="wing_r")])
    assert set(table["of"]) == {"wing_l"}
    with pytest.raises(MocapError, match="no quantity 'knee_deg'"):
        cycle_statistics(found, [beat()], "knee_deg")
    assert without_side("d3_mcp_l_flexion_deg") == "d3_mcp_flexion_deg"
    assert without_side("body_speed_m_s") == "body_speed_m_s"


def test_quantities_of_a_cycle_are_what_each_is_alone(monkeypatch):
    """To the last bit, in the order of quantities and then of cycles, in memory for one curve as for all of them."""
    rng = np.random.default_rng(3)
    names = ("elbow_l_flexion_deg", "tail_flexion_deg", "elbow_r_flexion_deg", "body_speed_m_s")
    some = [quantity(name, rng.normal(0, 300, len(T)).cumsum(), rng.uniform(0.5, 2.0, len(T))) for name in names]
    some += [replace(some[1], name="tail_flexion_rate_deg_s", unit="deg_s")]
    found = Kinematics(recording="r", quantities=tuple(some), t_s=T)
    rows = [beat(1, 0.0, 0.4), beat(2, 0.4, 0.9, of="wing_r"), beat(3, 0.5, 0.52)]
    alone = [cycle_statistics(found, rows, name) for name in names]
    assert [len(one) for one in alone] == [6, 12, 6, 12]
    for most in (extremes.MOST, 1):
        monkeypatch.setattr(extremes, "MOST", most)
        pd.testing.assert_frame_equal(
            cycle_statistics(found, rows), pd.concat(alone, ignore_index=True), check_exact=True
        )
