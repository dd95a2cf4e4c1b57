"""Names and sentences inside Markdown: they are text, whatever characters they hold."""

import re

from mocap.text import as_text

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
