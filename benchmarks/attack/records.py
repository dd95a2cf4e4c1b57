"""Tampered records of every kind that is read back: each entry of each file, in each way that its kind allows.

A sound record of each kind is written by the program itself and must be read. Then, one entry at a time: it is left
out; one number becomes NaN, infinite, huge, negative, all are reversed; its type, shape or length is changed; a name
appears twice, is none, or holds a control character. What comes is counted: refused in one line that names the file,
read with the entry as it was (it says the same, or is not read back), read changed, or a defect: anything else.
"""

import argparse
import copy
import csv
import json
import shutil
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from mocap.datasets.folder import read_truth, write_recording
from mocap.datasets.lizards import make_lizard
from mocap.filters.mixture import Mixture
from mocap.filters.model import LearnedModel
from mocap.filters.models.constant_velocity import MarkerSettings
from mocap.filters.models.pose import PoseSettings
from mocap.filters.poses import MarkerTrial

import mocap
from eal import load_potential
from eal.archive import ArchiveError
from mocap.batches.trial import RECORD, Record, read_record, write_record
from mocap.cameras.camera import KnownLens
from mocap.cameras.lens import BrownLens
from mocap.digitising.clicks import Click, read_unseen, write_unseen
from mocap.errors import MocapError
from mocap.io.anipose import read_calibration, read_lenses, write_lenses
from mocap.io.contents import point_recording
from mocap.io.registry import read, write
from mocap.report.job import run_job
from mocap.results.stored import read_recording
from mocap.results.tables import write_run
from mocap.skeleton import quoted
from mocap.skeleton_files import read_skeleton
from mocap.tracking.model_file import load_model, save_model

Tampering = Callable[[Any], Any]
DIGITS = "9" * 100_000
NESTED = "[" * 50_000 + "]" * 50_000


@dataclass(frozen=True)
class Kind:
    """One kind of record.

    Attributes:
        file: The file that is tampered with, below the record's folder.
        read: Reads the record of a folder.
        made: How the file's entries are got and put back: ``npz``, ``hdf5``, ``json``, ``toml``, ``text``.
        inside: Name of the entry, or attribute, of that file whose JSON is tampered with in place of its entries.
    """

    file: str
    read: Callable[[Path], Any]
    made: str
    inside: str = ""


KINDS: Mapping[str, Kind] = {
    "model": Kind("m.npz", lambda f: load_model(f / "m.npz"), "npz"),
    "model, header": Kind("m.npz", lambda f: load_model(f / "m.npz"), "npz", "header"),
    "potential": Kind("p.npz", lambda f: load_potential(f / "p.npz"), "npz"),
    "potential, settings": Kind("p.npz", lambda f: load_potential(f / "p.npz"), "npz", "settings"),
    "result, recording.nc": Kind("run/recording.nc", lambda f: read_recording(f / "run"), "hdf5"),
    "result, header": Kind("run/recording.nc", lambda f: read_recording(f / "run"), "hdf5", "header"),
    "result, skeleton": Kind("run/skeleton.toml", lambda f: read_recording(f / "run"), "toml"),
    "result, report": Kind("run/report.json", lambda f: read_recording(f / "run"), "json"),
    "skeleton": Kind("s.toml", lambda f: read_skeleton(f / "s.toml"), "toml"),
    "movement": Kind("x.nc", lambda f: read(f / "x.nc"), "hdf5"),
    "calibration": Kind("c.toml", lambda f: read_calibration(f / "c.toml"), "toml"),
    "lenses": Kind("lenses.toml", lambda f: read_lenses(f / "lenses.toml"), "toml"),
    "unseen clicks": Kind("unseen.csv", lambda f: read_unseen(f / "unseen.csv"), "text"),
    "truth": Kind("t.npz", lambda f: read_truth(f / "t.npz"), "npz"),
    "batch record": Kind(f"trial/{RECORD}", lambda f: read_record(f / "trial"), "json"),
}


