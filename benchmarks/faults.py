"""Planted faults: what share of them the audit finds and names, and how many clean recordings it accuses wrongly.

Twins (a lizard in 4 cameras, a bat in a wind tunnel in 4) are audited as ``mocap info`` audits files, clean and with
one fault each, in several sizes. A fault is found where an alarm of its kind names its cameras or markers; alarms of
other kinds are counted apart. A clean recording is wrongly accused by any alarm.

    python -m benchmarks.faults [--quick] [--seeds 10] [--clean 200] [--only jump]
"""

import argparse
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mocap.datasets import make_lizard
from mocap.datasets.bats import make_bat_wind_tunnel
from mocap.datasets.recording import SyntheticRecording
from threadpoolctl import threadpool_limits

from eal.arrays import Array
from mocap.audit import Finding, alarms
from mocap.audit.audit import audit_recording
from mocap.cameras.camera import Camera, record, stacked, undistorted
from mocap.cameras.triangulate import linear
from mocap.io.contents import FileContents, pixel_recording
from mocap.records import MarkerTracks, marker_tracks

FRAMES = 150


@dataclass(frozen=True, eq=False)
class Case:
    """A recording as files hold it.

    Attributes:
        cameras: Calibrated cameras.
        uv_px: (C, T, M, 2) pixels.
        stored_m: (T, M, 3) stored points; None: none.
        concerned: Cameras and markers that a finding should name; empty: any.
    """

    cameras: tuple[Camera, ...]
    uv_px: Array
    stored_m: Array | None = None
    concerned: frozenset[str] = frozenset()


Plant = Callable[[SyntheticRecording, Case, float, np.random.Generator], Case]


@dataclass(frozen=True)
class Fault:
    """A fault to plant.

    Attributes:
        kinds: Kinds of findings that name it.
        sizes: Its sizes.
        unit: Of the sizes.
        plant: Plants it.
    """

    kinds: frozenset[str]
    sizes: tuple[float, ...]
    unit: str
    plant: Plant


def twin(seed: int) -> SyntheticRecording:
    """A lizard for even seeds, a bat for odd ones."""
    make = make_bat_wind_tunnel if seed % 2 else make_lizard
    return make(seed=seed, n_frames=FRAMES)


def clean(recording: SyntheticRecording) -> Case:
    """As filmed, with points stored as DLTdv stores them."""
    uv = np.round(np.array(recording.pixels.uv_px), 6)
    ideal = undistorted(recording.cameras, uv, iterations=3)
    return Case(recording.cameras, uv, np.round(linear(stacked(recording.cameras), ideal), 6))


def audited(recording: SyntheticRecording, case: Case) -> list[Finding]:
    """Alarms of a case, as for a project of DLTdv8."""
    contents: FileContents = pixel_recording(
        Path("twin_xypts.csv"),
        "dltdv-xypts",
        names=recording.pixels.names,
        cameras=[c.name for c in case.cameras],
        uv_px=case.uv_px,
        fps=recording.fps,
        calibration=case.cameras,
        pixel_origin="upper-left",
        unit="m",
    )
    if case.stored_m is not None:
        points: MarkerTracks = marker_tracks(contents.names, recording.pixels.t_s, case.stored_m)
        contents = replace(contents, points=points)
    return alarms(audit_recording(contents))


def _some(case: Case, rng: np.random.Generator, count: float) -> list[int]:
    return sorted(int(c) for c in rng.permutation(len(case.cameras))[: int(count)])


def _named(case: Case, which: list[int]) -> frozenset[str]:
    return frozenset(case.cameras[c].name for c in which)


def _size(camera: Camera) -> tuple[int, int]:
    if camera.size_px is None:
        raise ValueError("twins state the size of their pictures")
    return camera.size_px


