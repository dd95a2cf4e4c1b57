"""C3D files, through ezc3d."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from mocap.arrays import Array
from mocap.errors import FormatError
from mocap.formats.apart import read_apart
from mocap.formats.optical import UNIT_M, metres, told_apart
from mocap.formats.recording import Recording, point_recording
from mocap.records import Origin

SECONDS = 20.0
"""After so long (and a second for each megabyte) a file is given up."""
_NOT_POSITIONS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Groups of points (parameter POINT) that are modelled quantities, not places."""


def read_c3d(path: Path) -> Recording:
    """Read the points of a C3D file that are positions.

    A residual of -1 is a sample that was not seen, 0 an interpolated or filtered one, above 0 a measured one. A file
    without any residual above 0 does not record them: what it holds is called measured. ezc3d takes a point at exactly
    (0, 0, 0) as not seen. The table ``residual_m`` (T, M) holds the residuals above 0, in the unit of the points.

    Raises:
        FormatError: ezc3d cannot read the file, it is cut, or names are missing.
    """
    if not path.is_file():
        raise FormatError(f"{path}: cannot be read: no such file")
    table = _read(path)
    data, residual, parameters = table["points"], table["residuals"], json.loads(str(table["parameters"]))
    if not data.size:
        raise FormatError(f"{path.name}: holds no points: export the trajectories, not only analog channels")
    _check_whole(path, data.shape[2])
    names = _labels(path, parameters, data.shape[1])
    told = _last_frame(table["last_field"])
    model = {label.strip() for group in _NOT_POSITIONS for label in _values(parameters, group)}
    keep = np.array([name not in model for name in names])
    findings = [f"{(~keep).sum()} modelled quantities (angles, forces, ...) are left out"] if not keep.all() else []
    names, renamed = told_apart([name for name, kept in zip(names, keep, strict=True) if kept])
    findings += renamed
    said = (_values(parameters, "UNITS") or [""])[0].strip().lower()
    unit = said if said in UNIT_M else None
    if unit is None:
        findings.append(f"the unit of lengths is {said!r}" if said else "the unit of lengths is not in the file")
    if told > int(table["first_frame"]) + data.shape[2]:
        findings.append(f"TRIAL:ACTUAL_END_FIELD announces frames up to {told}, which were not read: the file is cut")
    hertz = float(table["rate_hz"])
    fps = hertz if np.isfinite(hertz) and hertz > 0 else None
    if fps is None:
        findings.append(f"the frame rate in the file is {hertz:g}")
    xyz = np.moveaxis(data[:3, keep], 0, -1).swapaxes(0, 1).copy()
    residual = residual[keep].T
    there = np.isfinite(xyz).all(axis=-1)
    seen = there & (residual >= 0)
    if not seen.any() and (there & (xyz != 0).any(axis=-1)).any():
        findings.append("every sample is marked as not seen (residual -1), although there are coordinates")
    xyz[~seen] = np.nan
    filled = Origin.INTERPOLATED if (residual > 0).any() else Origin.MEASURED
    if filled == Origin.MEASURED and seen.any():
        findings.append("the file records no residuals: all that has a position is called measured")
    scale = 1.0 if unit is None else metres(path, unit)
    return point_recording(
        path,
        "c3d",
        names=names,
        xyz=xyz,
        unit=unit,
        frames=1 + int(table["first_frame"]) + np.arange(len(xyz)),
        fps=fps,
        origin=np.where(seen, np.where(residual > 0, Origin.MEASURED, filled), Origin.MISSING),
        tables={"residual_m": np.where(seen & (residual > 0), residual * scale, np.nan)},
        findings=tuple(findings),
    )


def _read(path: Path) -> dict[str, Any]:
    """What ``c3d_process`` finds.

    Raises:
        FormatError: ezc3d refuses the file, crashes on it, or does not come to an end.
    """
    with np.load(io.BytesIO(read_apart(path, "c3d_process.py", kind="C3D", seconds=SECONDS))) as table:
        return dict(table)


def _check_whole(path: Path, frames: int) -> None:
    """As many frames came as the file's head announces; of a cut file ezc3d silently gives what is left.

    Raises:
        FormatError: there are fewer.
    """
    with path.open("rb") as stream:
        head = stream.read(10)
    first, last = (int.from_bytes(head[i : i + 2], "little") for i in (6, 8))
    announced = last - first + 1
    if last < 0xFFFF and frames < announced:  # 16 bits: longer recordings announce too few, or the largest number
        raise FormatError(
            f"{path.name}: {announced} frames are announced, {frames} are there: the file is cut; export it again"
        )


def _last_frame(field: Array) -> int:
    """Number of the last frame of a recording that is too long for 16 bits: two words, the lower first; 0 without."""
    words = [int(word) & 0xFFFF for word in field[:2] if np.isfinite(word)]
    return words[0] + (words[1] << 16) if len(words) == 2 else 0


def _values(parameters: dict[str, Any], key: str) -> list[str]:
    return [str(value) for value in parameters.get(key, [])]


def _labels(path: Path, parameters: dict[str, Any], count: int) -> list[str]:
    """LABELS, continued in LABELS2, LABELS3, ..."""
    labels = _values(parameters, "LABELS")
    following = 2
    while len(labels) < count and f"LABELS{following}" in parameters:
        labels += _values(parameters, f"LABELS{following}")
        following += 1
    if len(labels) < count:
        raise FormatError(f"{path.name}: {count} points, but {len(labels)} labels: name the others and export again")
    return [label.strip() for label in labels[:count]]
