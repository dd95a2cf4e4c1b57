"""Caliscope's tables: ``xy.csv``, a row for each point that a camera saw, and ``xyz.csv``, one for each point."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.apart import check_bytes
from mocap.io.contents import FileContents, pixel_recording, point_recording
from mocap.io.csv_table import read_table
from mocap.io.format import Head, Hints, file_format
from mocap.io.lines import even_times, frame_numbers, rate_of_times

if TYPE_CHECKING:
    import pandas as pd

_SEEN = ("sync_index", "point_id", "img_loc_x", "img_loc_y")
_PLACES = ("sync_index", "point_id", "x_coord", "y_coord", "z_coord")
_CAMERAS = ("port", "cam_id")
_NAMES = "names of points are not in the file: they are numbered as its tracker numbers them"


def _table(path: Path) -> "pd.DataFrame":
    import pandas as pd

    header, values = read_table(path)
    table = pd.DataFrame(values, columns=header)
    camera = [title for title in _CAMERAS if title in header]
    keys = ["sync_index", *camera, "point_id"]
    if (table[keys].to_numpy() % 1 != 0).any():
        raise FormatError(f"{path.name}: {', '.join(keys)} should be whole numbers: export it again")
    if table.duplicated(keys).any():
        row = int(np.argmax(table.duplicated(keys)))
        raise FormatError(f"{path.name}: line {row + 2} gives a point of a frame for the second time: export it again")
    return table.astype(dict.fromkeys(keys, int))


def _rows(
    path: Path, table: "pd.DataFrame", columns: list[str], camera: str | None = None
) -> tuple[np.ndarray, list[str], np.ndarray, Array]:
    """(T,) frames from the first to the last, the M points and (C,) cameras by number, and (C, T, M, K) values."""
    points, index = np.unique(table["point_id"]), table["sync_index"].to_numpy()
    cameras = np.zeros(1) if camera is None else np.unique(table[camera])
    view = 0 if camera is None else np.searchsorted(cameras, table[camera])
    frames = np.arange(int(index.min()), int(index.max()) + 1)
    size = (len(cameras), len(frames), len(points), len(columns))
    check_bytes(path, 8 * int(np.prod(size)), "all frames up to its last sync_index")
    values = np.full(size, np.nan)
    values[view, index - frames[0], np.searchsorted(points, table["point_id"])] = table[columns]
    return frames, [f"point_{number}" for number in points], cameras, values


def _rate(path: Path, table: "pd.DataFrame") -> tuple[float | None, list[str]]:
    """Frames a second by the mean time of each frame, where there are times."""
    if "frame_time" in table:
        times: Any = table.groupby("sync_index")["frame_time"].mean().dropna()  # type: ignore[union-attr]
        if len(times) > 1 and np.ptp(times.to_numpy()) > 0:
            return rate_of_times(path, np.interp(np.arange(times.index[0], times.index[-1] + 1), times.index, times))
    return None, []


@file_format("caliscope-xy", "pixels of Caliscope (xy.csv)", lambda head: _has(head, _SEEN, True))
def _pixels(path: Path, _hints: Hints) -> FileContents:
    table = _table(path)
    camera = next(title for title in _CAMERAS if title in table)
    frames, names, cameras, uv = _rows(path, table, ["img_loc_x", "img_loc_y"], camera)
    fps, notes = _rate(path, table)
    return pixel_recording(
        path,
        "caliscope-xy",
        names=names,
        cameras=[f"{camera.removesuffix('_id')}_{number}" for number in cameras],
        uv_px=uv,
        frames=frame_numbers(path, frames),
        first=int(frames[0]),
        fps=fps,
        pixel_origin="upper-left",
        findings=(_NAMES, *notes),
    )


@file_format("caliscope-xyz", "points of Caliscope (xyz.csv)", lambda head: _has(head, _PLACES, False))
def _points(path: Path, _hints: Hints) -> FileContents:
    table = _table(path)
    frames, names, _, (xyz,) = _rows(path, table, ["x_coord", "y_coord", "z_coord"])
    fps, notes = _rate(path, table)
    return point_recording(
        path,
        "caliscope-xyz",
        names=names,
        xyz=xyz,
        unit=None,
        frames=frame_numbers(path, frames),
        first=int(frames[0]),
        fps=fps,
        findings=(_NAMES, *notes),
    )


def _has(head: Head, titles: tuple[str, ...], cameras: bool) -> bool:
    cells = set(head.cells())
    return set(titles) <= cells and cameras == bool(cells & set(_CAMERAS))


_TITLE = re.compile(r"(?P<name>.+)/(?P<part>[^/]+)/(?P<axis>[XY])")


def _is_kinovea(head: Head) -> bool:
    first, *others = head.cells() or ("",)
    return first.lower().startswith("time") and bool(others) and all(map(_TITLE.fullmatch, others))


@file_format("kinovea", "trajectories of Kinovea (CSV)", _is_kinovea)
def _read_kinovea(path: Path, hints: Hints) -> FileContents:
    """Pixels of one camera; times are milliseconds, unless they count whole frames.

    Raises:
        FormatError: a trajectory lacks X or Y, or the table is broken.
    """
    header, values = read_table(path)
    matches = [match for title in header[1:] if (match := _TITLE.fullmatch(title))]
    single = len({match["name"] for match in matches}) == len({(match["name"], match["part"]) for match in matches})
    names = [match["name"] if single else f"{match['name']}/{match['part']}" for match in matches]
    if [match["axis"] for match in matches] != ["X", "Y"] * (len(matches) // 2) or names[::2] != names[1::2]:
        raise FormatError(f"{path.name}: columns are not X and Y of each trajectory in turn: export it again")
    times, steps = values[:, 0], np.diff(values[:, 0])
    findings = [
        "positions are pixels, or lengths where the image was calibrated in Kinovea, from the origin that was set "
        "there: the file does not state which"
    ]
    counts = bool((steps == 1).all())
    fps, notes = None, ["the column Time counts frames"]
    if not counts:
        _, fps, notes = even_times(path, times / 1000, stated=hints.fps)
        notes = ["times were read as milliseconds, as Kinovea writes them", *notes]
    uv = values[:, 1:].reshape(len(values), -1, 2)
    uv[np.isnan(uv).any(axis=-1)] = np.nan
    return pixel_recording(
        path,
        "kinovea",
        names=names[::2],
        cameras=[path.stem],
        uv_px=uv[None],
        frames=frame_numbers(path, times, first_line=2) if counts else None,
        first=int(times[0]) if counts else 0,
        fps=fps,
        findings=(*findings, *notes),
    )
