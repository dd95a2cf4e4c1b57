"""Kinovea's table of trajectories (its kinematics dialogues): ``Time``, then ``NAME/0/X`` and ``NAME/0/Y`` of each."""

import re
from pathlib import Path

import numpy as np

from mocap.errors import FormatError
from mocap.io.contents import FileContents, pixel_recording
from mocap.io.csv_table import read_table
from mocap.io.format import Format, Hints
from mocap.io.head import Head
from mocap.io.lines import frame_numbers
from mocap.io.optical import rate_of_times

_TITLE = re.compile(r"(?P<name>.+)/(?P<part>[^/]+)/(?P<axis>[XY])")


def _is_kinovea(head: Head) -> bool:
    first, *others = head.cells() or ("",)
    return first.lower().startswith("time") and bool(others) and all(map(_TITLE.fullmatch, others))


def _read(path: Path, _hints: Hints) -> FileContents:
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
    fps, told = None, ["the column Time counts frames"]
    if not counts:
        fps, told = rate_of_times(path, times / 1000)
        told = ["times were read as milliseconds, as Kinovea writes them", *told]
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
        findings=(*findings, *told),
    )


FORMATS = (Format(name="kinovea", title="trajectories of Kinovea (CSV)", knows=_is_kinovea, read=_read),)
