"""C3D files of all three processors, whole numbers and reals; what the head says is held against the file's size."""

import re
import struct
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.contents import FILLED, FileContents, point_recording, points_of
from mocap.io.format import Format
from mocap.io.lines import RATES_HZ, metres, told_apart, unit_of
from mocap.records import Status
from mocap.text import number_of

BLOCK = 512  # bytes, of the format
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
class C3dHead:
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


def read_head(path: Path, data: bytes) -> C3dHead:
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
    return C3dHead(
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
    offset = int.from_bytes(section[link : link + 2], "big" if processor == SGI else "little")
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
    return _Record(group, name.decode("latin-1").upper(), value, link + offset if offset else counted, counted, body)


def _value(data: bytes, kind: int, sizes: list[int], processor: int) -> Any:
    if kind == -1:
        length = sizes[0] if sizes else 1
        text = [data[i : i + length] for i in range(0, len(data), length)] if length else []
        return [_word(word) for word in text]
    if kind == 1:
        return np.frombuffer(data, dtype=np.int8)
    return whole_numbers(data, processor) if kind == 2 else reals(data, processor)


def _word(text: bytes) -> str:
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


_NOT_POSITIONS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Groups of points (parameter POINT) that are modelled quantities, not places."""
_SAME = 1e-5
"""Relative difference of two 32-bit reals that were written as one. Chosen; not measured."""
_MOST_FRAMES = 0xFFFF
"""The head counts with 16 bits: longer recordings state that number or their own without its upper bits."""
_MOST_COUNTS = 255
"""Counts of a residual that a byte holds."""
_RESIDUAL_M = 1e-5
"""One count of a residual as it is written here."""


def read_c3d(path: Path) -> FileContents:
    """Read the points of a C3D file that are positions.

    A residual below 0 is a sample that was not seen, 0 an interpolated or filtered one, above 0 a measured one. A file
    without any residual above 0 does not record them: what it holds is called measured. The table ``residual_m``
    (T, M) holds the residuals above 0, in the unit of the points.

    Raises:
        FormatError: the file is cut, or what decides positions is contradicted.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    head = read_head(path, data)
    layout, findings = _layout(path, head, data)
    values, residual, odd = _samples(head, layout, data)
    if odd:
        findings.append(f"{number_of(odd, 'sample has', 'samples have')} an invalid entry for residual and cameras")
    labels = _labels(head, layout.points)
    model = {label for group in _NOT_POSITIONS for label in head.words(f"POINT:{group}")}
    keep = np.array([name not in model for name in labels])
    if not keep.all():
        only = "" if keep.any() else ", and it contains nothing else: no markers"
        findings.append(f"{(~keep).sum()} modelled quantities (angles, forces, ...) were left out{only}")
    names, renamed = told_apart([name for name, kept in zip(labels, keep, strict=True) if kept])
    findings += renamed
    unit_text = (head.words("POINT:UNITS") or [""])[0].strip().lower()
    unit = unit_of(unit_text)
    if unit is None and unit_text:
        findings.append(f"POINT:UNITS is {unit_text!r}, which is no unit of lengths")
    fps, rate_findings = _rate(head)
    findings += rate_findings
    start = _long_number(head, "TRIAL:ACTUAL_START_FIELD")
    if start not in (0, head.first) and head.first < _MOST_FRAMES:
        findings.append(
            f"the first frame is {head.first} in the header, {start} in TRIAL:ACTUAL_START_FIELD: the first is used"
        )
    xyz, residual = values[:, keep], residual[:, keep]
    there = np.isfinite(xyz).all(axis=-1)
    seen = there & (residual >= 0)
    if not seen.any() and (there & (xyz != 0).any(axis=-1)).any():
        findings.append("every sample is marked as invalid (residual -1), although there are coordinates")
    xyz[~seen] = np.nan
    filled = Status.INTERPOLATED if (residual > 0).any() else Status.MEASURED
    if filled == Status.MEASURED and seen.any():
        findings.append("the file contains no residuals: every sample with a position counts as measured")
    scale = 1.0 if unit is None else metres(path, unit)
    return point_recording(
        path,
        "c3d",
        names=names,
        xyz=xyz,
        unit=unit,
        frames=head.first + np.arange(len(xyz)),
        fps=fps,
        status=np.where(seen, np.where(residual > 0, Status.MEASURED, filled), Status.MISSING),
        tables={"residual_m": np.where(seen & (residual > 0), residual * scale, np.nan)},
        saturated=seen & _saturated(residual / abs(layout.scale)),
        findings=(*head.findings, *findings),
    )


@dataclass(frozen=True)
class _Layout:
    """What decides which bytes are whose: numbers a frame, the byte at which data begin, the scale, and the frames."""

    points: int
    analog: int
    data_at: int
    scale: float
    frames: int

    @property
    def frame_bytes(self) -> int:
        return (4 * self.points + self.analog) * (4 if self.scale < 0 else 2)


def _layout(path: Path, head: C3dHead, data: bytes) -> tuple[_Layout, list[str]]:
    """The layout that fills the file, of all that head and parameters state, and a finding for each other statement.

    Most files state each number twice, and many programs state one of them wrongly. The size of the file says which:
    data fill it to the byte, or to the end of its last block; where everything agrees more may follow.

    Raises:
        FormatError: the file is cut, no layout fits its size, or two do as well as each other.
    """
    statements, size = _statements(head), len(data)
    if not any(statements["points"].values()):
        raise FormatError(f"{path.name}: contains no points: export the trajectories, not only analog channels")
    if not statements["scale"]:
        raise not_read(path, f"the scale of the points is {head.scale:g}")
    if max(statements["frames"].values()) < 1:
        raise FormatError(f"{path.name}: contains no frames: export the trajectories again")
    more = (head.number("ROTATION:USED") or 0) > 0  # its data follow those of the points
    ranks: dict[_Layout, tuple[bool, int, bool]] = {}
    for values in product(*(dict.fromkeys(own.values()) for own in statements.values())):
        layout = _Layout(*values)
        if not layout.points or layout.frames < 1:
            continue
        left = size - layout.data_at - layout.frames * layout.frame_bytes
        whole = left == 0 or (left > 0 and (more or (left < BLOCK and size % BLOCK == 0)))
        agreed = list(statements["frames"].values()).count(layout.frames) > 1
        count = left // layout.frame_bytes + layout.frames
        if (
            not whole
            and count > _MOST_FRAMES
            and all(_agrees("frames", n, count) for n in statements["frames"].values())
        ):
            layout, whole = replace(layout, frames=count), left % layout.frame_bytes == 0
        # bytes that were inserted are fewer than a block: only more than one can be what a writer reserved
        if whole or (agreed and left >= (BLOCK if size % BLOCK == 0 else 2 * BLOCK)):
            others = sum(not _agrees(k, v, getattr(layout, k)) for k, own in statements.items() for v in own.values())
            tail = data[layout.data_at + layout.frames * layout.frame_bytes :]
            ranks[layout] = (not whole, others, any(tail[:BLOCK]))  # what fills a block up is mostly 0
    best = [layout for layout, rank in ranks.items() if rank == min(ranks.values())]
    # of reals the scale is only that of residuals: the first is used
    if len({replace(one, scale=one.scale if one.scale > 0 else -1.0) for one in best}) == 1:
        return best[0], _contradictions(statements, best[0], size, more)
    first = _Layout(*(next(iter(own.values())) for own in statements.values()))
    room, least = size - first.data_at, min(statements["frames"].values())
    if not best and first.points and 0 < least * first.frame_bytes > room:
        raise FormatError(
            f"{path.name}: {number_of(least, 'frame is', 'frames are')} stated, but the file contains "
            f"{max(room // first.frame_bytes, 0)}: copy or export it again"
        )
    what = "; ".join(f"{words.format(' or '.join(f'{v:g}' for v in dict.fromkeys(statements[key].values())))}"
                     for key, words in _WORDS.items())  # fmt: skip
    raise not_read(path, f"{what} do not fill its {size} bytes" if not best else f"{what}: the size fits several")


_WORDS = {
    "points": "{} points",
    "analog": "{} analog values a frame",
    "data_at": "data from byte {}",
    "scale": "a scale of {}",
    "frames": "{} frames",
}
"""Of each part of a layout, how it is called."""


def _statements(head: C3dHead) -> dict[str, dict[str, Any]]:
    """Who states what of each part of a layout; what no file can have is left out."""
    channels, starts = head.number("ANALOG:USED"), head.number("POINT:DATA_START")
    ends = {"POINT:DATA_START": BLOCK * (int(starts or 0) - 1), "the block count of the parameters": head.blocks_end}
    places = {"the header": head.data_at} | {who: at for who, at in ends.items() if at >= 2 * BLOCK}
    scales = {"the header": head.scale, "POINT:SCALE": head.number("POINT:SCALE")}
    frames = {"the header": head.last - head.first + 1}
    for key in ("POINT:FRAMES", "POINT:LONG_FRAMES"):
        if (number := head.number(key)) is not None:
            frames[key] = int(number) & 0xFFFF if number < 0 else int(number)
    if last := _long_number(head, "TRIAL:ACTUAL_END_FIELD"):
        start = _long_number(head, "TRIAL:ACTUAL_START_FIELD") or head.first
        frames["TRIAL:ACTUAL_END_FIELD"] = last - start + 1
    used = head.number("POINT:USED")
    return {
        "points": {"the header": head.points} | ({} if used is None else {"POINT:USED": int(used) & 0xFFFF}),
        "analog": {"the header": head.analog}
        | ({} if channels is None else {"ANALOG:USED": (int(channels) & 0xFFFF) * head.analog_per_frame}),
        "data_at": {who: at for who, at in places.items() if at > 0},
        "scale": {who: s for who, s in scales.items() if s is not None and np.isfinite(s) and 1e-9 < abs(s) < 1e9},
        "frames": frames,
    }


def _agrees(part: str, value: float, chosen: float) -> bool:
    """Whether a statement is that of a layout, as far as its bits and digits can say it."""
    if part == "frames" and chosen > _MOST_FRAMES:
        return value in (chosen, int(chosen) & 0xFFFF, _MOST_FRAMES)
    return abs(value - chosen) <= (_SAME * abs(chosen) if part == "scale" else 0)


def _contradictions(statements: dict[str, dict[str, Any]], layout: _Layout, size: int, more: bool) -> list[str]:
    """A sentence for each statement that is not that of the layout, and on what follows the data."""
    findings = [
        f"{who} states {_WORDS[part].format(f'{value:g}')}, but the file contains "
        f"{_WORDS[part].format(f'{getattr(layout, part):g}')}"
        for part, own in statements.items()
        for who, value in own.items()
        if not _agrees(part, value, getattr(layout, part))
    ]
    left = size - layout.data_at - layout.frames * layout.frame_bytes
    return [*findings, *([f"{left} bytes after the last frame were ignored"] if left >= BLOCK and not more else [])]


def _rate(head: C3dHead) -> tuple[float | None, list[str]]:
    """Frames a second by the head, else by POINT:RATE, and a finding where they differ or are none."""
    rates = {"the header": head.rate_hz, "POINT:RATE": head.number("POINT:RATE")}
    sane = {who: rate for who, rate in rates.items() if rate is not None and RATES_HZ[0] <= rate <= RATES_HZ[1]}
    if not sane:
        return None, [f"the frame rate in the file is {head.rate_hz:g}"]
    who, fps = next(iter(sane.items()))
    odd = [(w, r) for w, r in rates.items() if r is not None and abs(r - fps) > _SAME * fps]
    return fps, [f"the frame rate is {r:g} in {w}, {fps:g} in {who}: the latter is used" for w, r in odd]


def _long_number(head: C3dHead, key: str) -> int:
    """A number of two 16-bit words, the lower first; 0 where it is absent."""
    words = head.parameters.get(key)
    if not isinstance(words, np.ndarray) or words.size != 2 or not np.isfinite(words).all():
        return 0
    low, high = (int(word) & 0xFFFF for word in words)
    return low + (high << 16)


def _samples(head: C3dHead, layout: _Layout, data: bytes) -> tuple[Array, Array, int]:
    """(T, P, 3) coordinates and (T, P) residuals in the unit of the file, and samples whose fourth word is none.

    The fourth word holds the cameras in its lower byte and a residual in the upper one, or is below 0.
    """
    real, step = layout.scale < 0, abs(layout.scale)
    body = data[layout.data_at : layout.data_at + layout.frames * layout.frame_bytes]
    raw = (reals if real else whole_numbers)(body, head.processor).reshape(layout.frames, -1)
    words = raw[:, : 4 * layout.points].reshape(layout.frames, layout.points, 4)
    with np.errstate(invalid="ignore"):
        xyz = words[..., :3].astype(np.float64) * (1.0 if real else step)
        fourth: NDArray = words[..., 3].astype(np.float64)
        whole = (fourth == np.round(fourth)) & (np.abs(fourth) <= 0xFFFF)
    number = np.where(whole, fourth, -1).astype(np.int64)
    residual = np.where(number < 0, -1.0, (number >> 8) * step)
    return xyz, residual, int((~whole).sum())


def _saturated(counts: Array) -> NDArray[np.bool_]:
    """Residuals, in counts, that are the largest their byte holds; half of it where the word has a sign, as written."""
    most = _MOST_COUNTS if counts.max(initial=0) > _MOST_COUNTS // 2 else _MOST_COUNTS // 2
    return np.asarray(np.round(counts) >= most)


def _labels(head: C3dHead, points: int) -> list[str]:
    """LABELS, continued in LABELS2, LABELS3, ...; empty for a point without one."""
    labels, following = list(head.words("POINT:LABELS")), 2
    while len(labels) < points and f"POINT:LABELS{following}" in head.parameters:
        labels += head.words(f"POINT:LABELS{following}")
        following += 1
    return [label.strip() for label in labels[:points]] + [""] * (points - len(labels))


def write_c3d(path: Path, recording: FileContents) -> None:
    """Write positions as 32-bit reals of Intel's order, in the unit of the recording.

    The residual says where a sample comes from: -1 not seen (or rejected), 0 filled, above 0 measured: the residual
    that the recording holds, else the standard deviation, else the smallest that can be said, 0.01 mm.

    Raises:
        FormatError: there are too many frames, or a name is empty or longer than 120 bytes.
    """
    tracks, unit = points_of(path, recording), recording.unit or "m"
    count, fps = len(tracks.t_s), float(recording.fps or 1.0)
    if count > _MOST_FRAMES:
        raise FormatError(
            f"{path.name}: {count} frames, but a C3D file can contain {_MOST_FRAMES}: split the recording"
        )
    names = [name.encode() for name in tracks.names]
    bad = next((name for name in names if not name.strip() or len(name) > 120), None)
    if bad is not None:
        raise FormatError(f"{path.name}: marker name {bad.decode()!r} is empty or longer than 120 bytes: rename it")
    length_m = metres(path, unit)
    size = recording.tables.get("residual_m", tracks.sd_m)
    counts = np.clip(np.round(np.nan_to_num(size, nan=0.0) / _RESIDUAL_M), 1, _MOST_COUNTS)
    counts[np.isin(tracks.status, FILLED)] = 0
    body = np.zeros((count, len(names), 4), dtype="<f4")
    body[..., :3] = np.where(tracks.seen[..., None], tracks.xyz_m / length_m, 0.0)
    body[..., 3] = np.where(tracks.seen, counts * 256, -1)
    start = int(recording.frames[0]) if count else 1
    first = start if 0 < start <= _MOST_FRAMES + 1 - count else 1
    scale = -_RESIDUAL_M / length_m
    sections = [names[i : i + 255] for i in range(0, len(names), 255)]  # labels in one parameter
    blocks = 0
    for _ in range(2):  # the place of the data stands among the parameters, which are as long whatever it is
        section = b"\1\x50" + bytes([blocks % 256, INTEL]) + record(-1, "POINT") + record(-2, "ANALOG")
        section += record(1, "USED", np.uint16(len(names))) + record(1, "FRAMES", np.uint16(count))
        section += record(1, "SCALE", np.float32(scale)) + record(1, "RATE", np.float32(fps))
        section += record(1, "DATA_START", np.uint16(2 + blocks)) + record(1, "UNITS", [unit.encode()])
        for number, part in enumerate(sections, start=1):
            section += record(1, "LABELS" if number == 1 else f"LABELS{number}", part)
        section += record(2, "USED", np.uint16(0)) + record(2, "RATE", np.float32(fps))
        section += bytes(BLOCK - len(section) % BLOCK)  # at least one 0, which ends the parameters
        blocks = len(section) // BLOCK
    words = (0x5002, len(names), 0, first, first + count - 1, 10)  # 10 frames: the largest gap that was interpolated
    head = struct.pack("<6HfHHf", *words, scale, 2 + blocks, 0, fps)
    data = body.tobytes()
    path.write_bytes(head.ljust(BLOCK, b"\0") + section + data + bytes(-len(data) % BLOCK))


C3D = Format(
    name="c3d",
    title="C3D",
    knows=lambda head: len(head.start) > 512 and head.start[1] == 0x50 and 2 <= head.start[0] <= 0x7F,
    read=lambda path, _: read_c3d(path),
    write=write_c3d,
    holds=frozenset({"points", "first_frame", "fps", "unit", "origin", "residual_m", "sd"}),
    needs=frozenset({"fps", "unit"}),
    zero_is_missing=True,
    suffixes=(".c3d",),
    signs="binary c3d",
)
