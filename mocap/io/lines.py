"""What readers of text exports share: lines of a head, rows of cells with numbers, units, rates and names."""

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path, PurePath
from typing import Any, AnyStr

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.schema import LARGEST
from mocap.text import number_of

MOST_FRAMES = 10**9  # twelve days at 1 kHz
FRAMES = (
    r"(frames?|fnum|img|images?|pictures?|samples?|index|idx|timestamps?|bild)"
    r"[ _.#-]*(no|nr|num|number|numbers|index|idx|id|count|counter)?[.#]?"
)
"""Titles of a column of frame numbers, for ``re.IGNORECASE``."""
_PRINTF = ("-NaN", "-nan", "-nan(ind)", "nan(ind)", "1.#QNAN", "-1.#QNAN", "-1.#IND")
_WORDS = ("na", "nan", "n/a", "n.a.", "#n/a", "<na>", "null", "(null)", "none", "missing", "undefined")
_SIGNS = ("", "-", "--", "---", ".", "..", "...", "*", "#NV", "#VALUE!", "#DIV/0!", "#NUM!", "#REF!")
"""Of people and spreadsheets: what they leave where there is no number, and what Excel shows where none comes out."""
MISSING_WORDS = frozenset(
    (
        *_PRINTF,
        *_SIGNS,
        *(spelt for word in _WORDS for spelt in (word, word.upper(), word.title(), word.capitalize())),
        "NaN",
    )
)
"""Cells of tables, of any program, that say that a number is missing."""
_NO_NUMBER = re.compile(r"[^0-9eE+.\-]")
"""Letters that Python's float takes, but no program writes: underscores, digits of other scripts, infinity."""


