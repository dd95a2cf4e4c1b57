"""Text that is safe to write: names of files are bytes, and not all of them are text, nor all text a name of a file."""

import re
import unicodedata
from collections.abc import Iterable, Mapping

_BYTES = re.compile("[\udc80-\udcff]+")
_NO_FILE = re.compile(r'[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff<>:"/\\|?*]|^\.+|[. ]+$')
_DEVICE = re.compile(r"(?:con|prn|aux|nul|conin\$|conout\$|(?:com|lpt)[0-9¹²³])(?=$|\.)", re.IGNORECASE)
"""What Windows reads as a device, whatever stands behind the dot."""
_ACTS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Controls of terminals (ESC, CSI, ...), turns of the writing direction, line ends that are none; not the tab and
the new line."""


def as_text(text: str) -> str:
    r"""Text with the bytes of file names that Python left undecoded (in a C locale, or of another encoding).

    They are read as UTF-8, and what that leaves is written as \\xe4 is.
    """
    return _BYTES.sub(lambda found: _decoded(found[0]), text)


def _decoded(escaped: str) -> str:
    return bytes(ord(letter) - 0xDC00 for letter in escaped).decode("utf-8", errors="backslashreplace")


def file_names(names: Iterable[str]) -> list[str]:
    """A name for the file of each of these, without its ending: every system takes it, and keeps all of them apart.

    Names stay as they are where they can. Disks of Windows and macOS ignore case, and ways to code an accent; what such
    a disk would take for an earlier name gets a number.
    """
    found: dict[str, str] = {}
    for name in names:
        plain = _NO_FILE.sub("_", name) or "_"
        plain = _DEVICE.sub(r"\g<0>_", plain) if _DEVICE.match(plain) else plain
        number, one = 1, plain
        while (key := unicodedata.normalize("NFC", unicodedata.normalize("NFD", one).casefold())) in found:
            number += 1
            one = f"{plain}_{number}"
        found[key] = one
    return list(found.values())


def visible(text: str) -> str:
    r"""Text as it is, but for characters that act on a terminal or change how text reads, written as \\x1b is.

    Names of markers, cameras and animals are read so, and all that is printed is.
    """
    return _ACTS.sub(_escape, as_text(text))


def unfit(name: str) -> str | None:
    """Why nothing can be called so in a result that is written and read back; None where it can.

    Names that are given in memory, and those of skeletons, are refused for it; those of files are changed, and told.
    """
    if not name:
        return "has no letters"
    if visible(name) != name or "\n" in name:
        return "contains characters that do not show, end a line or change how text reads"
    return None


def number_of(count: int, thing: str, things: str | None = None) -> str:
    """``1 frame``, ``2 frames``.

    Args:
        count: How many.
        thing: What one is called.
        things: What several are called; None: with an s.
    """
    return f"{count} {thing if count == 1 else things or thing + 's'}"


def _escape(found: re.Match[str]) -> str:
    code = ord(found[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


OTHER_OPTIONS = {
    "format": "--format",
    "image_height_px": "--image-height",
    "point_sd_mm": "--point-sd",
    "stored_points": "--stored",
    "overwrite": "--force",
    "no_solid": "--no-solid",
}
"""Options of the command line that are not called as the arguments that they are."""


def with_options(text: str, options: Mapping[str, str]) -> str:
    """A message in which each argument between backquotes is the option that states it, by the argument's name."""
    return re.sub(r"`(\w+)`", lambda found: options.get(found[1], found[0]), text)


_MEANS = re.compile(r"[\\`*<>\[\]|~&]|(?<![^\W_])_|_(?![^\W_])")
"""What begins or ends markup inside a line; an underscore inside a word does not."""
_BEGINS = re.compile(r"^(\s*)([#+=-]|\d+(?=[.)]))")
"""What makes a line a heading, an item or a rule."""


def plain(text: str) -> str:
    """Text that Markdown shows as it is, in a line or in the cell of a table."""
    line = as_text(text).replace("\r", "\\r").replace("\n", "\\n").replace("\t", " ")
    escaped = _MEANS.sub(lambda found: "\\" + found[0], line)
    return _BEGINS.sub(_not_a_beginning, escaped)


def _not_a_beginning(found: re.Match[str]) -> str:
    space, first = found[1], found[2]
    return f"{space}{first}\\" if first.isdigit() else f"{space}\\{first}"