def sound(folder: Path) -> None:
    """A sound record of each kind, as the program writes it."""
    rng = np.random.default_rng(0)
    xyz = np.cumsum(rng.normal(0, 1e-3, (40, 5, 3)), axis=0) + rng.normal(0, 0.1, (5, 3))
    xyz[3:6, 2] = np.nan
    sd = np.where(np.isnan(xyz[..., 0]), np.nan, 1e-3)
    trials = tuple(MarkerTrial(name=n, t_s=np.arange(40) / 100, xyz_m=xyz, sd_m=sd) for n in "uv")
    mixture = Mixture(
        offset=np.zeros(2), slope=np.zeros(2), length=np.array([10.0, 50.0]), scale=np.ones((2, 2)),
        widen=1.0, dof=36.0,
    )  # fmt: skip
    model = LearnedModel(
        names=tuple("abcde"), trunk=("a", "b"), bones=(("a", "b"),), trials=trials,
        models=(MarkerSettings(), PoseSettings(ranks=(2,))), mixture=mixture,
        scores={"mixture": {"gap_frames": [10, 50], "rmse_mm": [1.0, 2.0], "coverage95": [95.0] * 2, "z": [1.0] * 2}},
    )  # fmt: skip
    save_model(model, folder / "m.npz")
    made = make_lizard(seed=0, n_frames=60)
    paths = write_recording(made, folder / "made", others=True)
    source = mocap.read(paths["pixels"], calibration=paths["coefficients"], skeleton=paths["skeleton"], fps=made.fps)
    run = run_job(source, model="constant_velocity", validated=False)[0]
    (folder / "run").mkdir()
    write_run(run, folder / "run", write_recording=None)
    shutil.copy(next((folder / "run" / "potentials").iterdir()), folder / "p.npz")
    shutil.copy(paths["skeleton"], folder / "s.toml")
    shutil.copy(paths["calibration"], folder / "c.toml")
    shutil.copy(paths["truth"], folder / "t.npz")
    points = point_recording(folder / "x.csv", "made", names=["a", "b"], xyz=xyz[:, :2], unit="m", fps=100.0)
    write(points, folder / "x.nc")
    lens = BrownLens(f_px=(900.0, 910.0), centre_px=(320.0, 240.0), k=(-0.1, 0.01, 0.0))
    known = [KnownLens(name=n, lens=lens, size_px=(640, 480), free=(0, 1), cov=np.diag([4.0, 5.0])) for n in "lr"]
    write_lenses(folder / "lenses.toml", known)
    write_unseen(folder / "unseen.csv", [Click(camera=0, frame=t, marker=1, uv_px=None) for t in range(3)])
    (folder / "trial").mkdir()
    write_record(
        Record(trial="a", status="failed", error="no", row={"fps": 100.0, "animal": "bat"}, key="0"), folder / "trial"
    )


def _one(value: float) -> Tampering:
    def change(array: np.ndarray) -> np.ndarray:
        out = np.array(array)
        out[(0,) * out.ndim] = value
        return out

    return change


def _nested_number(array: np.ndarray) -> np.ndarray:
    return np.asarray(array)[None]


ARRAYS: Mapping[str, tuple[str, Tampering]] = {
    "NaN": ("f", _one(np.nan)),
    "infinite": ("f", _one(np.inf)),
    "huge": ("f", _one(1e300)),
    "below every code": ("i", _one(-100)),
    "above every code": ("i", _one(100)),
    "all NaN": ("f", lambda a: np.full(a.shape, np.nan)),
    "complex": ("fi", lambda a: a.astype(complex)),
    "text": ("fi", lambda a: a.astype("S8")),
    "another axis": ("fiU", _nested_number),
    "one too few": ("fiU", lambda a: a[:-1]),
    "one too many": ("fiU", lambda a: np.concatenate([a, a[-1:]])),
    "a scalar": ("fiU", lambda a: np.asarray(a.ravel()[0])),
    "twice the same": ("U", lambda a: np.concatenate([a[:1], a[:1], a[2:]]) if len(a) > 1 else a),
    "a control character": ("U", lambda a: np.concatenate([np.array(["a\x1b[2J"]), a[1:]])),
    "numbers for names": ("U", lambda a: np.arange(a.size, dtype=float).reshape(a.shape)),
}
"""Tamperings of an array, and kinds of arrays that have them."""
ENDS: Mapping[str, Tampering] = {
    "t_s": lambda a: a[::-1],
    "time": lambda a: a[::-1],
    "mixture_length": lambda a: a[::-1],
    "sd": lambda a: -a,
    "scale": lambda a: -a,
    "weights": lambda a: -a,
    "eigenvalues": lambda a: a[::-1],
    "covariance": lambda a: -a,
}
"""What more is done to entries whose names end so: numbers reversed, or below 0."""
PLAIN: Mapping[str, Any] = {
    "missing": ...,
    "null": None,
    "text": "x\x1b",
    "number": 1e300,
    "negative": -1,
    "true": True,
    "list": [],
    "list of lists": [[[]]],
    "list of numbers": [0, 99],
    "table": {},
}
"""What stands in place of an entry of JSON or TOML."""
WHOLE = {
    "empty": "",
    "nested": NESTED,
    "nested tables": '{"a":' * 50_000 + "1" + "}" * 50_000,
    "nested in an entry": "name = " + NESTED,
    "digits": DIGITS,
    "digits in an entry": f"max_speed_m_s = {DIGITS}",
    "digits in a table": '{"status": ' + DIGITS + "}",
    "digits in a row": f"camera,frame,marker\n1,{DIGITS},1\n",
    "negative in a row": "camera,frame,marker\n-1,0,1\n",
    "short row": "camera,frame,marker\n1,2\n",
    "no text": "\udcff\udcfe\udcff",
}
"""What stands in place of a file of text."""


