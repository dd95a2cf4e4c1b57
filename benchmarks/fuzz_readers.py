"""Damaged files for every reader: ``python -m benchmarks.fuzz_readers [--cases 20000] [--seed 0]``.

Files of every format (real ones where they lie in MOCAP_REAL_DATA, and files of our writers and of small size as the
programs write them) are cut, bent and spliced. Of each only two things may happen: a FormatError in one line, or a
recording; of a file that was cut, a recording only of whole rows with the values of the whole file. A worker reads, a
watchman counts the seconds: a crash or a hang is a defect too. The table gives, for each format, the cases, how many
were refused, and the defects; the exit code is their number.
"""

import argparse
import multiprocessing
import os
import pickle
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

from mocap.errors import FormatError
from mocap.formats.recording import Recording, pixel_recording, point_recording
from mocap.formats.registry import read, write

SECONDS = 60.0
"""A file of these sizes that takes longer hangs; readers that start a process give up after 20 s."""
LARGEST = 400_000
"""Bytes of real files that are worth mutating; larger ones take seconds each."""
REAL = Path(os.environ.get("MOCAP_REAL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
APART = (
    *("c3d", "qualisys-mat", "easywand", "easywand-tforms"),
    *("dltdv-project", "deeplabcut-h5", "movement", "sleap-analysis", "sleap-anipose-3d"),
)
"""Formats whose readers start a process a file: they get a tenth of the cases that others do."""
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
    """A sound file, and what it holds."""

    name: str
    format: str
    content: bytes


@dataclass(frozen=True)
class Outcome:
    """What came of one damaged file: ``refused``, ``read``, or a defect in words."""

    case: int
    seed: str
    format: str
    verdict: str


def seeds(folder: Path, *, real: bool = True) -> list[Seed]:
    """Sound files of all formats, read once to be sure of it."""
    found = [path for path in sorted(REAL.rglob("*")) if path.is_file()] if real and REAL.is_dir() else []
    paths = [path for path in found if path.suffix in (".csv", ".tsv", ".mat", ".h5", ".c3d", ".trc", ".toml", ".txt")]
    paths = [path for path in paths if path.stat().st_size <= LARGEST]
    for name, content in SMALL.items():
        (folder / name).write_text(content)
    paths += [folder / name for name in SMALL] + _written(folder) + _binary(folder)
    out, per_format = [], Counter()
    for path in paths:
        try:
            recording = read(path)
        except FormatError:
            continue
        if per_format[recording.format] < 4:
            per_format[recording.format] += 1
            out.append(Seed(path.name, recording.format, path.read_bytes()))
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


def damaged(content: bytes, rng: np.random.Generator) -> tuple[bytes, bool]:
    """The content with one to three things done to it, and whether it was only cut."""
    kind = int(rng.integers(8))
    if kind <= 1:
        return content[: int(rng.integers(len(content)))], True
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 4))):
        at, length = int(rng.integers(len(data) or 1)), int(rng.integers(1, 40))
        head = int(rng.integers(min(len(data), 2000) or 1))
        if kind == 2:
            data[at : at + 1] = bytes([int(rng.integers(256))])
        elif kind == 3:
            data[head : head + 1] = bytes([int(rng.integers(256))])
        elif kind == 4:
            del data[at : at + length]
        elif kind == 5:
            data[at:at] = data[at : at + length]
        elif kind == 6:
            data[at : at + 1] = rng.choice(
                [b"", b",", b"\t", b"\n", b"-", b"9", b"NaN", b"inf", b"1e400", b'"', b"\xff"]
            )
        else:
            lines = bytes(data).split(b"\n")
            one, other = int(rng.integers(len(lines))), int(rng.integers(len(lines)))
            lines[one], lines[other] = lines[other], lines[one]
            data = bytearray(b"\n".join(lines))
    return bytes(data), False


def judge(seed: Seed, case: int, folder: Path) -> Outcome:
    """Damage a seed as the case's number says, read it, and judge what comes."""
    rng = np.random.default_rng([case, len(seed.content)])
    content, cut = damaged(seed.content, rng)
    path = folder / seed.name
    path.write_bytes(content)
    verdict = "read"
    try:
        recording = read(path)
    except FormatError as error:
        verdict = "refused" if "\n" not in str(error) else "an error of several lines"
    except Exception as error:
        verdict = f"{type(error).__name__}: {error}"[:200]
    else:
        if cut:
            path.write_bytes(seed.content)
            verdict = _truth_of_cut(recording, read(path), content, seed.content)
    return Outcome(case, seed.name, seed.format, verdict)


