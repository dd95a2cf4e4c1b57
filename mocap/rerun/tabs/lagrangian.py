"""Tab: energy, V_z and Theorem 3's bound of an animal that its own Lagrangian moves, beside the scene."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mocap.rerun import palette, paths
from mocap.rerun.blueprint import log_line, robust_range, rows, series_view
from mocap.rerun.layout import Layout
from mocap.rerun.scene_views import scene_view
from mocap.tracking.result import Result


def log(rec: rr.RecordingStream, run: Result, layout: Layout) -> None:  # noqa: ARG001 - as every tab
    """Three lines; nothing where no Lagrangian was tracked."""
    if "energies" not in run.data:
        return
    t_s = run.t_s
    energy, value, bound = run.data["energies"].values.T
    log_line(rec, f"{paths.VALLEY}/bound", t_s, bound, name="bound (Theorem 3)", color=palette.GREY)
    log_line(rec, f"{paths.VALLEY}/value", t_s, value, name="V_z", color=palette.SKY_BLUE)
    log_line(rec, paths.ENERGY, t_s, energy, name="energy", color=palette.ORANGE)


def tab(layout: Layout) -> rrb.Container | None:
    """Does it stay in its valley?"""
    if "energies" not in layout.run.data:
        return None
    energy = series_view(
        paths.ENERGY,
        "Energy (J) of segments (trunk and joints made heavy), elastic joints, V_z/eps²",
        y_range=robust_range(layout.run.data["energies"].values[:, 0]),
        legend=False,
    )
    plots = rows([valley_view(layout), energy], columns=1, name="Energy")
    return rrb.Horizontal(scene_view(layout), plots, column_shares=[2, 3], name="Lagrangian")


def valley_view(layout: Layout) -> rrb.View:
    """V_z and its bound, as far as that is near."""
    _, value, bound = layout.run.data["energies"].values.T
    near = bound < 3.0 * max(1.0, *value[np.isfinite(value)])  # the rest is out of the image
    what = ", and what it would stay below if the animal were let go at this instant (Theorem 3, grey)"
    if not near.any():
        finite = bound[np.isfinite(bound)]
        what = f"; Theorem 3's bound of a release is {finite.min():.3g} or more" if len(finite) else ""
    return series_view(paths.VALLEY, f"V_z{what}", y_range=robust_range(np.concatenate([[0.0], value, bound[near]])))
