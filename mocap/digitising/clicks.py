"""What a person clicked: places of markers in images, kept in DLTdv's format too."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.documents import one_line, regular_bytes
from mocap.errors import FormatError
from mocap.io.dltdv import write_pixels
from mocap.io.format import Hints
from mocap.io.lines import MOST_FRAMES, cells_of
from mocap.io.registry import read
from mocap.records import PixelTracks
from mocap.schema import Entry, Schema, checked
from mocap.skeleton import Skeleton


@dataclass(frozen=True, kw_only=True)
class Click:
    """One click.

    Attributes:
        camera: Number of the camera, from 0.
        frame: Frame of the tracks, from 0.
        marker: Number of the marker, from 0.
        uv_px: Place as recorded, the centre of the first pixel at (1, 1) as DLTdv counts; None: the marker cannot be
            seen there.
    """

    camera: int
    frame: int
    marker: int
    uv_px: tuple[float, float] | None


def read_clicks(path: Path, skeleton: Skeleton, *, n_cameras: int, n_frames: int) -> list[Click]:
    """Clicks of any file of pixels that mocap knows (DLTdv's xypts, a project, ...).

    Raises:
        FormatError: it holds no pixels, those of another number of cameras, or frames after the end of the videos.
        SkeletonError: none of its markers is in the skeleton.
    """
    contents = read(path, Hints(cameras=n_cameras))
    pixels = contents.pixels
    if pixels is None:
        raise FormatError(f"{path.name}: contains no pixels ({contents.format}): give clicks as DLTdv's xypts")
    if len(pixels.cameras) != n_cameras:
        raise FormatError(f"{path.name}: clicks of {len(pixels.cameras)} cameras for {n_cameras} videos")
    names = skeleton.renamed(pixels.names)
    marker_of = {i: skeleton.markers.index(name) for i, name in enumerate(names) if name in skeleton.markers}
    if not marker_of:
        raise FormatError(
            f"{path.name}: its markers ({', '.join(names[:5])}, ...) are not in the skeleton "
            f"({', '.join(skeleton.markers[:5])}, ...): correct the names, or map them under [aliases]"
        )
    out = []
    for camera, row, column in np.argwhere(pixels.seen):
        if column not in marker_of:
            continue
        frame, (u, v) = int(contents.frames[row]) - 1, pixels.uv_px[camera, row, column]
        if frame >= n_frames:
            raise FormatError(
                f"{path.name}: frame {frame + 1} is clicked, but the videos have {n_frames} frames in step: check "
                "`offset_frames`, and that the clicks belong to these videos"
            )
        out.append(Click(camera=int(camera), frame=frame, marker=marker_of[column], uv_px=(float(u), float(v))))
    return out


def write_clicks(
    path: Path, clicks: Iterable[Click], *, names: Sequence[str], cameras: Sequence[str], n_frames: int, fps: float
) -> None:
    """Write clicks as DLTdv's ``xypts.csv``, of all frames; of several at one place the last counts."""
    uv_px, t_s = places(clicks, (len(cameras), n_frames, len(names))), np.arange(n_frames) / fps
    write_pixels(path, PixelTracks(names=tuple(names), cameras=tuple(cameras), t_s=t_s, uv_px=uv_px))


def write_unseen(path: Path, clicks: Iterable[Click]) -> None:
    """Write what DLTdv's table cannot say: where a person said that a marker is not to be seen; counted from 1."""
    last = {(click.camera, click.frame, click.marker): click.uv_px for click in clicks}
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(_HEADER)
        table.writerows([n + 1 for n in place] for place, uv_px in last.items() if uv_px is None)


_HEADER = ["camera", "frame", "marker"]
_UNSEEN: Schema = {"rows": Entry(kind="i", shape=(None, 3), least=1, most=MOST_FRAMES)}


def read_unseen(path: Path) -> list[Click]:
    """Read what ``write_unseen`` wrote.

    Raises:
        FormatError: it is another file.
    """
    again = "expected a table of camera, frame and marker, counted from 1: delete it to go on"
    try:
        lines = regular_bytes(path).decode("utf-8").splitlines()
        header, *table = cells_of(path, lines)
        if header != _HEADER:
            raise ValueError("its first line is another")
        rows = [[int(text) for text in row] for row in table]
    except ValueError as error:
        raise FormatError(f"{path.name}: {one_line(error)}: {again}") from None
    found = checked(path.name, {"rows": rows}, _UNSEEN, again=again)["rows"] - 1
    return [Click(camera=c, frame=t, marker=m, uv_px=None) for c, t, m in found.tolist()]


def places(clicks: Iterable[Click], shape: tuple[int, int, int]) -> Array:
    """(C, T, M, 2) clicked places; NaN where none is; of several at one place the last counts."""
    out = np.full((*shape, 2), np.nan)
    for click in clicks:
        out[click.camera, click.frame, click.marker] = np.nan if click.uv_px is None else click.uv_px
    return out
