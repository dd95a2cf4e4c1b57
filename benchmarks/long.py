"""Long recordings, many markers, many trials: time and memory.

``python -m benchmarks.long [--quick] [--part PART] [--seconds 300] --out DIR``. Each case runs in a
process of its own, whose peak memory (``ru_maxrss``) and time are measured, imports and twin included; the twin is made
stretch by stretch, so that it takes no memory that grows. A case that is not done after ``--seconds`` is stopped, and
the table says how far it came.

- frames: the bat (34 markers), tracked in blocks with constant velocity, as positions and as rays in 8 cameras;
  everything that ``mocap track --blocks`` writes.
- markers: 400 frames of the bat's skin with 30 to 1000 markers, tracked at once.
- trials: a motion model learned from 10 to 1000 flights (``mocap learn``).
- potentials: joint potentials of 10 to 1000 flights by map and reduce.

Writes ``long.json`` and ``long.md`` into the folder.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from mocap.datasets.bat_skeleton import MARKERS, bat_skeleton
from mocap.datasets.bats import bat_motion
from mocap.datasets.rig import tunnel_cameras
from mocap.datasets.scene import frame_times
from mocap.filters.body_axes import body_frames

from eal import fit_potential
from eal.arrays import Array
from eal.threads import one_blas_thread
from mocap.cameras.camera import project, stacked
from mocap.joints import joint_tracks
from mocap.measures import Measures
from mocap.pipeline.blocks import BLOCK, LongRecording
from mocap.pipeline.cleaning import clean
from mocap.pipeline.job import run_job
from mocap.pipeline.learning import learn_from
from mocap.pipeline.many import learn_joints
from mocap.pipeline.recording import Recording, of_pixels, of_points
from mocap.progress import Stages
from mocap.records import MarkerTracks, PixelTracks, Status
from mocap.results.long_result import write_in_blocks
from mocap.skeleton import Skeleton

FPS, CHUNK, SD_M, SD_PX, LOST = 240.0, 500, 3e-4, 1.0, 0.08


class Enough(Exception):
    """The time is over."""


def flight(frames: slice, *, seed: int = 0) -> Array:
    """(n, 34, 3) a stretch of the bat's flight; the same frames are the same in every stretch."""
    first, last = frames.start // CHUNK, (frames.stop - 1) // CHUNK
    whole = np.concatenate([_chunk(seed, k) for k in range(first, last + 1)])
    return whole[frames.start - first * CHUNK : frames.stop - first * CHUNK]


@lru_cache(maxsize=32)
def _chunk(seed: int, k: int) -> Array:
    t_s = (np.arange(CHUNK) + k * CHUNK) / FPS
    return bat_motion(seed)(t_s).xyz_m


def points(n_frames: int, *, seed: int = 0) -> LongRecording:
    """The bat's markers with noise and gaps, had stretch by stretch."""
    t_s = frame_times(n_frames, FPS)

    def tracks(frames: slice) -> MarkerTracks:
        xyz = np.concatenate([_noisy(seed, k) for k in _chunks(frames)])[_inside(frames)]
        return _as_tracks(MARKERS, t_s[frames], xyz)

    skeleton = bat_skeleton()
    return LongRecording(
        name="bat",
        skeleton=skeleton,
        names=MARKERS,
        t_s=t_s,
        part=lambda frames: of_points(tracks(frames), skeleton, name="bat"),
    )


