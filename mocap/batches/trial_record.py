"""What has been done is known by content: of the files, of what is stated, of the options and of the program."""

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, is_dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, get_args

from mocap.batches.trial import Trial
from mocap.documents import from_json, regular_bytes
from mocap.errors import FormatError, MocapError, OutputError
from mocap.io.crop import crops_beside
from mocap.io.manifest import PARTIAL, current_files, digest, locked
from mocap.io.output import recovered, result_folder
from mocap.results.stored import RECORDING
from mocap.schema import Entry, Schema, checked

RECORD = "trial.json"
"""The file of a trial's folder that says how it went, and what of."""
Outcome = Literal["done", "failed", "skipped"]


class NoWorkers(MocapError):
    """The cluster that tracks has no worker left."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """How every trial of a batch is tracked.

    Attributes:
        model: ``auto``, ``mixture``, ``eal``, ``constant_velocity``, or the file of a learned model.
        validate: Whether samples are hidden, to measure how they are filled.
        seed: Which samples.
        pictures: Whether figures, ``report.html`` and ``recording.rrd`` are written, too.
    """

    model: str | Path = "auto"
    validate: bool = True
    seed: int = 0
    pictures: bool = False


@dataclass(frozen=True, kw_only=True)
class Record:
    """How a trial went.

    Attributes:
        trial: Its name.
        status: ``done``, ``failed`` or ``skipped``.
        error: Why it failed, or was skipped, in one line.
        row: The figures of ``summary.csv``.
        key: What it was made of (``key_of``); empty where the failure was not of the data, and is to be tried again.
    """

    trial: str
    status: Outcome
    error: str = ""
    row: Mapping[str, object] = field(default_factory=dict)
    key: str = ""


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
        record = Record(row=row, **entries)
    except (KeyError, OSError, TypeError, ValueError, FormatError):
        return None
    whole = record.status != "done" or RECORDING in files
    return record if whole and all(path.is_file() for path in files.values()) else None


def write_record(record: Record, folder: Path) -> None:
    """Write how a trial went into the folder of its result, as ``mocap.io.output.result_folder`` gives it."""
    text = json.dumps(asdict(record), indent=1, sort_keys=True, allow_nan=False)
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
