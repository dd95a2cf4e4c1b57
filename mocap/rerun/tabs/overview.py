"""Tab: the scene, the cameras that saw most, and when each marker was seen."""

import rerun as rr
import rerun.blueprint as rrb

from mocap.rerun.blueprint import rows
from mocap.rerun.layout import Layout
from mocap.rerun.log_markers import (
    gap_map_view,
    log_axes,
    log_gap_map,
    log_looks,
    log_markers,
    log_trails,
    log_uncertainty,
    log_world,
)
from mocap.rerun.scene_views import camera_order, camera_view, names_view, scene_view
from mocap.tracking.result import Result


def log(rec: rr.RecordingStream, run: Result, layout: Layout) -> None:
    """World, markers with their uncertainty and trails, and the map of gaps."""
    scene, markers = layout.scene, run.tracks
    log_world(rec, scene, names=markers.names, skeleton=run.skeleton)
    log_axes(rec, scene)
    log_looks(rec, len(markers.names))
    log_markers(rec, scene, markers)
    log_uncertainty(rec, scene, markers)
    log_trails(rec, scene, markers, trunk=run.skeleton.trunk)
    log_gap_map(rec, markers)


def tab(layout: Layout) -> rrb.Container:
    """The scene, the cameras that saw most, and who was seen when."""
    right: list[rrb.Container | rrb.View] = []
    if layout.bounds_px:
        names = list(layout.bounds_px)[:4]
        tiles = [camera_view(layout, name) for name in sorted(names, key=camera_order(layout).index)]
        right.append(rows(tiles, columns=2))
    right.append(gap_map_view())
    return rrb.Horizontal(
        rrb.Tabs(scene_view(layout), names_view(layout), active_tab=0),
        rrb.Vertical(*right),
        column_shares=[3, 2],
        name="Overview",
    )
