"""One class for each kind of trouble that a caller can act on; the message says what to do."""

import os
from difflib import get_close_matches
from pathlib import Path

from eal.errors import MocapError

__all__ = ["CalibrationError", "FormatError", "MocapError", "OutputError", "SkeletonError"]


class FormatError(MocapError):
    """A file does not hold what its format promises."""

    page = "your_files"


class CalibrationError(MocapError):
    """Cameras and pixels do not belong together, or cannot be told apart."""

    page = "calibration"


class SkeletonError(MocapError):
    """A skeleton and the markers of a recording disagree."""

    page = "skeleton"


class OutputError(MocapError):
    """A result cannot be written there.

    Attributes:
        kept: What became of the earlier result.
    """

    page = "files"

    def __init__(self, message: str, *, kept: str = "") -> None:
        """With what was kept, if anything is to be said of it."""
        super().__init__(message)
        self.kept = kept


def shown_elsewhere(error: OSError) -> str:
    """What to do about a file that is there and may not be used: on Windows Excel keeps others from what it shows.

    Returns:
        The words, to stand before what else can be done, or none for other errors.
    """
    place = error.filename2 or error.filename
    if not isinstance(error, PermissionError) or place is None or not os.path.isfile(place):
        return ""
    return f"close {os.path.basename(os.fsdecode(place))} in the program that has it open, such as Excel; "


def beside(path: Path) -> str:
    """What is there in place of a file that is not: names like its, to end a sentence with; empty where none is."""
    if not path.parent.is_dir():
        return f" (there is no folder {path.parent})"
    try:
        stems = {entry.stem: entry.name for entry in path.parent.iterdir()}
    except OSError:
        return ""
    like = [stems[stem] for stem in get_close_matches(path.stem, stems)]
    return f" (its folder has {', '.join(like)})" if like else ""


class NoRateError(MocapError):
    """The frame rate is in no file, and not stated."""

    mends = ("fps",)


class NoUnitError(FormatError):
    """No unit of lengths is stated, and none makes it an animal."""

    mends = ("unit",)
