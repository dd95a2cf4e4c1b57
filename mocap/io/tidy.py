"""Tables with one row for each marker of a frame, as R and pandas keep them: frame or time, marker, x, y and z.

Columns may be in any order and rows too; a marker without a row was not seen. Mocap's own such tables, which say more
of each sample, are in ``tables_long``.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.contents import FileContents, pixel_recording, point_recording
from mocap.io.format import Head, Hints, file_format
from mocap.io.lines import even_times, frame_numbers
from mocap.io.plain import LIKELY, is_frame, seconds_of, without_unit
from mocap.io.tables import read_rows, titles
from mocap.text import number_of

_MARKERS = ("marker", "markers", "point", "keypoint", "bodypart", "body_part", "landmark", "label", "name", "joint")
_OWN = {"origin", "seen", "x_m", "u_px", "sd"}
"""Titles of mocap's own tables."""


def roles_of(header: tuple[str, ...]) -> dict[str, int]:
    """Which column is the frame, time, marker, x, y, z, likelihood; empty where one lacks or is there twice."""
    bare, _ = without_unit(list(header))
    found: dict[str, int] = {}
    for place, title in enumerate(bare):
        low, likely = title.strip().casefold(), LIKELY.fullmatch(title)
        if low in _OWN:
            return {}
        if title and is_frame(title):
            role = "frame"
        elif title and seconds_of(title):
            role = "time"
        elif low in _MARKERS or low in ("x", "y", "z"):
            role = "marker" if low in _MARKERS else low
        elif likely is not None and not likely["name"]:
            role = "likelihood"
        else:
            continue
        if role in found:
            return {}
        found[role] = place
    whole = {"marker", "x", "y"} <= set(found) and ("frame" in found or "time" in found)
    return found if whole else {}


def _is_tidy(head: Head) -> bool:
    return bool(roles_of(head.cells()))


@file_format("rows-of-markers", "a table with one row for each marker of a frame", _is_tidy, of_words=True)
def read_tidy(path: Path, hints: Hints) -> FileContents:
    """Positions, or pixels where there is no z.

    Raises:
        FormatError: a cell is no number, or a marker stands twice in a frame.
    """
    header = titles(path)
    roles, unit = roles_of(tuple(header)), without_unit(header)[1]
    kinds = {title: float if place in roles.values() else str for place, title in enumerate(header)}
    kinds[header[roles["marker"]]] = str
    table = read_rows(path, kinds)
    column = {role: table[header[place]].to_numpy() for role, place in roles.items()}
    words = table[header[roles["marker"]]].astype(object).fillna("").astype(str).str.strip()
    counted = column["frame" if "frame" in roles else "time"].astype(np.float64)
    if not np.isfinite(counted).all():
        row = int(np.argmax(~np.isfinite(counted)))
        raise FormatError(f"{path.name}: line {row + 2} has no frame or time: correct it")
    names = list(dict.fromkeys(words))
    moments, at = np.unique(counted, return_inverse=True)
    number = {name: k for k, name in enumerate(names)}
    which = np.array([number[word] for word in words])
    _once(path, at * len(names) + which, words.to_numpy(), counted)
    axes = [axis for axis in "xyz" if axis in roles]
    laid = np.full((len(moments), len(names), len(axes)), np.nan)
    laid[at, which] = np.stack([column[axis] for axis in axes], axis=-1)
    frames = frame_numbers(path, moments) if "frame" in roles else None
    times, fps, notes = None, None, list[str]()
    if "time" in roles:
        times = np.full(len(moments), np.nan)
        times[at] = column["time"] * (seconds_of(without_unit(header)[0][roles["time"]]) or 1.0)
        times, fps, notes = even_times(path, times, frames=frames, stated=hints.fps)
    rest = [title for place, title in enumerate(header) if place not in roles.values()]
    notes += (
        [f"{number_of(len(rest), 'column is', 'columns are')} of no marker, left out: {', '.join(rest[:8])}"]
        if rest
        else []
    )
    first = 1 if frames is None else int(frames[0])
    if len(axes) == 3:
        return point_recording(
            path, "rows-of-markers", names=names, xyz=laid, unit=unit, frames=frames, first=first, fps=fps,
            t_s=times, findings=tuple(notes),
        )  # fmt: skip
    score = None
    if "likelihood" in roles:
        score = np.full((1, *laid.shape[:2]), np.nan)
        score[0, at, which] = column["likelihood"]
    laid[np.isnan(laid).any(axis=-1)] = np.nan
    return pixel_recording(
        path, "rows-of-markers", names=names, cameras=["cam1"], uv_px=laid[None], frames=frames, first=first, fps=fps,
        score=score, findings=tuple(notes),
    )  # fmt: skip


def _once(path: Path, cells: NDArray[np.int64], words: NDArray, counted: Array) -> None:
    """Each marker once a frame.

    Raises:
        FormatError: one stands twice, as where a table holds several animals or cameras.
    """
    _, firsts, counts = np.unique(cells, return_index=True, return_counts=True)
    if (counts > 1).any():
        row = int(np.flatnonzero(cells == cells[firsts[np.argmax(counts > 1)]])[1])
        raise FormatError(
            f"{path.name}: line {row + 2}: {words[row]!r} stands twice at {counted[row]:g}: keep the rows of one "
            "animal and camera"
        )
