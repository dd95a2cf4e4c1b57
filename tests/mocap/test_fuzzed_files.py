"""Damaged files of every format: one line of a FormatError, or what is sound in them; a short run of the benchmark."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import fuzz_readers
from benchmarks.fuzz_readers import APART, Seed, damaged, judge, outcomes, seeds


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Files of our writers and small ones; readers that start a process a file are left to the benchmark."""
    found = seeds(tmp_path_factory.mktemp("seeds"), real=False)
    return [seed for seed in found if seed.format not in APART]


def test_damaged_files_do_no_harm(sound):
    """Of 600 damaged files none crashes, hangs, raises anything else, or passes for a whole one."""
    assert len({seed.format for seed in sound}) >= 18
    verdicts = [outcome for outcome in outcomes(sound, 600, seed=5)]
    bad = [outcome for outcome in verdicts if outcome.verdict not in ("read", "refused")]
    assert not bad
    assert sum(outcome.verdict == "refused" for outcome in verdicts) > 300


def test_damage_is_the_same_again():
    """A case's number says what is done to the file, so that a defect can be looked at."""
    for case in range(50):
        once, again = (damaged(b"0123456789\n" * 9, np.random.default_rng(case)) for _ in range(2))
        assert once == again


def test_a_careless_reader_is_found_out(monkeypatch, sound, tmp_path):
    """A reader that raises something else, or believes a cut row, gives a verdict of its own."""
    seed = next(s for s in sound if s.format == "csv-wide")

    def raises(_path: Path):
        raise KeyError("frame")

    monkeypatch.setattr(fuzz_readers, "read", raises)
    assert judge(seed, 0, tmp_path).verdict.startswith("KeyError")
    monkeypatch.undo()

    whole = Seed("a.csv", "dltdv-xypts", b"pt1_cam1_X,pt1_cam1_Y\n1.250,2.500\n3.250,4.500\n")
    real_read = fuzz_readers.read

    def believes(path: Path):
        path.write_bytes(path.read_bytes().rpartition(b",")[0] + b",4.500\n")
        return real_read(path)

    monkeypatch.setattr(fuzz_readers, "read", believes)
    verdicts = {judge(whole, case, tmp_path).verdict for case in range(200)}
    assert "a cut row was read" in verdicts
