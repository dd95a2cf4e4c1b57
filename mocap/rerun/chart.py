"""A small chart whose horizontal axis is no time: drawn in a view of two dimensions."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from mocap.arrays import Array
from mocap.rerun import palette
from mocap.rerun.columns import single

SIZE = (160.0, 100.0)
"""Width and height of the frame, in units of the view."""

Line = tuple[Array, palette.Rgb]
"""(n, 2) points inside [0, 1] x [0, 1], and a colour."""


def log_chart(
    rec: rr.RecordingStream,
    path: str,
    *,
    lines: Sequence[Line],
    dots: Line,
    ticks: Sequence[tuple[float, float, str]],
) -> None:
    """A frame with lines, dots and texts.

    Args:
        rec: Where to.
        path: Parent of the entities.
        lines: Lines in coordinates of the frame, (0, 0) at its lower left.
        dots: Likewise.
        ticks: Texts, each at a place in coordinates of the frame.
    """
    box = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)], dtype=np.float64)
    strips = [(box, palette.DIM), *lines]
    ui = rr.components.Radius.ui_points
    rec.log(
        f"{path}/lines",
        rr.LineStrips2D([_placed(xy) for xy, _ in strips], colors=[color for _, color in strips], radii=ui(1.0)),
        static=True,
    )
    rec.log(f"{path}/dots", rr.Points2D(_placed(dots[0]), colors=dots[1], radii=ui(2.5), draw_order=40.0), static=True)
    texts = rr.Points2D(
        _placed(np.array([(x, y) for x, y, _ in ticks])),
        labels=[text for *_, text in ticks],
        colors=palette.GREY,
        radii=0.0,
        show_labels=True,
    )
    rec.log(f"{path}/ticks", texts, static=True)


def _placed(xy: Array) -> np.ndarray:
    """(n, 2) of the frame, up, to (n, 2) of the view, down."""
    return single(np.column_stack([xy[:, 0], 1 - xy[:, 1]]) * SIZE)
