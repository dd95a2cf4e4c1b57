"""How fast the tracker is, and what memory it takes.

``python -m benchmarks.tracker_speed [PART ...] [--quick] [--out DIR]``; parts are those of ``PARTS``, or all. A row for
each thing that was run is printed, and written to ``DIR/table.csv``: its part, what it is, its frames, seconds of the
processor, these over those of ``loop`` in the same minute (a busy machine slows both), seconds on the wall, megabytes.

*frames*: 34 markers in 30 cameras, every ray seen: 2040 rows a frame, on one BLAS thread; the best of ``ROUNDS`` runs
that take turns. *memory* is by how much the peak of a process of its own grows, beyond what it held with the recording
in it; ``smooth`` is given 200 MB for states. What was seen of each ray, 0.05 MB a frame, is returned by ``filter`` and
``smooth``, and given away by ``live``. *many*: positions of ever more markers, over 34 of them, by what fills a user's
gaps. *commands*: whole commands, in one process, over what a user would run in their place (``tracker_peers``).
*mouse*: 10,500 frames of 11 positions, the time to learn a pose model from them, and to smooth them.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from mocap.datasets import make_bat
from mocap.datasets.rig import tunnel_cameras
from mocap.filters.anatomy import Anatomy
from mocap.filters.live import live
from mocap.filters.models.base import TrialSet
from mocap.filters.models.constant_velocity import learn_constant_velocity
from mocap.filters.models.pose import PoseSettings
from mocap.filters.motion.base import MotionModel
from mocap.filters.observations import Observations, PixelObservations, PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.track import filter_forward, smooth

from benchmarks import tracker_peers as peers
from eal.arrays import Array
from eal.threads import one_blas_thread
from mocap.cameras import triangulate
from mocap.cameras.camera import stacked
from mocap.cameras.triangulate import project
from mocap.io.qualisys import read_mat
from mocap.records import Status

N_CAMERAS, N_MARKERS, SD_PX, FPS = 30, 34, 1.0, 240.0
ROUNDS = 3
DATA = Path(os.environ.get("MOCAP_REAL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
FLIGHT = DATA / "bat_windtunnel_dltdv8" / "derived_csv" / "078A3_F5"
DEMO_FPS = 240.0
MOUSE = DATA / "mouse_mocap_qtm" / "MOS1aD_S15_M5_MC2_T2_TRM_15MMIN_B.mat"


@dataclass(frozen=True, kw_only=True)
class Row:
    """What one thing took; NaN where that was not measured.

    Attributes:
        what: What was run.
        frames: Of how many frames; 0: it has none.
        cpu_s: Seconds of the processor.
        wall_s: Seconds on the wall.
        memory_mb: Growth of the peak of memory.
        over: Seconds of the processor over those of what a user would run in its place, or of the fewest markers, in
            the same run.
    """

    what: str
    frames: int = 0
    cpu_s: float = np.nan
    wall_s: float = np.nan
    memory_mb: float = np.nan
    over: float = np.nan


@dataclass(frozen=True, eq=False)
class Case:
    """A model, and what it is to track."""

    model: MotionModel
    seen: Observations
    t_s: Array

    def filtered(self) -> None:
        """Forward only; of a frame what was seen is kept."""
        with one_blas_thread():
            for _ in filter_forward(self.model, self.seen, self.t_s):
                pass

    def smoothed(self, most_bytes: float = 1e9) -> None:
        """Forward and back."""
        smooth(self.model, self.seen, self.t_s, most_bytes=most_bytes)

    def lagged(self, lag: int, every: int) -> None:
        """Live."""
        for _ in live(self.model, self.seen, self.t_s, lag=lag, every=every):
            pass


def filmed(xyz: Array, t_s: Array) -> PixelObservations:
    """Every pixel of markers (T, M, 3), with noise, and the points that follow."""
    matrices = stacked(tunnel_cameras(N_CAMERAS))
    uv = project(matrices, xyz)
    uv += np.random.default_rng(0).normal(0, SD_PX, uv.shape)
    sd = np.full(uv.shape[:3], SD_PX)
    points, cov = triangulate.refine(matrices, uv, triangulate.linear(matrices, uv), sd_px=sd)
    assert len(t_s) == len(points)
    return PixelObservations(matrices=matrices, uv_px=uv, sd_px=sd, xyz_m=points, cov_m2=cov, wide_m=0.1)


def markers(n_frames: int) -> Case:
    """Markers that swing at 2 to 9 Hz, constant velocity each: n = 204."""
    rng = np.random.default_rng(0)
    t_s = np.arange(n_frames) / FPS
    phase = 2 * np.pi * (rng.uniform(2, 9, N_MARKERS) * t_s[:, None] + rng.random(N_MARKERS))
    size = rng.uniform(0.005, 0.03, (N_MARKERS, 3))
    xyz = rng.uniform(-0.1, 0.1, (N_MARKERS, 3)) + size * np.stack([np.sin(phase), np.cos(phase), np.sin(2 * phase)], 2)
    seen = filmed(xyz, t_s)
    return Case(learn_constant_velocity(seen.xyz_m, dt_s=1 / FPS), seen, t_s)


def twin(n_frames: int, settings: PoseSettings) -> Case:
    """The bat, its pose model learned from the same recording."""
    truth = make_bat(n_frames=max(n_frames, 240), n_cameras=N_CAMERAS)
    t_s = truth.truth.t_s[:n_frames]
    seen = filmed(truth.truth.xyz_m[:n_frames], t_s)
    trunk = [truth.truth.names.index(name) for name in truth.skeleton.trunk]
    own = MarkerTrial(name="bat", t_s=t_s, xyz_m=seen.xyz_m, sd_m=np.full(seen.xyz_m.shape[:2], 1e-3))
    return Case(settings.fit(TrialSet([own], Anatomy(tuple(trunk)))).motion, seen, t_s)


def best(calls: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, tuple[float, float]]:
    """Least wall time and least processor time of each call, in seconds; they take turns."""
    found = {name: (np.inf, np.inf) for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            wall, cpu = time.perf_counter(), time.process_time()
            call()
            spent = time.perf_counter() - wall, time.process_time() - cpu
            found[name] = min(found[name][0], spent[0]), min(found[name][1], spent[1])
    return found


def timed(what: str, case: Case, calls: dict[str, Callable[[], None]], rounds: int) -> list[Row]:
    """A row for each call."""
    n, found = len(case.t_s), best(calls, rounds)
    return [
        Row(what=f"{what}, n = {case.model.size}: {name}", frames=n, cpu_s=cpu, wall_s=wall)
        for name, (wall, cpu) in found.items()
    ]


def grown(what: str, n_frames: int) -> float:
    """Growth of this process' peak in MB, by Linux' counters."""
    case = markers(n_frames)
    calls = {
        "filter": case.filtered,
        "live, lag 10": partial(case.lagged, 10, 1),
        "smooth": partial(case.smoothed, 2e8),
    }
    Case(case.model, case.seen, case.t_s[:3]).lagged(1, 1)  # what is allocated once
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew from here
    before = _resident_mb("VmRSS")
    calls[what]()
    return _resident_mb("VmHWM") - before


def _resident_mb(which: str) -> float:
    status = Path("/proc/self/status").read_text().splitlines()
    return float(next(line for line in status if line.startswith(which)).split()[1]) / 1024


def apart(what: str, n_frames: int) -> float:
    """``grown`` in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.tracker_speed", "--memory", what, "--frames", str(n_frames)]
    return float(subprocess.run(command, capture_output=True, check=True, text=True).stdout)


