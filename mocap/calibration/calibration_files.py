"""A calibration as files: calibration.toml, DLT coefficients, camera profile, report."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mocap.cameras.camera import Camera
from mocap.errors import FormatError
from mocap.io.anipose import write_calibration
from mocap.io.dltdv import write_coefficients
from mocap.io.profile import write_profile
from mocap.text import plain


@dataclass(frozen=True, eq=False, kw_only=True)
class CalibrationReport:
    """What was found, for machines and for people.

    Attributes:
        numbers: As ``report.json`` holds it.
        lines: Sentences and tables in markdown.
    """

    numbers: Mapping[str, object]
    lines: Sequence[str]


def write_calibration_folder(
    folder: Path,
    cameras: Sequence[Camera],
    report: CalibrationReport,
    *,
    upright: Sequence[Camera] | None = None,
    lenses: bool = True,
) -> CalibrationReport:
    """Write a calibration into a folder; files that cannot hold it are left out, and the report says why.

    Args:
        folder: Where to, as ``mocap.io.output.result_folder`` gives it.
        cameras: In the pixel convention of the input, for ``dltCoefs.csv``.
        report: What was found.
        upright: The same cameras for pixel rows from the upper left, for ``calibration.toml``; None: ``cameras``.
        lenses: Whether the cameras' lenses are whole (else ``dltCoefs.csv`` alone is written).

    Returns:
        The report as written.
    """
    written, held_back = [], []
    todo = [("dltCoefs.csv", write_coefficients, cameras)]
    if lenses:
        todo += [
            ("calibration.toml", write_calibration, cameras if upright is None else upright),
            ("camera_profile.txt", write_profile, cameras),
        ]
    for name, write, what in todo:
        try:
            write(folder / name, what)
            written.append(name)
        except (FormatError, ValueError) as error:
            (folder / name).unlink(missing_ok=True)
            held_back.append(f"{name} was not written: {error}")
    return write_report(folder, report, written, held_back)


def write_report(
    folder: Path, report: CalibrationReport, written: Sequence[str], held_back: Sequence[str] = ()
) -> CalibrationReport:
    """Write ``report.json`` and ``report.md`` beside the files that were written; the report as written."""
    lines = [*report.lines, "", *(f"- {line}" for line in held_back)] if held_back else [*report.lines]
    lines += ["", "Written: " + ", ".join([*written, "report.json", "report.md"]) + "."]
    full = CalibrationReport(numbers={**report.numbers, "written": written, "not_written": held_back}, lines=lines)
    text = json.dumps(full.numbers, indent=1, allow_nan=False, default=_plain)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    (folder / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return full


def number(x: float) -> float | None:
    """A finite number, else None: JSON has no NaN."""
    return float(x) if np.isfinite(x) else None


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """A table in markdown."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return [*lines, *("| " + " | ".join(plain(str(cell)) for cell in row) + " |" for row in rows), ""]


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is no JSON")


def of_pictures(image_px: Mapping[str, Mapping[str, float]]) -> list[str]:
    """A paragraph for each camera: the root mean square error of each of its images."""
    return [
        line
        for name, own in image_px.items()
        for line in (f"Images of {plain(name)}, px: " + ", ".join(f"{plain(s)} {v:.2f}" for s, v in own.items()), "")
    ]