def mirrored(_r: SyntheticRecording, case: Case, count: float, rng: np.random.Generator) -> Case:
    """Columns counted from the right in some cameras."""
    which, uv = _some(case, rng, count), case.uv_px.copy()
    for c in which:
        uv[c, ..., 0] = _size(case.cameras[c])[0] - uv[c, ..., 0]
    return replace(case, uv_px=uv, stored_m=None, concerned=_named(case, which))


def upside_down(_r: SyntheticRecording, case: Case, count: float, rng: np.random.Generator) -> Case:
    """Rows counted from below in some cameras."""
    which, uv = _some(case, rng, count), case.uv_px.copy()
    for c in which:
        uv[c, ..., 1] = _size(case.cameras[c])[1] - uv[c, ..., 1]
    return replace(case, uv_px=uv, stored_m=None, concerned=_named(case, which))


def below(_r: SyntheticRecording, case: Case, count: float, rng: np.random.Generator) -> Case:
    """The films of some cameras stand below the others'."""
    which, uv = _some(case, rng, count), case.uv_px.copy()
    for c in which:
        uv[c, ..., 1] += _size(case.cameras[c])[1]
    return replace(case, uv_px=uv, stored_m=None, concerned=_named(case, which))


def exchanged(_r: SyntheticRecording, case: Case, count: float, rng: np.random.Generator) -> Case:
    """So many cameras in each other's place."""
    which, uv = _some(case, rng, count), case.uv_px.copy()
    uv[which] = uv[np.roll(which, 1)]
    return replace(case, uv_px=uv, stored_m=None, concerned=_named(case, which))


def moved(_r: SyntheticRecording, case: Case, pixels: float, rng: np.random.Generator) -> Case:
    """One camera turned after calibration by so many pixels."""
    uv, c, angle = case.uv_px.copy(), int(rng.integers(len(case.cameras))), rng.uniform(0, 2 * np.pi)
    uv[c] += pixels * np.array([np.cos(angle), np.sin(angle)])
    return replace(case, uv_px=uv, stored_m=None, concerned=_named(case, [c]))


def no_lens(_r: SyntheticRecording, case: Case, k1: float, _rng: np.random.Generator) -> Case:
    """Lenses of so much k1 that no file states, in place of the twin's own."""
    lenses = [c.lens for c in case.cameras]
    ideal = undistorted(case.cameras, case.uv_px)
    uv = np.stack(
        [
            replace(lens, k=(k1, 0.0, 0.0), p=(0.0, 0.0)).distort(view) if lens is not None else view
            for lens, view in zip(lenses, ideal, strict=True)
        ]
    )
    return replace(case, cameras=tuple(replace(c, lens=None) for c in case.cameras), uv_px=uv, stored_m=None)


def late(recording: SyntheticRecording, case: Case, frames: float, rng: np.random.Generator) -> Case:
    """One camera late by so many frames."""
    c, uv, t = int(rng.integers(len(case.cameras))), case.uv_px.copy(), np.arange(case.uv_px.shape[1])
    truth = recording.truth.xyz_m
    then = np.clip(t + frames, 0, len(t) - 1)
    later = np.stack([np.interp(then, t, axis) for axis in truth.reshape(len(t), -1).T], axis=1).reshape(truth.shape)
    uv[c] += record([case.cameras[c]], later)[0] - record([case.cameras[c]], truth)[0]
    return replace(case, uv_px=uv, stored_m=None, concerned=_named(case, [c]))


def stale(_r: SyntheticRecording, case: Case, pixels: float, rng: np.random.Generator) -> Case:
    """1 % of points edited by so many pixels in one camera after they were stored."""
    uv = case.uv_px.copy()
    edited = rng.random(uv.shape[1:3]) < 0.01
    uv[:, edited] += pixels * rng.choice([-1.0, 1.0], (len(uv), int(edited.sum()), 2))
    return replace(case, uv_px=uv)