def read_lines(path: Path) -> list[str]:
    """The lines of a text file, without their ends.

    Raises:
        FormatError: it cannot be read, is empty, or no text.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    if not data.strip():
        raise FormatError(f"{path.name}: the file is empty: export it again")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise FormatError(f"{path.name}: not a text file; expected the text export of a motion-capture system")
    return one_kind(text).removesuffix("\n").split("\n")


def one_kind(text: AnyStr) -> AnyStr:
    """Text with the line ends of Unix; those of Windows, also where they were translated twice, and of old Macs go."""
    if isinstance(text, bytes):
        return one_kind(text.decode("latin-1")).encode("latin-1") if b"\r" in text else text
    while "\r\r\n" in text:
        text = text.replace("\r\r\n", "\r\n")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def cells_of(
    path: Path, lines: Iterable[str], *, separator: str = ",", first_line: int = 1, skipinitialspace: bool = False
) -> Iterator[list[str]]:
    """The cells of each line of a table, without the quotes around them; the one place where lines are split so.

    Args:
        path: The file, for messages.
        lines: Its lines, with their ends or without.
        separator: Between cells.
        first_line: Number of the first of ``lines`` in the file, from 1.
        skipinitialspace: Whether blanks after a separator are no part of a cell.

    Raises:
        FormatError: a cell is longer than any that a program writes (131,072 characters), or no text.
    """
    rows = csv.reader(lines, delimiter=separator, skipinitialspace=skipinitialspace)
    while True:
        try:
            row = next(rows, None)
        except csv.Error as error:
            raise not_split(path, rows.line_num + first_line - 1, error) from None
        if row is None:
            return
        yield row


def not_split(path: Path, line: int, error: csv.Error) -> FormatError:
    """What is said of a line that is no cells."""
    if "field limit" in str(error):
        return _too_long(path, line)
    return FormatError(
        f"{path.name}: line {line} cannot be split into cells ({error}): correct it, or export the file again"
    )


_CELL = re.compile(rb'"([^"]*)"|([^,;\t "\r\n]+)')


def check_cells(path: Path) -> None:
    """Refuse a text table with a cell longer than ``csv`` takes, before any reader quotes it.

    Only lines that are as long are looked at, whatever separates their cells. JSON and XML have no cells.

    Raises:
        FormatError: there is one; the message names its line.
    """
    most, line = csv.field_size_limit(), 1
    with path.open("rb") as stream:
        start = stream.read(1 << 12)
        if b"\0" in start or start.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"[", b"<"):
            return
        stream.seek(0)
        while len(part := stream.read(most + 1)) > most:
            cut = max(part.rfind(b"\n"), part.rfind(b"\r")) + 1
            if not cut:
                part += stream.readline()
                cut = len(part)
                if any(len(quoted) > most or len(plain) > most for quoted, plain in _CELL.findall(part)):
                    raise _too_long(path, line)
            stream.seek(cut - len(part), 1)
            line += part[:cut].count(b"\n")


def _too_long(path: Path, line: int) -> FormatError:
    return FormatError(
        f"{path.name}: line {line} has a cell of more than {csv.field_size_limit():,} characters, as where a quote is "
        "not closed: correct it, or export the file again"
    )


def numbers(path: Path, lines: Sequence[str], *, separator: str, columns: int, first_line: int) -> Array:
    """(rows, columns) numbers of lines, a row each; NaN where a cell is empty or ``NA``.

    Empty cells too many at the end are none where all rows have as many. ``first_line`` is the number of the first of
    ``lines`` in the file, from 1.

    Raises:
        FormatError: a row has another number of cells, or a cell is no number.
    """
    rows = [line.split(separator) for line in lines]
    usual = Counter(map(len, rows)).most_common(1)[0][0] if rows else columns
    closed = usual > columns and not any("".join(row[columns:]).strip() for row in rows if len(row) == usual)
    surplus = usual - columns if closed else 0
    for place, cells in enumerate(rows, start=first_line):
        if len(cells) != columns + surplus:
            raise FormatError(
                f"{path.name}: line {place} has {len(cells) - surplus} cells, expected {columns} as the header "
                "states: correct it, or export it again"
            )
    rows = [["nan" if cell.strip() in MISSING_WORDS else cell for cell in row[:columns]] for row in rows]
    values, bad = _array(rows, columns, plain=all(line.isascii() and "_" not in line for line in lines))
    bad = np.argwhere(bad | (np.abs(values) > LARGEST))
    if len(bad):
        i, j = bad[0]
        trouble = "is larger than any measured value" if np.isfinite(number(rows[i][j])) else "is not a finite number"
        raise FormatError(
            f"{path.name}: line {i + first_line}, cell {j + 1}: {rows[i][j].strip()!r:.80} {trouble}; "
            "correct it, or leave it empty if the marker was not seen"
        )
    return values


def number(text: str) -> float:
    """A number as programs write it; NaN where it is none.

    Python takes more: ``1_000``, digits of other scripts, ``infinity``.
    """
    text = text.strip()
    try:
        return np.nan if _NO_NUMBER.search(text) else float(text)
    except ValueError:
        return np.nan


def _array(rows: list[list[str]], columns: int, *, plain: bool) -> tuple[Array, NDArray[np.bool_]]:
    """(rows, columns) numbers, and where a cell is none; only ``plain`` text is what NumPy and we read alike."""
    if plain:
        with suppress(ValueError):
            return np.array(rows, dtype=np.float64).reshape(len(rows), columns), np.zeros((len(rows), columns), bool)
    values = np.array([[number(cell) for cell in row] for row in rows]).reshape(len(rows), columns)
    return values, np.isnan(values) & (np.array(rows).reshape(len(rows), columns) != "nan")


def frame_numbers(path: Path, values: Any, *, first_line: int | None = None) -> NDArray[np.int64]:
    """Whole numbers that increase, from a column of (T,) numbers, the first of them in line ``first_line``.

    Raises:
        FormatError: one is none, or does not increase; the message names its line, or its row.
    """
    values = np.asarray(values, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        wrong = ~((values == np.round(values)) & (np.abs(values) < MOST_FRAMES))
        falling = np.append(False, ~(np.diff(values) > 0)) if first_line is not None else np.zeros_like(wrong)
    if (wrong | falling).any():
        row = int(np.argmax(wrong | falling))
        where = f"row {row + 1}" if first_line is None else f"line {row + first_line}"
        trouble = f"{values[row]:.12g} is not a frame number below {MOST_FRAMES:.0e}"
        if np.isnan(values[row]):
            trouble = "no frame number"
        elif not wrong[row]:
            trouble = f"{values[row]:.12g} follows frame {values[row - 1]:.12g}"
        raise FormatError(f"{path.name}: {where}: {trouble}; expected whole numbers that increase: correct them")
    return values.astype(np.int64)


def image_numbers(names: Sequence[str]) -> list[int] | None:
    """The numbers that end the names of images (before ``.png``); None where one has none, or two have the same."""
    ends = [re.search(r"(\d{1,8})$", PurePath(name).stem) for name in names]
    numbers = [int(end[1]) for end in ends if end]
    return numbers if len(set(numbers)) == len(names) else None


UNIT_M = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
"""Metres in a unit."""
_IN_WORDS = re.compile(r"(milli|centi|deci|micro|)met(?:er|re)s?")
_TIME_WORDS = re.compile(r"(milli|micro|nano|[munµμ])?(?:s|secs?|seconds?)")
_TIME_S = {None: 1.0, "milli": 1e-3, "m": 1e-3, "nano": 1e-9, "n": 1e-9} | dict.fromkeys(("micro", *"uµμ"), 1e-6)
_PREFIXES = {"milli": "mm", "centi": "cm", "deci": "dm", "micro": "um", "": "m"}


def unit_of(text: str) -> str | None:
    """The unit of ``UNIT_M`` that a text names, in short or in full; None: it names none."""
    text = text.strip().lower()
    words = _IN_WORDS.fullmatch(text)
    short = _PREFIXES[words[1]] if words else text
    return short if short in UNIT_M else None


def time_unit_s(text: str) -> float | None:
    """Seconds in a unit of time that a text names, in short or in full; None: it names none."""
    words = _TIME_WORDS.fullmatch(text.strip().lower())
    return _TIME_S[words[1]] if words else None


def metres(path: Path, unit: str) -> float:
    """Length of a unit in metres.

    Raises:
        FormatError: the unit is not known.
    """
    if (short := unit_of(unit)) is None:
        units = ", ".join(UNIT_M)
        raise FormatError(f"{path.name}: lengths are in {unit!r}, which is not a known unit ({units}): state the unit")
    return UNIT_M[short]


def rate(path: Path, value: object) -> float:
    """A frame rate in hertz.

    Raises:
        FormatError: it is no positive number.
    """
    try:
        hertz = number(value) if isinstance(value, str) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        hertz = np.nan
    if not (np.isfinite(hertz) and hertz > 0):
        raise FormatError(f"{path.name}: the frame rate is {value}; expected frames a second, above 0")
    return hertz


RATES_HZ = (1e-4, 1e7)  # a picture in three hours, and the fastest cameras
SLOW_HZ = 1.0
"""Times that a second or more lies between, as seconds, are doubted: few animals are filmed so slowly. Chosen."""
SLOW = "ARE TIMES SECONDS?"
"""How a sentence on them begins."""


def told_apart(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names of which none is empty or another's (U_1, U_2, ... are unnamed), and findings on what was changed."""
    found, changed = [], []
    unnamed = (new for new in map("U_{}".format, count(1)) if new not in names)
    for place, name in enumerate(names, start=1):
        new = name or next(unnamed)
        while new in found:
            new = f"{new}_{place}"
        if new != name:
            changed.append(f"{name!r} -> {new!r}")
        found.append(new)
    shown = ", ".join(changed[:5]) + (", ..." if len(changed) > 5 else "")
    renamed = number_of(len(changed), "point without a unique name was", "points without a unique name were")
    return found, [f"{renamed} renamed: {shown}"] if changed else []


