"""Clicks are counted, and what is asked is where the ways say, on a recording whose gap was filled 10 mm off."""

from types import SimpleNamespace

import numpy as np

from benchmarks.arena.flights import FPS
from benchmarks.desk_clicks import ENOUGH_M, as_the_desk, at_random, by_residual, sit
from mocap.records import marker_tracks
from tests.mocap.desk.test_proof import proof_of

HIDDEN = slice(20, 44)


def flight_of(folder):
    """A person who clicks exactly, and a result that is wrong in the gap alone: a fifth of all points."""
    proof, seen_px, xyz = proof_of(folder, hidden=HIDDEN, sd_m=1e-3)
    t_s = np.arange(len(xyz)) / FPS
    person = SimpleNamespace(t_s=t_s, pixels=SimpleNamespace(uv_px=seen_px))
    flight = SimpleNamespace(
        name="f", filmed=proof.raw, people=(person, person), people_m=np.stack([xyz, xyz]), truth_m=xyz
    )
    wrong, old = xyz.copy(), proof.result.tracks
    wrong[HIDDEN, 1, 0] += 0.01
    tracks = marker_tracks(old.names, old.t_s, wrong, cov_m2=old.cov_m2, status=old.status)
    return flight, SimpleNamespace(**(vars(proof.result) | {"tracks": tracks}))


def test_the_desk_asks_for_the_gap_and_counts_clicks(tmp_path):
    """One place of each run, three cameras each: that in the gap is enough, and what was clicked is believed."""
    flight, result = flight_of(tmp_path)
    found = sit([flight], [result], as_the_desk, 1000)
    runs = 4  # the first marker, the second before, in and after its gap
    assert (found["reached"], found["places"], found["clicks"]) == (1, runs, 3 * runs)
    assert found["mm_90_after_0"] > 1e3 * ENOUGH_M > found[f"mm_90_after_{runs}"]
    assert found["rejected"] == 0
    assert found["mm_from_clicks"] < 1


def test_others_ask_elsewhere(tmp_path):
    """A gap has no reprojection error: it is never asked for. By lot it is found; the same lot asks the same."""
    flight, result = flight_of(tmp_path)
    found = sit([flight], [result], by_residual, 20)
    assert (found["reached"], found["places"]) == (0, 20)
    first, again, other = (sit([flight], [result], at_random(seed), 1000) for seed in (0, 0, 1))
    assert first["reached"] == other["reached"] == 1
    assert first == again