def _chunks(frames: slice) -> range:
    return range(frames.start // CHUNK, max(frames.stop - 1, frames.start) // CHUNK + 1)


def _inside(frames: slice) -> slice:
    start = frames.start - frames.start // CHUNK * CHUNK
    return slice(start, start + frames.stop - frames.start)


@lru_cache(maxsize=32)
def _noisy(seed: int, k: int) -> Array:
    rng = np.random.default_rng([seed, k])
    xyz = _chunk(seed, k) + SD_M * rng.standard_normal((CHUNK, len(MARKERS), 3))
    return np.where(_lost(rng, (CHUNK, len(MARKERS)))[..., None], np.nan, xyz)


def _lost(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Gaps of 1 to 40 frames; about ``LOST`` of the samples."""
    lost = np.zeros(shape, dtype=bool)
    flat = lost.reshape(len(lost), -1)
    for column in flat.T:
        for start in rng.integers(0, len(flat), int(len(flat) * LOST / 20)):
            column[start : start + int(rng.integers(1, 40))] = True
    return lost


def _as_tracks(names: tuple[str, ...], t_s: Array, xyz: Array) -> MarkerTracks:
    seen = np.isfinite(xyz[..., 0])
    return MarkerTracks(
        names=names,
        t_s=t_s,
        xyz_m=xyz,
        cov_m2=np.where(seen, SD_M**2, np.nan)[..., None, None] * np.eye(3),
        status=np.where(seen, Status.MEASURED, Status.MISSING).astype(np.int8),
    )


def rays(n_frames: int, *, seed: int = 0) -> LongRecording:
    """The bat's markers in 8 cameras without lenses, a ray in seven lost, had stretch by stretch."""
    cameras = tuple(replace(camera, lens=None) for camera in tunnel_cameras(8))
    matrices, t_s = stacked(cameras), frame_times(n_frames, FPS)

    @lru_cache(maxsize=16)
    def chunk(k: int) -> Array:
        rng = np.random.default_rng([seed, k, 1])
        uv = project(matrices, _chunk(seed, k))
        uv += SD_PX * rng.standard_normal(uv.shape)
        lost = _lost(rng, (CHUNK, len(MARKERS), 8)) | (rng.random((CHUNK, len(MARKERS), 8)) < 0.06)
        uv[np.moveaxis(lost, 2, 0)] = np.nan
        return uv

    def pixels(frames: slice) -> PixelTracks:
        uv = np.concatenate([chunk(k) for k in _chunks(frames)], axis=1)[:, _inside(frames)]
        return PixelTracks(names=MARKERS, cameras=tuple(c.name for c in cameras), t_s=t_s[frames], uv_px=uv)

    return LongRecording(
        name="bat",
        skeleton=bat_skeleton(),
        names=MARKERS,
        t_s=t_s,
        part=lambda frames: of_pixels(pixels(frames), cameras, bat_skeleton(), name="bat"),
    )


def peak_mb() -> float:
    """Peak memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def frames_case(kind: str, n_frames: int, seconds: float) -> dict[str, object]:
    """Track in blocks; how far it came, and in what time and memory."""
    recording = (points if kind == "points" else rays)(n_frames)
    began, done, cpu = time.perf_counter(), 0.0, time.process_time()
    size = min(BLOCK, max(250, n_frames))

    def tell(stage: str, share: float) -> None:
        nonlocal done
        if stage == "track in blocks" and share < 1:
            done = share
        if time.perf_counter() - began > seconds and stage == "track in blocks":
            raise Enough

    report: dict[str, object] = {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            report = write_in_blocks(recording, Path(folder), model="constant_velocity", size=size, progress=tell)
            done = 1.0
        except Enough:
            pass
    spent = time.perf_counter() - began
    frames = round(done * n_frames)
    return {
        "kind": kind,
        "frames": n_frames,
        "done": frames,
        "seconds": spent,
        "cpu_seconds": time.process_time() - cpu,
        "cpu_ms_a_frame": 1e3 * (time.process_time() - cpu) / max(frames, 1),
        "peak_mb": peak_mb(),
        "stages": report.get("seconds", {}),
    }


def many_markers(count: int, n_frames: int) -> tuple[Array, Skeleton]:
    """(n, count, 3) markers on the bat: its own, then points between three of them; and a skeleton of them."""
    xyz, rng = flight(slice(0, n_frames)), np.random.default_rng(0)
    if count <= len(MARKERS):
        names = MARKERS[:count]
        trunk = tuple(name for name in bat_skeleton().trunk if name in names)
        return xyz[:, :count], Skeleton(name="bat", markers=names, trunk=trunk)
    apart = np.linalg.norm(xyz[0][:, None] - xyz[0], axis=-1)
    more = []
    for _ in range(count - len(MARKERS)):
        near = np.argsort(apart[int(rng.integers(len(MARKERS)))])[:4]
        more.append(np.einsum("k,tki->ti", rng.dirichlet(np.ones(4)), xyz[:, near]))
    names = (*MARKERS, *(f"skin_{i}" for i in range(len(more))))
    every = np.concatenate([xyz, np.stack(more, axis=1)], axis=1)
    return every, Skeleton(name="bat", markers=names, trunk=bat_skeleton().trunk)


def markers_case(kind: str, count: int, n_frames: int, model: str) -> dict[str, object]:
    """Prepare and track at once."""
    xyz, skeleton = many_markers(count, n_frames)
    rng, t_s = np.random.default_rng(0), frame_times(n_frames, FPS)
    stages, cpu = Stages(), time.process_time()
    with one_blas_thread():
        with stages.stage("clean"):
            if kind == "points":
                noisy = xyz + SD_M * rng.standard_normal(xyz.shape)
                noisy[_lost(rng, xyz.shape[:2])] = np.nan
                prepared = clean(of_points(_as_tracks(skeleton.markers, t_s, noisy), skeleton, name="bat"))
            else:
                cameras = tuple(replace(camera, lens=None) for camera in tunnel_cameras(8))
                uv = project(stacked(cameras), xyz)
                uv += SD_PX * rng.standard_normal(uv.shape)
                uv[rng.random(uv.shape[:3]) < 0.14] = np.nan
                pixels = PixelTracks(names=skeleton.markers, cameras=tuple(c.name for c in cameras), t_s=t_s, uv_px=uv)
                prepared = clean(of_pixels(pixels, cameras, skeleton, name="bat"))
        run, _ = run_job(prepared, model=model, validated=False, stages=stages)  # type: ignore[arg-type]
    error = np.linalg.norm(run.xyz_m - xyz, axis=-1)
    filled = run.tracks.status == Status.SMOOTHED
    return {
        "kind": kind,
        "markers": count,
        "frames": n_frames,
        "model": model,
        "clean_s": stages.seconds["clean"],
        "track_s": sum(v for k, v in stages.seconds.items() if k.startswith(("track", "learn"))),
        "cpu_seconds": time.process_time() - cpu,
        "filled_mm": float(1e3 * np.sqrt(np.nanmean(error[filled] ** 2))) if filled.any() else None,
        "peak_mb": peak_mb(),
    }


def trials_case(count: int, n_frames: int) -> dict[str, object]:
    """Learn from so many flights, each made, cleaned and read when its turn comes."""
    t_s = frame_times(n_frames, FPS)
    spent = 0.0

    def prepared() -> Iterator[Recording]:
        nonlocal spent
        for seed in range(count):
            began = time.process_time()
            rng = np.random.default_rng(seed)
            xyz = bat_motion(seed)(t_s).xyz_m + SD_M * rng.standard_normal((n_frames, len(MARKERS), 3))
            xyz[_lost(rng, xyz.shape[:2])] = np.nan
            one = clean(of_points(_as_tracks(MARKERS, t_s, xyz), bat_skeleton(), name=f"{seed}"))
            spent += time.process_time() - began
            yield one

    before, start = peak_mb(), time.process_time()
    with one_blas_thread():
        learned = learn_from(prepared())
    return {
        "learned": "motion model",
        "trials": count,
        "frames": n_frames,
        "kept": len(learned.trials),
        "reading_s": spent,
        "cpu_seconds": time.process_time() - start,
        "before_mb": before,
        "peak_mb": peak_mb(),
        "rmse_mm": learned.scores["mixture"]["rmse_mm"],
    }


def potentials_case(count: int, n_frames: int) -> dict[str, object]:
    """Potentials of four joints of so many flights by map and reduce; each flight is made anew in each round."""
    skeleton, t_s = bat_skeleton(), frame_times(n_frames, FPS)
    joints = tuple(joint for joint in skeleton.joints if joint.name in ("elbow_l", "wrist_l", "elbow_r", "wrist_r"))
    part = replace(skeleton, joints=joints, measures=Measures())
    trunk = [MARKERS.index(name) for name in skeleton.trunk]

    @lru_cache(maxsize=1)
    def trial(name: str) -> dict[str, Array]:
        xyz = bat_motion(int(name))(t_s).xyz_m
        tracks = _as_tracks(MARKERS, t_s, xyz + SD_M * np.random.default_rng(int(name)).standard_normal(xyz.shape))
        limb = joint_tracks(tracks, part, body_frames(xyz[:, trunk], dt_s=1 / FPS, cutoff_hz=30.0))["limb"]
        return {joint: limb.q_m[:, i] for i, joint in enumerate(limb.names)}

    began, before = time.process_time(), peak_mb()
    names = [str(seed) for seed in range(count)]
    with one_blas_thread():
        found = learn_joints(names, trial)
        one = found["elbow_l"]
        potential = one.potential().potential
        scores = one.left_out()
        spent, peak = time.process_time() - began, peak_mb()
        at_once = None
        if count * n_frames <= 60_000:
            every = np.concatenate([trial(name)["elbow_l"] for name in names]) / one.scale_m
            whole = fit_potential(every, kernel=potential.kernel, lam=1e-3, method="cholesky")
            q = np.random.default_rng(0).normal(size=(500, 2)) * every.std(axis=0) * 2 + every.mean(axis=0)
            at_once = float(np.abs(potential.value(q) - whole.value(q)).max())
    return {
        "learned": "potentials of 4 joints",
        "trials": count,
        "frames": n_frames,
        "cpu_seconds": spent,
        "before_mb": before,
        "peak_mb": peak,
        "landmarks": len(potential.centres),
        "largest difference from all at once": at_once,
        "mean V_z left out": float(np.mean([score.value for score in scores])),
        "mean V_z learned": float(np.mean([score.own for score in scores])),
    }


CASES: dict[str, Callable[..., dict[str, object]]] = {
    "frames": frames_case,
    "markers": markers_case,
    "trials": trials_case,
    "potentials": potentials_case,
}


def apart(part: str, arguments: list[object], seconds: float) -> dict[str, object]:
    """A case in a process of its own; None of what it did not come to if it takes twice the time."""
    command = [sys.executable, "-m", "benchmarks.long", "--case", part, json.dumps(arguments)]
    try:
        found = subprocess.run(command, capture_output=True, check=True, text=True, timeout=2 * seconds + 30)
    except subprocess.TimeoutExpired:
        return {"arguments": arguments, "stopped_after_s": 2 * seconds + 30}
    return json.loads(found.stdout.splitlines()[-1])


def table(rows: list[dict[str, object]]) -> str:
    """Rows as markdown."""
    rows = [{k: v for k, v in row.items() if k != "stages"} for row in rows]
    titles = list(dict.fromkeys(k for row in rows for k in row))

    def cell(value: object) -> str:
        if isinstance(value, float):
            return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
        return "-" if value is None else str(value)

    lines = ["| " + " | ".join(titles) + " |", "|---" * len(titles) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(cell(row.get(k)) for k in titles) + " |" for row in rows)])


def main() -> None:
    """Print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the smallest cases")
    parser.add_argument("--part", choices=list(CASES), action="append", help="only this part")
    parser.add_argument("--seconds", type=float, default=300.0, help="most time for a case")
    parser.add_argument("--only", type=int, action="append", help="only cases of so many frames, markers, trials")
    parser.add_argument("--kind", choices=["points", "rays"], action="append")
    parser.add_argument("--model", default="constant_velocity", help="of many markers")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--case", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(CASES[options.case[0]](*json.loads(options.case[1]))))
        return
    frames = [500] if options.quick else [10**3, 10**4, 10**5, 10**6]
    markers = [10, 50] if options.quick else [30, 100, 300, 1000]
    trials = [2, 4] if options.quick else [10, 100, 1000]
    kinds = options.kind or ["points", "rays"]
    some = {
        "frames": [[kind, n, options.seconds] for n in frames for kind in kinds if n in (options.only or frames)],
        "markers": [
            [kind, n, 60 if options.quick else 400, options.model]
            for n in markers
            for kind in kinds
            if n in (options.only or markers)
        ],
        "trials": [[n, 120 if options.quick else 540] for n in trials if n in (options.only or trials)],
        "potentials": [[n, 120 if options.quick else 540] for n in trials if n in (options.only or trials)],
    }
    found: dict[str, list] = {}
    text = [f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors", ""]
    for part in options.part or list(CASES):
        found[part] = []
        for arguments in some[part]:
            found[part].append(apart(part, arguments, options.seconds))
            print(json.dumps(found[part][-1]), flush=True)
        text += [f"## {part}", "", table(found[part]), ""]
    print("\n".join(text))
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "long.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
        (options.out / "long.md").write_text("\n".join(text), encoding="utf-8")


if __name__ == "__main__":
    main()
