"""A picture with a row a marker or camera and the frames across, and a line at the current frame."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.rerun import palette
from mocap.rerun.columns import segments, time_columns

SIZE, WIDE = (160.0, 100.0), (320.0, 100.0)
"""Width and height of a map, in units of its view: all frames across, all rows down."""
_NAMED_ROWS = 12
"""Names that have room below one another."""
_NAME_COLUMNS = 3
"""Neighbouring names stand beside one another where there are more rows."""
_NAME_WIDTH = 0.27
"""Room of a column of names, over the height."""
_COLUMNS = 500


def columns_of(n_frames: int) -> NDArray[np.int64]:
    """The first frame of each column: a column a frame, or where there are too many several frames a column."""
    n_columns = min(n_frames, _COLUMNS)
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
        names: Of the rows; all are shown where they have room in ``_NAME_COLUMNS`` columns.
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
    aside = name_columns(n_rows)
    rows = np.arange(0, n_rows, max(1, -(-n_rows // (aside * _NAMED_ROWS))))
    left = -(0.15 + _NAME_WIDTH * (aside - 1 - np.arange(len(rows)) % aside)) * height
    labels = rr.Points2D(
        np.column_stack([left, (rows + 0.5) * row_height - 0.022 * height]),
        labels=[names[m] for m in rows],
        colors=palette.GREY,
        radii=0.0,
        show_labels=True,
    )
    rec.log(f"{path}/names", labels, static=True)
    n_frames = len(t_s)
    x = (np.arange(n_frames) + 0.5) * width / n_frames
    lines = segments(np.column_stack([x, np.zeros(n_frames)]), np.column_stack([x, np.full(n_frames, height)]))
    look = rr.LineStrips2D.from_fields(
        colors=palette.WHITE, radii=rr.components.Radius.ui_points(1.0), draw_order=20.0, show_labels=False
    )
    rec.log(f"{path}/now", look, static=True)
    columns = rr.LineStrips2D.columns(strips=lines).partition(np.ones(n_frames, dtype=int))
    rec.send_columns(f"{path}/now", indexes=time_columns(t_s), columns=columns)


def name_columns(n_rows: int) -> int:
    """Columns in which the names of so many rows stand."""
    return min(_NAME_COLUMNS, max(1, -(-n_rows // _NAMED_ROWS)))


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


def rms(values: Array) -> Array:
    """(T,) root mean square of the rows of (rows, T) numbers; NaN where all are."""
    there = np.isfinite(values)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt((np.where(there, values, 0.0) ** 2).sum(axis=0) / there.sum(axis=0))


def row_map_view(path: str, name: str, size: tuple[float, float] = SIZE, *, n_rows: int = _NAMED_ROWS) -> rrb.View:
    """The view of a map of so many rows."""
    width, height = size
    return rrb.Spatial2DView(
        origin=path,
        name=name,
        background=palette.GROUND,
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-(0.05 + 0.3 * name_columns(n_rows)) * height, width + 0.03 * height],
            y_range=[-0.03 * height, 1.03 * height],
        ),
    )