def tampered(kind: Kind, folder: Path) -> Iterator[tuple[str, str, Callable[[Path], None]]]:
    """Entry, tampering, and a function that tampers with the file at a path."""
    path = folder / kind.file
    if kind.made in ("json", "toml", "text"):
        for name, text in WHOLE.items():
            yield "file", name, lambda p, text=text: p.write_bytes(text.encode("utf-8", "surrogateescape"))
    if kind.made == "npz":
        with np.load(path) as file:
            arrays = dict(file)
        if kind.inside:
            for entry, name, found in _plain(json.loads(str(arrays[kind.inside]))):
                yield entry, name, lambda p, f=found: _save(p, arrays | {kind.inside: np.array(json.dumps(f()))})
            return
        for entry, array in arrays.items():
            rest = {k: v for k, v in arrays.items() if k != entry}
            yield entry, "missing", lambda p, rest=rest: _save(p, rest)
            yield entry, "objects", lambda p, e=entry: _save(p, arrays | {e: np.array([{}, None], dtype=object)})
            for name, change in _changes(entry, array):
                yield entry, name, lambda p, e=entry, c=change, a=array: _save(p, arrays | {e: c(a)})
    elif kind.made == "hdf5":
        with h5py.File(path, "r") as file:
            names = [n for n in file if file[n].size and "dimension but not" not in str(file[n].attrs.get("NAME", b""))]
            header = file.attrs.get("header")
            values = {n: _values(file[n]) for n in names}
        if kind.inside:
            for entry, name, found in _plain(json.loads(str(header))):
                yield entry, name, lambda p, f=found: _put_header(p, json.dumps(f()))
            return
        for entry, array in values.items():
            yield entry, "missing", lambda p, e=entry: _remove(p, e)
            for name, change in _changes(entry, array):
                if name not in ("another axis", "one too few", "one too many", "a scalar"):
                    yield entry, name, lambda p, e=entry, c=change, a=array: _put(p, e, c(a))
    elif kind.made in ("json", "toml"):
        text = path.read_text(encoding="utf-8")
        as_written = json.dumps if kind.made == "json" else _toml
        for entry, name, found in _plain(json.loads(text) if kind.made == "json" else tomllib.loads(text)):
            if kind.made == "json" or name != "null":  # TOML has none
                yield entry, name, lambda p, f=found: p.write_text(as_written(f()), encoding="utf-8")


def _changes(entry: str, array: np.ndarray) -> Iterator[tuple[str, Tampering]]:
    kind = {"f": "f", "i": "i", "u": "i", "U": "U", "b": "i"}.get(array.dtype.kind, "")
    for name, (kinds, change) in ARRAYS.items():
        if kind and kind in kinds and array.ndim:
            yield name, change
    for end, change in ENDS.items():
        if entry.endswith(end) and kind in "fi":
            yield "reversed or negative", change


def _plain(found: Any) -> Iterator[tuple[str, str, Callable[[], Any]]]:
    """Each entry of tables in tables (of a list its first table), replaced by each of ``PLAIN``; made when called."""

    def walk(part: Any, at: tuple[Any, ...]) -> Iterator[tuple[tuple[Any, ...], Any]]:
        keys = list(part) if isinstance(part, dict) else [0] if isinstance(part, list) and part else []
        for key in keys[:60]:
            yield (*at, key), part[key]
            if isinstance(part[key], dict | list) and len(at) < 3:
                yield from walk(part[key], (*at, key))

    def changed(place: tuple[Any, ...], value: Any) -> Any:
        whole = copy.deepcopy(found)
        part = whole
        for key in place[:-1]:
            part = part[key]
        if value is ...:
            del part[place[-1]]
        else:
            part[place[-1]] = value
        return whole

    for place, sound_value in walk(found, ()):
        for name, value in PLAIN.items():
            if value != sound_value:
                yield ".".join(map(str, place)), name, partial(changed, place, value)


def _toml(found: Any) -> str:
    """TOML of plain values."""

    def inline(value: Any) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(f"{quoted(str(k))} = {inline(v)}" for k, v in value.items()) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(map(inline, value)) + "]"
        return quoted(value) if isinstance(value, str) else json.dumps(value)

    tables = [k for k, v in found.items() if isinstance(v, dict)]
    lines = [f"{quoted(k)} = {inline(v)}" for k, v in found.items() if k not in tables]
    for key in tables:
        lines += [f"[{quoted(key)}]", *(f"{quoted(k)} = {inline(v)}" for k, v in found[key].items())]
    return "\n".join(lines) + "\n"


