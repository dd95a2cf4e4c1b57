"""The manifest of a batch before it runs: what was found, to be corrected."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mocap.batches.find import find_trials
from mocap.batches.manifest import write_manifest
from mocap.batches.trial import Trial
from mocap.errors import MocapError
from mocap.io.output import result_file

PLAN = "manifest.csv"


def write_plan(sources: Sequence[str | Path], out: Path, **stated: Any) -> tuple[Path, list[Trial], dict[str, str]]:
    """Find trials as ``mocap.batch`` does, read each, and write the manifest of them; nothing is tracked.

    Args:
        sources: As ``mocap.batch`` takes them.
        out: The file (``.csv``), or a folder, in which it is called ``manifest.csv``.
        **stated: Arguments of ``mocap.read`` for all trials.

    Returns:
        The file, the trials, and why some of them cannot be tracked, by their names.

    Raises:
        MocapError: no trial was found, or the file cannot be written.
    """
    trials = find_trials(sources, stated=stated, out=out)
    path = out if out.suffix.lower() == ".csv" else out / PLAN
    errors: dict[str, str] = {}
    told = [_told(trial, errors) for trial in trials]
    with result_file(path, replace=True, inputs=[file for trial in trials for file in trial.paths]) as file:
        write_manifest(file, trials, folder=path.parent, told=told)
    return path, trials, errors


def _told(trial: Trial, errors: dict[str, str]) -> dict[str, object]:
    """What its files hold; if they cannot be read, or it is skipped, ``errors`` gets why."""
    if trial.skip:
        errors[trial.name] = trial.skip
        return {"note": "not tracked"}
    try:
        found = trial.recording()
    except MocapError as error:
        errors[trial.name] = " ".join(str(error).split())
        return {"note": errors[trial.name]}
    if not found.seen.any():
        errors[trial.name] = "no marker is ever seen"
        return {"note": errors[trial.name]}
    unit = found.data.attrs.get("space_unit")
    return {
        "frames": len(found.t_s),
        "markers": len(found.names),
        "cameras": len(found.camera_names),
        "note": f"{found.format}, {found.fps:g} frames a second" + (f", {unit}" if unit else ""),
    }
