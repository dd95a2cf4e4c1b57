"""A trial of a batch: its files, what is stated about them, also in a table of trials; and how it went, by content."""

import csv
import hashlib
import json
import os
import re
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, is_dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from io import StringIO
from pathlib import Path
from typing import Any, Literal, get_args

from mocap.audit.across import TrialFacts
from mocap.documents import decoded, from_json, regular_bytes
from mocap.errors import FormatError, MocapError, OutputError, shown_elsewhere
from mocap.findings import Finding
from mocap.io.crop import crops_beside
from mocap.io.lines import not_split
from mocap.io.manifest import PARTIAL, current_files, digest, locked
from mocap.io.output import recovered, result_folder
from mocap.json_records import record as of_json
from mocap.options import ReadOptions, TrackOptions, options_of, stated
from mocap.reading.reading import read
from mocap.recording import Recording
from mocap.results.files import RECORDING
from mocap.schema import Entry, Schema, checked

_YES = ("true", "yes", "1", "wahr", "vrai", "verdadero", "vero", "waar")
_NO = ("false", "no", "0", "falsch", "faux", "falso", "onwaar")
"""What spreadsheets make of a cell that says ``true``, in the languages that they are sold in most."""


def yes(cell: str) -> bool:
    """A cell that says yes or no.

    Raises:
        ValueError: it says neither.
    """
    if cell.casefold() not in _YES + _NO:
        raise ValueError(cell)
    return cell.casefold() in _YES


_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")


def number(cell: str, *, decimal_comma: bool = False) -> float:
    """A number, also with a decimal comma.

    Args:
        cell: The cell.
        decimal_comma: Whether a comma can only be that, as where it does not separate cells.

    Raises:
        ValueError: it is no number, or its comma may as well separate thousands.
    """
    if "," not in cell:
        return float(cell)
    if not decimal_comma and _THOUSANDS.fullmatch(cell):
        raise ValueError(cell)
    return float(cell.replace(",", "."))


_CELLS: dict[type, Callable[[str], Any]] = {float: number, bool: yes}
STATED: dict[str, Callable[[str], Any]] = {
    name: _CELLS.get(one.of, one.of) for name, one in options_of(ReadOptions).items() if one.of is not None
}
"""What a manifest can state of a trial: arguments of ``mocap.read``, and the type of each."""
MOST_NAMED = 4
"""Names that a message tells of many."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One recording of a batch.

    Attributes:
        name: Unique in the batch; its result is written to the folder of this name below the results.
        paths: The file of its tracks; several: the pixel files of its views, a camera each.
        arguments: Arguments of ``mocap.read`` (``STATED``, and ``hints``) that are given for it.
        animal: Whose trial it is; empty: not stated.
        skip: Why it is not tracked; empty: it is.
    """

    name: str
    paths: tuple[Path, ...]
    arguments: Mapping[str, Any] = field(default_factory=dict)
    animal: str = ""
    skip: str = ""

    def recording(self, **more: Any) -> Recording:
        """Its files, read as ``mocap track`` reads them.

        Args:
            **more: Further arguments of ``mocap.read``.

        Raises:
            MocapError: they cannot be read.
        """
        return read(list(self.paths), **{**self.arguments, **more})


def size_bytes(paths: Sequence[Path]) -> int:
    """Of files together; those that are not there have none."""
    size = 0
    for path in paths:
        with suppress(OSError):
            size += path.stat().st_size
    return size


def some(names: Sequence[str]) -> str:
    """``a, b, c, d, ...``."""
    return ", ".join(names[:MOST_NAMED]) + (", ..." if len(names) > MOST_NAMED else "")


def relative(path: Path, folder: Path) -> str:
    """A path as a manifest in ``folder`` names it: with slashes, relative where there is a way."""
    try:
        return Path(os.path.relpath(path.absolute(), folder.absolute())).as_posix()
    except ValueError:  # another drive
        return path.absolute().as_posix()