def loop() -> float:
    """Processor time of a fixed loop, in seconds: 1.5 on an idle machine of 2026."""
    rng = np.random.default_rng(0)
    small, large = rng.normal(size=(120, 120)), rng.normal(size=(300, 300))
    with one_blas_thread():
        start = time.process_time()
        for _ in range(400):
            np.linalg.svd(small)
            _ = large @ large
        return time.process_time() - start


def frames(quick: bool) -> Iterator[list[Row]]:
    """Each model, forward, forward and back, and live."""
    n_frames, rounds = (100, 1) if quick else (300, ROUNDS)
    case = markers(n_frames)
    lines = {"filter": case.filtered, "filter + smooth": case.smoothed}
    lags = {"live, lag 10": partial(case.lagged, 10, 1), "live, lag 10, by tens": partial(case.lagged, 10, 10)}
    yield timed("constant velocity a marker", case, lines | lags, rounds)
    for title, settings in {
        "pose, no forces": PoseSettings(potential="none", bones=0.0),
        "pose, V_z": PoseSettings(bones=0.0),
        "pose, V_z, bones": PoseSettings(),
    }.items():
        case = twin(n_frames, settings)
        yield timed(title, case, {"filter": case.filtered, "filter + smooth": case.smoothed}, rounds)


def memory(quick: bool) -> Iterator[list[Row]]:
    """Of markers by themselves, in few frames and in four times as many."""
    for what in ("filter", "live, lag 10", "smooth"):
        counts = (100, 400) if quick else (500, 2000)
        yield [Row(what=f"constant velocity: {what}", frames=n, memory_mb=apart(what, n)) for n in counts]