def _rounded_rate(t_s: Array) -> float:
    """The rate with the fewest digits of which even times in seconds are multiples, as far as they are rounded.

    Files round times: 0.001429, 0.002857, ... are of 700 frames a second, not of 699.999999.
    """
    fps = (len(t_s) - 1) / (t_s[-1] - t_s[0])
    decimals = _decimals(t_s)
    for digits in range(9):
        simple = round(fps, digits)
        off = np.abs(t_s - t_s[0] - np.arange(len(t_s)) / (simple or np.inf))
        if simple and off.max() <= 10.0**-decimals:
            return simple
    return fps


def _decimals(t_s: Array) -> int:
    return next((d for d in range(12) if np.allclose(t_s, np.round(t_s, d), rtol=0, atol=1e-13)), 12)


_LIKE_LINES = 0.05
"""Steps of the last digit are never rounded unevenly; a line that is lost or stands twice among twenty or more makes
them seem to differ from it by less than this share."""
_SURE = 1e-3
"""Relative width of rates that rounded times allow, below which the simplest of them is taken. Chosen: a rate that is
wrong by more than that moves the end of a recording of a thousand frames by a frame."""


def even_times(
    path: Path,
    t_s: Array,
    *,
    frames: NDArray[np.number] | None = None,
    header: float | None = None,
    stated: float | None = None,
) -> tuple[Array, float | None, list[str]]:
    """Times of frames, frames a second, and findings, of a column of times that the file may have rounded.

    Times with too few digits fall on each other, or seem uneven, although the frames were even (2,000 frames a second
    with three decimals). Where rounding explains them the rate is the one that is stated, else what they tell of it;
    where they leave it open there is none, and times count frames. Other times stay as they are.

    Args:
        path: The file, for messages.
        t_s: (T,) times in seconds.
        frames: (T,) increasing frame numbers; None: every row is the frame after the one before.
        header: Frames a second by the head of the file.
        stated: Frames a second by the user.

    Raises:
        FormatError: times do not increase, and no rounding explains it, or nobody states the rate.
    """
    count = np.arange(len(t_s), dtype=np.float64) if frames is None else frames - frames[0]
    if _are_days(t_s):
        t_s = 86400 * (t_s - t_s[0])
        steps = np.diff(t_s)
        fps = count[-1] / t_s[-1] if np.ptp(steps) <= 0.5 * np.median(steps) else 1 / float(np.median(steps))
        return t_s, round(fps, 2), ["times are days, as spreadsheets store dates: read as seconds from the first"]
    steps = np.diff(t_s)
    uneven = len(steps) > 0 and not (steps.min() > 0 and np.ptp(steps) <= 0.5 * np.median(steps))
    if not uneven:
        return t_s, *rate_of_times(path, t_s)
    digit = 10.0 ** -_decimals(t_s)
    for rate in (stated, header):
        if rate and _rounds(t_s, count, 1 / rate, digit):
            note = f"times are rounded to {digit:g} s: frames are even, {rate:g} a second as stated"
            return t_s[0] + count / rate, rate, [note]
    if stated is not None and not (steps > 0).all():
        return count / stated, stated, ["times do not increase, and were not used: `fps` is stated"]
    closest = _closest(t_s, count, digit)
    if closest is None:
        return t_s, *rate_of_times(path, t_s)
    least, most = 1 / closest[1], 1 / closest[0]
    if most - least > _SURE * least:
        if (steps > 0).all():  # they may be uneven, too
            return t_s, *rate_of_times(path, t_s)
        note = f"times are rounded to {digit:g} s, which leaves the rate open: {least:.4g} to {most:.4g} frames"
        return count, None, [f"{note} a second; state `fps`"]
    rate = next(r for d in range(12) if least <= (r := round((least + most) / 2, d)) <= most)
    return (
        t_s[0] + count / rate,
        rate,
        [f"times are rounded to {digit:g} s: frames are even, {rate:g} a second ({least:.6g} to {most:.6g} fit)"],
    )