COLUMNS = ("trial", "path", "animal", "skip", *STATED)
"""What is read of it."""
TOLD = ("frames", "markers", "cameras", "note", "wrong")
"""Columns that tell what was found, and are not read."""
BETWEEN = ";"
"""Separates the files of one trial."""


def is_manifest(path: Path) -> bool:
    """Whether a file is a manifest: a CSV table with a column ``path`` (and one ``trial``, or others of ours)."""
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    try:
        with path.open("rb") as stream:
            header = stream.readline(10_000).decode("utf-8-sig", "replace")
    except OSError:
        return False
    try:
        titles = {title.strip() for title in next(csv.reader([header], delimiter=_separator(header)), [])} - {""}
    except csv.Error:
        return False
    return "path" in titles and titles <= {*COLUMNS, *TOLD}


def _separator(header: str) -> str:
    """Spreadsheets of some countries separate cells by semicolons, and some programs by tabs."""
    return max((",", BETWEEN, "\t"), key=header.count)


def read_manifest(path: Path) -> list[Trial]:
    """The trials of a manifest; paths are relative to its folder.

    Args:
        path: CSV with the columns ``path`` (several files of one trial are separated by semicolons) and, each where
            wanted, ``trial`` (else the name of the file), ``animal``, ``skip`` (a reason: it is not tracked), and the
            arguments of ``mocap.read`` in ``STATED``. Empty cells state nothing.

    Raises:
        FormatError: a column is not known, a cell is no number where one is needed, two trials have one name, or a
            row names no file.
    """
    text, _ = decoded(path, path.read_bytes())
    separator = _separator(text.partition("\n")[0])
    table = csv.reader(StringIO(text, newline=""), delimiter=separator, skipinitialspace=True)
    found: dict[str, Trial] = {}
    titles: list[str] = []
    try:
        for cells in table:
            cells = [cell.strip() for cell in cells]
            where = f"{path.name}: line {table.line_num}"
            if not any(cells):
                continue
            if not titles:
                titles = _titles(path, cells)
                continue
            if beyond := [cell for cell in cells[len(titles) :] if cell]:
                raise FormatError(
                    f"{where}: {beyond[0][:40]!r} stands beyond the last column: put cells that contain {separator!r} "
                    "between double quotes"
                )
            row = {title: cell for title, cell in zip(titles, cells, strict=False) if title}
            trial = _trial(path, where, row, decimal_comma=separator != ",")
            if trial.name.casefold() in found:
                raise FormatError(f"{where}: two trials are called {trial.name!r}: rename one")
            found[trial.name.casefold()] = trial
    except csv.Error as error:
        raise not_split(path, table.line_num, error) from None
    if not found:
        raise FormatError(f"{path.name}: has no trials: expected a row each, with a path")
    return list(found.values())


def _titles(path: Path, cells: Sequence[str]) -> list[str]:
    unknown = [title for title in cells if title and title not in (*COLUMNS, *TOLD)]
    twice = [title for title in cells if title and cells.count(title) > 1]
    if unknown or twice or "path" not in cells:
        wrong = ", ".join(unknown) or (f"{twice[0]} (twice)" if twice else "(no path)")
        raise FormatError(
            f"{path.name}: columns {wrong}: a manifest has the column path, and may have "
            f"{', '.join(c for c in COLUMNS if c != 'path')}"
        )
    return list(cells)


def _trial(path: Path, where: str, cells: dict[str, str], *, decimal_comma: bool) -> Trial:
    files = [path.parent / file.strip() for file in cells.get("path", "").split(BETWEEN) if file.strip()]
    if not files:
        raise FormatError(f"{where}: names no file in the column path")
    arguments: dict[str, Any] = {}
    for title, kind in STATED.items():
        if not (cell := cells.get(title, "")):
            continue
        try:
            if kind is Path:
                files_of = [path.parent / one.strip() for one in cell.split(BETWEEN)]
                arguments[title] = files_of[0] if len(files_of) == 1 else files_of
            else:
                arguments[title] = number(cell, decimal_comma=decimal_comma) if kind is number else kind(cell)
        except ValueError:
            kinds = "yes or no" if kind is yes else "a number"
            raise FormatError(f"{where}: {title} {cell!r} is not {kinds}") from None
    name = cells.get("trial") or files[0].stem
    try:
        check_name(name)
    except MocapError as error:
        raise FormatError(f"{where}: {error}") from None
    return Trial(
        name=name, paths=tuple(files), arguments=arguments, animal=cells.get("animal", ""), skip=cells.get("skip", "")
    )


