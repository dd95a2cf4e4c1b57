"""When each marker was seen: as a map of all of them, and as one lane a marker to look closer."""

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from app.view import palette, paths
from app.view.columns import segments, time_columns
from app.view.log_markers import classes
from mocap.records import MarkerTracks

MAP_SIZE = (160.0, 100.0)
"""Width and height of the map, in units of its view: all frames across, all markers down."""

_NAMED_ROWS = 12
_MAP_COLUMNS = 500
_STATES = np.array(["", *paths.ORIGINS])


def log_gap_map(rec: rr.RecordingStream, markers: MarkerTracks) -> None:
    """A picture of the class of every sample, a row a marker, with a line at the current frame.

    Where there are more frames than columns, a column shows the last class of ``paths.ORIGINS`` among its frames: one
    rejected sample or a short gap is not lost.
    """
    n_frames, n_markers = markers.origin.shape
    width, height = MAP_SIZE
    n_columns = min(n_frames, _MAP_COLUMNS)
    starts = -(-np.arange(n_columns) * n_frames // n_columns)
    row_height = height / max(n_markers, 1)
    colors = np.array([palette.GROUND, *(palette.DIM_ORIGIN[name] for name in paths.ORIGINS)], dtype=np.uint8)
    picture = colors[np.maximum.reduceat(class_codes(markers), starts, axis=0).T]
    samples = f"{paths.GAP_MAP}/samples"
    rec.log(samples, rr.Transform3D(scale=(width / n_columns, row_height, 1.0)), static=True)
    rec.log(samples, rr.Image(picture, draw_order=-10.0), static=True)
    every = max(1, -(-n_markers // _NAMED_ROWS))
    rows = np.arange(0, n_markers, every)
    names = rr.Points2D(
        np.column_stack([np.full(len(rows), -0.12 * width), (rows + 0.5) * row_height - 0.022 * height]),
        labels=[markers.names[m] for m in rows],
        colors=palette.GREY,
        radii=0.0,
        show_labels=True,
    )
    rec.log(f"{paths.GAP_MAP}/names", names, static=True)
    x = (np.arange(n_frames) + 0.5) * width / n_frames
    lines = segments(np.column_stack([x, np.zeros(n_frames)]), np.column_stack([x, np.full(n_frames, height)]))
    look = rr.LineStrips2D.from_fields(
        colors=palette.WHITE, radii=rr.components.Radius.ui_points(1.0), draw_order=20.0, show_labels=False
    )
    rec.log(f"{paths.GAP_MAP}/now", look, static=True)
    columns = rr.LineStrips2D.columns(strips=lines).partition(np.ones(n_frames, dtype=int))
    rec.send_columns(f"{paths.GAP_MAP}/now", indexes=time_columns(markers.t_s), columns=columns)


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
        rec.log(path, look, static=True)
        at = np.flatnonzero(np.append(True, states[1:, m] != states[:-1, m]))
        rec.send_columns(
            path,
            indexes=time_columns(markers.t_s, at=at),
            columns=rr.StateChange.columns(state=states[at, m].tolist()),
        )


def class_codes(markers: MarkerTracks) -> NDArray[np.int8]:
    """(T, M) class of each sample: 1 + its index in ``paths.ORIGINS``; 0 where there is no position."""
    masks = classes(markers)
    codes = np.zeros(markers.origin.shape, dtype=np.int8)
    for i, name in enumerate(paths.ORIGINS):
        codes[masks[name]] = i + 1
    return codes
