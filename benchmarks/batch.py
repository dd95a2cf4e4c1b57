"""Batches of short twins: speed of two processes over one, what the engine costs, kills, bad files, memory.

Everything is measured through the commands that a user types, in processes of their own. Beside them: a shell loop
over ``mocap track`` (``xargs -P 2``, as GNU parallel would do it), which pays the start of Python for each trial.

Wall-clock times are those of this machine while it was measured; processor seconds of the processes, which a busy
neighbour changes less, are beside them. ``DIR/table.csv`` has a row for each command, ``DIR/batch.md`` all tables.
"""

import argparse
import ctypes
import hashlib
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import pandas as pd
import psutil
from mocap.datasets import make_bat, write_recording

from mocap.batches.summary import read_times

FPS = 240.0
CALL = [sys.executable, "-c", "if __name__ == '__main__': from mocap.cli.main import main; main()"]
"""The command ``mocap``, of this checkout."""
QUICK = ["--model", "constant_velocity", "--no-validate"]
"""The quickest trials are the hardest for an engine."""
NOT_COMPARED = ("times.csv", "summary.html", ".mocap-manifest.json")
"""Files of the results folder itself that tell the time, and the list that holds their SHA-256."""


@dataclass(frozen=True, kw_only=True)
class Spent:
    """What a command took: seconds by the clock, and of processors (with all processes that it started)."""

    wall_s: float
    cpu_s: float


@dataclass(frozen=True, kw_only=True)
class Sample:
    """A batch at a moment: processor seconds so far and resident megabytes, of the command and of its workers."""

    at_s: float
    command_s: float
    command_mb: float
    workers_s: Mapping[int, float]
    worker_mb: float


