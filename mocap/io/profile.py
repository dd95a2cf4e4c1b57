"""Camera profiles (Argus, easyWand): one line for each camera, ``cam f W H cx cy AR k1 k2 p1 p2 k3``.

Cells are separated by spaces or tabs, or by commas as spreadsheets write them; a line of titles may come first.

Argus's bundle adjustment writes another, ``f cx cy AR skew k1 k2 t1 t2 k3 q0 q1 q2 q3 tx ty tz``, which also states
where the cameras are.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mocap.cameras.camera import Camera, pinhole_camera
from mocap.cameras.lens import BrownLens
from mocap.errors import CalibrationError, FormatError
from mocap.io import lines
from mocap.io.contents import FileContents, calibration_recording
from mocap.io.easywand import read_tform
from mocap.io.format import Format, Head, Hints, file_format, head

_COLUMNS = ("cam", "f", "w", "h", "cx", "cy", "ar", "k1", "k2", "p1", "p2", "k3")
_ALSO = {
    "camera": "cam", "focal": "f", "focal length": "f", "width": "w", "height": "h", "aspect": "ar",
    "aspect ratio": "ar",
}  # fmt: skip
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?", re.ASCII)
_OTHERS = {13: "an omnidirectional (CMei) camera", 17: "an Argus bundle-adjustment profile", 19: "a Scaramuzza camera"}


def read_profile(path: Path) -> tuple[tuple[BrownLens, tuple[int, int]], ...]:
    """Read lenses and image sizes (width, height) of all cameras, in the order of their numbers.

    The pixel aspect ratio AR scales the vertical focal length: fy = f AR.

    Raises:
        FormatError: a line has not 12 numbers, belongs to a camera model that is not supported, or repeats a camera.
    """
    lenses: dict[float, tuple[BrownLens, tuple[int, int]]] = {}
    for number, line in _lines(path):
        if len(line) != 12:
            other = f" ({_OTHERS[len(line)]}: not supported as a lens)" if len(line) in _OTHERS else ""
            raise FormatError(
                f"{path.name}: line {number} has {len(line)} columns{other}; "
                "expected 12: cam f W H cx cy AR k1 k2 p1 p2 k3"
            )
        camera, f, width, height, cx, cy, aspect, k1, k2, p1, p2, k3 = _numbers(path, number, line)
        if not (f > 0 and aspect > 0 and width >= 1 and height >= 1):
            raise FormatError(
                f"{path.name}: line {number} describes no camera: focal length, aspect ratio and image size must be "
                f"positive, all numbers finite: {' '.join(line)}"
            )
        if camera in lenses:
            raise FormatError(
                f"{path.name}: line {number} describes camera {line[0]} again: number the cameras 1, 2, ..."
            )
        lens = BrownLens(f_px=(f, f * aspect), centre_px=(cx, cy), k=(k1, k2, k3), p=(p1, p2))
        lenses[camera] = (lens, (int(width), int(height)))
    return tuple(lenses[camera] for camera in sorted(lenses))


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Number and cells of each line that is not empty, without a line of titles, in the order of ``_COLUMNS``."""
    try:
        texts = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FormatError(f"{path.name}: not a text file; expected a camera profile") from None
    found = [(number, _cells(text)) for number, text in enumerate(texts, start=1) if text.strip()]
    if found and (order := _titled(found[0][1])):
        found = [(n, [cells[i] for i in order] if len(cells) == len(order) else cells) for n, cells in found[1:]]
    if not found:
        raise FormatError(f"{path.name}: the file is empty; expected a camera profile, one line for each camera")
    return found


def _cells(text: str) -> list[str]:
    return _spaced(text) or re.split(r"\s*,\s*", text.strip())


def _spaced(text: str) -> list[str]:
    """The cells of a line that spaces or tabs separate, decimal commas read as points; none where commas separate."""
    cells = text.split()
    if "," in text and (len(cells) == 1 or any("," in cell and not _DECIMAL_COMMA.fullmatch(cell) for cell in cells)):
        return []
    return [cell.replace(",", ".") for cell in cells]


def _titled(cells: Sequence[str]) -> list[int]:
    """Where each of ``_COLUMNS`` is by the titles of a first line; empty where it is not a line of titles."""
    titles = [_ALSO.get(cell.strip().lower(), cell.strip().lower()) for cell in cells]
    return [titles.index(title) for title in _COLUMNS] if sorted(titles) == sorted(_COLUMNS) else []


def _numbers(path: Path, number: int, line: list[str]) -> list[float]:
    values = [lines.number(cell) for cell in line]
    odd = [cell for cell, value in zip(line, values, strict=True) if not abs(value) <= lines.LARGEST]
    if odd:
        raise FormatError(f"{path.name}: line {number} contains something that is not a number: {' '.join(line)}")
    return values


