"""The head of a C3D file: sixteen words that place the data, and the records of parameters (c3d.org, user guide).

Nothing in it is believed by itself: records must follow each other as their own sizes say, and ``mocap.io.c3d`` holds
against the file's size what decides positions.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError

BLOCK = 512
INTEL, DEC, SGI = 84, 85, 86
"""Processors by the byte that names them: which of its bytes a number begins with."""
_KINDS = {-1: 1, 1: 1, 2: 2, 4: 4}
"""Bytes of a value of each type: letters, bytes, 16-bit whole numbers, reals."""
_DECISIVE = re.compile(
    r"POINT:(USED|(LONG_)?FRAMES|SCALE|UNITS|LABELS\d*|ANGLES|FORCES|MOMENTS|POWERS|SCALARS)|TRIAL:ACTUAL_\w+"
    r"|(ANALOG|ROTATION):USED"
)
"""Parameters that decide which bytes are positions of what, and in which unit."""


@dataclass(frozen=True, kw_only=True)
class Head:
    """What the head of a C3D file says, by itself and in its parameters.

    Attributes:
        processor: INTEL, DEC or SGI.
        points: Points a frame.
        analog: Analog values a frame, of all channels.
        first: Number of the first frame.
        last: Number of the last frame, at most 65535.
        scale: Length of one whole number, in the unit of the points; below 0 where the data are reals.
        data_at: Byte at which the data begin.
        blocks_end: Byte at which the parameters end by their count of blocks.
        analog_per_frame: Analog values a frame of each channel.
        rate_hz: Frames a second.
        parameters: Values by ``GROUP:NAME``: words, or numbers in an array.
        findings: What is unusual.
    """

    processor: int
    points: int
    analog: int
    first: int
    last: int
    scale: float
    data_at: int
    blocks_end: int
    analog_per_frame: int
    rate_hz: float
    parameters: dict[str, Any]
    findings: tuple[str, ...]

    def number(self, key: str) -> float | None:
        """The first number of a parameter; None where it is absent, or none."""
        values = self.parameters.get(key)
        if not isinstance(values, np.ndarray) or not values.size or not np.isfinite(values[0]):
            return None
        return float(values[0])

    def words(self, key: str) -> list[str]:
        """The words of a parameter; none where it is absent."""
        values = self.parameters.get(key, [])
        return values if isinstance(values, list) else []


def whole_numbers(data: bytes, processor: int) -> NDArray[np.int16]:
    """16-bit whole numbers in the order of bytes of a processor."""
    return np.frombuffer(data, dtype=">i2" if processor == SGI else "<i2")


def reals(data: bytes, processor: int) -> Array:
    """32-bit reals of a processor; DEC's have their halves exchanged and an exponent larger by 2."""
    if processor == DEC:
        halves = np.frombuffer(data, dtype="<u2").reshape(-1, 2)
        with np.errstate(invalid="ignore"):
            return np.ascontiguousarray(halves[:, ::-1]).view("<f4").ravel() / np.float32(4)
    return np.frombuffer(data, dtype=">f4" if processor == SGI else "<f4").astype(np.float32, copy=False)


def read_head(path: Path, data: bytes) -> Head:
    """The head of a file, of which ``data`` is the whole.

    Raises:
        FormatError: it is cut, or does not begin like the head of a C3D file.
    """
    start = BLOCK * (data[0] - 1) if data else 0
    if len(data) < BLOCK or data[1] != 0x50 or not 0 < start <= len(data) - 4:
        raise not_read(path, "does not begin like a C3D file, or ends within its header")
    processor = data[start + 3]
    if processor not in (INTEL, DEC, SGI):
        raise not_read(path, f"byte {start + 3} is {processor}; expected the processor: 84, 85 or 86")
    words = np.frombuffer(data[:BLOCK], dtype=">u2" if processor == SGI else "<u2")
    data_at = BLOCK * (int(words[8]) - 1)
    blocks_end = start + BLOCK * data[start + 2]
    if (data_at - blocks_end) % (256 * BLOCK) == 0 and data_at > blocks_end:  # a byte counts the blocks
        blocks_end = data_at
    end = data_at if start < data_at <= len(data) else blocks_end
    parameters, findings = _parameters(path, data[start:end], processor, start)
    scale, rate_hz = (float(reals(data[at : at + 4], processor)[0]) for at in (12, 20))
    return Head(
        processor=processor,
        points=int(words[1]),
        analog=int(words[2]),
        first=int(words[3]),
        last=int(words[4]),
        scale=scale,
        data_at=data_at,
        blocks_end=blocks_end,
        analog_per_frame=int(words[9]),
        rate_hz=rate_hz,
        parameters=parameters,
        findings=tuple(findings),
    )


def not_read(path: Path, trouble: str) -> FormatError:
    """The error of a file whose parts contradict each other; there are programs that write such files."""
    return FormatError(f"{path.name}: not read as C3D: {trouble}: copy it again; if it stays so, please report it")