def make_twins(folder: Path, count: int, *, frames: int) -> None:
    """Short flights of bats in nested folders, each with its calibration and skeleton.

    Beside ten of them there is one whose clicks are cut off.
    """
    for i in range(count):
        place = folder / f"bat{i % 10:02d}" / f"t{i:04d}"
        if not place.is_dir():
            recording = make_bat(seed=i, n_frames=frames, n_cameras=3)
            paths = write_recording(recording, place)
            paths["truth"].unlink()
            paths["card"].unlink()
    for i in range(count // 10):
        place = folder / "damaged" / f"d{i:04d}"
        if not place.is_dir():
            shutil.copytree(folder / f"bat{i % 10:02d}" / f"t{i:04d}", place)
            (clicks,) = place.glob("*_xypts.csv")
            clicks.write_bytes(clicks.read_bytes()[:5000] + b"\n1,2,3\n")


def reaped() -> None:
    """Wait for all that a command started: processes whose parent has ended are this one's on Linux (``main``)."""
    with suppress(ChildProcessError):
        while True:
            os.wait()


def spent(command: Sequence[str]) -> Spent:
    """Run a command to its end."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wall_s = time.perf_counter() - begun
    reaped()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Spent(wall_s=wall_s, cpu_s=cpu)


def batch(twins: Path, out: Path, *options: str, jobs: int) -> list[str]:
    """The command."""
    given = ["--out", str(out), "--fps", str(FPS), "--jobs", str(jobs), *QUICK, *options]
    return [*CALL, "batch", str(twins), *given]


def contents(out: Path) -> dict[str, str]:
    """SHA-256 of every file of the results that does not tell the time."""
    files = [path for path in sorted(out.rglob("*")) if path.is_file()]
    left_out = {out / name for name in NOT_COMPARED}
    return {
        path.relative_to(out).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if path not in left_out
    }


def loop(twins: Path, out: Path) -> list[str]:
    """``mocap track`` of each trial, two at a time; as ``mocap batch --pictures`` it writes all there is."""
    out.mkdir()
    options = " ".join(["--fps", str(FPS), *QUICK])
    beside = '--calibration "${s}_dltCoefs.csv" --profile "${s}_camera_profile.txt" --skeleton "${s}_skeleton.toml"'
    place = '"$4/$(basename "$(dirname "$s")")"'
    one = f's="${{1%_xypts.csv}}"; exec "$2" -c "$3" track "$1" {beside} {options} --jobs 1 --out {place}'
    listed = out / "list.txt"
    listed.write_text("\n".join(sorted(map(str, twins.rglob("*_xypts.csv")))) + "\n")
    return ["xargs", "-a", str(listed), "-P", "2", "-I{}", "sh", "-c", one, "sh", "{}", *CALL[::2], str(out)]


def in_one_process(twins: Path, out: Path) -> list[str]:
    """The same trials one after the other in one process without an engine."""
    script = (
        "import sys; from pathlib import Path; from mocap.batches.find import find_trials; "
        "from mocap.batches.trial import Options; from mocap.batches.one import track_trial; "
        f"out = Path(sys.argv[2]); options = Options(model='constant_velocity', validate=False); "
        f"[track_trial(t, options, out) for t in find_trials([sys.argv[1]], arguments={{'fps': {FPS}}})]"
    )
    return [sys.executable, "-c", script, str(twins), str(out)]


def watched(command: Sequence[str]) -> tuple[Spent, list[Sample]]:
    """Run a batch to its end, and look at its processes twice a second."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    samples = []
    while running.poll() is None:
        try:
            own = psutil.Process(running.pid)
            workers = {process.pid: process for process in own.children(recursive=True)}
            samples.append(
                Sample(
                    at_s=time.time(),
                    command_s=sum(own.cpu_times()[:2]),
                    command_mb=own.memory_info().rss / 1e6,
                    workers_s={pid: sum(process.cpu_times()[:2]) for pid, process in workers.items()},
                    worker_mb=max((process.memory_info().rss / 1e6 for process in workers.values()), default=0.0),
                )
            )
        except psutil.NoSuchProcess:
            continue
        finally:
            time.sleep(0.5)
    wall_s = time.perf_counter() - begun
    reaped()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Spent(wall_s=wall_s, cpu_s=cpu), samples


def trials(twins: Path, folder: Path, count: int, *, beside: bool) -> list[str]:
    """One process, two, no engine, and a second run; what the engine costs; memory.

    ``beside``: with pictures and beside a shell loop, too.
    """
    took: dict[str, Spent] = {}
    engine, memory = [], []
    for jobs, name in ((1, "mocap batch, 1 process"), (2, "mocap batch, 2 processes")):
        out = folder / f"jobs{jobs}"
        shutil.rmtree(out, ignore_errors=True)
        took[name], samples = watched(batch(twins, out, jobs=jobs))
        print(name, took[name], file=sys.stderr, flush=True)
        engine.append(engine_row(out, samples, jobs=jobs))
        memory += memory_rows(out, samples, jobs=jobs)
    commands: dict[str, Callable[[Path], list[str]]] = {"no engine, 1 process": lambda out: in_one_process(twins, out)}
    if beside:
        commands["mocap batch --pictures, 2 processes"] = lambda out: batch(twins, out, "--pictures", jobs=2)
        commands["xargs -P 2 mocap track"] = lambda out: loop(twins, out)
    for name, command in commands.items():
        out = folder / f"beside{len(took)}"
        shutil.rmtree(out, ignore_errors=True)
        took[name] = spent(command(out))
        print(name, took[name], file=sys.stderr, flush=True)
    again = spent(batch(twins, folder / "jobs2", jobs=2))
    same = contents(folder / "jobs1") == contents(folder / "jobs2")
    lines = [
        f"## Speed: {count} twins, {count // 10} damaged files",
        "",
        "| command | wall s | processor s | processor s a trial |",
        "|---|---|---|---|",
    ]
    rows = [{"command": name, **vars(one), "cpu_s_a_trial": one.cpu_s / count} for name, one in took.items()]
    pd.DataFrame(rows).to_csv(folder / "table.csv", index=False, float_format="%.6g")
    for name, one in took.items():
        lines.append(f"| {name} | {one.wall_s:.1f} | {one.cpu_s:.1f} | {one.cpu_s / count:.2f} |")
    alone, two, bare, *others = took.values()
    table = pd.read_csv(folder / "jobs2" / "summary.csv")["status"].value_counts().to_dict()
    lines += [
        "",
        f"- speedup of 2 processes over 1: {alone.wall_s / two.wall_s:.2f} by the clock, start included",
        f"- beside the same trials without an engine: {100 * (alone.cpu_s / bare.cpu_s - 1):+.1f} % processor time, "
        "start of the worker included",
        f"- a second run, which has nothing to do: {again.wall_s:.1f} s",
        f"- 1 and 2 processes write the same bytes: {same}",
        f"- trials: {table}",
    ]
    if beside:
        pictures, shell = others
        lines.append(
            f"- the shell loop takes {shell.wall_s / pictures.wall_s:.2f} times as long as mocap batch --pictures, "
            f"which writes the same files, and {shell.cpu_s / pictures.cpu_s:.2f} times the processor time"
        )
    lines += stored(folder / "jobs1", count)
    title = ["", "## The engine, once it runs", ""]
    lines += [*title, "| processes | workers wait | the command itself |", "|---|---|---|", *engine]
    title = ["", "## Memory: most resident, while so many trials were done", ""]
    return [*lines, *title, "| processes | trials | command, MB | worker, MB |", "|---|---|---|---|", *memory]


def stored(out: Path, count: int) -> list[str]:
    """What a file system must take: files, folders and bytes a trial."""
    files = [path for path in out.rglob("*") if path.is_file()]
    folders = sum(path.is_dir() for path in out.rglob("*"))
    size = sum(path.stat().st_size for path in files)
    return [
        f"- a trial is {len(files) / count:.1f} files in {folders / count:.1f} folders, {size / count / 1e6:.2f} MB"
    ]


def finished(out: Path) -> list[Path]:
    """The records of trials that have been finished; folders may come and go meanwhile."""
    return [Path(folder) / "trial.json" for folder, _, names in os.walk(out) if "trial.json" in names]


def ended_s(out: Path) -> dict[str, float]:
    """When each trial ended that was tracked."""
    return {path.parent.relative_to(out).as_posix(): path.stat().st_mtime for path in finished(out)}


def engine_row(out: Path, samples: Sequence[Sample], *, jobs: int) -> str:
    """What the engine costs once it runs: time in which workers wait, and processor time of the command itself.

    Both are shares, which a busy neighbour hardly changes: workers wait between the first trial's begin and the last
    trial's end for as long as no trial is theirs (``times.csv``).
    """
    ended = ended_s(out)
    seconds = {trial: spent for trial, spent in read_times(out).items() if trial in ended}
    begun, end = min(ended[trial] - spent for trial, spent in seconds.items()), max(ended.values())
    # at the end one worker has none left: the longest trial at most, of which half is expected
    waited = 1 - (sum(seconds.values()) + (jobs - 1) * median(seconds.values()) / 2) / (jobs * (end - begun))
    running = [sample for sample in samples if begun <= sample.at_s <= end]
    command_s = running[-1].command_s - running[0].command_s
    workers_s = sum(running[-1].workers_s.values()) - sum(running[0].workers_s.values())
    return (
        f"| {jobs} | {100 * max(waited, 0):.1f} % | {1e3 * command_s / len(seconds):.0f} ms a trial, "
        f"{100 * command_s / (workers_s + command_s):.1f} % of all processor time |"
    )


def memory_rows(out: Path, samples: Sequence[Sample], *, jobs: int) -> list[str]:
    """Resident memory of the command and of its worker until so many trials were done."""
    ended = sorted(ended_s(out).values())
    rows = []
    for step in sorted({max(1, round(share * len(ended))) for share in (0.05, 0.25, 0.5, 0.75, 1.0)}):
        before = [sample for sample in samples if sample.at_s <= ended[step - 1]]
        command, worker = max(s.command_mb for s in before), max(s.worker_mb for s in before)
        rows.append(f"| {jobs} | {step} | {command:.0f} | {worker:.0f} |")
    return rows


def kills(twins: Path, folder: Path, count: int, *, times: int, seed: int) -> list[str]:
    """Killed at random moments, with all its processes or without, the same bytes as undisturbed."""
    rng = random.Random(seed)
    whole, out = folder / "jobs2", folder / "killed"
    shutil.rmtree(out, ignore_errors=True)
    whole_s = sum(read_times(whole).values()) / 2
    done_before: dict[Path, int] = {}
    redone, killed = 0, []
    for kill in range(times):
        running = subprocess.Popen(
            batch(twins, out, jobs=2), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        at = _begun(running, out, len(done_before)) + rng.uniform(0, whole_s / (times + 1))
        while time.perf_counter() < at and running.poll() is None:
            time.sleep(0.01)
        if kill % 2:  # a worker alone: it is replaced
            workers = [p for p in psutil.Process(running.pid).children(recursive=True) if p.memory_info().rss > 8e7]
            if workers:
                rng.choice(workers).kill()
            time.sleep(rng.uniform(1, 3))
        running.kill()
        running.wait()
        now = {path: path.stat().st_mtime_ns for path in finished(out)}
        redone += sum(now.get(path) != when for path, when in done_before.items())
        killed.append(len(now))
        done_before = now
    spent(batch(twins, out, jobs=2))
    now = {path: path.stat().st_mtime_ns for path in finished(out)}
    redone += sum(now.get(path) != when for path, when in done_before.items())
    first, second = contents(whole), contents(out)
    differ = sum(first.get(name) != second.get(name) for name in {*first, *second})
    left = [name for name in second if ".mocap-partial" in name]
    bad = count // 10
    return [
        f"## Killed {times} times: {count} twins and {bad} damaged files",
        "",
        f"- finished trials after each kill: {', '.join(map(str, killed))} of {count + bad}",
        f"- finished trials that were done again: {redone}",
        f"- half-written files left: {len(left)}",
        f"- files that differ from the undisturbed run: {differ} of {len(first)}",
    ]


def _begun(running: subprocess.Popen, out: Path, before: int) -> float:
    """When the command has finished a trial of its own, or ended."""
    end = time.perf_counter() + 120
    while time.perf_counter() < end and running.poll() is None and len(finished(out)) <= before:
        time.sleep(0.02)
    return time.perf_counter()


def main() -> None:
    """Print the tables, and write them to the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="12 twins instead of 60, 3 kills instead of 5")
    parser.add_argument("--count", type=int, help="so many twins")
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--parts", default="trials,kills", help="which of them, separated by commas")
    parser.add_argument("--no-loop", action="store_true", help="without pictures and without the shell loop")
    parser.add_argument("--out", type=Path, required=True, help="folder for twins and results")
    given = parser.parse_args()
    count = given.count or (12 if given.quick else 60)
    given.out.mkdir(parents=True, exist_ok=True)
    twins = given.out / f"twins{count}x{given.frames}"
    make_twins(twins, count, frames=given.frames)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(36, 1)  # PR_SET_CHILD_SUBREAPER: what orphans took is counted
    os.environ |= {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    lines = [f"load when it began: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores", ""]
    for part in given.parts.split(","):
        if part == "trials":
            lines += trials(twins, given.out, count, beside=not given.no_loop)
        elif part == "kills":
            lines += kills(twins, given.out, count, times=3 if given.quick else 5, seed=0)
        lines += ["", f"load now: {os.getloadavg()[0]:.1f}", ""]
        (given.out / "batch.md").write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
