"""The last lines of a command that tracks: where the result is, what is wrong, what error to expect."""

import json
import textwrap
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

from mocap.cli.console import program, show, show_text, typed
from mocap.reading.reading import in_options
from mocap.report.summary import better, error_lines, length_line, notes
from mocap.text import number_of

LINES = 25
"""A result takes no more lines on a terminal of 80 columns; all else is in the report."""


def finish(report: Mapping, text: str, out: Path, *, as_json: bool, verbose: bool, cycles: Sequence[str] = ()) -> None:
    """Say where the result is, how to look at it, what is wrong, and what error to expect."""
    if as_json:
        print(json.dumps(report))  # noqa: T201
        return
    if verbose:
        show(text)
    show_text("\n".join(closing(report, out, cycles=cycles)))


def closing(report: Mapping, out: Path, *, cycles: Sequence[str] = ()) -> list[str]:
    """The lines of ``finish``, at most ``LINES`` of 80 columns.

    Args:
        report: Of the result.
        out: Its folder.
        cycles: Their frequency, or why there is none.
    """
    page = "report.md" if report.get("plane") else "report.html"
    counts = report["frames"], len(report["markers"]), len(report["cameras"])
    size = ", ".join(number_of(n, thing) for n, thing in zip(counts, ("frame", "marker", "camera"), strict=True) if n)
    lines = _indented(f"{report['name']}: {size}", "")
    kind = "parquet" if "blocks" in report else "csv"
    lines += _indented(f"Result: {out}/ (begin with {page}; tables: markers.{kind}, kinematics.{kind})")
    if not report.get("plane"):
        lines += _indented(f"Look:   {typed(*program(), 'view', out)}   (in the browser: add --web)")
    after = ["", "Error to expect in gaps", *(part for line in error_lines(report) for part in _indented(line))]
    after += ["", "Animal", *_indented(length_line(report))]
    wrong = [in_options(sentence) for sentence in (*report.get("wrong", ()), *filter(None, [better(report)]))]
    left_open = [in_options(sentence) for sentence in report.get("open", ())]
    known = "Nothing is wrong, as far as is known" if left_open else "Nothing is wrong"
    lines += ["", "What is wrong, worst first" if wrong else known]
    decided = len(notes(report))
    for shown, whole in product(range(len(wrong), -1, -1), (True, False)):
        told = wrong[:shown] or [_cut(one, 74) for one in wrong[:1]]  # one line
        items = [part for k, one in enumerate(told) for part in _indented(f"{k + 1}. {one}", deeper="   ")]
        more = [f"{len(wrong) - len(told)} more"] if len(told) < len(wrong) else []
        more += [f"notes ({decided}) on what was decided or repaired"] if decided else []
        items += _indented(f"{' and '.join(more)}: {page}, or --verbose") if more else []
        counted = [part for line in cycles for part in _indented(_whole_or_cut(in_options(line), whole=whole))]
        end = [*_left_open(left_open, whole=whole), *after, *counted]
        if len(lines) + len(items) + len(end) <= LINES:
            break
    return [*lines, *items, *end]


def _left_open(texts: Sequence[str], *, whole: bool) -> list[str]:
    """What its user can state: whole or a line each, of many the first two."""
    if not texts:
        return []
    told = [_whole_or_cut(text, whole=whole) for text in texts[:2]]
    told += [f"{len(texts) - 2} more"] if len(texts) > 2 else []
    return ["", "Left open, to be stated", *(part for line in told for part in _indented(line))]


def _whole_or_cut(text: str, *, whole: bool) -> str:
    return text if whole else _cut(text, 76)


def _cut(text: str, width: int) -> str:
    """One line of a sentence, without its middle: it begins with what is wrong and ends with what to do."""
    words = text.split()
    end = len(words)
    while end and len(" ".join(words[end - 1 :])) <= width // 2:
        end -= 1
    room = width - len(" ".join(["", *words[end:]]))
    begin = textwrap.shorten(" ".join(words[:end]), room, placeholder=" ...", break_on_hyphens=False)
    return " ".join([begin, *words[end:]]).strip()


def _indented(text: str, indent: str = "  ", *, deeper: str = "  ") -> list[str]:
    """A sentence broken at 80 columns; words, as paths, stay whole."""
    return textwrap.wrap(
        text,
        80,
        initial_indent=indent,
        subsequent_indent=indent + deeper,
        break_long_words=False,
        break_on_hyphens=False,
    )
