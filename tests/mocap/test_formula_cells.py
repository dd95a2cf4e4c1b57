"""A name in a file must not become a formula of the spreadsheet that opens it, and must come back as it was.

Characters that act on a terminal come back as they are shown.
"""

import csv
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap.io.contents import pixel_recording, point_recording
from mocap.io.csv_table import as_cell, from_cell
from mocap.io.dltdv import write_residuals
from mocap.io.registry import read, write
from mocap.results.tables import write_markers
from mocap.text import visible

HOSTILE = ("=cmd|'/c calc'!A1", "+1+cmd|x", "-2+3", "@SUM(A1)", "＝1", "'=1", "a;=1+1", 'b","=1', "=a\\nb")
BROKEN = ("\t=1", "\r=1", "a\r=1", "a\n=1", "a\t=1")
"""Names with tabs and line ends, which DLTdv and TRC files cannot hold."""
ORDINARY = ("-x", "+1", "'", "o'brien", "C:\\n", "wrist_l", "d3 tip", "é")
_RUNS = re.compile(r"\s*[=+\-@＝＋－＠]")
_NUMBER = re.compile(r"[+-]?[\d.]+(e[+-]?\d+)?|NaN", re.IGNORECASE)


@given(st.text(alphabet=st.one_of(st.sampled_from("=+-@'\t\r\n;\\,\"ax"), st.characters(exclude_categories=["Cs"]))))
def test_every_text_comes_back_and_none_runs(text):
    """A bijection between texts and cells of which none begins as a formula does, in any column of any separator."""
    cell = as_cell(text)
    assert from_cell(cell) == text
    for part in re.split(r"[\t\r\n;]", cell):
        assert part == "" or part[0] not in "=+-@\t\r＝＋－＠"


def test_ordinary_text_is_written_as_it_is():
    """No apostrophe without need."""
    for text in ("wrist_l", "o'brien", "C:\\n", "d3 tip", "a=b", "1-2", ""):
        assert as_cell(text) == text
        assert from_cell(text) == text


def shown(name):
    """A name as files give it: line ends and what acts on a terminal are escaped."""
    return visible(name).replace("\n", "\\n")


def cells_that_run(path):
    """Cells of a text file that some spreadsheet takes for a formula, whichever separator it takes a CSV file for."""
    text = path.read_text(encoding="utf-8")
    found = []
    for separator in "\t" if path.suffix == ".trc" else ",;\t":
        for row in csv.reader(text.replace("\r", "\n").split("\n"), delimiter=separator):
            found += [cell for cell in row if _RUNS.match(cell) and not _NUMBER.fullmatch(cell.split(",")[0])]
    return found


def points(path, names):
    """Two frames of markers, one of them negative."""
    xyz = np.random.default_rng(0).normal(size=(3, len(names), 3))
    return point_recording(path, "csv-wide", names=names, xyz=xyz, unit="m", fps=100.0)


@pytest.mark.parametrize(
    ("format", "file", "names"),
    [
        ("csv-wide", "a.csv", HOSTILE + BROKEN + ORDINARY),
        ("csv-long", "a.long.csv", HOSTILE + BROKEN + ORDINARY),
        ("trc", "a.trc", HOSTILE + ORDINARY),
        ("dltdv", "a", HOSTILE + ORDINARY),
    ],
)
def test_names_of_markers(tmp_path, format, file, names):
    """In headers and cells of every text format that holds positions."""
    path = tmp_path / file
    write(points(path, names), path, format)
    for file in tmp_path.iterdir():
        assert cells_that_run(file) == []
    back = read(path if path.exists() else next(tmp_path.glob("*xyzpts.csv")))
    assert back.names == tuple(map(shown, names))


def test_names_of_cameras(tmp_path):
    """And of markers in pixels, a row a sample."""
    path, names, cameras = tmp_path / "a.long.csv", HOSTILE + BROKEN, ("=1+1", "+2;@3")
    uv = np.random.default_rng(0).normal(size=(2, 4, len(names), 2))
    write(pixel_recording(path, "csv-long", names=names, cameras=cameras, uv_px=uv, fps=100.0), path, "csv-long")
    assert cells_that_run(path) == []
    back = read(path)
    assert (back.names, back.camera_names) == (tuple(map(shown, names)), cameras)


def test_tables_of_a_run_and_residuals(tmp_path):
    """markers.csv is read back; residuals have names too."""
    names = HOSTILE + BROKEN + ORDINARY
    tracks = points(tmp_path / "a", names).points
    write_markers(tracks, np.zeros(tracks.seen.shape, dtype=bool), tmp_path / "markers.csv")
    write_residuals(tmp_path / "xyzres.csv", names, np.ones(tracks.seen.shape))
    assert read(tmp_path / "markers.csv").names == tuple(map(shown, names))
    assert cells_that_run(tmp_path / "markers.csv") == []
    assert cells_that_run(tmp_path / "xyzres.csv") == []