def check_name(name: str) -> None:
    """Refuse a name that leads out of the folder of results.

    Raises:
        MocapError: it does, or is hidden.
    """
    parts = name.replace("\\", "/").split("/")
    if any(not part.strip() or part.startswith(".") for part in parts):
        raise MocapError(f"the trial {name!r} cannot be a folder below the results: give it a plain name")


def write_manifest(
    path: Path, trials: Sequence[Trial], *, folder: Path, columns: Sequence[dict[str, object]] = ()
) -> None:
    """Write the manifest of trials, with paths relative to ``folder``, and what was found in files (``TOLD``)."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*COLUMNS, *TOLD])
        for i, trial in enumerate(trials):
            cells: list[object] = [
                trial.name,
                BETWEEN.join(relative(file, folder) for file in trial.paths),
                trial.animal,
                trial.skip,
            ]
            for title in STATED:
                value = trial.arguments.get(title, "")
                several = value if isinstance(value, list | tuple) else [value]
                texts = [_cell(title, one, folder) for one in several]
                cells.append(BETWEEN.join(texts))
            cells += [columns[i].get(title, "") if columns else "" for title in TOLD]
            writer.writerow(cells)


def _cell(title: str, value: Any, folder: Path) -> str:
    if isinstance(value, bool):  # spreadsheets turn True into a word of their language
        return "yes" if value else "no"
    return relative(Path(value), folder) if STATED[title] is Path and value != "" else str(value)


RECORD = "trial.json"
"""The file of a trial's folder that says how it went, and what of."""
Outcome = Literal["done", "failed", "skipped"]


@dataclass(frozen=True, kw_only=True)
class Options(TrackOptions):
    """How every trial of a batch is tracked."""

    pictures: bool = field(
        default=False, metadata=stated(bool, "Write figures, report.html and recording.rrd of each trial, too.")
    )


@dataclass(frozen=True, kw_only=True)
class Record:
    """How a trial went.

    Attributes:
        trial: Its name.
        status: ``done``, ``failed`` or ``skipped``.
        error: Why it failed, or was skipped, in one line.
        row: The figures of ``summary.csv``.
        key: What it was made of (``key_of``); empty where the failure was not of the data, and is to be tried again.
        facts: What it is compared with other trials by; None: it could not be read.
        beside: What it differed in from the others when it was tracked (``mocap.batches.beside.kinds_of``).
        found: What is wrong in its own files, or left open.
    """

    trial: str
    status: Outcome
    error: str = ""
    row: Mapping[str, object] = field(default_factory=dict)
    key: str = ""
    facts: TrialFacts | None = None
    beside: tuple[str, ...] = ()
    found: tuple[Finding, ...] = ()


def why_failed(error: BaseException) -> str:
    """What is told of a trial or a file at which something went wrong, in one line."""
    text = " ".join(str(error).split())
    if isinstance(error, MocapError):
        return text
    if isinstance(error, OSError) and error.filename:
        advice = f"{shown_elsewhere(error)}check that it is there and that you may use it"
        return f"{error.filename}: {error.strerror}: {advice}"
    place = traceback.extract_tb(error.__traceback__)
    where = f" at {Path(place[-1].filename).name}:{place[-1].lineno}" if place else ""
    return f"{type(error).__name__}{where}: {text[:300]}: this is an error in mocap, not in your data: please report it"


