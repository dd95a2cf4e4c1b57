"""The screen about the views of a recording, views in rows, and lines over time: how they are logged and shown."""

from collections.abc import Sequence
from math import ceil, sqrt

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from eal.arrays import Array
from mocap.rerun import palette
from mocap.rerun.columns import FRAME, log_over_time

PAUSED = rrb.components.PlayState.Paused


def screen(
    content: rrb.Container | rrb.View,
    *,
    fps: float | None = None,
    play_state: rrb.components.PlayState | None = PAUSED,
    timeline: str = FRAME,
) -> rrb.Blueprint:
    """What is where on the screen; ``fps``: frames a second when played (None: the viewer's choice)."""
    return rrb.Blueprint(
        content,
        rrb.TimePanel(state=rrb.PanelState.Collapsed, timeline=timeline, fps=fps, play_state=play_state),
        rrb.SelectionPanel(state=rrb.PanelState.Hidden),
        rrb.BlueprintPanel(state=rrb.PanelState.Hidden),
        auto_views=False,
        auto_layout=False,
    )


def rows(views: Sequence[rrb.View], *, columns: int | None = None, name: str | None = None) -> rrb.Container:
    """Views (at least one) in rows that leave no cell empty: the last row shares its width among what is left.

    ``columns``: views in a row; None: about as many as there are rows.
    """
    across = ceil(sqrt(len(views))) if columns is None else columns
    parts = [views[i : i + across] for i in range(0, len(views), across)]
    return rrb.Vertical(*(part[0] if len(part) == 1 else rrb.Horizontal(*part) for part in parts), name=name)


def log_line(
    rec: rr.RecordingStream,
    path: str,
    t_s: Array,
    values: Array,
    *,
    name: str | Sequence[str],
    color: palette.Rgb | Sequence[palette.Rgb],
) -> None:
    """One line, or several of one entity, over time.

    Args:
        rec: Where to.
        path: Entity.
        t_s: (T,) times.
        values: (T,) or (T, lines) numbers; NaN breaks the line.
        name: What the legend says, a line.
        color: Of all lines, or a line.
    """
    n_lines = 1 if values.ndim == 1 else values.shape[1]
    colors = [color] * n_lines if isinstance(color[0], int) else list(color)
    names = [name] if isinstance(name, str) else list(name)
    look = rr.SeriesLines(names=names, colors=colors, widths=[1.5] * n_lines)
    log_over_time(rec, path, t_s, rr.Scalars.columns(scalars=values), look)


def series_view(origin: str, name: str, *, y_range: tuple[float, float] | None = None, legend: bool = True) -> rrb.View:
    """Lines over frames; all such views share their time axis."""
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
        axis_y=rrb.ScalarAxis(range=y_range) if y_range else None,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=legend),
        background=rrb.archetypes.PlotBackground(color=palette.GROUND, show_grid=True),
    )


def robust_range(values: Array) -> tuple[float, float] | None:
    """Ends of an axis that shows all but the outermost values, so that one outlier does not flatten the rest.

    Returns:
        Lower and upper end; None where there is no value.
    """
    there = values[np.isfinite(values)]
    if not len(there):
        return None
    low, high = np.quantile(there, (0.01, 0.99))  # the others may lie outside, where they are far out
    room = max(0.1 * float(high - low), 1e-9 * max(1.0, abs(float(high))))
    least, most = float(there.min()), float(there.max())
    reach = 3 * room  # what is a little outside is shown
    low = least if least > low - reach else float(low)
    high = most if most < high + reach else float(high)
    return low - room, high + room
