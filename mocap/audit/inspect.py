"""What files contain, one by one, and whether they agree with each other."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mocap.audit.file_audit import audit_recording
from mocap.cameras.camera import check_cameras, stacked, undistorted
from mocap.cameras.origin import PixelOptions, decide_origin
from mocap.errors import CalibrationError, FormatError, MocapError
from mocap.io.contents import FileContents, summary
from mocap.io.format import Hints
from mocap.io.registry import identify, read_as
from mocap.io.together import joined
from mocap.io.unstated_unit import in_metres, of_cameras
from mocap.text import number_of

_NOTHING = {"points": 0, "cameras": 0, "frames": 0, "fps": None, "units": None, "missing": None}


def inspect(
    files: Sequence[Path],
    hints: Hints,
    *,
    fps: float | None = None,
    unit: str | None = None,
    origin: PixelOptions | None = None,
) -> list[dict[str, Any]]:
    """A summary of each file, with the findings of its reader and of the audit.

    A file that cannot be read has ``error`` and that as its finding, and the ``format`` that it begins as, if any.
    Several files that belong together are compared; what that finds stands with the first of them. A frame rate and a
    unit that the user states are those of files that do not hold them, as in ``mocap track``, and so are corners of
    pixels and coefficients.
    """
    found, recordings = [], []
    corners = origin or PixelOptions()
    hints = replace(hints, fps=fps)
    for path in files:
        name = None
        try:
            format = identify(path, hints)
            name = format.name
            recording = read_as(format, path, hints)
            recording = recording if fps is None else recording.with_rate(fps)
            unit_findings = _unit_findings(recording, unit)
            recording = recording if unit is None else recording.with_unit(unit)
            recording = replace(recording, findings=(*unit_findings, *recording.findings))
        except Exception as error:  # whatever it is, the other files are looked at too
            expected = isinstance(error, MocapError)
            text = (
                str(error)
                if expected
                else f"{path.name}: cannot be read ({type(error).__name__}: {error}): report this"
            )
            found.append({"format": name, **_NOTHING, "findings": [text], "file": str(path), "error": text})
        else:
            recordings.append((recording, len(found)))
            found.append(_audited({**summary(recording), "file": str(path), "title": format.title}, recording, corners))
    if len(recordings) == len(found) > 1:
        _together(found[0], [recording for recording, _ in recordings], corners)
    return found


def _audited(found: dict[str, Any], recording: FileContents, corners: PixelOptions) -> dict[str, Any]:
    """With what the audit says: sentences among ``findings``, everything under ``audit``."""
    refused = False
    try:
        check_cameras(recording.cameras, recording.paths[0].name)
    except CalibrationError as error:
        found["findings"].append(str(error))
        refused = True
    try:
        with np.errstate(all="ignore"):  # of cameras that are none
            audited = audit_recording(recording, corners)
    except (ValueError, ArithmeticError) as error:  # NumPy's LinAlgError is one: numbers that no rig has
        if not refused:
            found["findings"].append(f"the audit could not be completed: {error}")
        audited = audit_recording(replace(recording, cameras=()), corners)
    audited = [f for f in audited if f.as_json() not in found.get("audit", [])]
    found["audit"] = [*found.get("audit", []), *(f.as_json() for f in audited)]
    found["findings"] += [f.text for f in audited]
    return found


def _together(found: dict[str, Any], recordings: Sequence[FileContents], corners: PixelOptions) -> None:
    if (compared := _two_calibrations(recordings)) is not None:
        found["findings"].append(compared)
        return
    try:
        whole = joined(recordings)
    except FormatError as error:
        found["findings"].append(str(error))
        return
    found["findings"].append(
        f"together {', '.join(path.name for path in whole.paths)}: {len(whole.names)} points, "
        f"{len(whole.camera_names)} cameras{', calibrated' if whole.cameras else ''}, {len(whole.frames)} frames"
    )
    found["findings"] += _unit_findings(whole, None)
    _audited(found, whole, corners)


def _unit_findings(recording: FileContents, unit: str | None) -> tuple[str, ...]:
    """What is assumed of the unit of positions, or of pixels with their calibration; also that no unit would do."""
    try:
        if recording.pixels is None or not recording.cameras or recording.unit is not None or unit is not None:
            return tuple(map(str, in_metres(recording, unit)[1]))
        if not len(recording.pixels.cameras) == len(recording.cameras) > 1:
            return ()
        check_cameras(recording.cameras, recording.paths[0].name)
        ideal = undistorted(recording.cameras, recording.pixels.uv_px)
        return tuple(map(str, of_cameras(stacked(recording.cameras), ideal, where=recording.paths[0].name)[1]))
    except CalibrationError:
        return ()  # told by the audit
    except FormatError as error:
        if unit is not None:
            raise
        return (str(error),)


def _two_calibrations(recordings: Sequence[FileContents]) -> str | None:
    """A recording with its own calibration beside another one: which of them fits its pixels, and whether they differ.

    None where that is not what the files are.
    """
    own = [r for r in recordings if r.pixels is not None and r.cameras and r.format != "easywand"]
    other = [r for r in recordings if r.cameras and r not in own]
    if len(own) != 1 or len(other) != 1 or len(recordings) != 2:
        return None
    filmed, rig = own[0], other[0]
    a, b = filmed.paths[0].name, rig.paths[0].name
    if filmed.pixels is None or len(filmed.cameras) != len(rig.cameras):
        return f"{a} has {len(filmed.cameras)} cameras, {b} {len(rig.cameras)}: they are not of one session"
    fits = []
    for cameras in (filmed.cameras, rig.cameras):
        try:
            decision = decide_origin(cameras, filmed.pixels.uv_px, PixelOptions(usual=filmed.pixel_origin))
            fits.append(f"{decision.residual_px:.2f} px")
        except CalibrationError as error:
            fits.append(f"none ({error})")
    first, second = (stacked(cameras) for cameras in (filmed.cameras, rig.cameras))
    first, second = first / first[:, 2:, 3:], second / second[:, 2:, 3:]
    same = np.allclose(first, second, rtol=1e-6, atol=1e-12)
    return (
        f"{a} has its own calibration, {b} another, with {'the same' if same else 'other'} coefficients: the median "
        f"triangulation residual of the pixels is {fits[0]} with its own, {fits[1]} with that of {b}"
    )


_CONTAINED = {
    "points": "3D points",
    "plane": "positions in a plane",
    "cameras": "calibrated cameras",
    "score": "scores of samples",
    "residual_px": "triangulation residuals in px",
    "residual_m": "residuals of points",
    "interval": "95 % intervals",
    "edited": "samples that a person corrected",
    "offset_frames": "offsets of cameras in frames",
    "transforms": "rigid-body transforms",
}
"""Parts of a file in words."""


def readable(found: dict[str, Any]) -> str:
    """One summary as text for people."""
    lines = [str(found["file"])]
    if "error" in found:
        return "\n".join([*lines, f"  error: {found['error']}", ""])
    lines.append(f"  {found['title']} ({found['format']})")
    counts = [number_of(found[f"{what}s"], what) for what in ("point", "camera", "frame") if found[f"{what}s"]]
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
        without = [number_of(blank["frames"], "frame")] if blank["frames"] else []
        without += [number_of(len(blank["markers"]), "marker")] if blank["markers"] else []
        text = f"  {100 * found['missing']:.1f} % missing"
        text += f" where anything was digitised; {' and '.join(without)} without a sample" if without else ""
        text += f"; {number_of(gaps['count'], 'gap')} inside the tracks"
        if gaps["count"]:
            longest = number_of(gaps["longest_frames"], "frame")
            text += f", median length {gaps['median_frames']:g}, longest {longest}"
        lines.append(text)
    if found["names"]:
        lines.append("  names: " + ", ".join(found["names"][:12]) + (", ..." if len(found["names"]) > 12 else ""))
    return "\n".join([*lines, *(f"  - {finding}" for finding in found["findings"]), ""])
