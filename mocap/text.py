"""Text that is safe to write: names of files are bytes, and not all of them are text."""

import re

_BYTES = re.compile("[\udc80-\udcff]+")


def as_text(text: str) -> str:
    r"""Text with the bytes of file names that Python left undecoded (in a C locale, or of another encoding).

    They are read as UTF-8, and what that leaves is written as \\xe4 is.
    """
    return _BYTES.sub(lambda found: _decoded(found[0]), text)


def _decoded(escaped: str) -> str:
    return bytes(ord(letter) - 0xDC00 for letter in escaped).decode("utf-8", errors="backslashreplace")
