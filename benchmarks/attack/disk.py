"""Interrupts every call that changes the disk, in every command: ``python -m benchmarks.attack --stage disk``.

A library preloaded before the process (``disk.c``, made with the machine's C compiler) counts the calls below the
output's folder (open for writing, write, fsync, rename, unlink, mkdir, rmdir, ...) and interrupts the n-th: it kills
the process, sends it the signal of Ctrl-C, or lets the call fail (ENOSPC, EIO, EACCES, EBUSY; and ENOSPC from there
on, as on a full disk). The folder holds files of somebody else and an earlier result. After each interruption the
foreign files must be bit for bit there, and the earlier result or the new one whole: every file the manifest lists
with its SHA-256, and the new one with the content of an undisturbed run. Then the command runs once more, undisturbed,
and must end with a whole result, in a plain folder, through a link, and on a mount point where this is allowed.

What a command computes is computed once, before: a child process is forked for each interruption and only writes.
"""

import argparse
import ctypes
import errno
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np
from mocap.datasets.folder import write_recording

import mocap
import mocap.cli.main  # loaded before children are forked
from mocap.io.manifest import PARTIAL, current_files, digest, read_manifest

KILL, INTERRUPT, ERROR, FULL = 1, 2, 3, 4
WAYS: dict[str, tuple[int, int]] = {
    "kill": (KILL, 0),
    "Ctrl-C": (INTERRUPT, 0),
    **{name: (ERROR, getattr(errno, name)) for name in ("ENOSPC", "EIO", "EACCES", "EBUSY")},
    "disk full": (FULL, errno.ENOSPC),
}
FOREIGN = {
    "notes.txt": b"mine\n",
    "chapters/one.tex": b"\\section{Mine}\n",
    ".hidden": b"\0\1",
    "markers.csv.bak": b"1",
}
_SHIM = "EAL_MOCAP_ATTACK_LIBRARY"
_TEXT = (".csv", ".json", ".md", ".toml", ".txt", ".trc", ".tsv", ".stl")


@dataclass(frozen=True)
class Case:
    """A command that writes.

    Attributes:
        name: For the table.
        argv: Of ``mocap``; ``OUT`` stands for the output.
        out: Name of the output in its folder; empty where the folder itself is the output.
        patches: What replaces the slow part of the command, by the name it is imported from.
    """

    name: str
    argv: tuple[str, ...]
    out: str = ""
    patches: Mapping[str, object] | None = None


@dataclass(frozen=True)
class Outcome:
    """What came of one interruption: empty, or what was lost."""

    call: str
    trouble: str


