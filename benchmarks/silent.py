"""Slips of tables that change numbers, and whether anybody is told: ``python -m benchmarks.importers --corpus DIR``.

Each mutant is a sound file with one slip of a hand, a spreadsheet or a script: a cell emptied, two cells of a row
exchanged (Vicon's CSV), two lines exchanged or one doubled, a minus sign (pixels of DLTdv), one column of pixels in
another unit (DeepLabCut). A check can see it where it changes numbers by more than the recording itself moves or errs;
``visible`` says so of each, from the sound numbers alone. It is told where `mocap info` refuses it, or says of it what
it does not say of the sound file, which lies beside it (``sound/NAME``, ``mutants/KIND_N/NAME``).
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.audit.inspect import inspect
from mocap.findings import Kind
from mocap.io.contents import FileContents
from mocap.io.format import Hints

_NUMBER = re.compile(r"\s*(?:[-+0-9.eE]*|nan|NaN)\s*")
SCALES = (1000.0, 0.001, 10.0, -1.0, 25.4)
LOCAL = (Kind.SINGLE_SAMPLES.value, Kind.EXCHANGED_FRAMES.value, Kind.NEGATIVE_PIXELS.value)
"""Findings that list frames: one more is told, though the sentence was there before."""


@dataclass(frozen=True)
class Slip:
    """One mutant: its text, and whether a check can see it."""

    kind: str
    text: str
    visible: bool


@dataclass(frozen=True)
class Table:
    """The lines of a sound file, its data lines, and what it holds."""

    lines: list[str]
    rows: list[int]
    values: Array  # (T, K) coordinates of the data lines, NaN where empty
    columns: list[int]  # where they stand in their lines

    def cells(self, row: int) -> list[str]:
        """The cells of a data line."""
        return self.lines[self.rows[row]].split(",")

    def with_cells(self, changes: dict[int, list[str]]) -> str:
        """The text with other cells in some data lines."""
        lines = list(self.lines)
        for row, cells in changes.items():
            lines[self.rows[row]] = ",".join(cells)
        return "\n".join(lines)

    def off(self) -> Array:
        """(T, K) how far coordinates are from the middle of their neighbours."""
        out = np.full(self.values.shape, np.nan)
        out[1:-1] = self.values[1:-1] - (self.values[:-2] + self.values[2:]) / 2
        return np.abs(out)


def table_of(path: Path, found: FileContents) -> Table | None:
    """The data of a CSV file by its numbers; None where they are not laid out a frame a line."""
    lines = path.read_text(encoding="utf-8-sig").replace("\r\n", "\n").split("\n")
    first = {"dltdv-xypts": 0, "deeplabcut-csv": 1, "vicon-csv": 2}[found.format]
    split = [line.split(",") for line in lines]
    rows = [i for i, cells in enumerate(split) if len(cells) > first + 1 and all(map(_NUMBER.fullmatch, cells))]
    rows = [i for i in rows if first == 0 or split[i][0].strip()]
    width = min((len(split[i]) for i in rows), default=0)
    if len(rows) != len(found.frames) or len(rows) < 30:
        return None
    columns = list(range(first, width))
    if found.format == "deeplabcut-csv":
        columns = [c for c in columns if (c - 1) % 3 < 2]
    cells = [[lines[i].split(",")[c].strip() for c in columns] for i in rows]
    return Table(lines, rows, np.array([[float(x) if x else np.nan for x in row] for row in cells]), columns)


def _moves(table: Table, row: int, k: int, change: float) -> bool:
    """Whether a cell is changed by far more than its coordinate errs or turns, with neighbours that show it."""
    off = table.off()[:, k]
    if row < 1 or row + 1 >= len(table.values) or np.isfinite(off).sum() < 20:
        return False
    near = table.values[max(0, row - 4) : row + 5, k]
    extent = np.nanmax(np.nanquantile(table.values, 0.99, axis=0) - np.nanquantile(table.values, 0.01, axis=0))
    usual, around = np.nanquantile(off, 0.9), np.nanmax(off[max(0, row - 4) : row + 5])
    seen = bool(np.isfinite(near[max(0, min(row, 4) - 1) : min(row, 4) + 2]).all())
    return seen and bool(abs(change) > max(30 * usual, 12 * around, 0.02 * extent))


def _empty_cell(table: Table, rng: np.random.Generator) -> Slip:
    row, k = _seen(table, rng)
    cells = table.cells(row)
    cells[table.columns[k]] = ""
    return Slip("empty cell", table.with_cells({row: cells}), visible=True)


def _two_cells(table: Table, rng: np.random.Generator) -> Slip:
    row, k = _seen(table, rng)
    other = int(rng.choice(np.flatnonzero(np.isfinite(table.values[row]))))
    cells, a, b = table.cells(row), table.columns[k], table.columns[other]
    cells[a], cells[b] = cells[b], cells[a]
    change = table.values[row, other] - table.values[row, k]
    visible = _moves(table, row, k, change) or _moves(table, row, other, change)
    return Slip("two cells exchanged", table.with_cells({row: cells}), visible)


def _two_lines(table: Table, rng: np.random.Generator) -> Slip:
    row, _ = _seen(table, rng)
    near = int(rng.integers(2))
    full = np.flatnonzero(np.isfinite(table.values).any(axis=1))
    other = min(row + 1, len(table.rows) - 1) if near else int(rng.choice(full))
    text = table.with_cells({row: table.cells(other), other: table.cells(row)})
    changes = table.values[other] - table.values[row]
    told = [_moves(table, r, k, c) for r in (row, other) for k, c in enumerate(changes) if np.isfinite(c)]
    return Slip("two lines exchanged", text, visible=len(told) > 7 and float(np.mean(told)) > 0.5)


def _doubled(table: Table, rng: np.random.Generator) -> Slip:
    row, _ = _seen(table, rng)
    lines = list(table.lines)
    lines.insert(table.rows[row], lines[table.rows[row]])
    around = table.values[max(0, row - 3) : row + 4]
    steps = np.abs(np.diff(around, axis=0))
    both = np.isfinite(steps)
    # what is there before and after moves in every frame
    visible = len(around) == 7 and bool(both.sum(axis=1).min(initial=99) >= 4 and (steps[both] > 0).mean() > 0.9)
    return Slip("line doubled", "\n".join(lines), visible)


def _minus(table: Table, rng: np.random.Generator) -> Slip:
    row, k = _seen(table, rng)
    cells = table.cells(row)
    cells[table.columns[k]] = "-" + cells[table.columns[k]].strip()
    value = table.values[row, k]
    near = table.values[max(0, row - 2) : row + 3, k]
    near = near if len(near) == 5 else np.full(5, np.nan)
    steady = bool((np.abs(near - value) < 0.3 * value).all())  # what lay elsewhere may have left the image
    visible = (value > 0.06 * np.nanmax(table.values) and steady) or (value > 0 and _moves(table, row, k, 2 * value))
    return Slip("minus sign", table.with_cells({row: cells}), visible=bool(visible))


def _scaled(factor: float) -> Callable[[Table, np.random.Generator], Slip]:
    def slip(table: Table, rng: np.random.Generator) -> Slip:
        k = int(rng.integers(table.values.shape[1]))
        changes = {}
        for row in range(len(table.rows)):
            cells = table.cells(row)
            value = table.values[row, k]
            if np.isfinite(value):
                cells[table.columns[k]] = f"{value * factor:.10g}"
            changes[row] = cells
        return Slip(f"column times {factor:g}", table.with_cells(changes), visible=True)

    return slip


SLIPS: dict[str, tuple[Callable[[Table, np.random.Generator], Slip], ...]] = {
    "vicon-csv": (_empty_cell, _two_cells, _minus),
    "dltdv-xypts": (_empty_cell, _two_lines, _doubled, _minus, _two_cells),
    "deeplabcut-csv": (*map(_scaled, SCALES), _minus),
}
"""What is done to the files of a format."""


def _seen(table: Table, rng: np.random.Generator) -> tuple[int, int]:
    """A row and a column with a number."""
    at = np.argwhere(np.isfinite(table.values))
    row, k = at[int(rng.integers(len(at)))]
    return int(row), int(k)


def _told(path: Path) -> tuple[str, set[str], set[str]]:
    """The refusal of a file; its findings without their numbers; whole findings of single frames."""
    found = inspect([path], Hints())[0]
    local = {f["text"] for f in found.get("audit", []) if f["kind"] in LOCAL}
    return found.get("error", ""), {re.sub(r"[\d.eE+-]*\d", "#", f) for f in found["findings"]}, local


def slips(path: Path, found: FileContents, each: int, folder: Path, *, seed: int = 0) -> Iterator[dict[str, object]]:
    """A row for each mutant of a sound file, which is written beside them.

    Args:
        path: The sound file.
        found: What it holds.
        each: Mutants of each kind.
        folder: Where sound files and mutants go.
        seed: Of what is changed.
    """
    table = table_of(path, found) if found.format in SLIPS else None
    if table is None:
        return
    rng = np.random.default_rng([seed, *path.name.encode()])
    sound = _written(folder / "sound" / path.name, path.read_text(encoding="utf-8-sig"))
    _, before, local = _told(sound)
    for make in SLIPS[found.format]:
        for n in range(each):
            slip = make(table, rng)
            mutant = _written(folder / "mutants" / f"{slip.kind.replace(' ', '_')}_{n}" / path.name, slip.text)
            error, after, now = _told(mutant)
            told = bool(error or after - before or now - local)
            yield {
                "file": path.name,
                "format": found.format,
                "kind": slip.kind,
                "visible": slip.visible,
                "told": told,
                "mutant": mutant.relative_to(folder).as_posix(),
            }


def _written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path