def other_world(_r: SyntheticRecording, case: Case, scale: float, rng: np.random.Generator) -> Case:
    """Stored points of another calibration: turned, shifted and scaled."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    assert case.stored_m is not None
    return replace(case, stored_m=np.round(scale * case.stored_m @ turn.T + rng.normal(0, 1, 3), 6))


def columns(recording: SyntheticRecording, case: Case, _size: float, rng: np.random.Generator) -> Case:
    """Stored points of two markers under each other's name."""
    assert case.stored_m is not None
    a, b = (int(m) for m in rng.permutation(case.stored_m.shape[1])[:2])
    xyz = case.stored_m.copy()
    xyz[:, [a, b]] = xyz[:, [b, a]]
    return replace(case, stored_m=xyz, concerned=frozenset(recording.pixels.names[m] for m in (a, b)))


def time_shift(_r: SyntheticRecording, case: Case, frames: float, _rng: np.random.Generator) -> Case:
    """Points stored so many frames after their pixels."""
    assert case.stored_m is not None
    xyz = np.full_like(case.stored_m, np.nan)
    xyz[int(frames) :] = case.stored_m[: -int(frames)]
    return replace(case, stored_m=xyz)


def rounded(_r: SyntheticRecording, case: Case, step: float, _rng: np.random.Generator) -> Case:
    """Pixels rounded to so many."""
    return replace(case, uv_px=np.round(case.uv_px / step) * step, stored_m=None)


def repeated(_r: SyntheticRecording, case: Case, count: float, rng: np.random.Generator) -> Case:
    """So many frames of one camera stored twice."""
    uv, c = case.uv_px.copy(), int(rng.integers(len(case.cameras)))
    for t in 10 + 20 * np.arange(int(count)):
        uv[c, t + 1] = uv[c, t]
    return replace(case, uv_px=uv, stored_m=None, concerned=_named(case, [c]))


def copied(_r: SyntheticRecording, case: Case, _size: float, rng: np.random.Generator) -> Case:
    """The calibration of one camera under another's name."""
    a, b = _some(case, rng, 2)
    rig = list(case.cameras)
    rig[b] = replace(rig[a], name=rig[b].name)
    return replace(case, cameras=tuple(rig), stored_m=None, concerned=_named(case, [a, b]))


