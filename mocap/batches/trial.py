"""A trial of a batch: its files, and what is stated about them."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mocap.pipeline.reading import read
from mocap.pipeline.recording import Recording


def yes(cell: str) -> bool:
    """A cell that says yes or no.

    Raises:
        ValueError: it says neither.
    """
    if cell.casefold() not in ("true", "yes", "false", "no"):
        raise ValueError(cell)
    return cell.casefold() in ("true", "yes")


STATED: dict[str, Callable[[str], Any]] = {
    "fps": float,
    "unit": str,
    "calibration": Path,
    "skeleton": Path,
    "profile": Path,
    "origin": str,
    "calibration_origin": str,
    "image_height_px": float,
    "pixel_sd": float,
    "crop": Path,
    "edits": Path,
    "correct_lag": yes,
    "fit_lens": yes,
}
"""What a manifest can state of a trial: arguments of ``mocap.read``, and the type of each."""
MOST_NAMED = 4
"""Names that a message tells of many."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One recording of a batch.

    Attributes:
        name: Unique in the batch; its result is written to the folder of this name below the results.
        paths: The file of its tracks; several: the pixel files of its views, a camera each.
        stated: Arguments of ``mocap.read`` (``STATED``, and ``hints``) that are given for it.
        animal: Whose trial it is; empty: not stated.
        skip: Why it is not tracked; empty: it is.
    """

    name: str
    paths: tuple[Path, ...]
    stated: Mapping[str, Any] = field(default_factory=dict)
    animal: str = ""
    skip: str = ""

    def recording(self) -> Recording:
        """Its files, read as ``mocap track`` reads them.

        Raises:
            MocapError: they cannot be read.
        """
        return read(list(self.paths), **self.stated)


def some(names: Sequence[str]) -> str:
    """``a, b, c, d, ...``."""
    return ", ".join(names[:MOST_NAMED]) + (", ..." if len(names) > MOST_NAMED else "")


def relative(path: Path, folder: Path) -> str:
    """A path as a manifest in ``folder`` names it: with slashes, relative where there is a way."""
    try:
        return Path(os.path.relpath(path.absolute(), folder.absolute())).as_posix()
    except ValueError:  # another drive
        return path.absolute().as_posix()