def key_of(trial: Trial, options: Options) -> str:
    """SHA-256 of all that a trial's result depends on.

    The content of its files (also of those that are found beside them: stored points, crop offsets), what is stated,
    the options, the content of the learned model, and the version of this program; not where files lie, nor when they
    were written.

    Raises:
        OSError: a file cannot be read.
    """
    first = trial.paths[0]
    sparse = [first.with_name(first.name.replace("xypts", part)) for part in ("xyzpts", "offsets", "point_names")]
    found = [path for path in sparse if path != first and path.is_file()]
    of = {
        "trial": trial.name,
        "version": version("eal-mocap"),
        "files": [
            [path.name, _content(path)]
            for path in (*trial.paths, *[*found, *(() if "crop" in trial.arguments else crops_beside(trial.paths))])
        ],
        "stated": {name: _plain(value) for name, value in sorted(trial.arguments.items())},
        "options": {name: _plain(value) for name, value in sorted(vars(options).items())},
    }
    return hashlib.sha256(json.dumps(of, sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, Path):
        return [value.name, _content(value)]
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return asdict(value) if is_dataclass(value) and not isinstance(value, type) else value


def _content(path: Path) -> str:
    """SHA-256 of a file, or of the files of a folder with their names."""
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file())
        return json.dumps([[file.relative_to(path).as_posix(), _content(file)] for file in files])
    stat = path.stat()
    return _digest(path, stat.st_size, stat.st_mtime_ns, stat.st_ino)


@lru_cache(maxsize=4096)
def _digest(path: Path, _size: int, _changed_ns: int, _node: int) -> str:
    """Of a file in one state: a calibration that many trials share is read once."""
    return digest(path)


_ENTRIES: Schema = {
    "trial": Entry(kind="s"),
    "status": Entry(kind="s", words=get_args(Outcome)),
    "error": Entry(kind="s"),
    "key": Entry(kind="s"),
}


def read_record(folder: Path) -> Record | None:
    """How a trial went, by its folder; None where nothing was finished there, or files of the result are gone."""
    files = current_files(folder) if folder.is_dir() else {}
    try:
        found = from_json(regular_bytes(files[RECORD], follow=False), RECORD)
        entries = {name: value[()] for name, value in checked(RECORD, found, _ENTRIES, again="").items()}
        row = dict(found["row"])
        kinds = {key: Entry(kind="s" if isinstance(row[key], str) else "f", needed=False) for key in row}
        checked(RECORD, row, kinds, again="")
        facts = None if found.get("facts") is None else TrialFacts.from_json(found["facts"])
        beside = tuple(map(str, found.get("beside", ())))
        own = tuple(of_json(Finding, one, RECORD) for one in found.get("found", ()))
        record = Record(row=row, facts=facts, beside=beside, found=own, **entries)
    except (KeyError, OSError, TypeError, ValueError, FormatError):
        return None
    whole = record.status != "done" or RECORDING in files
    return record if whole and all(path.is_file() for path in files.values()) else None


def write_record(record: Record, folder: Path) -> None:
    """Write how a trial went into the folder of its result, as ``mocap.io.output.result_folder`` gives it."""
    plain = asdict(replace(record, facts=None, found=()))
    plain |= {"facts": None if record.facts is None else record.facts.as_json()}
    plain |= {"found": [one.as_json() for one in record.found]}
    text = json.dumps(plain, indent=1, sort_keys=True, allow_nan=False)
    (folder / RECORD).write_text(text + "\n", encoding="utf-8")


def keep(record: Record, folder: Path) -> None:
    """Keep how a trial went that has no result, in place of an earlier one; where that is not possible it is not."""
    try:
        with result_folder(folder, "track", replace=True) as stage:
            write_record(record, stage)
    except OutputError:  # in use, full, or others' files: the next run tries again
        return


def earlier_record(trial: Trial, options: Options, out: Path) -> Record | None:
    """How a trial went, if that was of the same files, options and version; None: it is to be tracked."""
    folder = out / trial.name
    record = read_record(folder)
    with suppress(OSError, OutputError):
        if record is not None and record.key and record.key == key_of(trial, options):
            if any(folder.glob(f"{PARTIAL}*")):  # nothing else is written there that would clean up
                with suppress(OSError, OutputError), locked(folder):
                    recovered(folder)
            return record
    return None
