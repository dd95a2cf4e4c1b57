"""How fast the tracker is, and what memory it takes.

``python -m benchmarks.tracker_speed [PART ...] [--quick]``; parts are those of ``PARTS``, or all.

*frames*: 34 markers in 30 cameras, every ray seen: 2040 rows a frame. Times are of one BLAS thread, for every frame: on
the wall, and of the processor alone, which a busy machine changes less; the best of ``ROUNDS`` runs that take turns.
Frames a second are those of the wall. *memory* is by how much the peak of a process of its own grows, beyond what it
held with the recording in it; ``smooth`` is given 200 MB for states. What was seen of each ray, 0.05 MB a frame, is
returned by ``filter`` and ``smooth``, and given away by ``live``. *many*: positions of ever more markers. *commands*:
whole commands, in processor time over that of ``loop`` in the same minute: a busy machine slows both.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from mocap.datasets import make_bat
from mocap.datasets.rig import tunnel_cameras
from mocap.filters.anatomy import Anatomy
from mocap.filters.live import live, looks
from mocap.filters.models.base import TrialSet
from mocap.filters.models.constant_velocity import learn_constant_velocity
from mocap.filters.models.pose import PoseSettings
from mocap.filters.motion.base import MotionModel
from mocap.filters.motion.pose import PoseMotion
from mocap.filters.observations import Observations, PixelObservations, PositionObservations
from mocap.filters.poses import MarkerTrial
from mocap.filters.track import filter_forward, smooth

from eal.arrays import Array
from eal.threads import one_blas_thread
from mocap.cameras import triangulate
from mocap.cameras.camera import project, stacked
from mocap.io.qualisys import read_mat
from mocap.records import Status

N_CAMERAS, N_MARKERS, SD_PX, FPS = 30, 34, 1.0, 240.0
ROUNDS = 3
PARTS = ["frames", "memory", "many", "commands", "mouse"]
DATA = Path(os.environ.get("MOCAP_REAL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
FLIGHT = DATA / "bat_windtunnel_dltdv8" / "derived_csv" / "078A3_F5"
MOUSE = DATA / "mouse_mocap_qtm" / "MOS1aD_S15_M5_MC2_T2_TRM_15MMIN_B.mat"


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
        for _ in live(self.model, looks(self.seen, self.t_s), lag=lag, every=every):
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


def best(calls: dict[str, Callable[[], None]], rounds: int) -> dict[str, tuple[float, float]]:
    """Least wall time and least processor time of each call, in seconds; they take turns."""
    found = {name: (np.inf, np.inf) for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            wall, cpu = time.perf_counter(), time.process_time()
            call()
            spent = time.perf_counter() - wall, time.process_time() - cpu
            found[name] = min(found[name][0], spent[0]), min(found[name][1], spent[1])
    return found


def show(title: str, case: Case, calls: dict[str, Callable[[], None]], rounds: int) -> None:
    """Print a line for each call."""
    n_frames = len(case.t_s)
    for name, (wall, cpu) in best(calls, rounds).items():
        print(
            f"{title:44}{case.model.size:4}  {name:22}{1e3 * wall / n_frames:9.2f}{1e3 * cpu / n_frames:9.2f}"
            f"{n_frames / wall:10.0f}",
            flush=True,
        )


def memory(what: str, n_frames: int) -> float:
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
    """``memory`` in a process of its own."""
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


def many(n_frames: int) -> None:
    """The pose model of ever more markers between those of the bat, each of which wanders by 0.3 mm."""
    film = make_bat(n_frames=n_frames, n_cameras=2)
    trunk, t_s = [film.truth.names.index(name) for name in film.skeleton.trunk], film.truth.t_s
    least = None
    for count in (34, 60, 100, 300):
        rng = np.random.default_rng(0)
        ends = rng.integers(0, N_MARKERS, (2, count - N_MARKERS))
        xyz = np.concatenate([film.truth.xyz_m, film.truth.xyz_m[:, ends].mean(axis=1)], axis=1)
        xyz += 2e-5 * rng.normal(size=xyz.shape).cumsum(axis=0) + 3e-4 * rng.normal(size=xyz.shape)
        own = MarkerTrial(name="bat", t_s=t_s, xyz_m=xyz, sd_m=np.full(xyz.shape[:2], 3e-4))
        with one_blas_thread():
            model = PoseSettings(regression=0.0).fit(TrialSet([own], Anatomy(tuple(trunk)))).motion
        case = Case(model, PositionObservations(xyz_m=xyz, sd_m=own.sd_m), t_s)
        _, cpu = best({"smooth": case.smoothed}, 1)["smooth"]
        least = cpu if least is None else least
        print(f"{count:4} markers{1e3 * cpu / n_frames:9.1f} ms a frame{cpu / least:9.2f} times 34", flush=True)


def commands() -> None:
    """``mocap`` in one process, in loops."""
    files = [str(FLIGHT / f"{FLIGHT.name}_xypts.csv"), "--calibration", str(FLIGHT / f"{FLIGHT.name}_dltCoefs.csv")]
    asked = {"demo": ["demo"]}
    asked |= {"info": ["info", files[0]], "track": ["track", *files, "--fps", "700"]} if FLIGHT.exists() else {}
    for name, command in asked.items():
        with tempfile.TemporaryDirectory() as folder:
            out = [] if name == "info" else ["--out", str(Path(folder) / "run")]
            before, unit = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime, loop()
            environment = os.environ | {"MOCAP_JOBS": "1", "OMP_NUM_THREADS": "1"}
            mocap = str(Path(sys.executable).with_name("mocap"))
            subprocess.run([mocap, *command, *out], env=environment, check=True, capture_output=True)
            spent = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        unit = 0.5 * (unit + loop())
        print(f"mocap {name:24}{spent:8.2f} s of the processor{spent / unit:8.2f} loops of {unit:.2f} s", flush=True)


def mouse() -> None:
    """10,500 frames of 11 positions: the time to learn a pose model from them, and to smooth them."""
    tracks = read_mat(MOUSE).points
    xyz = np.where((tracks.status == Status.MEASURED)[..., None], tracks.xyz_m, np.nan)
    trunk = [tracks.names.index(n) for n in ("left_coord", "right_coord", "left_back", "right_back", "miniscope")]
    own = MarkerTrial(name="mouse", t_s=tracks.t_s, xyz_m=xyz, sd_m=np.full(xyz.shape[:2], 1e-4))
    start = time.perf_counter()
    with one_blas_thread():
        model = PoseSettings().fit(TrialSet([own], Anatomy(tuple(trunk)))).motion
    learned = time.perf_counter() - start
    case = Case(model, PositionObservations(xyz_m=xyz, sd_m=own.sd_m), tracks.t_s)
    (wall, cpu) = best({"smooth": case.smoothed}, 1)["smooth"]
    print(
        f"mouse, {len(xyz)} x {xyz.shape[1]} positions, V_z, bones, n = {model.size}: learned in {learned:.1f} s, "
        f"filtered and smoothed in {wall:.1f} s ({cpu:.1f} s of the processor)"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="*", choices=[*PARTS, []], help="all of them if none is given")
    parser.add_argument("--quick", action="store_true", help="a third of the frames, one round")
    parser.add_argument("--memory", help=argparse.SUPPRESS)
    parser.add_argument("--frames", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.memory:
        print(memory(options.memory, options.frames))
        return
    parts = options.part or PARTS
    n_frames, rounds = (100, 1) if options.quick else (300, ROUNDS)
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    if "frames" in parts:
        frames(n_frames, rounds)
    if "memory" in parts:
        print(f"\n{'memory, MB: constant velocity':34}{'500 frames':>12}{'2000 frames':>12}")
        for what in ("filter", "live, lag 10", "smooth"):
            few, more = (100, 400) if options.quick else (500, 2000)
            print(f"{what:34}{apart(what, few):12.0f}{apart(what, more):12.0f}")
    if "many" in parts:
        many(n_frames // 2)
    if "commands" in parts:
        commands()
    if "mouse" in parts and MOUSE.exists():
        mouse()


def frames(n_frames: int, rounds: int) -> None:
    """Each model, a frame."""
    print(f"{'34 markers x 30 cameras':44}{'n':>4}  {'':22}{'wall ms':>9}{'cpu ms':>9}{'frames/s':>10}")
    case = markers(n_frames)
    lines = {"filter": case.filtered, "filter + smooth": case.smoothed}
    lags = {"live, lag 10": partial(case.lagged, 10, 1), "live, lag 10, by tens": partial(case.lagged, 10, 10)}
    show("constant velocity a marker", case, lines | lags, rounds)
    for title, settings in {
        "pose, no forces": PoseSettings(potential="none", bones=0.0),
        "pose, V_z": PoseSettings(bones=0.0),
        "pose, V_z, bones": PoseSettings(),
    }.items():
        case = twin(n_frames, settings)
        assert isinstance(case.model, PoseMotion)
        show(
            f"{title}, rank {case.model.rank}",
            case,
            {"filter": case.filtered, "filter + smooth": case.smoothed},
            rounds,
        )


if __name__ == "__main__":
    main()