def _are_days(t_s: Array) -> bool:
    """Whether times are dates of a spreadsheet (45,000 days are in 2023), of frames that are less than 2 s apart.

    As seconds they would be more than 50,000 frames a second, half a day after the start.
    """
    steps = np.diff(t_s)
    return bool(len(steps) and t_s[0] > 30_000 and t_s[-1] < 80_000 and steps.min() > 0 and np.median(steps) < 2e-5)


def _rounds(t_s: Array, count: Array, step_s: float, digit: float) -> bool:
    """Whether times are multiples of a step from some first time on, but for rounding to a ``digit``."""
    steps, exact = np.diff(t_s) / digit, np.diff(count) * step_s / digit
    near = (steps > np.floor(exact) - 0.01) & (steps < np.ceil(exact) + 0.01)  # whole numbers both, to their last bits
    return bool(near.all()) and _off(t_s, count, step_s) <= digit * (1 + 1e-6)


def _off(t_s: Array, count: Array, step_s: float) -> float:
    """By how much times differ, at most, from multiples of a step from some first time on."""
    return float(np.ptp(t_s - count * step_s))


def _closest(t_s: Array, count: Array, digit: float) -> tuple[float, float] | None:
    """The least and the largest step whose multiples times with a last ``digit`` can be; None: no step fits."""
    span, total = t_s[-1] - t_s[0], count[-1]
    low, high = (span - digit) / total, (span + digit) / total
    a, b = low, high
    for _ in range(80):  # what they differ by is a convex function of the step
        c, d = a + (b - a) / 3, b - (b - a) / 3
        a, b = (a, d) if _off(t_s, count, c) < _off(t_s, count, d) else (c, b)
    best = (a + b) / 2
    if not _rounds(t_s, count, best, digit) or best > 2 * digit or abs(best - digit) < _LIKE_LINES * digit:
        return None
    ends = []
    for end in (low, high):
        inside, outside = best, end
        for _ in range(60):
            middle = (inside + outside) / 2
            inside, outside = (middle, outside) if _off(t_s, count, middle) <= digit * (1 + 1e-6) else (inside, middle)
        ends.append(inside)
    return ends[0], ends[1]


