"""JSON and TOML that may come from anywhere: regular files of a limited size, and no nesting without an end."""

import errno
import json
import os
import stat
import tomllib
from math import isfinite
from pathlib import Path
from typing import Any, BinaryIO

from mocap.errors import FormatError

MOST_BYTES = 1 << 26
"""The largest documents of ours are manifests, 130 bytes a file: this is half a million files."""
DEEPEST = 32
"""Levels of lists and tables in a document; ours have 8 at most."""


def open_regular(path: Path | str, *, within: int | None = None, follow: bool = False) -> BinaryIO:
    """A regular file, opened to be read; a pipe or a device is not waited for.

    Args:
        path: The file.
        within: Opened folder that it is in; None: that of the path.
        follow: Whether it may be a link.

    Raises:
        FormatError: it is a folder, a pipe or a device.
        OSError: it cannot be opened, or is a link where it may be none.
    """
    if not follow and within is None and os.path.islink(path):  # where the system knows no O_NOFOLLOW
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    flags = os.O_RDONLY | (0 if follow else getattr(os, "O_NOFOLLOW", 0))
    for name in ("O_NONBLOCK", "O_NOCTTY", "O_BINARY"):
        flags |= getattr(os, name, 0)
    handle = os.open(path, flags, dir_fd=within)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise FormatError(f"{path}: is no regular file (a folder, a pipe or a device): give a file")
    return os.fdopen(handle, "rb")


def check_regular(path: Path) -> None:
    """Refuse what would be waited for; a file that is not there is the reader's to name.

    Raises:
        FormatError: it is a folder, a pipe or a device.
    """
    if path.is_dir():
        raise FormatError(f"{path}: is a folder; expected a file")
    if path.exists() and not path.is_file():
        raise FormatError(f"{path}: is no regular file (a pipe or a device): give a file")


def regular_bytes(path: Path, *, most: int = MOST_BYTES, follow: bool = True) -> bytes:
    """The content of a regular file of limited size; arguments and errors as of ``open_regular``.

    Raises:
        FormatError: it is larger.
    """
    with open_regular(path, follow=follow) as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise FormatError(f"{path}: has more than {most / 1e6:.3g} MB, which such a file never has: give another")
    return content


def from_json(text: str | bytes, where: str, *, finite: bool = True) -> Any:
    """What JSON says.

    Args:
        text: The document.
        where: Its file, for messages.
        finite: Whether every number must be finite.

    Raises:
        FormatError: it is no JSON, nested too deeply, or has a number that is not finite, or of thousands of digits.
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{where}: not readable as JSON: {one_line(error)}: write it again") from None
    return _checked(found, where, finite=finite)


def from_toml(text: str, where: str) -> dict[str, Any]:
    """What TOML says.

    Raises:
        FormatError: it is no TOML, nested too deeply, or has a number of thousands of digits.
    """
    try:
        found = tomllib.loads(text.replace("\r\n", "\n"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{where}: not a readable TOML file: {one_line(error)}") from None
    return _checked(found, where, finite=False)


def read_toml(path: Path) -> dict[str, Any]:
    """What a TOML file in UTF-8 says.

    Raises:
        FormatError: it cannot be read, or as of ``from_toml``.
    """
    try:
        return from_toml(regular_bytes(path).decode("utf-8-sig"), path.name)
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise FormatError(f"{path.name}: not a readable TOML file: {error}") from None


def one_line(error: Exception) -> str:
    """What a library says of a file, in one line."""
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    text = " ".join(str(error).split())
    return "a number has thousands of digits" if "int_max_str_digits" in text else text


def _checked(found: Any, where: str, *, finite: bool) -> Any:
    level = [found]
    for _ in range(DEEPEST):
        below: list[Any] = []
        for one in level:
            for value in one.values() if isinstance(one, dict) else one if isinstance(one, list) else (one,):
                if isinstance(value, dict | list):
                    below.append(value)
                elif finite and isinstance(value, float) and not isfinite(value):
                    raise FormatError(f"{where}: contains {value}, expected finite numbers: write it again")
        if not below:
            return found
        level = below
    raise FormatError(f"{where}: lists and tables are nested more than {DEEPEST} deep: write it again")
