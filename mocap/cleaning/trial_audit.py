"""What is found in the files of a trial before it is tracked: the one list that every command tells in its order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from mocap.audit.samples import pixel_findings
from mocap.cameras.arrangement import ArrangementError
from mocap.cleaning.cleaning import clean
from mocap.errors import MocapError, NoRateError
from mocap.findings import Finding, Kind, alarm, worst_first
from mocap.io.contents import FileContents
from mocap.io.format import Hints
from mocap.io.registry import read as read_file
from mocap.reading.ideal_pixels import of_one_camera
from mocap.reading.reading import read
from mocap.recording import BLOCK, LONG, Recording


@dataclass(frozen=True, eq=False, kw_only=True)
class Looked:
    """What came of a look at a trial.

    Attributes:
        recording: As it was read; None: it cannot be.
        findings: What ``mocap.track`` finds before it tracks, in the same order; of a trial that it refuses also why.
        refused: Why it cannot be tracked; None: it can, as far as its files tell.
    """

    recording: Recording | None
    findings: tuple[Finding, ...]
    refused: MocapError | None = None


def looked_at(reads: Callable[[], Recording], *, modelled: bool = False) -> Looked:
    """Read a trial and clean it, whatever comes.

    Of a long recording the first block is looked at.

    Args:
        reads: Reads it, as ``mocap.read`` does.
        modelled: Whether it will be tracked with a learned model, as one camera needs it.
    """
    recording: Recording | None = None
    found: list[Finding] = []
    try:
        recording = reads()
        found += recording.findings
        if of_one_camera(recording) and modelled:
            return Looked(recording=recording, findings=tuple(worst_first(found)))
        part = recording if len(recording.t_s) <= LONG else recording.at(slice(BLOCK))
        return Looked(recording=recording, findings=clean(part).findings)
    except MocapError as error:
        if recording is not None and recording.pixels is not None:
            found += [one for one in pixel_findings(recording.pixels) if one.asks]
        return Looked(recording=recording, findings=tuple(worst_first([*found, why_not(error)])), refused=error)


def why_not(error: MocapError) -> Finding:
    """What makes it impossible to track, as a finding."""
    if isinstance(error, ArrangementError):
        one = error.arrangement
        numbers = {"residual_px": one.residual_px, "undone_px": one.undone_px}
        return alarm(kind=one.kind, text=str(error), numbers=numbers, cameras=one.cameras)
    kind = Kind.FRAME_RATE if isinstance(error, NoRateError) else Kind.REFUSED
    return alarm(kind=kind, text=" ".join(str(error).split()), mends=tuple(error.mends))


def of_files(files: Sequence[Path], *, hints: Hints, **stated: Any) -> Looked | None:
    """A look at the trial that some files are together: tracks, and whatever belongs to them.

    Args:
        files: Pixels or positions, a calibration, a camera profile, stored points, in any order.
        hints: How they are read.
        **stated: Further arguments of ``mocap.read``.

    Returns:
        What came of it; None: they are no one trial, or it cannot be told how they belong together.
    """
    try:
        found = [read_file(path, hints) for path in files]
    except MocapError:
        return None
    parts = _parts(found)
    if parts is None:
        return None
    tracks = parts.pop("tracks")
    return looked_at(partial(read, tracks, hints=hints, **{**parts, **stated}))


def _parts(found: Sequence[FileContents]) -> dict[str, Any] | None:
    """Which argument of ``mocap.read`` each file is; None: that is not told by what they hold."""
    filmed = [one for one in found if one.pixels is not None]
    placed = [one for one in found if one.points is not None and one.pixels is None]
    rigs = [one for one in found if one.cameras and one.pixels is None and one not in placed]
    lenses = [one for one in found if one.lenses and not one.cameras and one.pixels is None]
    tracks = filmed or placed
    one_trial = len(tracks) == 1 or all(len(one.camera_names) == 1 for one in filmed)
    others = {"calibration": rigs, "profile": lenses, "stored_points": placed if filmed else []}
    told = len(tracks) + sum(map(len, others.values())) == len(found) and all(len(one) <= 1 for one in others.values())
    if not (tracks and one_trial and told) or (rigs and any(one.cameras for one in tracks)):
        return None
    return {"tracks": [one.paths[0] for one in tracks]} | {k: one[0].paths[0] for k, one in others.items() if one}
