"""Track a long recording in blocks, into a folder; look at any range of its frames."""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from eal.threads import one_blas_thread
from mocap.filters.body_axes import body_frames
from mocap.filters.velocities import Motion, without_rates
from mocap.findings import over_blocks
from mocap.io.unstated_unit import length
from mocap.joints import joint_tracks
from mocap.kinematics.compute import kinematics
from mocap.kinematics.cycles import Cycle, cycles, footfalls
from mocap.pipeline.blocks import BLOCK, Known, LongRecording, Model, learn_once, tracked_blocks
from mocap.pipeline.job import JOINT_HZ
from mocap.pipeline.potentials import FRAME, SPACE, joint_potentials
from mocap.pipeline.reading import in_options
from mocap.pipeline.recording import Recording, of_points
from mocap.pipeline.tracking import tracks_alone
from mocap.pipeline.variables import VARIABLES, with_joints, with_motion
from mocap.plots.page import write_page
from mocap.progress import Stages, Tell, silent
from mocap.records import MarkerTracks, Status
from mocap.results.blocks import BlockWriter, read_markers
from mocap.results.stored import read_recording, write_arrays
from mocap.results.tables import write_report
from mocap.text import number_of, plain

_SHOWN = ("position", "covariance", "status", "ideal")
"""Variables that an overview has beside those of tracking."""
OVERVIEW, DETAIL = 4000, 1500
"""Frames of the overview that the viewer shows and potentials are learned from, and of the stretch in the figures."""


