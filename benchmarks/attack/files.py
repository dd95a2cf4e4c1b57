"""Damaged files for every reader: real ones where they lie in MOCAP_REAL_DATA, of our writers, and small ones.

Of each mutant one of these things becomes: it is refused in one line, it is read unchanged, it is read changed with a
finding that the sound file has not, it is read changed in silence, or there is a defect: a traceback, a hang, more
memory than 2 GB. What changed in silence is split: ``cells``, where the shape is the same and at most 200 values
differ; ``rows``, where whole rows are gone and all others are as they were; ``shifted``, the rest. What is read goes on
to the audit, and one in 50 that changed to the preparation for tracking; trouble there is a defect too.
"""

import argparse
import csv
import multiprocessing
import os
import pickle
import re
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import savemat

import mocap
from benchmarks.attack.mutants import damaged, kinds
from mocap.audit.inspect import inspect
from mocap.cleaning.cleaning import clean
from mocap.errors import FormatError, MocapError
from mocap.io.contents import FileContents, pixel_recording, point_recording
from mocap.io.format import Hints
from mocap.io.registry import read, write

SECONDS = 60.0
"""A file of these sizes that takes longer hangs; readers that start a process give up after 20 s."""
MOST_MB = 2000
"""More memory than that is a blow-up: the files have at most 0.4 MB."""
LARGEST = 400_000
"""Bytes of real files that are worth mutating; larger ones take seconds each."""
A_FORMAT = 8
"""Real files of a format, at most."""
FEW = 200
"""Values that may differ in a file of the same shape before it is more than a few cells."""
PREPARED = 50
"""One in so many changed recordings goes on to the preparation."""
REAL = Path(os.environ.get("MOCAP_REAL_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
APART = (
    *("qualisys-mat", "easywand", "easywand-tforms"),
    *("dltdv-project", "deeplabcut-h5", "movement", "sleap-analysis", "sleap-anipose-3d"),
)
"""Formats whose readers start a process a file: they get 300 cases."""
VERDICTS = ("refused", "unchanged", "finding", "cells", "rows", "shifted", "traceback", "hang", "memory")
DEFECTS = ("traceback", "hang", "memory")
SMALL = {
    "xypts.csv": "pt1_cam1_X,pt1_cam1_Y,pt1_cam2_X,pt1_cam2_Y\n" + "1.250000,2.500000,NaN,NaN\n" * 6,
    "argus.csv": "a_cam_1_x,a_cam_1_y,b_cam_1_x,b_cam_1_y\n" + "1.5,2.5,3.5,4.5\n" * 6,
    "a-xyzpts.csv": "a_x,a_y,a_z\n" + "0.125,0.250,0.375\n" * 6,
    "b-xypts.tsv": "Row\tColumn\tEntry\n9\t4\t4\n" + "".join(f"{i}\t{i}\t5.5\n" for i in range(1, 5)),
    "sparse.tsv": "Sparse format 3D coordinates file\n9\t6\t4\n" + "".join(f"{i}\t{i}\t5.5\n" for i in range(1, 5)),
    "names.tsv": "PointNames_to_go_with_DLTdv8a_sparsesave_arrays\ntip\nroot\n",
    "sba-profile.txt": "900 320 240 1 0 -0.1 0 0 0 0 1 0 0 0 0 0 5\n" * 3,
    "profile.txt": "".join(f"{c} 526 640 512 320 256 1 -0.3069 0.1134 0 0 0\n" for c in (1, 2, 3)),
    "frames.csv": "Frame,a_X,a_Y,a_Z\n" + "".join(f"{i},1.5,2.5,3.5\n" for i in range(1, 7)),
    "offset.csv": "cam0_offsetcam1_offseta_cam1_X,a_cam1_Y,a_cam2_X,a_cam2_Y\n" + "0,0,1.5,2.5,3.5,4.5\n" * 6,
    "anipose.csv": "a_x,a_y,a_z,a_error,a_ncams,a_score,fnum\n"
    + "".join(f"1.5,2.5,3.5,0.5,2,0.9,{i}\n" for i in range(6)),
    "dlc.csv": "scorer,s,s,s\nbodyparts,a,a,a\ncoords,x,y,likelihood\n"
    + "".join(f"{i},1.5,2.5,0.5\n" for i in range(6)),
    "plain.csv": "time,hip.x,hip.y,hip.z\n" + "".join(f"{i / 10},1.5,2.5,3.5\n" for i in range(6)),
    "offsets.csv": "camera_1,camera_2\n" + "0,3\n" * 6,
    "c-xyzres.csv": "a,b\n" + "0.125,0.250\n" * 6,
    "cis.csv": "a_x_lower,a_x_upper,a_y_lower,a_y_upper,a_z_lower,a_z_upper\n" + "0.1,1.1,0.2,2.2,0.3,3.3\n" * 6,
}
"""Files as programs write them of which there is no real one here."""


@dataclass(frozen=True)
class Seed:
    """A sound file, what it is, and what it holds."""

    name: str
    format: str
    content: bytes
    values: dict[str, np.ndarray]
    findings: frozenset[str]


@dataclass(frozen=True)
class Outcome:
    """What came of one mutant: a verdict, how many values differ, and words on it."""

    case: int
    seed: str
    format: str
    kind: str
    verdict: str
    changed: int = 0
    text: str = ""


def values_of(recording: FileContents) -> dict[str, np.ndarray]:
    """All numbers of a recording by name; rows are the first axis of those of a marker or frame."""
    found: dict[str, Any] = {"frames": recording.frames, **recording.tables}
    if recording.points is not None:
        points = recording.points
        found |= {"xyz": points.xyz_m, "t_s": points.t_s, "origin": points.status, "sd": points.sd_m}
    if recording.pixels is not None:
        found |= {"uv": np.moveaxis(recording.pixels.uv_px, 1, 0), "t_s": recording.pixels.t_s}
    if recording.score is not None:
        found["score"] = np.moveaxis(recording.score, 1, 0) if recording.score.ndim == 3 else recording.score
    if recording.cameras:
        found["cameras"] = np.stack([camera.matrix for camera in recording.cameras])
    for i, (lens, size) in enumerate(recording.lenses):
        found[f"lens{i}"] = np.array([*lens.f_px, *lens.centre_px, *lens.coefficients, *(size or ())])
    found["names"] = np.array([*recording.names, *recording.camera_names, recording.unit or "", recording.format])
    return {name: np.asarray(value) for name, value in found.items()}


def compared(sound: dict[str, np.ndarray], got: dict[str, np.ndarray]) -> tuple[str, int]:
    """``unchanged``, ``cells``, ``rows`` or ``shifted``, and how many values differ."""
    if sound.keys() == got.keys() and all(sound[name].shape == got[name].shape for name in sound):
        changed = sum(int((~_same(sound[name], got[name])).sum()) for name in sound)
        return ("unchanged" if not changed else "cells" if changed <= FEW else "shifted"), changed
    changed = sum(abs(sound.get(n, np.zeros(0)).size - got.get(n, np.zeros(0)).size) for n in sound.keys() | got.keys())
    whole = sound.keys() == got.keys() and np.array_equal(sound["names"], got["names"]) and len(sound["frames"]) > 0
    rows = whole and all(_rows_of(got[name], sound[name]) for name in sound if name != "frames")
    return ("rows" if rows else "shifted"), changed


def _same(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a == b if a.dtype.kind in "US" else (a == b) | ((a != a) & (b != b))


def _rows_of(some: np.ndarray, all_: np.ndarray) -> bool:
    """Whether the rows of one array are the first or the last of another, or all but a run of them."""
    if some.shape[1:] != all_.shape[1:] or len(some) > len(all_):
        return False
    n = len(some)
    first, last = (_same(some, part).reshape(n, some[:1].size) for part in (all_[:n], all_[len(all_) - n :]))
    front = int(np.cumprod(np.asarray(first.all(axis=1))).sum())
    back = int(np.cumprod(np.asarray(last.all(axis=1))[::-1]).sum())
    return front + back >= n


def plain_findings(findings: Sequence[str]) -> frozenset[str]:
    """Findings without their numbers: a count that differs is no new finding."""
    return frozenset(re.sub(r"[\d.eE+-]*\d", "#", finding) for finding in findings)


def seeds(folder: Path, *, real: bool = True) -> list[Seed]:
    """Sound files of all formats, read once to be sure of it."""
    found = [path for path in sorted(REAL.rglob("*")) if path.is_file()] if real and REAL.is_dir() else []
    paths = [path for path in found if path.suffix in (".csv", ".tsv", ".mat", ".h5", ".c3d", ".trc", ".toml", ".txt")]
    paths = [path for path in paths if path.stat().st_size <= LARGEST]
    for name, content in SMALL.items():
        (folder / name).write_text(content, encoding="utf-8")
    paths += [folder / name for name in SMALL] + _written(folder) + _binary(folder)
    out, per_format = [], Counter()
    for path in paths:
        try:
            recording = read(path)
        except FormatError:
            continue
        if per_format[recording.format] < A_FORMAT or path.parent == folder:
            per_format[recording.format] += 1
            findings = plain_findings(inspect([path], Hints())[0]["findings"])
            out.append(Seed(path.name, recording.format, path.read_bytes(), values_of(recording), findings))
    return out


def _written(folder: Path) -> list[Path]:
    """A file of each of our writers."""
    rng = np.random.default_rng(0)
    xyz = rng.normal(size=(8, 3, 3))
    xyz[2, 1] = np.nan
    points = point_recording(folder / "made", "made", names=["a", "b c", "d,e"], xyz=xyz, unit="m", fps=100.0)
    pixels = pixel_recording(
        folder / "made", "made", names=["a", "b"], cameras=["cam1", "cam2"], uv_px=rng.uniform(0, 999, (2, 8, 2, 2)),
        fps=100.0, score=rng.uniform(size=(2, 8, 2)),
    )  # fmt: skip
    names = ["w.csv", "w_long.csv", "w.parquet", "w.nc", "w.trc", "w.c3d", "w_xyzpts.csv"]
    for name in names:
        write(points, folder / name)
    for name in ("p_long.csv", "p.parquet", "p.nc", "p_xypts.csv"):
        write(pixels, folder / name)
    return [folder / name for name in [*names, "p_long.csv", "p.parquet", "p.nc", "p_xypts.csv", "p_xyzres.csv"]]


def _binary(folder: Path) -> list[Path]:
    """Small files as Qualisys Track Manager and DeepLabCut lay them out; the real ones here are large or none."""
    data = np.arange(40.0).reshape(2, 4, 5)
    labelled = {"Count": 2, "Labels": np.array(["a", "b"], dtype=object), "Data": data, "Type": np.ones((2, 5))}
    struct = {"Frames": 5, "StartFrame": 1, "FrameRate": 100.0, "Trajectories": {"Labeled": labelled}}
    savemat(folder / "qtm.mat", {"trial": struct})
    columns = [("s", part, axis) for part in ("a", "b") for axis in ("x", "y", "likelihood")]
    rows = np.zeros(6, dtype=[("index", "<i8"), ("values_block_0", "<f8", (len(columns),))])
    rows["index"], rows["values_block_0"] = np.arange(6), np.arange(36.0).reshape(6, 6)
    with h5py.File(folder / "dlc.h5", "w") as file:
        table = file.create_dataset("df_with_missing/table", data=rows)
        table.attrs["values_block_0_kind"] = np.bytes_(pickle.dumps(columns, 0))
    return [folder / "qtm.mat", folder / "dlc.h5"]


def judge(seed: Seed, case: int, folder: Path, *, track: bool = False) -> Outcome:
    """Damage a seed as the case's number says, read it, and judge what comes."""
    rng = np.random.default_rng([case, len(seed.content)])
    kind = str(rng.choice(kinds(seed.content)))
    content = damaged(seed.content, kind, rng)
    path = folder / seed.name
    path.write_bytes(content)

    def outcome(verdict: str, changed: int = 0, text: str = "") -> Outcome:
        return Outcome(case, seed.name, seed.format, kind, verdict, changed, text[:300])

    if content == seed.content:
        return outcome("unchanged")
    try:
        recording = read(path)
    except FormatError as error:
        several = "\n" in str(error)
        return outcome("traceback" if several else "refused", text=str(error))
    except MemoryError as error:
        return outcome("memory", text=str(error))
    except Exception as error:
        return outcome("traceback", text=f"{type(error).__name__}: {error}")
    verdict, changed = compared(seed.values, values_of(recording))
    if verdict == "unchanged":
        return outcome(verdict)
    try:
        found = inspect([path], Hints())[0]
        if "report this" in found.get("error", "") or any("came to no end" in f for f in found["findings"]):
            return outcome("traceback", changed, found["findings"][-1])
        if track or rng.integers(PREPARED) == 0:
            clean(mocap.read(path, fps=recording.fps or 100.0))
    except MocapError:
        pass
    except Exception as error:
        return outcome("traceback", changed, f"after reading: {type(error).__name__}: {error}")
    new = plain_findings(found["findings"]) - seed.findings
    return outcome("finding" if new else verdict, changed, "; ".join(sorted(new)))


def _work(jobs: Connection, folder: str, found: list[Seed], track: bool) -> None:
    """Answer case numbers with outcomes and the memory that was needed, until none comes."""
    resource.setrlimit(resource.RLIMIT_AS, (16 << 30, 16 << 30))
    while (job := jobs.recv()) is not None:
        case, index = job
        outcome = judge(found[index], case, Path(folder), track=track)
        who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        jobs.send((outcome, max(resource.getrusage(one).ru_maxrss for one in who) / 1e3))


class _Worker:
    """A process that reads mutants in a folder of its own."""

    def __init__(self, context: Any, root: str, number: int, found: list[Seed], track: bool) -> None:
        folder = Path(root) / str(number)
        folder.mkdir(exist_ok=True)
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs, str(folder), found, track), daemon=True)
        self.process.start()
        theirs.close()
        self.job: tuple[int, int] | None = None
        self.since = time.monotonic()

    def give(self, job: tuple[int, int]) -> None:
        self.job, self.since = job, time.monotonic()
        self.pipe.send(job)

    def end(self) -> None:
        self.process.kill()
        self.process.join()


def plan(found: Sequence[Seed], cases: int, seed: int, *, least: int = 300) -> list[tuple[int, int]]:
    """Case numbers with the seed of each: as many for each format, ``least`` for slow ones and at least."""
    formats: dict[str, list[int]] = {}
    for index, one in enumerate(found):
        formats.setdefault(one.format, []).append(index)
    slow = [format for format in formats if format in APART]
    each = max(least, -(-(cases - least * len(slow)) // max(1, len(formats) - len(slow))))
    jobs = [
        places[i % len(places)] for format, places in formats.items() for i in range(least if format in slow else each)
    ]
    numbered = [(seed * 1_000_000 + number, index) for number, index in enumerate(jobs)]
    np.random.default_rng(seed).shuffle(numbered)  # slow formats among quick ones: a run that is cut tells something
    return [(int(case), int(index)) for case, index in numbered]


def outcomes(
    found: list[Seed], jobs: Sequence[tuple[int, int]], *, workers: int, track: bool = False
) -> Iterator[Outcome]:
    """Judge cases in workers that are replaced where they crash, hang or take too much memory."""
    context, waiting = multiprocessing.get_context("forkserver"), list(jobs)[::-1]
    with tempfile.TemporaryDirectory() as root:
        team = [_Worker(context, root, n, found, track) for n in range(workers)]
        while waiting or any(worker.job for worker in team):
            for worker in team:
                if worker.job is None and waiting:
                    worker.give(waiting.pop())
            ready = wait([worker.pipe for worker in team if worker.job], timeout=1.0)
            for n, worker in enumerate(team):
                if worker.job is None:
                    continue
                (case, index), verdict, text = worker.job, None, ""
                if worker.pipe in ready:
                    try:
                        outcome, megabytes = worker.pipe.recv()
                        if megabytes < MOST_MB:
                            worker.job = None
                            yield outcome
                            continue
                        verdict, text = "memory", f"{megabytes:.0f} MB"
                    except (EOFError, OSError):
                        verdict, text = "traceback", "the process died"
                elif time.monotonic() - worker.since > SECONDS:
                    verdict, text = "hang", f"more than {SECONDS:g} s"
                if verdict is not None:
                    worker.end()
                    yield Outcome(case, found[index].name, found[index].format, "", verdict, 0, text)
                    team[n] = _Worker(context, root, n, found, track)
        for worker in team:
            worker.end()


def table(done: Sequence[Outcome], found: Sequence[Seed]) -> list[dict[str, Any]]:
    """A row a format: files, cases, how many of each verdict, and the median of values that changed in silence."""
    rows = []
    for format in [*sorted({outcome.format for outcome in done}), "all"]:
        own = [outcome for outcome in done if format in ("all", outcome.format)]
        counts = Counter(outcome.verdict for outcome in own)
        silent = [outcome.changed for outcome in own if outcome.verdict in ("cells", "rows", "shifted")]
        files = sum(format in ("all", seed.format) for seed in found)
        row: dict[str, Any] = {"format": format, "files": files, "cases": len(own)}
        row |= {verdict: counts[verdict] for verdict in VERDICTS}
        rows.append(
            row | {"median_silent": int(np.median(silent)) if silent else 0, "most_silent": max(silent, default=0)}
        )
    return rows


def run(options: argparse.Namespace) -> int:
    """Attack, print the table, write it; the number of defects."""
    with tempfile.TemporaryDirectory() as folder:
        found = seeds(Path(folder), real=not options.quick)
    found = [seed for seed in found if options.only in (None, seed.format)]
    jobs = plan(found, 0 if options.quick else options.cases, options.seed, least=10 if options.quick else 300)
    done, start = [], time.perf_counter()
    for outcome in outcomes(found, jobs, workers=options.workers, track=options.track):
        done.append(outcome)
        if len(done) % 1000 == 0:
            print(f"{len(done)} of {len(jobs)}, {time.perf_counter() - start:.0f} s", file=sys.stderr)
        if outcome.verdict in DEFECTS:
            print(
                f"case {outcome.case}, {outcome.seed}, {outcome.kind}: {outcome.verdict}: {outcome.text}",
                file=sys.stderr,
            )
    rows = table(done, found)
    print("  ".join(f"{title:>{_width(title)}}" for title in rows[0]))
    for row in rows:
        print("  ".join(f"{value:>{_width(title)}}" for title, value in row.items()))
    shifted = Counter((o.format, o.kind) for o in done if o.verdict == "shifted")
    print("shifted in silence: " + (", ".join(f"{f} {k} {n}" for (f, k), n in shifted.most_common()) or "none"))
    defects = sum(outcome.verdict in DEFECTS for outcome in done)
    took = time.perf_counter() - start
    print(f"{len(done)} mutants of {len(found)} files, seed {options.seed}, {took:.0f} s: {defects} defects")
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        _write(options.out / "table.csv", rows)
        _write(options.out / "cases.csv", [vars(outcome) for outcome in done])
    return defects


def _width(title: str) -> int:
    return 21 if title == "format" else max(6, len(title))


def _write(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    with path.open("w", encoding="utf-8", errors="backslashreplace", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
