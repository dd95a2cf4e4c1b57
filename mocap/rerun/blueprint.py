"""The screen about the views of a recording: time below, no other panels; and views in rows."""

from collections.abc import Sequence
from math import ceil, sqrt

import rerun.blueprint as rrb

from mocap.rerun.columns import FRAME

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
