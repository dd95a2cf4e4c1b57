"""Pages of the manual: where they lie, and what of them tells what to do about a finding."""

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from mocap.findings import Kind

ROOMS = ("tutorials", "howto", "howto/programs", "explanation", "reference")
"""Folders of pages."""

UNITS, RESIDUALS, MIRRORED = '"No frame rate" or "no unit".', "All errors are large", "Left and right are exchanged"
SWAPPED, NARROW, UNSEEN = "A gap is filled with nonsense.", "My intervals are too narrow.", "A marker is never seen."
STORED, OTHERS, EDITS = "Stored points differ", "A trial differs from the others.", "Corrections do not fit."
SYMPTOMS: Mapping[str, tuple[Kind, ...]] = {
    UNITS: (Kind.ASSUMED_UNIT, Kind.UNITS, Kind.FRAME_RATE, Kind.REFUSED),
    RESIDUALS: (
        Kind.SWAPPED_CAMERAS,
        Kind.SHIFTED_PIXELS,
        Kind.COPIED_CAMERAS,
        Kind.COPIED_PIXELS,
        Kind.FOREIGN_CAMERA,
        Kind.FOREIGN_CALIBRATION,
        Kind.LARGE_RESIDUAL,
        Kind.UNEVEN_CAMERAS,
        Kind.DISTORTION,
        Kind.LENS,
        Kind.BAD_CAMERA,
    ),
    MIRRORED: (Kind.PIXEL_ORIGIN, Kind.MIRRORED_PIXELS, Kind.MIRRORED_WORLD, Kind.MIRRORED_CAMERA),
    '"Cameras are not synchronised."': (Kind.CAMERA_OFFSETS,),
    STORED: (Kind.STALE_POINTS, Kind.ANOTHER_WORLD, Kind.WRONG_COLUMNS, Kind.TIME_SHIFT, Kind.ONE_V_ROW),
    SWAPPED: (
        Kind.JUMP,
        Kind.EXCHANGED_NAMES,
        Kind.REPEATED_FRAMES,
        Kind.EXCHANGED_FRAMES,
        Kind.SINGLE_SAMPLES,
        Kind.NEGATIVE_PIXELS,
    ),
    EDITS: (Kind.BY_HAND, Kind.CORRECTIONS),
    UNSEEN: (Kind.NEVER_SEEN, Kind.NEVER_TOGETHER),
    OTHERS: (Kind.UNLIKE_SIBLINGS,),
    NARROW: (Kind.QUANTISED_PIXELS, Kind.PIXEL_NOISE, Kind.INTERVALS),
    "My elbow does not appear.": (Kind.JOINTS,),
}
"""What can be wrong, by the entry of the page ``troubleshooting`` that says what to do: how its title begins."""
_SYMPTOM_OF = {kind: title for title, kinds in SYMPTOMS.items() for kind in kinds}


def topics() -> dict[str, str]:
    """The pages of the manual, in Markdown, by name."""
    package = Path(__file__).parent
    pages = package / "pages"
    folder = pages if pages.is_dir() else package.parent / "docs"  # installed, or in the repository
    files = [file for room in ROOMS for file in sorted((folder / room).glob("*.md")) if file.stem != "index"]
    return {file.stem: file.read_text(encoding="utf-8") for file in files}


@cache
def _entries() -> dict[str, str]:
    """Title and text, in Markdown, of each symptom; links to other pages are said as the command that prints them."""
    page = re.sub(r"\[[^]]*\]\((?:\w+/)*(\w+)\.md[^)]*\)", r"`mocap help \1`", topics().get("troubleshooting", ""))
    found = re.findall(r"^\*\*(.+?)\*\*\s+(.+?)(?=\n\n|\Z)", page, re.MULTILINE | re.DOTALL)
    return {" ".join(title.split()): text for title, text in found}


def what_to_do(kind: Kind) -> tuple[str, str] | None:
    """Title and text, in Markdown, of what to do about an alarm of a kind; None: nothing, or no pages."""
    begins = _SYMPTOM_OF.get(kind)
    if begins is None:
        return None
    return next(((title, text) for title, text in _entries().items() if title.startswith(begins)), None)
