"""What a person is told of an error, whatever raised it: what happened, where, and who is at fault, in one line.

The command line, the pages in the browser and processes that track all ask here.
"""

import csv
import errno
import os
import traceback
from dataclasses import dataclass
from importlib.metadata import entry_points

from eal.needs import MissingPackageError
from mocap.errors import MocapError, shown_elsewhere

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_OURS = {"mocap", "eal", "filters", "datasets"}
_LOOP = "Symlink loop from "
_GROUPS = ("mocap.formats", "mocap.models", "mocap.views", "eal.kernels")
"""Of entry points, by which other packages extend this one (``eal.plugins``)."""

INSTALLING = "installing"
"""The page (of ``mocap help``) for what is not installed, or not as it should be."""


@dataclass(frozen=True)
class Trouble:
    """What to say of an error.

    Attributes:
        text: In one line, with what to do.
        fault: Whether it is an error of this program, which its authors have to mend; otherwise the user can.
        page: The page of ``docs/`` that says more; None: there is none.
    """

    text: str
    fault: bool = False
    page: str | None = None


def trouble_of(error: BaseException) -> Trouble:
    """What to say of an error."""
    if _disk_is_full(error) and not (isinstance(error, MocapError) and _names_it(error)):
        place = f" ({os.fsdecode(error.filename)})" if isinstance(error, OSError) and error.filename else ""
        return Trouble(f"the disk is full, or your quota is used up{place}: free some space, or choose another place")
    if isinstance(error, MissingPackageError):  # an extra, whose message says how to install it
        return Trouble(str(error), page=INSTALLING)
    if isinstance(error, MocapError):
        return Trouble(" ".join(str(error).split("\n")), page=error.page)
    if isinstance(error, UnicodeEncodeError) and error.reason == "surrogates not allowed":
        name = error.object[max(0, error.start - 30) : error.end + 30]
        return Trouble(f"{name}: this file name is not UTF-8: rename the file, or its folder")
    if isinstance(error, MemoryError):
        detail = f" ({error})" if str(error) else ""
        return Trouble(
            f"there is not enough memory{detail}: close other programs, or take a shorter part of the recording"
        )
    if isinstance(error, RuntimeError) and (loop := str(error)).startswith(_LOOP):  # pathlib's, up to Python 3.12
        return Trouble(f"{loop.removeprefix(_LOOP).strip(chr(39))}: a link that leads to itself: choose another place")
    where = _where(error)
    said = f"{type(error).__name__}{where}: {' '.join(str(error).split())[:300] or 'no further details'}"
    if (offered := _plugin(error)) is not None:
        return Trouble(f"{said}: the plug-in {offered} did that, not mocap: tell its authors, or uninstall it")
    if isinstance(error, OSError) and error.strerror:
        if error.filename:
            advice = f"{shown_elsewhere(error)}check that it is there and that you may use it"
            return Trouble(f"{os.fsdecode(error.filename)}: {error.strerror}: {advice}")
        return Trouble(f"{said}: the system refused to read or write: check the disk, or the network drive")
    if isinstance(error, csv.Error):
        return Trouble(f"{said}: a table has a line that is no CSV: mocap info FILE names it; export the table again")
    if any(kind.__name__ == "LinAlgError" for kind in type(error).__mro__):  # NumPy's, which takes a while to import
        return Trouble(
            f"{said}: these data lead to equations without a solution, as numbers out of all bounds, or too few "
            "samples, do: see what mocap info says of the files"
        )
    return Trouble(f"{said}: this is an error in mocap, not in your data", fault=True)


def _disk_is_full(error: BaseException) -> bool:
    """Whether an error, or what it came from, is of a full disk; libraries in C and Rust tell it by its words only."""
    found: BaseException | None = error
    while found is not None:
        if isinstance(found, OSError) and found.errno in _FULL:
            return True
        if _names_it(found):
            return True
        found = found.__cause__ or found.__context__
    return False


def _names_it(error: BaseException) -> bool:
    return any(os.strerror(number) in str(error) for number in _FULL)


def _where(error: BaseException) -> str:
    place = traceback.extract_tb(error.__traceback__)
    return f" at {os.path.basename(place[-1].filename)}:{place[-1].lineno}" if place else ""


def _plugin(error: BaseException) -> str | None:
    """The plug-in in whose code an error was raised, or in a library that it called; None: it was not."""
    frames = [frame.f_globals.get("__name__", "") for frame, _ in traceback.walk_tb(error.__traceback__)]
    packages = [str(name).partition(".")[0] for name in frames]
    if set(packages) <= _OURS | {"__main__", "typer", "click", "rich"}:
        return None  # looking up what is installed takes milliseconds, and every end of a command comes by here
    points = {point.module.partition(".")[0]: point for group in _GROUPS for point in entry_points(group=group)}
    for package in reversed(packages):
        if package in _OURS:
            return None
        if package in points:
            point = points[package]
            return f"{point.name!r} of the package {package if point.dist is None else point.dist.name!r}"
    return None


def ended_by_plugin(error: SystemExit) -> bool:
    """Whether code of a plug-in has ended the program, and not the program itself."""
    return _plugin(error) is not None