def jump(recording: SyntheticRecording, case: Case, length_m: float, rng: np.random.Generator) -> Case:
    """One marker is clicked elsewhere from the middle on, after a hole of one frame; size in animal's steps."""
    uv, m = case.uv_px.copy(), int(rng.integers(case.uv_px.shape[2]))
    truth = np.array(recording.truth.xyz_m)
    steps = np.linalg.norm(np.diff(truth, axis=0), axis=-1)
    way = rng.normal(size=3)
    other = truth.copy()
    other[FRAMES // 2 :, m] += length_m * np.quantile(steps, 0.999) * way / np.linalg.norm(way)
    uv[:, :, m] += (record(case.cameras, other) - record(case.cameras, truth))[:, :, m]
    uv[:, FRAMES // 2 - 1, m] = np.nan
    return replace(case, uv_px=uv, stored_m=None, concerned=frozenset({recording.pixels.names[m]}))


def millimetres(_r: SyntheticRecording, case: Case, factor: float, _rng: np.random.Generator) -> Case:
    """Lengths of the calibration in another unit than stated."""
    world = np.diag([1 / factor, 1 / factor, 1 / factor, 1.0])
    return replace(case, cameras=tuple(replace(c, matrix=c.matrix @ world) for c in case.cameras), stored_m=None)


def _kinds(*names: str) -> frozenset[str]:
    return frozenset(names)


FAULTS: dict[str, Fault] = {
    "columns mirrored": Fault(_kinds("mirrored pixels"), (1, 2), "cameras", mirrored),
    "rows from below": Fault(_kinds("mirrored pixels"), (1, 2), "cameras", upside_down),
    "film below another": Fault(_kinds("shifted pixels"), (1, 2), "cameras", below),
    "cameras exchanged": Fault(_kinds("swapped cameras"), (2, 3), "cameras", exchanged),
    "one camera turned": Fault(_kinds("foreign camera", "large residual"), (20, 60, 200), "px", moved),
    "lens not given": Fault(_kinds("distortion"), (-0.05, -0.14, -0.3), "k1", no_lens),
    "one camera late": Fault(_kinds("camera offsets"), (0.3, 0.9, 3.0), "frames", late),
    "pixels edited after": Fault(_kinds("stale points"), (1, 5, 20), "px", stale),
    "points of another world": Fault(_kinds("another world"), (1.0, 1.3), "scale", other_world),
    "columns of points swapped": Fault(_kinds("wrong columns"), (2,), "markers", columns),
    "points shifted in time": Fault(_kinds("time shift"), (1, 5), "frames", time_shift),
    "pixels rounded": Fault(_kinds("quantised pixels"), (1.0, 0.5), "px", rounded),
    "frames repeated": Fault(_kinds("repeated frames"), (1, 4), "frames", repeated),
    "camera copied": Fault(_kinds("copied cameras"), (1,), "cameras", copied),
    "marker jumps": Fault(_kinds("jump"), (4, 8, 20), "x the 99.9 % step", jump),
    "wrong unit": Fault(_kinds("units"), (1000.0,), "times", millimetres),
}


def found(case: Case, fault: Fault, raised: list[Finding]) -> bool:
    """Whether an alarm of the fault's kind names what it concerns."""
    of_kind = [f for f in raised if f.kind in fault.kinds]
    named = {name for f in of_kind for name in (*f.cameras, *f.markers)}
    return bool(of_kind) and (not case.concerned or bool(case.concerned & named))


def clean_table(count: int, first: int = 1000) -> tuple[Counter[str], set[int]]:
    """Alarms of clean recordings: kinds with their number, and the seeds that raise one."""
    kinds: Counter[str] = Counter()
    accused = set()
    for seed in range(first, first + count):
        recording = twin(seed)
        raised = {f.kind for f in audited(recording, clean(recording))}
        kinds.update(raised)
        if raised:
            accused.add(seed)
    return kinds, accused


def fault_table(seeds: int, only: str | None = None) -> Iterator[tuple[str, float, str, float, Counter[str]]]:
    """Each fault and size: the share found, and alarms of other kinds."""
    for name, fault in FAULTS.items():
        if only is not None and only not in name:
            continue
        for size in fault.sizes:
            hits, others = 0, Counter()
            for seed in range(seeds):
                recording = twin(seed)
                case = fault.plant(recording, clean(recording), size, np.random.default_rng(seed))
                raised = audited(recording, case)
                hits += found(case, fault, raised)
                others.update({f.kind for f in raised} - fault.kinds)
            yield name, size, fault.unit, hits / seeds, others


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description="Planted faults: which of them the audit finds.")
    parser.add_argument("--quick", action="store_true", help="2 seeds, 6 clean recordings")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--clean", type=int, default=200)
    parser.add_argument("--first", type=int, default=1000, help="first seed of the clean recordings")
    parser.add_argument("--only", help="faults whose name contains this")
    options = parser.parse_args()
    seeds, count = (2, 6) if options.quick else (options.seeds, options.clean)
    with threadpool_limits(1), np.errstate(all="ignore"):
        print(f"{'fault':28}{'size':>8} {'':20}{'found':>7}  other alarms")
        for name, size, unit, share, others in fault_table(seeds, options.only):
            told = ", ".join(f"{kind} {n}" for kind, n in others.most_common(3))
            print(f"{name:28}{size:8g} {unit:20}{share:7.0%}  {told}", flush=True)
        if options.only is None:
            kinds, accused = clean_table(count, options.first)
            told = ", ".join(f"{kind} {n}" for kind, n in kinds.most_common())
            print(f"\nclean recordings wrongly accused: {len(accused)} of {count}{f' ({told})' if told else ''}")


if __name__ == "__main__":
    main()
