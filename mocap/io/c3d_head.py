"""The head of a C3D file: sixteen words that place the data, and the records of parameters (c3d.org, user guide).

Nothing in it is believed by itself: records must follow each other as their own sizes say.
"""

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
_MOST_EVENTS = 18


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
    """The head of a file.

    Args:
        path: Of the file, for messages.
        data: The whole file.

    Raises:
        FormatError: it is cut, or its parts do not follow each other.
    """
    start = BLOCK * (data[0] - 1) if data else 0
    if len(data) < BLOCK or data[1] != 0x50 or not 0 < start <= len(data) - 4:
        raise damaged(path, "does not begin like a C3D file, or is cut within its header")
    processor, blocks = data[start + 3], data[start + 2]
    if processor not in (INTEL, DEC, SGI):
        raise damaged(path, f"byte {start + 3} is {processor}; expected the processor: 84, 85 or 86")
    words = np.frombuffer(data[:BLOCK], dtype=">u2" if processor == SGI else "<u2")
    data_at = BLOCK * (int(words[8]) - 1)
    room = (data_at - start) // BLOCK
    end = data_at if room > 0 and room % 256 == blocks else start + BLOCK * blocks  # a byte counts the blocks
    if not start < end <= min(data_at, len(data)):
        raise damaged(path, f"parameters end at byte {end}, data begin at {data_at}, the file has {len(data)}")
    scale, rate_hz = (float(reals(data[at : at + 4], processor)[0]) for at in (12, 20))
    parameters, findings = _parameters(path, data[start:end], processor, start)
    if words[150] > _MOST_EVENTS:
        findings.append(f"the head counts {words[150]} events; it has room for {_MOST_EVENTS}")
    return Head(
        processor=processor,
        points=int(words[1]),
        analog=int(words[2]),
        first=int(words[3]),
        last=int(words[4]),
        scale=scale,
        data_at=data_at,
        analog_per_frame=int(words[9]),
        rate_hz=rate_hz,
        parameters=parameters,
        findings=tuple(findings),
    )


def damaged(path: Path, trouble: str) -> FormatError:
    """The error of a file whose parts contradict each other."""
    return FormatError(f"{path.name}: the header of this C3D file is damaged ({trouble}): copy or export it again")


@dataclass(frozen=True)
class _Record:
    """A group or a parameter: its group's number, name, value (None of a group), and the two ways to the next one."""

    group: int
    name: str
    value: Any
    stated: int
    counted: int


def _parameters(path: Path, section: bytes, processor: int, start: int) -> tuple[dict[str, Any], list[str]]:
    """Values of all parameters by ``GROUP:NAME``, and findings.

    Each record states where the next one is, and has a size of its own. Where the two differ the next record must be
    found by one of them.

    Raises:
        FormatError: it is found by neither, or a name is given twice.
    """
    records, findings, at = [], [], 4
    while (record := _record(section, at, processor)) is not None:
        stated, counted = (_follows(section, step, processor) for step in (record.stated, record.counted))
        if record.stated == record.counted and stated:
            at = record.counted
        elif stated and record.stated > record.counted and not _follows(section, record.counted, processor, more=True):
            at = record.stated
        elif counted:
            at = record.counted
        else:
            raise damaged(path, f"no parameter follows {record.name!r} at byte {start + at}")
        if record.stated != record.counted:
            findings.append(f"the length of the parameter {record.name} differs from the one that it states")
        records.append(record)
    groups = {-record.group: record.name for record in records if record.group < 0}
    found: dict[str, Any] = {}
    for record in records:
        if record.group > 0:
            key = f"{groups.get(record.group, record.group)}:{record.name}"
            if key in found:
                raise damaged(path, f"the parameter {key} is given twice")
            found[key] = record.value
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
    if group == 0 or link + 4 > len(section) or not all(31 < letter < 127 for letter in name):
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
    return _Record(group, name.decode("ascii").upper(), value, link + stated if stated else counted, counted)


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
