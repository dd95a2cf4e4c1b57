"""Damaged files of every format: one line of a FormatError, or what is sound in them; a short run of the benchmark."""

import csv
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from benchmarks.attack import files
from benchmarks.attack.files import (
    APART,
    DEFECTS,
    Seed,
    compared,
    judge,
    outcomes,
    plain_findings,
    plan,
    seeds,
    values_of,
)
from benchmarks.attack.mutants import damaged, kinds
from mocap.audit.inspect import inspect
from mocap.errors import FormatError
from mocap.io.format import Hints
from mocap.io.lines import cells_of, check_cells
from mocap.io.registry import read

LONGEST = csv.field_size_limit()
DAMAGED = True
"""Files are, which are therefore read in processes of their own."""


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Files of our writers and small ones; readers that start a process a file are left to the benchmark."""
    found = seeds(tmp_path_factory.mktemp("seeds"), real=False)
    return [seed for seed in found if seed.format not in APART]


def test_damaged_files_do_no_harm(sound):
    """Of 500 damaged files none crashes, hangs, or raises anything else; of those read on most are told."""
    assert len({seed.format for seed in sound}) >= 20
    done = list(outcomes(sound, plan(sound, 500, seed=5, least=20), workers=2))
    assert [outcome for outcome in done if outcome.verdict in DEFECTS] == []
    assert sum(outcome.verdict == "refused" for outcome in done) > len(done) / 2


@pytest.mark.parametrize("cell", ["x" * (LONGEST + 1), '"' + "x,y" * (LONGEST // 2) + '"'], ids=["plain", "quoted"])
def test_a_cell_too_long_for_any_reader_is_refused_in_its_line(cell, sound, tmp_path):
    """In the titles or a row of every text table: one short line names the file and the line."""
    tables = [seed for seed in sound if seed.name.endswith((".csv", ".tsv", ".txt", ".trc"))]
    assert len(tables) > 15
    for seed in tables:
        for line in (0, 2):
            rows = seed.content.decode().split("\n")
            mark = max(",\t ", key=rows[line].count)
            whole = [one for one in rows[line].split(mark)[:-1] if '"' not in one]  # no half of a quoted cell
            rows[line] = mark.join([*whole, cell])
            path = tmp_path / seed.name
            path.write_text("\n".join(rows), encoding="utf-8")
            with pytest.raises(FormatError) as refused:
                read(path)
            said = str(refused.value)
            assert f"{seed.name}: line {line + 1} has a cell of more than 131,072 characters" in said
            assert len(said) < 300


@pytest.mark.parametrize("quote", ["", '"'])
def test_as_long_a_cell_as_csv_takes_is_no_long_one(quote, tmp_path):
    """131,072 characters are cells of a table like others; one more is refused, quoted or not, in every split."""
    path = tmp_path / "a.csv"
    for more in (0, 1):
        row = f"1,{quote}{'x' * (LONGEST + more)}{quote}"
        path.write_text(f"a,b\n{row}\n", encoding="utf-8")
        for split in (lambda: check_cells(path), lambda row=row: list(cells_of(path, ["a,b", row]))):
            with pytest.raises(FormatError, match="line 2 has a cell") if more else nullcontext():
                split()


def test_damage_is_the_same_again():
    """A case's number says what is done to the file, so that a defect can be looked at."""
    for content in (b"a,b\n1.5,2.5\n" * 9, bytes(range(256)) * 9):
        for case, kind in enumerate(kinds(content)):
            once, again = (damaged(content, kind, np.random.default_rng(case)) for _ in range(2))
            assert once == again


def test_what_changed_is_counted():
    """One cell, a row that is gone, and a column that moved are told from each other."""
    table = np.arange(600.0).reshape(50, 12)
    whole = {"frames": np.arange(50), "xyz": table, "names": np.array(["a"])}
    cell = table.copy()
    cell[3, 4] = np.nan
    assert compared(whole, whole | {"xyz": table.copy()}) == ("unchanged", 0)
    assert compared(whole, whole | {"xyz": cell}) == ("cells", 1)
    assert compared(whole, whole | {"xyz": np.roll(table, 1, axis=1)}) == ("shifted", 600)
    fewer = {"frames": np.arange(49), "xyz": np.delete(table, 7, axis=0), "names": whole["names"]}
    assert compared(whole, fewer) == ("rows", 13)
    assert compared(whole, fewer | {"xyz": np.delete(cell, 7, axis=0)})[0] == "shifted"


def test_a_careless_reader_is_found_out(monkeypatch, sound, tmp_path):
    """A reader that raises something else, or believes a shifted table, gives a verdict of its own."""
    seed = next(s for s in sound if s.format == "csv-wide")

    def raises(_path: Path):
        raise KeyError("frame")

    monkeypatch.setattr(files, "read", raises)
    verdicts = {judge(seed, case, tmp_path).verdict for case in range(5)}
    assert "traceback" in verdicts
    monkeypatch.undo()

    head, *rows = ["pt1_cam1_X,pt1_cam1_Y\n", *(f"{i}.250,{i}.500\n" for i in range(300))]
    text = head + "".join(rows)
    (tmp_path / "a.csv").write_text(text)
    findings = plain_findings(inspect([tmp_path / "a.csv"], Hints())[0]["findings"])
    whole = Seed("a.csv", "dltdv-xypts", text.encode(), values_of(read(tmp_path / "a.csv")), findings)

    def believes(path: Path):
        if path.read_bytes() != text.encode():
            path.write_text(head + "".join(rows[::-1]))
        return read(path)

    monkeypatch.setattr(files, "read", believes)
    assert "shifted" in {judge(whole, case, tmp_path).verdict for case in range(20)}