def rate_of_times(path: Path, t_s: Array) -> tuple[float | None, list[str]]:
    """Frames a second of times in seconds (None of fewer than two), and a finding where they are uneven.

    Raises:
        FormatError: they do not increase.
    """
    if len(t_s) < 2:
        return None, []
    steps = np.diff(t_s)
    if not (steps > 0).all():
        row = int(np.argmax(~(steps > 0)))
        raise FormatError(
            f"{path.name}: times do not increase: {t_s[row + 1]:g} s follows {t_s[row]:g} s (row {row + 2} of the "
            "tracks): correct it, or state the rate as `fps`, and times are not used"
        )
    uneven = np.ptp(steps) > 0.5 * np.median(steps)
    fps = float(1 / np.median(steps)) if uneven else _rounded_rate(t_s)
    notes = [f"times are uneven: steps of {steps.min():.4g} to {steps.max():.4g} s"] if uneven else []
    return float(f"{fps:.9g}"), [*notes, *slow_rate(fps, t_s)]


def slow_rate(fps: float, t_s: Array) -> list[str]:
    """A sentence where times make a rate of at most ``SLOW_HZ``, with what else they may be."""
    if fps > SLOW_HZ:
        return []
    counts = "if they count frames, their rate is not known"
    unit, size = ("milliseconds", 1e3) if fps > SLOW_HZ / 1e3 else ("microseconds", 1e6)
    other = counts if (np.diff(t_s) == 1).all() else f"if they are {unit}, {fps * size:.6g}"
    return [f"{SLOW} as such they give {fps:.4g} frames a second; {other}: state `fps`"]


def is_number_row(cells: tuple[str, ...]) -> bool:
    """Whether all cells are finite numbers."""
    try:
        return bool(cells) and bool(np.isfinite([float(cell) for cell in cells]).all())
    except ValueError:
        return False
