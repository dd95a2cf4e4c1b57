"""What the page of files says of columns, to be compared with what a run writes; the table of cycles, from the code."""

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import fields
from pathlib import Path

from mocap.kinematics.cycles import Cycle

PAGE = Path(__file__).resolve().parents[1] / "reference" / "files.md"
MADE = "<!-- made: cycles -->"
UNITS = {"_s": "s", "_hz": "Hz", "_deg": "degrees", "_m": "m", "_m_s": "m/s"}


def page() -> str:
    """The page, with what is made."""
    return PAGE.read_text(encoding="utf-8").replace(MADE, cycles_table())


def cycles_table() -> str:
    """The columns of ``cycles.csv`` in Markdown, from the record of a cycle."""
    told = dict(re.findall(r"^ {8}(\w+): (.*)$", Cycle.__doc__ or "", re.MULTILINE))
    lines = ["| column | unit | meaning |", "|---|---|---|"]
    for field in fields(Cycle):
        ends = [end for end in UNITS if field.name.endswith(end)]
        text = told[field.name].replace("``", "`").replace("|", "\\|")
        lines.append(f"| `{field.name}` | {UNITS[max(ends, key=len)] if ends else ''} | {text} |")
    return "\n".join(lines)


def documented(title: str) -> list[str]:
    """The names and patterns in the first column of the tables below a heading, as ``markers.csv``.

    Raises:
        ValueError: the page has no such heading.
    """
    parts = page().split(f"### `{title}`", 1)
    if len(parts) != 2:
        raise ValueError(f"{PAGE.name} says nothing of {title}")
    section = re.split(r"^##+ ", parts[1], maxsplit=1, flags=re.MULTILINE)[0]
    rows = re.findall(r"^\| (`.*?) \|", section, re.MULTILINE)
    return [name for row in rows for name in re.findall(r"`([^`]+)`", row)]


def undocumented(columns: Iterable[str], title: str, names: Mapping[str, Collection[str]]) -> list[str]:
    """The columns that the page does not describe.

    Args:
        columns: Of the file.
        title: Its heading.
        names: What ``<marker>``, ``<joint>`` and so on may stand for.
    """
    known = re.compile("|".join(_pattern(p, names) for p in documented(title)))
    return [column for column in columns if not known.fullmatch(column)]


def _pattern(text: str, names: Mapping[str, Collection[str]]) -> str:
    parts = re.split(r"<(\w+)>", text)
    for k in range(1, len(parts), 2):
        longest_first = sorted(names.get(parts[k], ()), key=len, reverse=True)
        parts[k] = f"(?:{'|'.join(map(re.escape, longest_first)) or '(?!)'})"
    return "".join(re.escape(part) if k % 2 == 0 else part for k, part in enumerate(parts))
