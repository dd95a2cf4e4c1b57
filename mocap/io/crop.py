"""Crop offsets: where in the whole image the upper left corner of a cropped video lies, constant or frame by frame.

A network is often given a small window of each image, which may follow the animal. Its pixels count from the corner
of that window, a calibration's from that of the whole image; the sum of pixel and offset belongs to the calibration.
"""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.apart import plain_pickle, variables
from mocap.io.format import Head, head
from mocap.io.lines import cells_of, number

VARIABLE = "XYtop_left"
"""The variable of a MATLAB file: (frames, 2) columns and rows of the window's upper left corner."""
META = "_meta.pickle"
"""End of the name of the file that DeepLabCut writes beside its predictions."""
KNOWN = (
    f"a MATLAB file with {VARIABLE} (frames x 2), DeepLabCut's config.yaml or *{META}, a table with the columns x,y "
    "(one row per frame, or one row) or camera,x,y (one row per camera)"
)


def read_crops(path: Path) -> dict[str, Array]:
    """Crop offsets of a file, (1, 2) constant or (frames, 2) pixels to add, by the name of the camera or video.

    The name of a file with the offsets of one video is that of the video.

    Raises:
        FormatError: the file holds none.
    """
    beginning = head(path)
    if VARIABLE in beginning.mat:
        try:
            table = np.atleast_2d(np.asarray(variables(path)[VARIABLE], dtype=np.float64))
        except (TypeError, ValueError):
            raise FormatError(f"{path.name}: {VARIABLE} contains no numbers; expected {KNOWN}") from None
        return {path.stem: _offsets(path, table.T if table.shape[0] == 2 and table.shape[1] != 2 else table)}
    if beginning.start[:1] == b"\x80":
        with damaged(f"{path.name}: no cropping_parameters of DeepLabCut in it", f"expected {KNOWN}"):
            data = plain_pickle(path.read_bytes(), inert=True)["data"]
            box = data["cropping_parameters"] if data["cropping"] else (0, 0, 0, 0)
        return {path.name.removesuffix(META): _offsets(path, _corner(path, box))}
    found = _config(path, beginning) or _table(path, beginning)
    if not found:
        raise FormatError(f"{path.name}: contains no crop offsets; expected {KNOWN}")
    return found


def has_crops(path: Path) -> bool:
    """Whether a file found beside a recording holds crop offsets, as MATLAB or DeepLabCut write them."""
    if path.name.endswith(META):
        return True
    try:
        return path.suffix.lower() == ".mat" and VARIABLE in head(path).mat
    except FormatError:
        return False


def crops_beside(tracks: Sequence[Path]) -> list[Path]:
    """Files with crop offsets in the folders of tracks or videos whose names begin those, or are begun by them.

    DeepLabCut's tracks of ``cam1_trial3.avi`` are ``cam1_trial3DLC_....csv``; the offsets are ``cam1_trial3.mat``.
    """
    found = []
    for folder in dict.fromkeys(path.absolute().parent for path in tracks):
        stems = [path.stem for path in tracks if path.absolute().parent == folder]
        if not folder.is_dir():
            continue
        for file in sorted(folder.iterdir()):
            name = file.name.removesuffix(META).removesuffix(".mat")
            if name == file.name or file in tracks or not file.is_file():
                continue
            if any(stem.startswith(name) or name.startswith(stem) for stem in stems) and has_crops(file):
                found.append(file)
    return found


def crops_of(paths: Sequence[Path]) -> dict[str, Array]:
    """The crop offsets of files, and of the files in folders that hold any.

    Raises:
        FormatError: a path is absent, a folder holds none, or a file is damaged.
    """
    found: dict[str, Array] = {}
    for path in paths:
        inside = _of_folder(path) if path.is_dir() else read_crops(path)
        if not inside:
            raise FormatError(f"{path}: this folder contains no crop offsets; expected {KNOWN}")
        found |= inside
    return found


def _of_folder(folder: Path) -> dict[str, Array]:
    """Of the files that MATLAB or DeepLabCut wrote; without any, of its tables."""
    files = sorted(file for file in folder.iterdir() if file.is_file())
    found: dict[str, Array] = {}
    for file in files:
        if has_crops(file):
            found |= read_crops(file)
    for file in () if found else files:
        with suppress(FormatError):
            found |= read_crops(file)
    return found


