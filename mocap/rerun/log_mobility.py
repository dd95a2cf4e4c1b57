"""Mobility of a joint in rerun: where the child's axes point, on a sphere in the parent's axes."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from eal.rotation_share import Mobility
from mocap.rerun import palette
from mocap.rerun.blueprint import screen
from mocap.rerun.columns import recording_into

SPHERE, TEXT = "/sphere", "/text"


def write_mobility_recording(found: Mobility, lines: list[str], path: Path) -> None:
    """Spherical frame projection (Herbst et al. 2022): samples, and paler the poses that are visited.

    Raises:
        RecordingError: rerun does not take it.
        OSError: the file cannot be written.
    """
    views = (rrb.Spatial3DView(origin=SPHERE, name="child's axes in the parent's"), rrb.TextDocumentView(origin=TEXT))
    blueprint = screen(rrb.Horizontal(*views, column_shares=[3, 1]), play_state=None, timeline="log_time")
    with recording_into(path, application="mocap", recording_id="mobility", blueprint=blueprint) as rec:
        rec.log(TEXT, rr.TextDocument("\n\n".join(lines), media_type="text/markdown"), static=True)
        turn = np.linspace(0.0, 2.0 * np.pi, 91)
        circle = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
        grid = [np.roll(circle, k, axis=1) for k in range(3)]
        rec.log(f"{SPHERE}/grid", rr.LineStrips3D(grid, colors=palette.GREY, radii=0.002), static=True)
        for k, colour in enumerate((palette.VERMILLION, palette.GREEN, palette.BLUE)):
            name = f"{SPHERE}/{'xyz'[k]}"
            ends = found.visited[:, :, k]
            rec.log(f"{name}/visited", rr.Points3D(ends, colors=(*colour, 90), radii=0.012), static=True)
            rec.log(
                f"{name}/samples", rr.Points3D(1.01 * found.rotations[:, :, k], colors=colour, radii=0.006), static=True
            )
