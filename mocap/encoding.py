"""Bytes of text files to text: UTF-8, UTF-16 with its mark, and Windows-1252, which has no mark."""

import codecs
from collections.abc import Iterable
from pathlib import Path

from mocap.errors import FormatError

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
