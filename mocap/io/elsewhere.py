"""The formats of other installed packages, so that one that fails is named, and stops no other."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from eal.plugins import described, left_out, offered
from mocap.errors import FormatError, MocapError
from mocap.io.contents import FileContents
from mocap.io.format import Format, Head, Hints

GROUP = "mocap.formats"


def formats_elsewhere() -> tuple[Format, ...]:
    """What the packages offer: a recogniser that fails knows no file from then on, a reader that fails is named."""
    return tuple(
        replace(format, knows=_recogniser(name, format.knows), read=_reader(name, format.read))
        for name, format in offered(GROUP, Format).items()
    )


def _recogniser(name: str, knows: Callable[[Head], bool]) -> Callable[[Head], bool]:
    failed = False

    def of_head(head: Head) -> bool:
        nonlocal failed
        try:
            return not failed and bool(knows(head))
        except KeyboardInterrupt:  # a person's
            raise
        except BaseException as error:  # sys.exit included
            failed = True
            left_out(GROUP, name, f"but it fails on {head.path.name}: {described(error)}")
            return False

    return of_head


def _reader(name: str, read: Callable[[Path, Hints], FileContents]) -> Callable[[Path, Hints], FileContents]:
    def of_file(path: Path, hints: Hints) -> FileContents:
        try:
            found = read(path, hints)
        except (MocapError, MemoryError, KeyboardInterrupt):  # of the file, of the machine, of a person
            raise
        except BaseException as error:
            trouble = described(error)
        else:
            if isinstance(found, FileContents):
                return found
            trouble = f"gives {type(found).__name__}, expected FileContents"
        raise FormatError(
            f"{path.name}: the reader of the format {name!r}, which another installed package offers, failed "
            f"({trouble}): correct or remove that package, or state another `format`"
        )

    return of_file
