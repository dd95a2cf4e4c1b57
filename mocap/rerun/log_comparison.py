"""A joint compared between two groups, in rerun: time at each angle, and the difference with its band."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from eal.comparison import Comparison
from mocap.rerun import palette
from mocap.rerun.blueprint import screen
from mocap.rerun.columns import recording_into

ANGLE = "degrees"
"""The axis that takes the place of time: whole degrees."""
GROUPS, DIFFERENCE = "/groups", "/difference"


def write_comparison_recording(found: Comparison, path: Path) -> None:
    """Write a comparison of one angle as a recording.

    Raises:
        RecordingError: rerun does not take it.
        OSError: the file cannot be written.
    """
    q = found.q[:, 0]
    degrees = np.arange(int(np.ceil(q[0])), int(np.floor(q[-1])) + 1)
    a, b, band = (np.interp(degrees, q, values) for values in (found.time_a, found.time_b, found.band))
    difference = a - b
    beyond = np.where(np.abs(difference) > band, difference, np.nan)
    lines = {
        GROUPS: {"a": (a, palette.SKY_BLUE), "b": (b, palette.ORANGE)},
        DIFFERENCE: {
            "upper band": (band, palette.GREY),
            "lower band": (-band, palette.GREY),
            "a minus b": (difference, palette.WHITE),
            "beyond the band": (beyond, palette.VERMILLION),
        },
    }
    views = (
        rrb.TimeSeriesView(origin=GROUPS, name=f"share of the time near each {found.names[0]}"),
        rrb.TimeSeriesView(origin=DIFFERENCE, name=f"a minus b, {100 * found.level:.0f} % band everywhere at once"),
        rrb.TextDocumentView(origin="/text", name="verdict"),
    )
    blueprint = screen(rrb.Vertical(*views, row_shares=[2, 2, 1]), play_state=None, timeline=ANGLE)
    with recording_into(path, application="mocap", recording_id="comparison", blueprint=blueprint) as rec:
        rec.log("/text", rr.TextDocument("\n\n".join(found.lines()), media_type="text/markdown"), static=True)
        for origin, series in lines.items():
            colours = [colour for _, colour in series.values()]
            rec.log(origin, rr.SeriesLines(names=list(series), colors=colours), static=True)
            values = np.column_stack([value for value, _ in series.values()])
            index = [rr.TimeColumn(ANGLE, sequence=degrees)]
            rec.send_columns(origin, indexes=index, columns=rr.Scalars.columns(scalars=values))
