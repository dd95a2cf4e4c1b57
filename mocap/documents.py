"""Text, JSON and TOML that may come from anywhere: regular files of a limited size, whatever their encoding."""

import codecs
import errno
import json
import os
import stat
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import Any, BinaryIO

from mocap.errors import FormatError, MocapError

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


def regular_bytes(path: Path, *, most: int = 2**26, follow: bool = True) -> bytes:
    """The content of a regular file of limited size; arguments and errors as of ``open_regular``.

    Raises:
        FormatError: it is larger.
    """
    with open_regular(path, follow=follow) as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise FormatError(f"{path}: has more than {most / 1e6:.3g} MB, which such a file never has: give another")
    return content


def from_json(text: str | bytes, where: str, *, finite: bool = True, once: bool = False) -> Any:
    """What JSON says.

    Args:
        text: The document.
        where: Its file, for messages.
        finite: Whether every number must be finite.
        once: Whether a table may have a key once only; else the last of two counts.

    Raises:
        FormatError: it is no JSON, nested too deeply, has a key twice where it may not, or has a number that is not
            finite, or of thousands of digits.
    """
    try:
        found = json.loads(text, object_pairs_hook=_once if once else None)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{where}: not readable as JSON: {one_line(error)}: write it again") from None
    return _checked(found, where, finite=finite)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(name for name in names if names.count(name) > 1)!r} stands twice")
    return found


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


@contextmanager
def damaged(what: str, advice: str) -> Iterator[None]:
    """Whatever libraries raise over a damaged file, each its own, in one line; errors of ours pass.

    Raises:
        FormatError: ``what`` (what the library says): ``advice``.
    """
    try:
        yield
    except MocapError:
        raise
    except Exception as error:
        raise FormatError(f"{what} ({type(error).__name__}: {one_line(error)[:200]}): {advice}") from None


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


_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_CONTROLS = {code: None for code in range(32) if chr(code) not in "\t\n\r\f\x1a"} | {127: None}


def is_utf16(data: bytes) -> bool:
    """Whether a file begins with the mark of UTF-16."""
    return data.startswith(_UTF16) and not data.startswith(codecs.BOM_UTF32_LE)


def is_utf8(blocks: Iterable[bytes]) -> bool:
    """Whether bytes are UTF-8, of which ASCII is a part; they may be cut anywhere but at the end."""
    decoder, plain = codecs.getincrementaldecoder("utf-8")(), True
    try:
        for block in blocks:
            if not (plain and block.isascii()):
                plain = False
                decoder.decode(block)
        decoder.decode(b"", final=True)
    except UnicodeDecodeError:
        return False
    return True


def decoded(path: Path, data: bytes) -> tuple[str, tuple[str, ...]]:
    """The text of a file, without a mark before it, and sentences on how it was read.

    Windows-1252 (of Excel and other programs of western Windows) is taken for what is not UTF-8, unless some letters
    are UTF-8: then the file is damaged, or of two programs.

    Raises:
        FormatError: it is no text.
    """
    if is_utf16(data):
        try:
            return data.decode("utf-16"), ()
        except UnicodeDecodeError:
            raise FormatError(f"{path.name}: begins as UTF-16, and does not go on so: save it as UTF-8") from None
    try:
        return data.decode("utf-8-sig"), ()
    except UnicodeDecodeError as error:
        at = data.count(b"\n", 0, error.start) + 1
    try:
        text = data.decode("cp1252")
    except UnicodeDecodeError:
        text = "\0"
    mixed = not data.decode("utf-8", "ignore").isascii()
    if mixed or text.translate(_CONTROLS) != text:
        raise FormatError(
            f"{path.name}: line {at} is not UTF-8 text{' though other lines are' if mixed else ''}; expected a "
            "text file in UTF-8, UTF-16 or Windows-1252: save it as UTF-8, or export it again"
        )
    shown = next(line for line in text.splitlines() if not line.isascii()).strip()
    return text, (
        f"letters are not in UTF-8: read as Windows-1252, in which line {at} begins {shown[:40]!r}; if that is wrong, "
        "save the file as UTF-8",
    )