def _truth_of_cut(got: Recording, whole: Recording, content: bytes, full: bytes) -> str:
    """A file that was cut may be read only at the end of a row, and then with the values of the whole one."""
    if got.format != whole.format and got.format in ("csv", "dltdv-coefficients"):
        return "read"  # what is left is a sound file of another kind
    if any("cut" in finding for finding in got.findings):
        return "read"
    lost = full[len(content) :]
    if b"\0" not in full and lost.strip() and content[-1:] not in b"\r\n" and lost[:1] not in b"\r\n":
        return "a cut row was read"
    n = len(got.frames)
    if n > len(whole.frames) or not np.array_equal(got.frames, whole.frames[:n]):
        return "a cut file has other frames"
    pairs = [(getattr(got.pixels, "uv_px", None), getattr(whole.pixels, "uv_px", None), 1)]
    pairs.append((getattr(got.points, "xyz_m", None), getattr(whole.points, "xyz_m", None), 0))
    for ours, theirs, axis in pairs:
        if ours is not None and got.names == whole.names:
            first = theirs[:, :n] if axis else theirs[:n]
            if ours.shape != first.shape or not np.array_equal(ours, first, equal_nan=True):
                return "a cut file has other values"
    return "read"


def _work(jobs: Connection, folder: str, found: list[Seed]) -> None:
    """Answer case numbers with outcomes until none comes."""
    while (job := jobs.recv()) is not None:
        case, index = job
        jobs.send(judge(found[index], case, Path(folder)))


def outcomes(found: list[Seed], cases: int, seed: int) -> Iterator[Outcome]:
    """Judge cases in a worker that is replaced where it crashes or hangs."""
    slow = [i for i, s in enumerate(found) if s.format in APART]
    rng = np.random.default_rng(seed)
    context = multiprocessing.get_context("forkserver")
    with tempfile.TemporaryDirectory() as folder:
        worker, pipe = _start(context, folder, found)
        for case in range(cases):
            index = int(rng.integers(len(found)))
            if index in slow and rng.random() > 0.1:
                index = int(rng.choice([i for i in range(len(found)) if i not in slow]))
            pipe.send((seed * cases + case, index))
            verdict = None
            try:
                if pipe.poll(SECONDS):
                    yield pipe.recv()
                    continue
                verdict = f"hangs for more than {SECONDS:g} s"
            except (EOFError, OSError):
                verdict = "the process died"
            worker.kill()
            worker.join()
            yield Outcome(seed * cases + case, found[index].name, found[index].format, verdict)
            worker, pipe = _start(context, folder, found)
        pipe.send(None)
        worker.join()


def _start(context: multiprocessing.context.BaseContext, folder: str, found: list[Seed]):
    ours, theirs = context.Pipe()
    worker = context.Process(target=_work, args=(theirs, folder, found), daemon=True)  # type: ignore[attr-defined]
    worker.start()
    theirs.close()
    return worker, ours


def main(arguments: list[str] | None = None) -> int:
    """Run and print; the number of defects."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="300 cases, without real files")
    options = parser.parse_args(arguments)
    cases = 300 if options.quick else options.cases
    with tempfile.TemporaryDirectory() as folder:
        found = seeds(Path(folder), real=not options.quick)
    counts: dict[str, Counter[str]] = {}
    defects, start = [], time.perf_counter()
    for outcome in outcomes(found, cases, options.seed):
        kind = outcome.verdict if outcome.verdict in ("read", "refused") else "defect"
        counts.setdefault(outcome.format, Counter())[kind] += 1
        if kind == "defect":
            defects.append(outcome)
            print(f"case {outcome.case}, {outcome.seed}: {outcome.verdict}", file=sys.stderr)
    print(f"{'format':24}{'files':>7}{'cases':>8}{'refused':>9}{'read':>7}{'defects':>9}")
    for format in sorted(counts):
        row, files = counts[format], sum(s.format == format for s in found)
        print(f"{format:24}{files:7}{row.total():8}{row['refused']:9}{row['read']:7}{row['defect']:9}")
    print(f"{cases} damaged files of {len(found)} in {time.perf_counter() - start:.0f} s: {len(defects)} defects")
    return min(len(defects), 255)


if __name__ == "__main__":
    sys.exit(main())