def read_sba_profile(path: Path) -> tuple[Camera, ...]:
    """Read the cameras of an Argus bundle adjustment, in the unit of its wand.

    The quaternion (scalar first) and the translation take world to camera coordinates, as in the sba library (Lourakis
    & Argyros 2009).

    Raises:
        FormatError: a line has not 17 finite numbers that describe a camera, or has skew, which lenses here have not.
    """
    from scipy.spatial.transform import Rotation

    cameras = []
    for number, line in _lines(path):
        if len(line) != 17:
            raise FormatError(
                f"{path.name}: line {number} has {len(line)} columns; expected 17: f cx cy AR skew k1 k2 t1 t2 k3 q0 "
                "q1 q2 q3 tx ty tz"
            )
        f, cx, cy, aspect, skew, k1, k2, p1, p2, k3, q0, q1, q2, q3, *shift = _numbers(path, number, line)
        length = np.linalg.norm([q0, q1, q2, q3])
        if not (f > 0 and aspect > 0 and length > 0.1 and skew == 0):
            raise FormatError(
                f"{path.name}: line {number} describes no camera: focal length and aspect ratio must be positive, the "
                "quaternion of length 1, the skew 0, all numbers finite"
            )
        lens = BrownLens(f_px=(f, f * aspect), centre_px=(cx, cy), k=(k1, k2, k3), p=(p1, p2))
        cameras.append(
            pinhole_camera(
                f"cam{len(cameras) + 1}",
                intrinsic=lens.intrinsic,
                rotation=Rotation.from_quat([q1, q2, q3, q0]).as_matrix(),
                translation_m=np.array(shift),
                lens=lens.if_bent,
            )
        )
    return tuple(cameras)


def with_profile(cameras: Sequence[Camera], path: Path) -> tuple[Camera, ...]:
    """The cameras with the lenses and sizes of a profile, or all with the one lens of a ``Tforms.mat``.

    Raises:
        CalibrationError: the profile describes another number of cameras.
    """
    if "camud" in head(path).mat:
        lens, _ = read_tform(path)
        return tuple(replace(camera, lens=lens.if_bent) for camera in cameras)
    lenses = read_profile(path)
    if len(lenses) != len(cameras):
        raise CalibrationError(
            f"{path.name}: describes {len(lenses)} cameras, but the coefficients are for {len(cameras)}: give the "
            "profile that belongs to the same calibration"
        )
    pairs = zip(cameras, lenses, strict=True)
    return tuple(replace(c, lens=lens.if_bent, size_px=size) for c, (lens, size) in pairs)


def write_profile(path: Path, cameras: Sequence[Camera]) -> None:
    """Write the lenses of cameras.

    Raises:
        FormatError: a camera has no lens or size, which this format must hold.
    """
    lines = []
    for number, camera in enumerate(cameras, start=1):
        if camera.lens is None or camera.size_px is None:
            raise FormatError(f"{path.name}: camera {camera.name!r} has no lens or image size, which a profile needs")
        if not isinstance(camera.lens, BrownLens):
            raise FormatError(
                f"{path.name}: camera {camera.name!r} has a {camera.lens.model} lens, but a camera profile can only "
                "store a Brown lens (k1 k2 p1 p2 k3): write calibration.toml, or calibrate with `lens` brown"
            )
        (fx, fy), (cx, cy) = camera.lens.f_px, camera.lens.centre_px
        numbers = (fx, *camera.size_px, cx, cy, fy / fx, *camera.lens.k[:2], *camera.lens.p, camera.lens.k[2])
        lines.append(f"{number} " + " ".join(f"{x:.12g}" for x in numbers) + "\n")
    path.write_text("".join(lines), encoding="utf-8", newline="")


def _knows(columns: Sequence[int]) -> Callable[[Head], bool]:
    """Whether the first line has so many numbers between spaces."""
    return lambda head: len(cells := _spaced(head.first)) in columns and lines.is_number_row(tuple(cells))


def _is_profile(head: Head) -> bool:
    """Whether a file is one by its first line, or a table whose titles or whose every line describe a camera."""
    if _knows((12, 13, 19))(head):
        return True
    rows = [_cells(line) for line in head.lines if line.strip()]
    if len(rows) > 1 and _titled(rows[0]):
        return True
    if not rows or not all(len(row) == 12 and lines.is_number_row(tuple(row)) for row in rows):
        return False
    numbers = [[float(cell) for cell in row] for row in rows]
    whole = all(size == round(size) and size >= 16 for row in numbers for size in row[2:4])
    return whole and [row[0] for row in numbers] == [*range(1, len(rows) + 1)] and all(0.2 < r[6] < 5 for r in numbers)


@file_format(
    "camera-profile",
    "camera profile of Argus and easyWand (one line of 12 numbers for each camera)",
    _is_profile,
    signs="text numbers space lenses cam f W H cx cy",
)
def _profile(path: Path, _hints: Hints) -> FileContents:
    lenses = read_profile(path)
    odd = [c + 1 for c, (lens, (_, height)) in enumerate(lenses) if not 0.25 < lens.centre_px[1] / height < 0.75]
    note = f"principal point far from the middle of the image in camera {', '.join(map(str, odd))}: check H and cy"
    names, findings = tuple(f"cam{c + 1}" for c in range(len(lenses))), (note,) if odd else ()
    return FileContents(format="camera-profile", paths=(path,), camera_names=names, lenses=lenses, findings=findings)


ARGUS_SBA_PROFILE = Format(
    name="argus-sba-profile",
    title="bundle-adjusted cameras of Argus (sba-profile, one line of 17 numbers for each camera)",
    knows=_knows((17,)),
    read=lambda path, _: calibration_recording(path, "argus-sba-profile", read_sba_profile(path)),
)