def compiled(folder: Path) -> Path:
    """The library that interrupts.

    Raises:
        RuntimeError: there is no C compiler, or this system preloads no libraries.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not sys.platform.startswith("linux"):
        raise RuntimeError("interrupting system calls needs Linux and a C compiler (cc)")
    library = folder / "disk.so"
    source = Path(__file__).with_name("disk.c")
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-ldl"], check=True)
    return library


def converting(files: Path) -> list[Case]:
    """Commands that read one recording and write another."""
    from mocap.datasets.lizards import make_lizard

    from mocap.io.contents import point_recording
    from mocap.io.registry import write

    xyz = np.random.default_rng(0).normal(size=(20, 2, 3))
    points = point_recording(files / "a.csv", "made", names=["a", "b"], xyz=xyz, unit="m", fps=100.0)
    write(points, files / "a.csv")
    write(points, files / "b.c3d")
    paths = write_recording(make_lizard(seed=0, n_frames=60), files)
    names = {"csv": "b.c3d", "nc": "a.csv", "c3d": "a.csv", "parquet": "a.csv", "trc": "a.csv"}
    found = [
        Case(f"convert .{end}", ("convert", str(files / n), "OUT", "--force"), f"r.{end}") for end, n in names.items()
    ]
    base = (str(paths["pixels"]), "--dlt", str(paths["coefficients"]))
    return [
        *found,
        Case("convert _long.csv", ("convert", str(files / "a.csv"), "OUT", "--force"), "r_long.csv"),
        Case("convert DLTdv", ("convert", base[0], base[2], "OUT", "--force"), "r_xypts.csv"),
        Case("triangulate", ("triangulate", *base, "--out", "OUT", "--force"), "r_xyzpts.csv"),
        Case("calibrate", ("calibrate", "refine", *base, "--out", "OUT", "--force")),
        Case("data make", ("data", "make", "pendulum_planar", "--out", "OUT", "--force")),
    ]


def tracking(files: Path) -> list[Case]:
    """Commands that write what was tracked, learned or drawn; it is made here, once."""
    from mocap.datasets.lizards import make_lizard
    from mocap.filters.model import learn_model

    from mocap.cleaning.cleaning import clean
    from mocap.report.job import run_job
    from mocap.reproduce.fig_penalty import figure_14a
    from mocap.tracking.tracking import marker_trial, seen_part

    twin = make_lizard(seed=0, n_frames=150)
    paths = write_recording(twin, files / "twin")
    source = mocap.read(paths["pixels"], calibration=paths["coefficients"], skeleton=paths["skeleton"], fps=twin.fps)
    run, figure = run_job(source, model="constant_velocity", validated=False), figure_14a(quick=True)
    prepared = clean(source)
    part = seen_part(prepared)
    trial = marker_trial(part)
    learned = learn_model(part.names, (), [trial], np.random.default_rng(0))
    base = [str(paths["pixels"]), "--dlt", str(paths["coefficients"]), "--fps", f"{twin.fps:g}"]
    ask = ["--skeleton", str(paths["skeleton"]), "--out", "OUT", "--force"]
    return [
        Case("track", ("track", *base, *ask), patches={"mocap.report.job.run_job": lambda *_, **__: run}),
        Case(
            "demo", ("demo", "--out", "OUT", "--force"),
            patches={"mocap.report.demo.run_demo": lambda *_, **__: run[0]},
        ),
        Case(
            "learn", ("learn", *base, *ask), "r.npz", {"mocap.tracking.learning.learn_from": lambda *_, **__: learned}
        ),
        Case(
            "reproduce", ("reproduce", "14a", "--out", "OUT", "--force"),
            patches={"mocap.reproduce.figures._SYNTHETIC": {"14a": lambda **_: figure}},
        ),
    ]  # fmt: skip


def showing(files: Path) -> list[Case]:
    """Joint design, and the folder for a web server: with the viewer's own files."""
    import urllib.request

    from mocap.datasets.lizards import make_lizard

    from mocap.report.job import run_job
    from mocap.rerun.record import write_recording as write_rrd
    from mocap.rerun.viewer import open_viewer
    from mocap.results.tables import write_run

    folder, twin = files / "run", make_lizard(seed=0, n_frames=150)
    paths = write_recording(twin, files / "shown")
    source = mocap.read(paths["pixels"], calibration=paths["coefficients"], skeleton=paths["skeleton"], fps=twin.fps)
    folder.mkdir()
    write_run(run_job(source, model="constant_velocity", validated=False)[0], folder, write_recording=write_rrd)
    joint = sorted(path.stem for path in (folder / "potentials").iterdir())[0]
    asked = f"design-joint {folder} --joint {joint} --out OUT --force --starts 1 --members 4 --no-solid".split()
    kept = files / "design"
    keep = {"mocap.joint_design.report.write_design": lambda design, *_, **__: kept.write_bytes(pickle.dumps(design))}
    _, said = forked(
        Case("", tuple(asked), patches=keep), files / "joint", files / "log"
    )  # in a child: JAX starts threads
    if not kept.is_file():
        raise RuntimeError(f"no joint was designed: {said}")
    design = pickle.loads(kept.read_bytes())
    viewer, fetched = open_viewer(folder / "recording.rrd", web=True), {}
    for name in ("", "re_viewer.js", "re_viewer_bg.wasm", "favicon.ico"):
        url = str(viewer.url).partition("?")[0] + name
        with urllib.request.urlopen(url, timeout=30) as answer:
            fetched[url] = answer.read()[:200_000]
    viewer.close()
    page = mock.Mock(url=viewer.url)
    return [
        Case(
            "design-joint", tuple(asked),
            patches={"mocap.joint_design.design.design_joint": lambda *_, **__: design},
        ),
        Case(
            "share", ("share", str(folder), "--out", "OUT", "--force"),
            patches={
                "mocap.rerun.share.open_viewer": lambda *_, **__: page,
                "mocap.rerun.share._fetched": lambda url: fetched[url],
            },
        ),
    ]  # fmt: skip


def forked(
    case: Case, out: Path, log: Path, arm: Callable[[], None] = lambda: None, after: Callable[[], object] = lambda: None
) -> tuple[int, str]:
    """Run a command in a child, between ``arm`` and ``after``; its exit code (below 0: killed), and what it said."""
    child = os.fork()
    if child == 0:
        code = 99
        try:
            with log.open("w", encoding="utf-8") as said:
                os.dup2(said.fileno(), 1)
                os.dup2(said.fileno(), 2)
                sys.stdout = sys.stderr = said
                code = _command(case, out, arm)
                after()
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return code, log.read_text(encoding="utf-8", errors="replace")


