"""Figures of one video: paths of markers in its image, and their coordinates over time."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eal.arrays import Z95
from mocap.pipeline.recording import Recording
from mocap.plots.figures import Picture, write_pictures
from mocap.plots.kinematics import COLOURS, labelled, legend_above, new_axes, shade
from mocap.records import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def write_plane_figures(run: Recording, folder: Path) -> None:
    """Write ``figures/paths`` and a figure of each coordinate, PNG and SVG."""
    write_pictures(list(plane_pictures(run)), folder)


def plane_pictures(run: Recording) -> Iterator[Picture]:
    """Paths of all markers; x and y over time of the six that are seen most."""
    assert run.plane is not None
    markers, (xy, cov) = run.tracks, run.plane.in_units(run.tracks)
    unit, filled = run.plane.unit, np.isin(markers.status, (Status.SMOOTHED, Status.PREDICTED))
    yield Picture(
        name="paths",
        caption="Paths in the image, rows downwards; thin grey where filled.",
        figure=_paths(xy, filled, markers.names, unit).figure,
    )
    most = np.argsort(-(markers.status == Status.MEASURED).sum(axis=0), kind="stable")[: len(COLOURS)]
    for axis, title in enumerate("xy"):
        ax = new_axes(width_mm=180, rows=1 + (len(most) - 1) // 6)
        shade(ax, markers.t_s, np.asarray(filled[:, most].sum(axis=1) > 0))
        for m, colour in zip(most, COLOURS, strict=False):
            value, half = xy[:, m, axis], Z95 * np.sqrt(cov[:, m, axis, axis])
            ax.fill_between(markers.t_s, value - half, value + half, color=colour, alpha=0.25, linewidth=0)
            ax.plot(markers.t_s, value, color=colour, linewidth=0.9, label=markers.names[m])
        labelled(ax, "time (s)        band: 95 % interval; grey: one of these markers was filled", f"{title} ({unit})")
        legend_above(ax, size=7, ncols=6)
        yield Picture(name=f"{title}_over_time", caption=f"{title} of markers with 95 % intervals.", figure=ax.figure)


def _paths(xy: np.ndarray, filled: np.ndarray, names: tuple[str, ...], unit: str) -> "Axes":
    ax = new_axes(width_mm=120, height_mm=100)
    for m in range(len(names)):
        colour = COLOURS[m % len(COLOURS)]
        ax.plot(*xy[:, m].T, color="#BBBBBB", linewidth=0.5)
        ax.plot(*np.where(filled[:, m, None], np.nan, xy[:, m]).T, color=colour, linewidth=0.9)
        finite = np.flatnonzero(np.isfinite(xy[:, m, 0]))
        if len(finite):
            ax.annotate(names[m], xy[finite[0], m], fontsize=5, color=colour)
    ax.set_aspect("equal", adjustable="datalim")
    ax.invert_yaxis()
    labelled(ax, f"x ({unit})", f"y ({unit})")
    return ax
