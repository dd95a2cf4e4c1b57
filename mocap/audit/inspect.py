"""What files contain, one by one, and whether they agree with each other."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mocap.audit import audit_recording
from mocap.cameras.camera import check_cameras
from mocap.cameras.origin import StatedOrigin
from mocap.errors import CalibrationError, FormatError
from mocap.io.contents import FileContents
from mocap.io.describe import summary
from mocap.io.format import Hints
from mocap.io.registry import identify, read_as
from mocap.io.together import joined
from mocap.io.unstated_unit import in_metres

_NOTHING = {"points": 0, "cameras": 0, "frames": 0, "fps": None, "units": None, "missing": None}


def inspect(
    files: Sequence[Path],
    hints: Hints,
    *,
    fps: float | None = None,
    unit: str | None = None,
    stated: StatedOrigin | None = None,
) -> list[dict[str, Any]]:
    """A summary of each file, with the findings of its reader and of the audit.

    A file that cannot be read has ``error`` and that as its finding, and the ``format`` that it begins as, if any.
    Several files that belong together are compared; what that finds stands with the first of them. A frame rate and a
    unit that the user states are those of files that do not hold them, as in ``mocap track``, and so are corners of
    pixels and coefficients.
    """
    found, recordings = [], []
    corners = stated or StatedOrigin()
    for path in files:
        name = None
        try:
            format = identify(path, hints)
            name = format.name
            recording = read_as(format, path, hints)
            recording = recording if fps is None else recording.with_rate(fps)
            told = in_metres(recording, unit)[1]
            recording = recording if unit is None else recording.with_unit(unit)
            recording = replace(recording, findings=(*told, *recording.findings))
        except Exception as error:  # whatever it is, the other files are looked at too
            known = isinstance(error, FormatError)
            text = (
                str(error) if known else f"{path.name}: cannot be read ({type(error).__name__}: {error}): report this"
            )
            found.append({"format": name, **_NOTHING, "findings": [text], "file": str(path), "error": text})
        else:
            recordings.append((recording, len(found)))
            found.append(_audited({**summary(recording), "file": str(path), "title": format.title}, recording, corners))
    if len(recordings) == len(found) > 1:
        _together(found[0], [recording for recording, _ in recordings], corners)
    return found


def _audited(found: dict[str, Any], recording: FileContents, corners: StatedOrigin) -> dict[str, Any]:
    """With what the audit says: sentences among ``findings``, everything under ``audit``."""
    try:
        check_cameras(recording.cameras, recording.paths[0].name)
    except CalibrationError as error:
        found["findings"].append(str(error))
    try:
        with np.errstate(all="ignore"):  # of cameras that are none
            audited = [f for f in audit_recording(recording, corners) if f.as_json() not in found.get("audit", [])]
    except (ValueError, ArithmeticError) as error:  # NumPy's LinAlgError is one: numbers that no rig has
        found["findings"].append(f"the audit could not be completed: {error}")
        audited = []
    found["audit"] = [*found.get("audit", []), *(f.as_json() for f in audited)]
    found["findings"] += [f.text for f in audited]
    return found


def _together(found: dict[str, Any], recordings: Sequence[FileContents], corners: StatedOrigin) -> None:
    try:
        whole = joined(recordings)
    except FormatError as error:
        found["findings"].append(str(error))
        return
    found["findings"].append(
        f"together with {', '.join(path.name for path in whole.paths[1:])}: {len(whole.names)} points, "
        f"{len(whole.camera_names)} cameras{', calibrated' if whole.cameras else ''}, {len(whole.frames)} frames"
    )
    _audited(found, whole, corners)


_CONTAINED = {
    "points": "3D points",
    "cameras": "calibrated cameras",
    "score": "scores of samples",
    "residual_px": "triangulation residuals in px",
    "residual_m": "residuals of points",
    "interval": "95 % intervals",
    "offset_frames": "offsets of cameras in frames",
    "transforms": "rigid-body transforms",
}
"""Parts of a file in words."""


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def readable(found: dict[str, Any]) -> str:
    """One summary as text for people."""
    lines = [str(found["file"])]
    if "error" in found:
        return "\n".join([*lines, f"  error: {found['error']}", ""])
    lines.append(f"  {found['title']} ({found['format']})")
    counts = [_count(found[f"{what}s"], what) for what in ("point", "camera", "frame") if found[f"{what}s"]]
    if found["first_frame"] not in (None, 1):
        counts[-1] += f" (the first is number {found['first_frame']})"
    if found["frames"]:
        counts.append("frame rate not stated" if found["fps"] is None else f"{found['fps']:g} frames per second")
    lines.append("  " + (", ".join(counts) or "no tracks and no cameras"))
    contained = ", ".join(str(_CONTAINED.get(part, part)) for part in found["holds"]) or "nothing"
    lines.append(f"  contains {contained}; unit {found['units'] or 'not stated'}")
    if found["missing"] is not None:
        gaps = found["gaps"]
        blank = found["undigitised"]
        without = [_count(blank["frames"], "frame")] if blank["frames"] else []
        without += [_count(len(blank["markers"]), "marker")] if blank["markers"] else []
        text = f"  {100 * found['missing']:.1f} % missing"
        text += f" where anything was digitised; {' and '.join(without)} without a sample" if without else ""
        text += f"; {_count(gaps['count'], 'gap')} inside the tracks"
        if gaps["count"]:
            longest = _count(gaps["longest_frames"], "frame")
            text += f", median length {gaps['median_frames']:g}, longest {longest}"
        lines.append(text)
    if found["names"]:
        lines.append("  names: " + ", ".join(found["names"][:12]) + (", ..." if len(found["names"]) > 12 else ""))
    return "\n".join([*lines, *(f"  - {finding}" for finding in found["findings"]), ""])