def _command(case: Case, out: Path, arm: Callable[[], None]) -> int:
    from contextlib import ExitStack

    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.alarm(120)
    sys.argv = ["mocap", *(str(out) if word == "OUT" else word for word in case.argv)]
    with ExitStack() as stack:
        for place, replacement in (case.patches or {}).items():
            stack.enter_context(mock.patch(place, replacement))
        arm()
        try:
            mocap.cli.main.main()
        except SystemExit as ended:
            return int(ended.code or 0)
        except KeyboardInterrupt:
            return 130
        except BaseException as error:
            print(f"TRACEBACK {type(error).__name__}: {error}", flush=True)
            return 98
    return 0


def contents(folder: Path) -> dict[str, str]:
    """SHA-256 of each file of the results in a folder, wherever it is now."""
    return {name: digest(path) for name, path in current_files(folder).items() if path.is_file()}


def trouble(folder: Path, before: Mapping[str, str], whole: Mapping[str, tuple[str, int]]) -> str:
    """What was lost; empty if nothing.

    Args:
        folder: The output's.
        before: SHA-256 of the files of the earlier result.
        whole: The same and the size of the files of an undisturbed new one.
    """
    for name, content in FOREIGN.items():
        path = folder / name
        if not path.is_file() or path.read_bytes() != content:
            return f"foreign file {name} is gone or changed"
    found = contents(folder)
    if found == dict(before):
        return ""
    manifest = read_manifest(folder)
    listed = {f: c for listing in manifest.results.values() for f, c in listing.files.items()}
    if manifest.pending is not None:
        listed = {f: c for f, c in listed.items() if f not in manifest.pending.replaces} | dict(
            manifest.pending.new.files
        )
    if found != listed:
        wrong = sorted({f for f in {*found, *listed} if found.get(f) != listed.get(f)})
        return f"neither the earlier nor the new result is whole: {', '.join(wrong)}"
    if found.keys() != whole.keys():
        return f"the new result has other files: {sorted(found.keys() ^ whole.keys())}"
    for name, path in current_files(folder).items():
        content, size = whole[name]
        if found[name] != content and (name.endswith(_TEXT) or abs(path.stat().st_size - size) > 0.02 * size + 64):
            return (
                f"{name} of the new result is not what an undisturbed run writes ({path.stat().st_size} bytes, {size})"
            )
    return ""


class Places:
    """Folders to write into: plain, through a link, and on a mount point."""

    def __init__(self, scratch: Path, kind: str) -> None:
        """Make the place; a mount point needs the right to mount."""
        self.real = scratch / f"{kind}_real"
        self.seen = scratch / kind
        self.kind = kind
        if kind == "plain":
            self.real = self.seen
        elif kind == "link":
            self.real.mkdir()
            self.seen.symlink_to(self.real)
        else:
            self.seen.mkdir()
            self.real = self.seen
            done = subprocess.run(["mount", "-t", "tmpfs", "none", str(self.seen)], capture_output=True, check=False)
            if done.returncode:
                raise RuntimeError("mounting is not allowed here")

    def fill(self, template: Path) -> None:
        """Make the place hold what the template holds."""
        if self.kind == "plain":
            shutil.rmtree(self.real, ignore_errors=True)
        else:
            for path in self.real.iterdir():
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        shutil.copytree(template, self.real, dirs_exist_ok=True)

    def close(self) -> None:
        """Unmount."""
        if self.kind == "mount":
            subprocess.run(["umount", str(self.seen)], check=False)