def many(quick: bool) -> Iterator[list[Row]]:
    """The pose model of ever more markers between those of the bat, each of which wanders by 0.3 mm."""
    n_frames, rounds = (50, 1) if quick else (150, ROUNDS)
    film = make_bat(n_frames=n_frames, n_cameras=2)
    trunk, t_s = [film.truth.names.index(name) for name in film.skeleton.trunk], film.truth.t_s
    fills: dict[str, Callable[[], object]] = {}
    for count in (N_MARKERS, 60, 100) if quick else (N_MARKERS, 60, 100, 300):
        rng = np.random.default_rng(0)
        ends = rng.integers(0, N_MARKERS, (2, count - N_MARKERS))
        xyz = np.concatenate([film.truth.xyz_m, film.truth.xyz_m[:, ends].mean(axis=1)], axis=1)
        xyz += 2e-5 * rng.normal(size=xyz.shape).cumsum(axis=0) + 3e-4 * rng.normal(size=xyz.shape)
        own = MarkerTrial(name="bat", t_s=t_s, xyz_m=xyz, sd_m=np.full(xyz.shape[:2], 3e-4))
        with one_blas_thread():
            fitted = PoseSettings(regression=0.0).fit(TrialSet([own], Anatomy(tuple(trunk))))
        fills[f"{count} markers: fill"] = partial(fitted.fill, PositionObservations(xyz_m=xyz, sd_m=own.sd_m))
    found = best(fills, rounds)
    fewest_s = next(iter(found.values()))[1]
    yield [
        Row(what=what, frames=n_frames, cpu_s=cpu, wall_s=wall, over=cpu / fewest_s)
        for what, (wall, cpu) in found.items()
    ]


MOCAP = Path(sys.executable).with_name("mocap")


def commands(quick: bool) -> Iterator[list[Row]]:  # noqa: ARG001
    """``mocap`` in one process, beside aniposelib on the same points and filterpy's filter and smoother."""
    with tempfile.TemporaryDirectory() as folder:
        out = ["--out", str(Path(folder) / "run"), "--force"]

        def ours(what: str, *words: str, of: float = np.nan) -> list[Row]:
            cpu, wall, _ = peers.spent([MOCAP, *words])
            return [Row(what=what, cpu_s=cpu, wall_s=wall, over=cpu / of)]

        def theirs(table: Path, fps: float) -> list[Row]:
            known = peers.read(table, table.with_name(table.name.replace("xypts", "dltCoefs")), fps)
            found = peers.anipose(known)
            alone = Row(what=f"aniposelib {found['version']}: {known.name}", cpu_s=float(found["cpu_s"]))
            return [alone, Row(what="  with its imports and compilation", cpu_s=float(found["whole_s"]))]

        peers.spent([MOCAP, "data", "make", "bat", "--out", folder])
        yield (peer := theirs(Path(folder) / "bat_xypts.csv", DEMO_FPS))
        yield ours("mocap demo", "demo", *out, of=peer[0].cpu_s)
        if not FLIGHT.exists():
            return
        table, calibration = (FLIGHT / f"{FLIGHT.name}_{what}.csv" for what in ("xypts", "dltCoefs"))
        known = "--calibration", str(calibration), "--fps", "700"
        yield (peer := theirs(table, 700))
        yield ours("mocap track", "track", str(table), *known, *out, of=peer[0].cpu_s)
        simple = "track", str(table), *known, *out, "--model", "constant_velocity", "--no-validate"
        yield ours("mocap track, constant velocity", *simple, of=peer[0].cpu_s)
        cpu, wall, printed = peers.spent([sys.executable, "-m", "benchmarks.tracker_peers", *simple])
        taken = json.loads(printed.splitlines()[-1])
        whole = cpu - taken["theirs_s"]
        rest = whole - taken["ours_s"]
        yield [
            Row(what="  the same with filterpy", cpu_s=rest + taken["theirs_s"], wall_s=wall),
            Row(what="  the same", cpu_s=whole, over=whole / (rest + taken["theirs_s"])),
        ]
        yield ours("mocap info", "info", str(table))
        peers.two_frames(table, Path(folder) / "two_xypts.csv")
        yield ours("mocap track, two frames", "track", str(Path(folder) / "two_xypts.csv"), *known, *out)


