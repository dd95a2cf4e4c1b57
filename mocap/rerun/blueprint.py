"""What is where on the screen: tabs of views, built from what the run has."""

import rerun.blueprint as rrb

from mocap.rerun.columns import FRAME
from mocap.rerun.layout import Layout
from mocap.rerun.tabs.registry import TABS


def make_blueprint(layout: Layout) -> rrb.Blueprint:
    """The tabs of ``mocap.rerun.tabs``; those without content are left out."""
    tabs = [found for tab in TABS if (found := tab.tab(layout)) is not None]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0, name=layout.name),
        rrb.TimePanel(
            state=rrb.PanelState.Collapsed,
            timeline=FRAME,
            fps=layout.fps,
            play_state=rrb.components.PlayState.Paused,
        ),
        rrb.SelectionPanel(state=rrb.PanelState.Hidden),
        rrb.BlueprintPanel(state=rrb.PanelState.Hidden),
        auto_views=False,
        auto_layout=False,
    )
