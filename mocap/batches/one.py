"""One trial of a batch: tracked as ``mocap track`` does, its result and how it went written into its folder."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mocap.batches.beside import kinds_of
from mocap.batches.trial import Options, Record, Trial, earlier_record, keep, key_of, write_record
from mocap.errors import MocapError, OutputError
from mocap.findings import Finding
from mocap.io.contents import gaps
from mocap.io.output import result_folder
from mocap.progress import Tell, silent
from mocap.reading.session import Siblings, facts_of, own_findings
from mocap.recording import LONG, Recording
from mocap.records import Status
from mocap.report.report import readable
from mocap.results.long_result import write_in_blocks
from mocap.results.tables import write_report
from mocap.results.tracked import Tracked, track
from mocap.tracking.learning import Model, load_model
from mocap.tracking.report_part import Report


def track_trial(
    trial: Trial,
    options: Options,
    out: Path,
    *,
    again: bool = False,
    siblings: Sequence[Finding] = (),
    progress: Tell = silent,
) -> Record:
    """Track a trial, unless that has been done, and write its folder.

    Args:
        trial: It.
        options: How.
        out: Folder of results.
        again: Whether it is tracked, too, if that has been done.
        siblings: What the other trials tell of it, which its report tells.
        progress: Told each stage.

    Returns:
        How it went; what is wrong with its data is its ``error``, and no exception.

    Raises:
        OutputError: its folder cannot be written, or is in use.
        OSError: a file cannot be read.
    """
    done = None if again else earlier_record(trial, options, out)
    if done is not None and done.beside == kinds_of(siblings):
        return done
    try:
        key = key_of(trial, options)
    except FileNotFoundError as error:
        return _failed(trial, f"{error.filename}: there is no such file", "", out)
    try:
        recording = trial.recording()
        facts = facts_of(recording, name=trial.name)
        recording = recording.with_part(Siblings(told=tuple(siblings))) if siblings else recording
        model = options.model if isinstance(options.model, str) else _model(options.model)
        if len(recording.t_s) > LONG:
            record = Record(trial=trial.name, status="done", key=key, facts=facts, beside=kinds_of(siblings))
            return _in_blocks(trial, recording, model, options, record, out, progress)
        tracked = track(recording, model=model, validate=options.validate, seed=options.seed, progress=progress)
    except OutputError:
        raise
    except MocapError as error:
        return _failed(trial, " ".join(str(error).split()), key, out)
    tracked = _timeless(tracked)
    row, beside, own = figures(tracked, trial), kinds_of(siblings), asking(tracked)
    record = Record(trial=trial.name, status="done", row=row, key=key, facts=facts, beside=beside, found=own)
    with result_folder(out / trial.name, "track", replace=True, inputs=recording.inputs) as stage:
        tracked.write(stage, progress=progress, pictures=options.pictures)
        write_record(record, stage)
    return record


def _in_blocks(
    trial: Trial, recording: Recording, model: str | Model, options: Options, record: Record, out: Path, progress: Tell
) -> Record:
    """A long recording, block by block as ``mocap track`` does."""
    name, learned = (model, None) if isinstance(model, str) else ("auto", model.learned)
    with result_folder(out / trial.name, "track", replace=True, inputs=recording.inputs) as stage:
        found = write_in_blocks(
            recording,
            stage,
            model=name,
            learned=learned,
            validate=options.validate,
            seed=options.seed,
            progress=progress,
        )
        found = _timeless(found)
        write_report(found, stage)
        record = replace(record, row=figures(found, trial), found=asking(found))
        write_record(record, stage)
    return record


def asking(tracked: Tracked) -> tuple[Finding, ...]:
    """What its own files ask to be mended; the others tell of it what they are now, when the batch is summed up."""
    return tuple(one for one in own_findings(tracked) if one.asks)


def _failed(trial: Trial, error: str, key: str, out: Path) -> Record:
    record = Record(trial=trial.name, status="failed", error=error, row=basic_columns(trial), key=key)
    keep(record, out / trial.name)
    return record


@lru_cache(maxsize=1)
def _model(path: Path) -> Model:
    return load_model(path)


def _timeless(tracked: Tracked) -> Tracked:
    """The same, without the times that its stages took: a result depends on the trial alone."""
    report = {name: value for name, value in tracked.report.items() if name != "seconds"}
    text = readable(report, title=tracked.name)
    return tracked.with_part(Report(numbers=report, text=text))


def basic_columns(trial: Trial) -> dict[str, object]:
    """What the row of a trial holds in any case."""
    return {"animal": trial.animal, "version": version("eal-mocap")}


def figures(tracked: Tracked, trial: Trial) -> dict[str, object]:
    """The row of a trial in ``summary.csv``.

    Samples are those of a marker in a frame. ``gaps`` are runs of frames without a measured position between two with
    one; ``residual_px`` is the median triangulation residual; ``rmse_mm`` and ``coverage95`` are of samples hidden
    from the recording and filled again: root mean square error, and the percentage inside 95 % intervals.
    """
    report: Any = tracked.report
    samples, validation = report["samples"], report["validation"]
    score = validation["methods"].get(report["model"]["name"]) or validation["methods"].get("mixture") or {}
    first, last = report["tracked_frames"]
    inside = (last - first + 1) / report["frames"]
    missing = {} if "blocks" in report else gaps((tracked.tracks.status == Status.MEASURED)[None])
    return basic_columns(trial) | {
        "frames": int(report["frames"]),
        "fps": _rounded(report["fps"]),
        "cameras": len(report["cameras"]),
        "measured_percent": _rounded(100 * samples["measured"] / inside),  # of the tracked frames, as in the report
        "model": str(report["model"]["name"]),
        "markers": len(report["markers"]),
        "gaps": missing.get("count"),
        "longest_gap_frames": missing.get("longest_frames"),
        "filled": int(report["filled"]),
        "extrapolated": int(report["extrapolated"]),
        "rejected": round(samples["rejected"] * samples["total"]),
        "residual_px": _rounded(report["residual_px"]["50%"]),
        "hidden_samples": int(validation["hidden_samples"]),
        "rmse_mm": _rounded(score.get("rmse_mm")),
        "coverage95": _rounded(score.get("coverage95")),
    }


def _rounded(value: object) -> float | None:
    """Six digits: what a table is read for."""
    return None if value is None else float(f"{value:.6g}")
