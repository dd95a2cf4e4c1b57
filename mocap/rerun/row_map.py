"""An image with a row a marker or camera and the frames across, and a line at the current frame."""

from collections.abc import Callable

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib.font_manager import findfont
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from eal.arrays import Array
from mocap.rerun import palette
from mocap.rerun.columns import log_over_time, segments, ui

SIZE, WIDE = (110.0, 100.0), (320.0, 100.0)
"""Width and height of a map, in units of its view: all frames across, all rows down."""
_NAMES = 30.0
"""Room for the names of the rows, left of the image; longer ones are cut."""
_LETTERS_PX, _LETTERS = 16, 6.0
"""Pixels of a line of the names' image, and the most that it takes of the view's height."""


def columns_of(n_frames: int) -> NDArray[np.int64]:
    """The first frame of each column: a column a frame, or where there are too many several frames a column."""
    n_columns = min(n_frames, 500)
    return -(-np.arange(n_columns) * n_frames // n_columns)


def log_row_map(
    rec: rr.RecordingStream,
    path: str,
    picture: NDArray[np.uint8],
    *,
    names: tuple[str, ...],
    t_s: Array,
    size: tuple[float, float] = SIZE,
) -> None:
    """The map.

    Args:
        rec: Where to.
        path: Parent of its entities.
        picture: (rows, columns, 3) colours, a column as ``columns_of`` says.
        names: Of the rows.
        t_s: (T,) times of the frames.
        size: Width and height.
    """
    n_rows, n_columns = picture.shape[:2]
    width, height = size
    row_height = height / max(n_rows, 1)
    samples = f"{path}/samples"
    rec.log(samples, rr.Transform3D(scale=(width / n_columns, row_height, 1.0)), static=True)
    rec.log(
        samples,
        rr.Image(picture, draw_order=-10.0, magnification_filter=rr.components.MagnificationFilter.Nearest),
        static=True,
    )
    scale = min(row_height, _LETTERS) / _LETTERS_PX
    lines = _picture_of_names(names, pitch_px=row_height / scale, width_px=int(_NAMES / scale))
    left = -0.02 * height - scale * lines.shape[1]
    rec.log(f"{path}/names", rr.Transform3D(translation=(left, 0.0, 0.0), scale=(scale, scale, 1.0)), static=True)
    rec.log(f"{path}/names", rr.Image(lines, draw_order=-10.0), static=True)
    n_frames = len(t_s)
    x = (np.arange(n_frames) + 0.5) * width / n_frames
    lines = segments(np.column_stack([x, np.zeros(n_frames)]), np.column_stack([x, np.full(n_frames, height)]))
    look = rr.LineStrips2D.from_fields(colors=palette.WHITE, radii=ui(1.0), draw_order=20.0, show_labels=False)
    columns = rr.LineStrips2D.columns(strips=lines)
    log_over_time(rec, f"{path}/now", t_s, columns, look, counts=np.ones(n_frames))


def _picture_of_names(names: tuple[str, ...], *, pitch_px: float, width_px: int) -> NDArray[np.uint8]:
    """(rows, columns, 3) the names below one another, each at the middle of its row, as the viewer's labels cannot."""
    font = ImageFont.truetype(findfont("DejaVu Sans"), _LETTERS_PX - 4)
    texts = [cut_to(name, width_px, font.getlength) for name in names]
    width = 1 + int(max((font.getlength(text) for text in texts), default=0.0))
    picture = Image.new("RGB", (width, max(1, round(pitch_px * len(texts)))), palette.GROUND)
    draw = ImageDraw.Draw(picture)
    for row, text in enumerate(texts):
        draw.text((width, (row + 0.5) * pitch_px), text, fill=palette.GREY, font=font, anchor="rm")
    return np.asarray(picture)


def cut_to(text: str, width: float, length: Callable[[str], float]) -> str:
    """Text, its middle left out where it is longer than a width."""
    shown, kept = text, len(text)
    while kept > 2 and length(shown) > width:
        kept -= 1
        shown = f"{text[: kept - kept // 2]}…{text[len(text) - kept // 2 :]}"
    return shown


def amounts(values: Array, limit: float) -> NDArray[np.uint8]:
    """(rows, columns, 3) colours of the root mean squares in each column, 0 dark to ``limit`` yellow; none: the ground.

    Args:
        values: (rows, T) numbers; NaN where there is none.
        limit: What is as yellow as can be.
    """
    starts = columns_of(values.shape[1])
    there = np.isfinite(values)
    total = np.add.reduceat(np.where(there, values, 0.0) ** 2, starts, axis=1)
    count = np.add.reduceat(there.astype(int), starts, axis=1)
    mean = np.sqrt(total / np.maximum(count, 1))
    return np.where(count[..., None] > 0, palette.depth(1 - mean / limit), np.array(palette.GROUND, dtype=np.uint8))


def rms(values: Array, axis: int = 0) -> Array:
    """Root mean square along an axis of what is no NaN; NaN where all are."""
    there = np.isfinite(values)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt((np.where(there, values, 0.0) ** 2).sum(axis=axis) / there.sum(axis=axis))


def usual_limit(values: Array) -> float:
    """The end of a scale that 99 % of the numbers stay below; 1 where there are none."""
    finite = values[np.isfinite(values)]
    return max(float(np.quantile(finite, 0.99)), 1e-9) if finite.size else 1.0


def row_map_view(path: str, name: str, size: tuple[float, float] = SIZE) -> rrb.View:
    """The view of a map."""
    width, height = size
    return rrb.Spatial2DView(
        origin=path,
        name=name,
        background=palette.GROUND,
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-0.04 * height - _NAMES, width + 0.03 * height],
            y_range=[-0.03 * height, 1.03 * height],
        ),
    )
