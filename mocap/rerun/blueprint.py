"""The screen about the views of a recording: time below, no other panels."""

import rerun.blueprint as rrb

from mocap.rerun.columns import FRAME

PAUSED = rrb.components.PlayState.Paused


def screen(
    content: rrb.Container | rrb.View, *, fps: float | None = None, play_state: rrb.components.PlayState = PAUSED
) -> rrb.Blueprint:
    """What is where on the screen.

    Args:
        content: All views.
        fps: Frames a second when played; None: the viewer's choice.
        play_state: Whether it plays.
    """
    return rrb.Blueprint(
        content,
        rrb.TimePanel(state=rrb.PanelState.Collapsed, timeline=FRAME, fps=fps, play_state=play_state),
        rrb.SelectionPanel(state=rrb.PanelState.Hidden),
        rrb.BlueprintPanel(state=rrb.PanelState.Hidden),
        auto_views=False,
        auto_layout=False,
    )
