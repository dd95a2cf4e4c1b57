"""Track a long recording in blocks, into a folder."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import xarray as xr

from eal.threads import one_blas_thread
from mocap.cleaning.cleaned import cleaned as found_by_cleaning
from mocap.errors import FormatError, MocapError
from mocap.filters.model import LearnedModel
from mocap.filters.models.registry import NAMED
from mocap.filters.score import Score
from mocap.findings import over_blocks
from mocap.kinematics.compute import kinematics
from mocap.kinematics.cycles import Cycle, cycles
from mocap.plots.page import write_page
from mocap.progress import Stages, Tell, silent
from mocap.reading.decided import decided
from mocap.reading.ideal_pixels import of_one_camera
from mocap.reading.session import own_findings
from mocap.recording import BLOCK, Recording
from mocap.records import Status
from mocap.report.job import reported
from mocap.report.report import counts, together
from mocap.results.blocks import BlockWriter
from mocap.results.stored import write_arrays
from mocap.results.tables import write_report
from mocap.results.tracked import Tracked
from mocap.tracking.blocks import blocks_of, learn_excerpts, track_block
from mocap.tracking.report_part import Report
from mocap.tracking.result import Result
from mocap.tracking.tracking import still

R = TypeVar("R", bound=Recording)
OVERVIEW, DETAIL = 4000, 1500
"""Frames of the overview that the viewer shows and potentials are learned from, and of the stretch in the figures."""
_OWN = ("limb", "x", "y", "sample", "angle", "segment", "energy", "pair", "reason")
"""Dimensions of variables that differ from block to block."""


def write_in_blocks(
    recording: Recording,
    folder: Path,
    *,
    model: str = "auto",
    learned: LearnedModel | None = None,
    size: int = BLOCK,
    validate: bool = True,
    seed: int = 0,
    footer: str = "",
    progress: Tell = silent,
) -> Tracked:
    """Track a recording block by block and write its result into an empty folder.

    ``markers.parquet``, ``kinematics.parquet``, ``cycles.csv``, ``angles.csv`` and ``blocks.csv``
    (``mocap.results.blocks``) are written as blocks are done. The overview, at most ``OVERVIEW`` frames evenly over the
    recording, is what potentials are learned from, ``recording.rrd`` shows, and ``mocap.load`` gives; figures show the
    ``DETAIL`` frames of which most was measured. Memory hardly grows with the number of frames (rows of cycles).

    Args:
        recording: The recording.
        folder: Where to.
        model: As of ``mocap.track``.
        learned: A model of other trials to track with, in place of these; None: none.
        size: Frames of a block.
        validate: Whether samples are hidden, to measure how they are filled: of the first block that shows enough for
            the model, or where none does, of the first.
        seed: Where gaps are hidden, to learn from and for that.
        footer: What the readable report ends with.
        progress: Called with the name of the stage and the share of it that is done.

    Returns:
        The overview, with the report of the whole.

    Raises:
        MocapError: of one camera: the whole decides between a pose and its mirror image, which blocks would do apart.
    """
    if of_one_camera(recording):
        raise MocapError(
            f"{recording.where}: what one camera sees is tracked at once, not in blocks, as the whole decides between "
            "a pose and its mirror image: give `blocks` 0, or fewer frames"
        )
    from mocap.rerun.record import write_recording

    stages, n_frames = Stages(tell=progress), len(recording.t_s)
    every, sums, found_out = max(1, -(-n_frames // OVERVIEW)), None, []
    thin: list[tuple[Result, Recording]] = []
    detail: tuple[int, Result] | None = None
    seen: list[int] = []
    scores: Mapping[str, Score] = {}
    models: Counter[str] = Counter()
    with one_blas_thread(), BlockWriter(folder, fps=1 / recording.dt_s) as writer:
        excerpts, why = learned is None and model not in NAMED, "as asked"
        if learned is not None:
            why = f"learned from {', '.join(trial.name for trial in learned.trials[:6])}"
        elif excerpts:
            learned, why = learn_excerpts(recording, model=model, seed=seed, stages=stages)
        name = model if model in NAMED else "constant_velocity"
        wanted = name if learned is None else "learned"
        for core in blocks_of(n_frames, size):
            with stages.stage("track in blocks") as share:
                share(core.start / n_frames)
                run, cleaned, own, tried = track_block(
                    recording,
                    core,
                    model=name,
                    learned=learned,
                    excerpts=excerpts,
                    validated=validate and wanted not in scores,
                    seed=seed,
                )
                models[run.model] += len(core)
                scores = tried if wanted in tried or not scores else scores
            with stages.stage("kinematics and tables"):
                found = kinematics(run.motion, run.skeleton, recording=run.name)
                rows = _begun(cycles(found, run.motion, run.skeleton), run, own)
                part, count = run.at(own), counts(cleaned, run, own)
                writer.add(core, part, found, own, rows)
            found_out.append(own_findings(cleaned))
            sums = count if sums is None else together(sums, count)
            shown = np.flatnonzero(np.isfinite(cleaned.xyz_m[own][..., 0]).any(axis=1)) + core.start
            if len(shown):
                seen += [int(shown[0]), int(shown[-1]) + 1]
                some = slice(own.start + (-core.start) % every, own.stop, every)
                thin.append((_shown(run.at(some)), _shown(cleaned.at(some))))
                detail = _better(detail, part)
            del run, cleaned, part, found, rows  # only one block at a time is in memory
        if detail is None or sums is None:
            raise FormatError(f"{recording.where}: no marker is ever seen: there is nothing to track")
        with stages.stage("overview, potentials, figures"):
            tracked, cleaned = _joined([run for run, _ in thin]), _joined([one for _, one in thin])
            told, runs = tuple(over_blocks(found_out)), {"swaps": (), "bad_cameras": (), "jumps": (), "stale": None}
            found_of_all = decided(recording), replace(found_by_cleaning(cleaned), audited=(), told=told, **runs)
            cleaned = cleaned.with_part(*found_of_all)
            data = tracked.data.assign_attrs(model=models.most_common(1)[0][0])
            tracked = replace(tracked, data=data).with_part(*found_of_all).with_motion(still(tracked.tracks))
            sums = {**sums, "blocks": {"frames": size, "every": every, "shown": len(tracked.t_s)}}
            sums["tracked"] = {"first": seen[0] + 1, "last": seen[-1]}
            tracked = reported(tracked, cleaned, why=why, scores=scores, stages=stages, whole=sums)
            tracked = Tracked.of(tracked).with_report(footer)
            write_arrays(tracked, folder)
            write_report(tracked, folder)
            write_recording(tracked, folder / "recording.rrd", every=every)
            one = Tracked.of(detail[1].with_part(tracked[Report]))
            write_page(one, one.kinematics, cycles(one.kinematics, one.motion, one.skeleton), one.footfalls, folder)
    return tracked


def _begun(rows: list[Cycle], run: Result, own: slice) -> list[Cycle]:
    """Cycles that begin in the block's own frames."""
    t_s = run.t_s
    end = t_s[own.stop] if own.stop < len(t_s) else np.inf
    return [row for row in rows if t_s[own.start] <= row.start_s < end]


def _shown(run: R) -> R:
    """What an overview shows, without velocities; copied, as a view would keep the whole block."""
    data = run.data.drop_dims([dim for dim in _OWN if dim in run.data.dims]).copy(deep=True)
    return replace(run, data=data)


def _joined(parts: Sequence[R]) -> R:
    """Parts of a recording, one after the other."""
    data = [part.data for part in parts]
    joined = xr.concat(data, dim="time", data_vars="minimal", coords="minimal", compat="override", join="override")
    return replace(parts[0], data=joined)


def _better(best: tuple[int, Result] | None, run: Result) -> tuple[int, Result]:
    """The stretch of which most was measured: the middle of a block, if it has more than the one before."""
    n = len(run.t_s)
    start = max(0, (n - DETAIL) // 2)
    frames = slice(start, min(n, start + DETAIL))
    count = int((run.tracks.status[frames] == Status.MEASURED).sum())
    if best is not None and count <= best[0]:
        return best
    part = run.at(frames)
    return count, replace(part, data=part.data.copy(deep=True))