def matched(crops: Mapping[str, Array], views: Sequence[Sequence[str]]) -> list[Array] | None:
    """The (1, 2) or (frames, 2) offsets of each view, by the names of its file and its camera.

    A view and its offsets belong together where one's name contains the other's (``cam1`` is not in ``cam12``); the
    longest match counts. None where a view has none, two views share one, or it is ambiguous.
    """
    chosen = []
    for names in views:
        shared = {crop: max(_common(crop, name) for name in names) for crop in crops}
        best = max(shared.values(), default=0)
        fits = [crop for crop, size in shared.items() if size == best > 0]
        if len(fits) != 1:
            return None
        chosen.append(fits[0])
    return [crops[crop] for crop in chosen] if len(set(chosen)) == len(chosen) else None


def _common(one: str, other: str) -> int:
    """Length of the shorter name where the longer contains it, no digit of the same number following or before."""
    short, long = sorted((one.lower(), other.lower()), key=len)
    before = r"(?<!\d)" if short[:1].isdigit() else ""
    after = r"(?!\d)" if short[-1:].isdigit() else ""
    return len(short) if short and re.search(before + re.escape(short) + after, long) else 0


def _offsets(path: Path, values: Array) -> Array:
    if values.ndim != 2 or values.shape[1] != 2 or not len(values) or not np.isfinite(values).all():
        raise FormatError(
            f"{path.name}: crop offsets have shape {values.shape}; expected finite x, y in one row per frame"
        )
    if np.abs(values).max() > 1e5:
        raise FormatError(f"{path.name}: a crop offset of {np.abs(values).max():g} px lies in no image")
    return values


def _corner(path: Path, box: Any) -> Array:
    """(1, 2) upper left corner of a box x1, x2, y1, y2."""
    try:
        x1, _, y1, _ = (float(value) for value in box)
    except (TypeError, ValueError):
        raise FormatError(f"{path.name}: crop {box!r:.60}; expected four numbers x1, x2, y1, y2") from None
    return np.array([[x1, y1]])


_CROP = re.compile(r"^\s*crop:\s*['\"]?\s*(-?\d+)\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*,\s*(-?\d+)")


def _config(path: Path, beginning: Head) -> dict[str, Array]:
    """Crops of videos in DeepLabCut's config.yaml: under ``video_sets`` a video, below it ``crop: x1, x2, y1, y2``."""
    if not any(line.startswith("video_sets:") for line in beginning.lines):
        return {}
    found, film = {}, None
    for line in beginning.lines:
        crop = _CROP.match(line)
        key = re.match(r"^\s+\??\s*['\"]?(\S.*?)['\"]?\s*:?\s*$", line)
        if crop is not None and film is not None:
            found[film] = _offsets(path, _corner(path, crop.groups()))
            film = None
        elif crop is None and key is not None and re.search(r"[./\\]", key[1]):
            film = re.split(r"[/\\]", key[1])[-1].rpartition(".")[0] or key[1]
    return found


def _table(path: Path, beginning: Head) -> dict[str, Array]:
    """A table with the columns x,y or camera,x,y; others are not looked at."""
    titles = [cell.strip().lower() for cell in beginning.cells()]
    if not {"x", "y"} <= set(titles):
        return {}
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = text.splitlines()[1:]
    rows = [[cell.strip() for cell in row] for row in cells_of(path, lines, first_line=2) if any(map(str.strip, row))]
    x, y = titles.index("x"), titles.index("y")
    short = next((i for i, row in enumerate(rows) if len(row) <= max(x, y)), None)
    if short is not None:
        raise FormatError(f"{path.name}: line {short + 2} has {len(rows[short])} cells; expected {', '.join(titles)}")
    values = np.array([[number(row[x]), number(row[y])] for row in rows]).reshape(-1, 2)
    if "camera" in titles:
        where = titles.index("camera")
        return {row[where]: _offsets(path, value[None]) for row, value in zip(rows, values, strict=True)}
    return {path.stem: _offsets(path, values)}