def attack(
    case: Case, scratch: Path, library: ctypes.CDLL, *, kind: str, step: int, offset: int, again: int
) -> list[tuple[str, Outcome]]:
    """Interrupt a command at every ``step``-th call, in every way.

    Args:
        case: The command.
        scratch: Folder for all of it.
        library: That interrupts.
        kind: Of folder: plain, link or mount.
        step: 1: at every call.
        offset: First call, from 0.
        again: After every so many interruptions the command is run once more.

    Returns:
        The way and what came of it, for each interruption.
    """
    place, template, log = Places(scratch, kind), scratch / "template", scratch / "log"
    shutil.rmtree(template, ignore_errors=True)
    template.mkdir()
    for name, content in FOREIGN.items():
        (template / name).parent.mkdir(exist_ok=True)
        (template / name).write_bytes(content)
    inner = template / case.out if case.out else template
    code, said = forked(case, inner, log)  # the earlier result
    if code:
        raise RuntimeError(f"{case.name}: the undisturbed run ends with {code}: {said}")
    before = contents(template)
    out = place.seen / case.out if case.out else place.seen
    report = scratch / "seen"

    def count() -> None:
        library.attack_arm(os.fsencode(place.real), -1, 0, 0)

    place.fill(template)
    calls = _counting(case, out, log, library, count, report)
    whole = {name: (digest(path), path.stat().st_size) for name, path in current_files(place.real).items()}
    found: list[tuple[str, Outcome]] = []
    for way, (mode, number) in WAYS.items():
        for n in range(1 + offset % step, calls + 1, step):
            place.fill(template)
            code, said = forked(
                case, out, log,
                lambda n=n, mode=mode, number=number: library.attack_arm(os.fsencode(place.real), n, mode, number),
            )  # fmt: skip
            wrong = trouble(place.real, before, whole)
            if not wrong and ("Traceback" in said or code in (70, 98, 99)):  # 70: what mocap calls a fault of its own
                wrong = f"traceback: {said.strip().splitlines()[-1][:200]}"
            if not wrong and code == -signal.SIGALRM:
                wrong = "hangs"
            if not wrong and len(found) % again == 0:
                code, said = forked(case, out, log)
                wrong = trouble(place.real, {}, whole) if code == 0 else f"the next run ends with {code}: {said[-300:]}"
                left = [p.name for p in place.real.rglob(f"{PARTIAL}*")]
                wrong = wrong or (f"the next run leaves {left}" if left else "")
            found.append((way, Outcome(f"call {n} of {calls}", wrong)))
    place.close()
    return found


def _counting(case: Case, out: Path, log: Path, library: ctypes.CDLL, count: Callable[[], None], report: Path) -> int:
    """How many calls change the disk in an undisturbed run."""
    library.attack_seen.restype = ctypes.c_long
    code, said = forked(case, out, log, count, lambda: report.write_text(str(library.attack_seen())))
    if code:
        raise RuntimeError(f"{case.name}: the undisturbed run fails: {said}")
    return int(report.read_text())


def main(arguments: list[str] | None = None) -> int:
    """Run and print a table; the exit code is the number of losses."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="the commands that compute little")
    parser.add_argument("--groups", default="converting,tracking,showing", help="of commands")
    parser.add_argument("--only", help="commands as the table names them, with commas between")
    parser.add_argument("--kinds", default="plain,link,mount", help="kinds of folder")
    parser.add_argument("--step", type=int, default=0, help="every so many calls; 0: 1, or 9 with --quick")
    options = parser.parse_args(arguments)
    if _SHIM not in os.environ:
        with tempfile.TemporaryDirectory() as folder:
            library = compiled(Path(folder))
            env = {**os.environ, "LD_PRELOAD": str(library), _SHIM: str(library), "OMP_NUM_THREADS": "1"}
            command = [
                sys.executable,
                "-m",
                "benchmarks.attack.disk",
                *(sys.argv[1:] if arguments is None else arguments),
            ]
            return subprocess.run(command, env=env, check=False).returncode
    library = ctypes.CDLL(os.environ[_SHIM])
    step, lost, points, start = options.step or (9 if options.quick else 1), 0, 0, time.perf_counter()
    print(f"{'command':18}{'folder':8}{'points':>8}{'lost':>6}  of each way", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder) / "files"
        files.mkdir()
        groups = [globals()[name] for name in ("converting" if options.quick else options.groups).split(",")]
        for case in (case for group in groups for case in group(files)):
            if options.only and case.name not in options.only.split(","):
                continue
            for k, kind in enumerate(options.kinds.split(",")):
                scratch = Path(folder) / f"{case.name.replace(' ', '_')}_{kind}"
                scratch.mkdir()
                try:
                    found = attack(
                        case, scratch, library, kind=kind, step=step if k == 0 else 3 * step, offset=k, again=5
                    )
                except RuntimeError as error:
                    print(f"{case.name:18}{kind:8} not tried: {error}")
                    lost += "mount" not in str(error)
                    continue
                ways, bad = Counter(way for way, _ in found), [(w, o) for w, o in found if o.trouble]
                points, lost = points + len(found), lost + len(bad)
                print(
                    f"{case.name:18}{kind:8}{len(found):8}{len(bad):6}  "
                    + ", ".join(f"{w} {n}" for w, n in ways.items()),
                    flush=True,
                )
                for way, outcome in bad[:20]:
                    print(f"    {way}, {outcome.call}: {outcome.trouble}", flush=True)
    print(f"{points} interruptions in {time.perf_counter() - start:.0f} s: {lost} lost something")
    return min(lost, 255)


if __name__ == "__main__":
    sys.exit(main())
