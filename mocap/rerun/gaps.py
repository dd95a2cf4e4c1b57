"""When each marker was seen: as a map of all of them, and as one lane a marker to look closer."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from mocap.records import MarkerTracks
from mocap.rerun import palette, paths
from mocap.rerun.columns import log_over_time
from mocap.rerun.log_markers import classes
from mocap.rerun.row_map import columns_of, log_row_map, row_map_view

_STATES = np.array(["", *paths.ORIGINS])


def log_gap_map(rec: rr.RecordingStream, markers: MarkerTracks) -> None:
    """A picture of the class of every sample, a row a marker.

    Where there are more frames than columns, a column shows the last class of ``paths.ORIGINS`` among its frames: one
    rejected sample or a short gap is not lost.
    """
    colors = np.array([palette.GROUND, *(palette.DIM_ORIGIN[name] for name in paths.ORIGINS)], dtype=np.uint8)
    starts = columns_of(len(markers.t_s))
    picture = colors[np.maximum.reduceat(class_codes(markers), starts, axis=0).T]
    log_row_map(rec, paths.GAP_MAP, picture, names=markers.names, t_s=markers.t_s)


def log_gaps(rec: rr.RecordingStream, markers: MarkerTracks) -> None:
    """The lanes: an entry where a marker's class changes; empty where it has no position."""
    look = rr.StateConfiguration(
        values=list(paths.ORIGINS),
        labels=[" ", *paths.ORIGINS[1:]],
        colors=[palette.DIM_ORIGIN[name] for name in paths.ORIGINS],
    )
    states = _STATES[class_codes(markers)]
    for m, name in enumerate(markers.names):
        path = paths.child(paths.GAPS, name)
        at = np.flatnonzero(np.append(True, states[1:, m] != states[:-1, m]))
        log_over_time(rec, path, markers.t_s, rr.StateChange.columns(state=states[at, m].tolist()), look, at=at)


def class_codes(markers: MarkerTracks) -> NDArray[np.int8]:
    """(T, M) class of each sample: 1 + its index in ``paths.ORIGINS``; 0 where there is no position."""
    masks = classes(markers)
    codes = np.zeros(markers.status.shape, dtype=np.int8)
    for i, name in enumerate(paths.ORIGINS):
        codes[masks[name]] = i + 1
    return codes


def gap_map_view() -> rrb.View:
    """Who was seen when, at a glance."""
    return row_map_view(paths.GAP_MAP, "Gaps over frames: measured blue, filled or extrapolated yellow, rejected red")


def gap_lanes_view() -> rrb.View:
    """When each marker was seen, a lane each."""
    return rrb.StateTimelineView(
        origin=paths.GAPS,
        name="Gaps of each marker (frames)",
        time_view=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
    )