def _save(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with path.open("wb") as stream:
        np.savez(stream, allow_pickle=True, **arrays)


def _values(data: h5py.Dataset) -> np.ndarray:
    return data.asstr()[()].astype("U") if h5py.check_string_dtype(data.dtype) else data[()]


def _put(path: Path, entry: str, values: np.ndarray) -> None:
    with h5py.File(path, "r+") as file:
        data = file[entry]
        if data.shape == values.shape and values.dtype.kind == data.dtype.kind:
            data[...] = values
        elif data.shape == values.shape and h5py.check_string_dtype(data.dtype) and values.dtype.kind == "U":
            data[...] = values.astype(object)
        else:
            kept, scales = dict(data.attrs), [[s.name for s in dim.values()] for dim in data.dims]
            is_scale = data.is_scale
            if is_scale:  # others point to it: only its values can change
                return
            del file[entry]
            new = file.create_dataset(entry, data=values.astype("S") if values.dtype.kind == "U" else values)
            for name, value in kept.items():
                if name not in ("DIMENSION_LIST", "_FillValue", "REFERENCE_LIST"):
                    new.attrs[name] = value
            for axis, names in enumerate(scales):
                for name in names:
                    new.dims[axis].attach_scale(file[name])


def _remove(path: Path, entry: str) -> None:
    with h5py.File(path, "r+") as file:
        del file[entry]


def _put_header(path: Path, text: str) -> None:
    with h5py.File(path, "r+") as file:
        file.attrs["header"] = text


def judged(kind: Kind, folder: Path, change: Callable[[Path], None], shown: str) -> tuple[str, str]:
    """``refused``, ``same``, ``read`` (changed) or ``defect``, and what was said; the file is as before afterwards.

    Args:
        kind: The kind.
        folder: Of the sound records.
        change: Tampers with the file.
        shown: ``repr`` of the sound record, as ``as_text`` has it.
    """
    path = folder / kind.file
    whole = path.read_bytes()
    try:
        change(path)
        found = kind.read(folder)
    except (MocapError, ArchiveError) as error:
        text = str(error)
        good = "\n" not in text and path.name.split(".")[0] in text and len(text) < 2000
        return ("refused" if good else "defect"), text
    except Exception as error:
        return "defect", f"{type(error).__name__}: {error}"
    finally:
        path.write_bytes(whole)
    return ("refused", "") if found is None else ("same" if as_text(found) == shown else "read", "")


def as_text(record: Any) -> str:
    """A record's numbers and names, to be compared."""
    if is_dataclass(record):
        return "(" + ",".join(as_text(getattr(record, one.name)) for one in fields(record)) + ")"
    if isinstance(record, Mapping):
        return "{" + ",".join(f"{k}:{as_text(v)}" for k, v in record.items()) + "}"
    if isinstance(record, list | tuple):
        return "[" + ",".join(map(as_text, record)) + "]"
    if isinstance(record, np.ndarray):
        return f"{record.dtype.kind}{record.shape}" + record.tobytes().hex() if record.dtype != object else repr(record)
    return repr(record)


def run(options: argparse.Namespace) -> int:
    """Tamper with every entry of every kind, print the table, write it; the number of defects."""
    rows, every = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sound(folder)
        for title, kind in KINDS.items():
            shown, counts = as_text(kind.read(folder)), Counter()
            for entry, tampering, change in tampered(kind, folder):
                verdict, text = judged(kind, folder, change, shown)
                counts[verdict] += 1
                every.append(
                    {"record": title, "entry": entry, "tampering": tampering, "verdict": verdict, "text": text[:300]}
                )
                if verdict == "defect":
                    print(f"{title}, {entry}, {tampering}: {text[:200]}")
            rows.append(
                {
                    "record": title,
                    "points": counts.total(),
                    **{v: counts[v] for v in ("refused", "same", "read", "defect")},
                }
            )
    print("  ".join(f"{key:>{24 if key == 'record' else 7}}" for key in rows[0]))
    for row in rows:
        print("  ".join(f"{value:>{24 if key == 'record' else 7}}" for key, value in row.items()))
    defects = sum(row["defect"] for row in rows)
    print(f"{len(every)} tampered records: {defects} defects")
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        with (options.out / "records.csv").open("w", encoding="utf-8", errors="backslashreplace", newline="") as stream:
            writer = csv.DictWriter(stream, list(every[0]))
            writer.writeheader()
            writer.writerows(every)
    return defects