def write_in_blocks(
    recording: LongRecording,
    folder: Path,
    *,
    model: Model = "auto",
    learned=None,
    size: int = BLOCK,
    seed: int = 0,
    footer: str = "",
    progress: Tell = silent,
) -> dict[str, object]:
    """Track a recording block by block and write its result into an empty folder.

    ``markers.parquet``, ``kinematics.parquet``, ``cycles.csv``, ``angles.csv`` and ``blocks.csv``
    (``mocap.results.blocks``) are written as blocks are done. The overview, at most ``OVERVIEW`` frames evenly over the
    recording, is what potentials are learned from, ``recording.rrd`` shows, and ``mocap.load`` gives; figures show the
    ``DETAIL`` frames of which most was measured. Memory hardly grows with the number of frames (rows of cycles).

    Args:
        recording: The recording (``mocap.pipeline.blocks``).
        folder: Where to.
        model: ``auto``, ``mixture`` or ``constant_velocity``.
        learned: A model of other trials to track with, in place of these; None: none.
        size: Frames of a block.
        seed: Where gaps are hidden to learn from.
        footer: What the readable report ends with.
        progress: Called with the name of the stage and the share of it that is done.

    Returns:
        The report.
    """
    from mocap.rerun.record import write_recording

    stages, began = Stages(tell=progress), time.perf_counter()
    every = max(1, -(-recording.n_frames // OVERVIEW))
    with one_blas_thread():
        with stages.stage("learn once"):
            known = learn_once(recording, model=model, learned=learned, seed=seed)
        detail, samples, found_out = None, Counter[int](), []
        thin: list[Recording] = []
        nothing: list[Recording] = []
        with BlockWriter(folder, fps=1 / recording.dt_s) as writer:
            for core, run, own, findings in tracked_blocks(recording, known, size=size, stages=stages):
                with stages.stage("kinematics and tables"):
                    found = kinematics(run.motion, run.skeleton, recording=run.name)
                    rows = _begun(cycles(found, run.motion, run.skeleton), run, own)
                    part = run.at(own)
                    writer.add(core, part.tracks, part.repaired, found, own, rows)
                found_out.append(findings)
                samples.update(part.tracks.status.ravel().tolist())
                thin += _thinned(part, (-core.start) % every, every)
                detail = _better(detail, part)
                nothing = [] if thin else [_shown(part)]
                del run, part, found, rows  # only one block at a time is in memory
        with stages.stage("overview, potentials, figures"):
            overview = _with_potentials(_joined(thin or nothing))
            report = _report(recording, known, samples, overview, every, size)
            told = (*recording.findings, *over_blocks(found_out))
            report["findings"] = [str(one) for one in told]
            report["wrong"] = [one.text for one in told if one.alarm]
            report["seconds"] = {k: round(v, 3) for k, v in stages.seconds.items()}
            report["seconds_total"] = round(time.perf_counter() - began, 3)
            text = in_options(_readable(report)) + footer
            overview = replace(overview, report=report, report_text=text)
            write_arrays(overview, folder)
            write_report(overview, folder)
            write_recording(overview, folder / "recording.rrd", every=every)
            if detail is not None:
                one = replace(detail[1], report_text=text)
                found = kinematics(one.motion, one.skeleton, recording=one.name)
                rows, steps = cycles(found, one.motion, one.skeleton), footfalls(one.motion, one.skeleton)
                write_page(one, found, rows, steps, folder)
    return report


def _begun(rows: list[Cycle], run: Recording, own: slice) -> list[Cycle]:
    """Cycles that begin in the block's own frames."""
    t_s = run.t_s
    end = t_s[own.stop] if own.stop < len(t_s) else np.inf
    return [row for row in rows if t_s[own.start] <= row.start_s < end]


def _thinned(run: Recording, first: int, every: int) -> list[Recording]:
    """Every so manieth frame of a block; none of a block in which nothing is seen."""
    part = run.at(slice(first, None, every))
    return [_shown(part)] if len(part.t_s) and part.tracks.seen.any() else []


def _shown(run: Recording) -> Recording:
    """What an overview shows, without velocities; copied, as a view would keep the whole block."""
    names = [name for name, one in VARIABLES.items() if one.since == "track" or name in _SHOWN]
    data = run.data[[name for name in names if name in run.data]].copy(deep=True)
    return replace(run, data=with_motion(data, _still(run.tracks)))


def _still(markers: MarkerTracks) -> Motion:
    measured = markers.status == Status.MEASURED
    return without_rates(markers.names, markers.t_s, markers.xyz_m, markers.cov_m2, measured)


def _joined(parts: Sequence[Recording]) -> Recording:
    """Parts of a recording, one after the other."""
    data = [part.data for part in parts]
    joined = xr.concat(data, dim="time", data_vars="minimal", coords="minimal", compat="override", join="override")
    return replace(parts[0], data=joined)


def _better(known: tuple[int, Recording] | None, run: Recording) -> tuple[int, Recording] | None:
    """The stretch of which most was measured: the middle of a block, if it has more than the one before."""
    n = len(run.t_s)
    start = max(0, (n - DETAIL) // 2)
    frames = slice(start, min(n, start + DETAIL))
    count = int((run.tracks.status[frames] == Status.MEASURED).sum())
    if count == 0 or (known is not None and count <= known[0]):
        return known
    part = run.at(frames)
    return count, replace(part, data=part.data.copy(deep=True))


def _with_potentials(run: Recording) -> Recording:
    if not run.joint_tracks:
        return run
    planar, spatial = (joint_potentials(run.joint_tracks[of], run.tracks, run.skeleton) for of in (FRAME, SPACE))
    return replace(run, potentials=planar, spatial_potentials=spatial)


def _report(
    recording: LongRecording, known: Known, samples: Mapping[int, int], overview: Recording, every: int, size: int
) -> dict[str, object]:
    total = recording.n_frames * len(recording.names)
    sd = overview.tracks.sd_m
    status = overview.tracks.status
    blocks = -(-recording.n_frames // size)

    def median(which: Status) -> float | None:
        some = sd[(status == which) & np.isfinite(sd)]
        return float(1e3 * np.median(some)) if len(some) else None

    return {
        "name": recording.name,
        "frames": recording.n_frames,
        "fps": float(1 / recording.dt_s),
        "markers": list(recording.names),
        "cameras": [camera.name for camera in overview.cameras],
        "skeleton": recording.skeleton.name,
        "model": {"name": known.name, "why": known.why},
        "samples": {"total": total, **{o.name.lower(): samples[o] / total for o in Status}},
        "sd_mm": {"measured": median(Status.MEASURED), "filled": median(Status.SMOOTHED)},
        "blocks": {"number": blocks, "frames": size},
        "overview": {"every": every, "frames": len(overview.tracks.t_s)},
        "validation": {"methods": {} if known.learned is None else known.learned.scores},
        "joints": sorted(overview.potentials),
        "length_m": length(overview.tracks.xyz_m),
    }


def _readable(report: Mapping) -> str:
    samples, model = report["samples"], report["model"]
    sd = {k: "-" if v is None else f"{v:.3g} mm" for k, v in report["sd_mm"].items()}
    lines = [
        f"# {plain(report['name'])}",
        "",
        f"{report['frames']} frames at {report['fps']:g} per second, {number_of(len(report['markers']), 'marker')}, "
        f"{number_of(len(report['cameras']), 'camera')}; tracked in {report['blocks']['number']} blocks of at most "
        f"{report['blocks']['frames']} frames.",
        f"Motion model: **{model['name']}** ({plain(model['why'])}).",
        "",
        "| samples | share |",
        "|---|---|",
        f"| seen in 3D and accepted | {samples['measured']:.1%} |",
        f"| filled, inside gaps | {samples['smoothed']:.1%} |",
        f"| extrapolated, before the first or after the last observation | {samples['predicted']:.1%} |",
        f"| rejected | {samples['rejected']:.1%} |",
        f"| left empty | {samples['missing']:.1%} |",
        "",
        f"Standard deviation (median): measured {sd['measured']}, filled {sd['filled']}.",
        "",
        "`recording.rrd`, `markers.nc`, `recording.nc` and potentials are of one frame in "
        f"{report['overview']['every']} ({report['overview']['frames']} frames); "
        "`markers.parquet` and `kinematics.parquet` hold all frames. "
        "`mocap view FOLDER --frames 1001:2000` shows every frame of a range.",
        "",
        "## Findings",
        "",
        *(f"- {plain(text)}" for text in report["findings"]),
    ]
    return "\n".join(lines) + "\n"


def load_range(folder: Path, frames: range) -> Recording:
    """All frames of a range of a result that was written in blocks, as a run; without pixels and velocities.

    Raises:
        MocapError: there are no such frames.
        FormatError: the files cannot be read.
    """
    markers, repaired = read_markers(folder, frames)
    whole = read_recording(folder)
    found = tracks_alone(of_points(markers, whole.skeleton, name=whole.name), whole.model, _still(markers))
    found = found.having(repaired=repaired)
    joints = joint_tracks(markers, whole.skeleton, _axes(markers, whole.skeleton.trunk))
    parts = {name: getattr(whole, name) for name in ("potentials", "spatial_potentials", "report", "report_text")}
    return replace(found, data=with_joints(found.data, joints), folder=folder, **parts)


def _axes(markers: MarkerTracks, trunk: tuple[str, ...]):
    wanted = [markers.names.index(name) for name in trunk] or list(range(len(markers.names)))
    xyz = markers.xyz_m[:, wanted]
    if not np.isfinite(xyz).any():
        xyz = markers.xyz_m
    dt_s = float(markers.t_s[1] - markers.t_s[0]) if len(markers.t_s) > 1 else 1.0
    return body_frames(xyz, dt_s=dt_s, cutoff_hz=JOINT_HZ)
