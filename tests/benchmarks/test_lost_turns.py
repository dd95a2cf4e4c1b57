"""Beats with a lost turning point: what is hidden, and which found beats are called wrong."""

from dataclasses import replace

import numpy as np
import pandas as pd
from mocap.datasets import make_bat
from mocap.datasets.bats import BEAT_HZ, bat_motion, beats_done

from benchmarks.lost_turns import FPS, FRAMES, beats, frequency, hidden, summary, truth
from mocap.kinematics.records import COUNTED, DOUBTFUL
from tests.mocap.kinematics.test_cycles import exact


def test_one_wing_is_hidden_about_a_turning_point():
    """From all cameras, for 0.15 to 1.5 of a beat or to the end; the other wing and the trunk are as they were."""
    film = make_bat(seed=1, n_frames=60, fps=FPS, n_cameras=2)
    rows = [row for row in truth(1, film.skeleton) if row.start_s >= 0 and row.end_s <= film.truth.t_s[-1]]
    for seed in range(6):
        changed = hidden(film, rows, np.random.default_rng(seed))
        gone = np.isfinite(film.pixels.uv_px[..., 0]) & ~np.isfinite(changed.pixels.uv_px[..., 0])
        names = {film.skeleton.markers[m] for m in np.flatnonzero(gone.any(axis=(0, 1)))}
        assert len({name[-2:] for name in names}) == 1
        frames = np.flatnonzero(gone.any(axis=(0, 2)))
        assert frames[-1] == 59 or len(frames) <= 1.5 / BEAT_HZ * FPS + 1


def test_true_beats_are_good_and_shifted_ones_are_wrong():
    """The truth itself; the same with one beat that ends a quarter of a beat late, and one of double length."""
    film = make_bat(seed=1, n_frames=2, fps=FPS, n_cameras=2)
    true = truth(1, film.skeleton)
    motion = exact(bat_motion(1), film.skeleton, np.arange(FRAMES) / FPS)
    rows = [row for row in true if row.start_s >= 0 and row.end_s <= motion.t_s[-1]]
    assert not any(one["wrong"] for one in beats(rows, true, motion, film.skeleton))
    late = replace(rows[0], end_s=rows[0].end_s + 0.25 / BEAT_HZ)
    double = replace(rows[1], end_s=rows[2].end_s)
    assert all(one["wrong"] for one in beats([late, double], true, motion, film.skeleton))
    found = frequency([replace(row, status=COUNTED) for row in rows], 1)
    assert found["inside"]
    assert found["value_hz"] != found["true_hz"], "exact turning points stray from the phase"
    assert frequency([replace(row, status=DOUBTFUL) for row in rows], 1) == {}


def test_true_frequencies_are_of_the_phase():
    """It wanders about 9 Hz by 3.5 %, and upper turning points are at one phase of it to two hundredths."""
    t_s = np.arange(4000) / 2000
    done = beats_done(1, t_s)
    assert done[0] == 0
    assert 8 < np.gradient(done, t_s).min() < np.gradient(done, t_s).max() < 10  # 9 Hz that wander by 3.5 %
    upper = [row.start_s for row in truth(1, make_bat(seed=1, n_frames=2, fps=FPS, n_cameras=2).skeleton)]
    at = np.interp([t for t in upper if t > 0], t_s, done)
    stray = np.exp(2j * np.pi * at).mean()
    assert abs(stray) > 0.99, "turning points are at one phase, but for two hundredths of a beat"


def test_the_summary_counts():
    """One wrong beat that counts, one good one that does not."""
    table = pd.DataFrame({"wrong": [True, False, False], "measured": True, "status": [COUNTED, DOUBTFUL, COUNTED]})
    rates = pd.DataFrame({"inside": [True], "z": [1.0], "sd_hz": [0.1]})
    text = summary(table, rates)
    assert "wrong: 1, of which counted: 1" in text
    assert "good: 2, of which doubtful: 1 (50.0%)" in text
