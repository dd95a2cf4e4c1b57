"""C3D files of all three processors, whole numbers and reals; what the head says is held against the file's size."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.c3d_head import BLOCK, Head, damaged, read_head, reals, whole_numbers
from mocap.io.contents import FileContents, point_recording
from mocap.io.optical import UNIT_M, metres, told_apart
from mocap.records import Status

_NOT_POSITIONS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Groups of points (parameter POINT) that are modelled quantities, not places."""
_SAME = 1e-5
"""Relative difference of two 32-bit reals that were written as one."""
_MOST_FRAMES = 0xFFFF
"""The head counts with 16 bits: longer recordings state that number or their own without its upper bits."""


def read_c3d(path: Path) -> FileContents:
    """Read the points of a C3D file that are positions.

    A residual below 0 is a sample that was not seen, 0 an interpolated or filtered one, above 0 a measured one. A file
    without any residual above 0 does not record them: what it holds is called measured. The table ``residual_m``
    (T, M) holds the residuals above 0, in the unit of the points.

    Raises:
        FormatError: the file is cut, its parts contradict each other, or names are missing.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    head = read_head(path, data)
    count, findings = _layout(path, head, len(data))
    values, residual, odd = _samples(head, data, count)
    if odd:
        findings.append(f"{odd} samples have an invalid entry for residual and cameras: the file is damaged")
    labels = _labels(path, head)
    model = {label for group in _NOT_POSITIONS for label in head.words(f"POINT:{group}")}
    keep = np.array([name not in model for name in labels])
    if not keep.all():
        findings.append(f"{(~keep).sum()} modelled quantities (angles, forces, ...) were left out")
    names, renamed = told_apart([name for name, kept in zip(labels, keep, strict=True) if kept])
    findings += renamed
    said = (head.words("POINT:UNITS") or [""])[0].strip().lower()
    unit = said if said in UNIT_M else None
    if unit is None:
        findings.append(f"the unit of lengths is {said!r}" if said else "the unit of lengths is not in the file")
    fps = head.rate_hz if head.rate_hz > 0 else None
    if fps is None:
        findings.append(f"the frame rate in the file is {head.rate_hz:g}")
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
        findings=(*head.findings, *findings),
    )


def _layout(path: Path, head: Head, size: int) -> tuple[int, list[str]]:
    """Frames that the file holds, and findings; the head, the parameters and the file's size must agree.

    Raises:
        FormatError: they do not, and the size does not tell which is right.
    """
    if not head.points:
        raise FormatError(f"{path.name}: contains no points: export the trajectories, not only analog channels")
    points = head.number("POINT:USED")
    if points is not None and points != head.points:
        raise damaged(path, f"{head.points} points in its first block, {points:g} in POINT:USED")
    channels, findings = head.number("ANALOG:USED"), []
    if channels is not None and channels * head.analog_per_frame != head.analog:
        told = f"{head.analog} analog values a frame, by ANALOG:USED {channels:g}, each {head.analog_per_frame} times"
        if head.analog:
            raise damaged(path, told)
        findings.append(told)
    scale = head.number("POINT:SCALE")
    if not (np.isfinite(head.scale) and 1e-9 < abs(head.scale) < 1e9):
        raise damaged(path, f"the scale of the points is {head.scale:g}")
    if scale is not None and abs(scale - head.scale) > _SAME * abs(head.scale):
        if head.scale > 0 or scale > 0:
            raise damaged(path, f"the scale of the points is {head.scale:g} in the header, {scale:g} in POINT:SCALE")
        findings.append(
            f"the scale of residuals is {head.scale:g} in the header, {scale:g} in POINT:SCALE: the first is used"
        )
    starts = head.number("POINT:DATA_START")
    if starts and BLOCK * (int(starts) - 1) != head.data_at:
        findings.append(f"the data begin at byte {head.data_at}, but POINT:DATA_START states block {starts:g}")
    if not 0 <= head.rate_hz < 1e7 or 0 < head.rate_hz < 1e-4:
        raise damaged(path, f"the frame rate is {head.rate_hz:g}")
    rate = head.number("POINT:RATE")
    if rate is not None and abs(rate - head.rate_hz) > _SAME * head.rate_hz:
        findings.append(f"the frame rate is {head.rate_hz:g} in the header, {rate:g} in POINT:RATE: the first is used")
    start = _long_number(head, "TRIAL:ACTUAL_START_FIELD")
    if start not in (0, head.first) and head.first < _MOST_FRAMES:
        findings.append(
            f"the first frame is {head.first} in the header, {start} in TRIAL:ACTUAL_START_FIELD: the first is used"
        )
    count, told = _frames(path, head, size)
    return count, [*findings, *told]


def _frames(path: Path, head: Head, size: int) -> tuple[int, list[str]]:
    """The number of frames that head, parameters and size tell, and what is to be said where not all tell the same.

    Raises:
        FormatError: the file is cut, or none fits its size.
    """
    frame = (4 * head.points + head.analog) * (4 if head.scale < 0 else 2)
    room = size - head.data_at
    more = (head.number("ROTATION:USED") or 0) > 0  # its data follow those of the points

    def fits(count: int) -> bool:
        left = room - frame * count
        return count > 0 and (left == 0 or (left > 0 and (more or (left < BLOCK and size % BLOCK == 0))))

    said = {"the first block": head.last - head.first + 1}
    for key in ("POINT:FRAMES", "POINT:LONG_FRAMES"):
        if (stated := head.number(key)) is not None:
            said[key] = int(stated) & 0xFFFF if stated < 0 else int(stated)
    if last := _long_number(head, "TRIAL:ACTUAL_END_FIELD"):
        said["TRIAL:ACTUAL_END_FIELD"] = last - (_long_number(head, "TRIAL:ACTUAL_START_FIELD") or head.first) + 1
    first, *others = said.values()
    agreed = fits(first) and (not others or first in others)
    fitting = {first} if agreed else {count for count in said.values() if fits(count)}
    if len(fitting) == 1:
        count = fitting.pop()
        whole = (count, count & 0xFFFF, _MOST_FRAMES) if count > _MOST_FRAMES else (count,)
        return count, [
            f"{key} states {other} frames, but the file contains {count}: was it cut or edited?"
            for key, other in said.items()
            if other not in whole
        ]
    left = room - frame * first
    if first in others and left >= BLOCK and size % BLOCK == 0:
        return first, [f"{left} bytes after the last frame were ignored"]
    if min(said.values()) > 0 and frame * min(said.values()) > room:
        raise FormatError(
            f"{path.name}: {min(said.values())} frames are stated, but the file contains {max(room // frame, 0)}: "
            "it is cut; export it again"
        )
    counts = " or ".join(str(count) for count in sorted(set(said.values())))
    raise damaged(path, f"{counts} frames of {frame} bytes do not fill the {room} bytes of data")


def _long_number(head: Head, key: str) -> int:
    """A number of two 16-bit words, the lower first; 0 where it is absent."""
    words = head.parameters.get(key)
    if not isinstance(words, np.ndarray) or words.size != 2 or not np.isfinite(words).all():
        return 0
    low, high = (int(word) & 0xFFFF for word in words)
    return low + (high << 16)


def _samples(head: Head, data: bytes, count: int) -> tuple[Array, Array, int]:
    """(T, P, 3) coordinates and (T, P) residuals in the unit of the file, and samples whose fourth word is none.

    The fourth word holds the cameras in its lower byte and a residual in the upper one, or is below 0.
    """
    real = head.scale < 0
    width = 4 * head.points + head.analog
    body = data[head.data_at : head.data_at + (4 if real else 2) * width * count]
    raw = (reals if real else whole_numbers)(body, head.processor).reshape(count, width)
    words = raw[:, : 4 * head.points].reshape(count, head.points, 4)
    step = abs(head.scale)
    with np.errstate(invalid="ignore"):
        xyz = words[..., :3].astype(np.float64) * (1.0 if real else step)
        fourth: NDArray = words[..., 3].astype(np.float64)
        whole = (fourth == np.round(fourth)) & (np.abs(fourth) <= 0xFFFF)
    number = np.where(whole, fourth, -1).astype(np.int64)
    residual = np.where(number < 0, -1.0, (number >> 8) * step)
    return xyz, residual, int((~whole).sum())


def _labels(path: Path, head: Head) -> list[str]:
    """LABELS, continued in LABELS2, LABELS3, ..."""
    labels, following = list(head.words("POINT:LABELS")), 2
    while len(labels) < head.points and f"POINT:LABELS{following}" in head.parameters:
        labels += head.words(f"POINT:LABELS{following}")
        following += 1
    if len(labels) < head.points:
        raise FormatError(
            f"{path.name}: {head.points} points, but {len(labels)} labels: name the others and export again"
        )
    return [label.strip() for label in labels[: head.points]]