@dataclass(frozen=True)
class _Record:
    """A group or a parameter: its group's number, name, value (None of a group), and the ways to the next one.

    ``bare`` is that of a record without a description.
    """

    group: int
    name: str
    value: Any
    stated: int
    counted: int
    bare: int


def _parameters(path: Path, section: bytes, processor: int, start: int) -> tuple[dict[str, Any], list[str]]:
    """Values of all parameters by ``GROUP:NAME``, and findings.

    Each record states where the next one is, and has a size of its own, which some writers count without the byte of
    the description that they leave out. Where the two differ the next record must be found by one of them; where it is
    found by neither, what follows is left.

    Raises:
        FormatError: a parameter that decides positions is given twice, with two values.
    """
    records, findings, at = [], [], 4
    while (record := _record(section, at, processor)) is not None:
        bare = record.stated == record.bare and _follows(section, record.bare, processor, more=True)
        ways = [record.bare] if bare else list(dict.fromkeys((record.counted, record.stated)))
        after = [way for more in (True, False) for way in ways if _follows(section, way, processor, more=more)]
        if len(ways) > 1:
            findings.append(f"the length of the parameter {record.name} differs from the one that it states")
        if not after:
            findings.append(f"what follows the parameter {record.name} at byte {start + at} cannot be read")
        if not after or after[0] >= record.bare:
            records.append(record)
        if not after:
            break
        at = after[0]
    groups = {-record.group: record.name for record in records if record.group < 0}
    found: dict[str, Any] = {}
    for record in records:
        if record.group > 0:
            key = f"{groups.get(record.group, record.group)}:{record.name}"
            if key in found and _DECISIVE.fullmatch(key) and not np.array_equal(found[key], record.value):
                raise not_read(path, f"the parameter {key} is given twice, with two values")
            if key in found:
                findings.append(f"the parameter {key} is given twice: the first is used")
            found.setdefault(key, record.value)
    return found, findings


def _follows(section: bytes, at: int, processor: int, *, more: bool = False) -> bool:
    """Whether a record is there, or (unless ``more``) the end of the section."""
    ends = at >= len(section) - 1 or section[at] == 0
    if ends:
        return not more and at <= len(section)
    return _record(section, at, processor) is not None


def _record(section: bytes, at: int, processor: int) -> _Record | None:
    """The record at a byte of the section; None where none is: at the end, or where it does not fit."""
    if not 0 < at < len(section) - 4 or section[at] == 0:
        return None
    length, group = abs(int(np.int8(np.uint8(section[at])))), int(np.int8(np.uint8(section[at + 1])))
    link = at + 2 + length
    name = section[at + 2 : link]
    if group == 0 or link + 4 > len(section) or not all(31 < letter != 127 for letter in name):
        return None
    stated = int.from_bytes(section[link : link + 2], "big" if processor == SGI else "little")
    value, body = None, link + 2
    if group > 0:
        kind, rank = int(np.int8(np.uint8(section[body]))), section[body + 1]
        sizes = list(section[body + 2 : body + 2 + rank])
        if kind not in _KINDS or rank > 7:
            return None
        count = int(np.prod(sizes, dtype=np.int64))
        values_at = body + 2 + rank
        body = values_at + count * _KINDS[kind]
        if body >= len(section):
            return None
        value = _value(section[values_at:body], kind, sizes, processor)
    counted = body + 1 + section[body]
    if counted > len(section):
        return None
    return _Record(group, name.decode("latin-1").upper(), value, link + stated if stated else counted, counted, body)


def _value(data: bytes, kind: int, sizes: list[int], processor: int) -> Any:
    if kind == -1:
        length = sizes[0] if sizes else 1
        text = [data[i : i + length] for i in range(0, len(data), length)] if length else []
        return [_word(word) for word in text]
    if kind == 1:
        return np.frombuffer(data, dtype=np.int8)
    return whole_numbers(data, processor) if kind == 2 else reals(data, processor)


def _word(text: bytes) -> str:
    """A word without the blanks that fill it up, in UTF-8 or in the letters of western Europe."""
    try:
        return text.decode("utf-8").strip(" \0")
    except UnicodeDecodeError:
        return text.decode("latin-1").strip(" \0")


def record(group: int, name: str, value: Any = None) -> bytes:
    """The record of a group (below 0), or of a parameter of it, as Intel's processors lay it out.

    The value of a parameter is a ``numpy.uint16``, a ``numpy.float32``, or words in bytes.
    """
    if value is None:
        body = b""
    elif isinstance(value, list):
        length = max(map(len, value))
        body = bytes([255, 2, length, len(value)]) + b"".join(word.ljust(length) for word in value)
    else:
        body = bytes([4 if value.dtype.kind == "f" else 2, 0]) + value.tobytes()
    offset = (len(body) + 3).to_bytes(2, "little")  # to the next record: itself, the body, an empty description
    return bytes([len(name), group % 256]) + name.encode() + offset + body + b"\0"