def mouse(quick: bool) -> Iterator[list[Row]]:
    """A long recording of positions; a fifth of it if quick."""
    if not MOUSE.exists():
        return
    tracks = read_mat(MOUSE).points
    some = slice(0, len(tracks.t_s) // 5 if quick else None)
    xyz = np.where((tracks.status == Status.MEASURED)[..., None], tracks.xyz_m, np.nan)[some]
    trunk = [tracks.names.index(n) for n in ("left_coord", "right_coord", "left_back", "right_back", "miniscope")]
    own = MarkerTrial(name="mouse", t_s=tracks.t_s[some], xyz_m=xyz, sd_m=np.full(xyz.shape[:2], 1e-4))
    wall, cpu = time.perf_counter(), time.process_time()
    with one_blas_thread():
        model = PoseSettings().fit(TrialSet([own], Anatomy(tuple(trunk)))).motion
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    yield [Row(what="mouse: learn", frames=len(xyz), cpu_s=cpu, wall_s=wall)]
    case = Case(model, PositionObservations(xyz_m=xyz, sd_m=own.sd_m), own.t_s)
    yield timed("mouse", case, {"smooth": case.smoothed}, 1)


PARTS = {"frames": frames, "memory": memory, "many": many, "commands": commands, "mouse": mouse}


def table(parts: Sequence[str], quick: bool) -> Iterator[dict[str, object]]:
    """A row for each thing that is run, with the loops that it took: each group of rows between two runs of these."""
    for part in parts:
        before = loop()
        for group in PARTS[part](quick):
            after = loop()
            for row in group:
                taken = asdict(row)
                what, n, cpu = (taken.pop(name) for name in ("what", "frames", "cpu_s"))
                yield dict(part=part, what=what, frames=n, cpu_s=cpu, loops=cpu / (0.5 * (before + after)), **taken)
            before = after


def main(arguments: Sequence[str] | None = None) -> None:
    """Print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="*", choices=[*PARTS, []], help="all of them if none is given")
    parser.add_argument("--quick", action="store_true", help="fewer frames and markers, one round")
    parser.add_argument("--out", type=Path, help="folder for table.csv")
    parser.add_argument("--memory", help=argparse.SUPPRESS)
    parser.add_argument("--frames", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.memory:
        print(grown(given.memory, given.frames))
        return
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    print(f"{'part':9}{'':62}{'frames':>7}{'cpu s':>9}{'loops':>8}{'wall s':>9}{'MB':>7}{'ms/frame':>10}{'over':>7}")
    rows = []
    for row in table(given.part or list(PARTS), given.quick):
        rows.append(row)
        each = 1e3 * row["cpu_s"] / row["frames"] if row["frames"] else np.nan
        line = (
            f"{row['part']:9}{row['what']:62}{row['frames']:7}{row['cpu_s']:9.2f}{row['loops']:8.2f}"
            f"{row['wall_s']:9.2f}{row['memory_mb']:7.0f}{each:10.2f}{row['over']:7.2f}"
        )
        print(line.replace("nan", "  -"), flush=True)
        if given.out is not None:
            given.out.mkdir(parents=True, exist_ok=True)
            pd.DataFrame(rows).to_csv(given.out / "table.csv", index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
