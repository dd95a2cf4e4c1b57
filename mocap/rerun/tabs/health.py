"""Tab: how well the filter agrees with what was seen, over time."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from scipy.special import chdtri

from eal.arrays import Array
from mocap.rerun import palette, paths
from mocap.rerun.blueprint import log_line, robust_range, rows, series_view
from mocap.rerun.layout import Layout
from mocap.rerun.log_markers import gap_lanes_view, log_gaps
from mocap.rerun.row_map import WIDE, amounts, log_row_map, row_map_view, usual_limit
from mocap.tracking.result import Result

BAND = (0.025, 0.975)
"""Quantiles of chi-square between which the normalised innovation of a consistent filter lies in 95 % of frames."""
_ERRORS = (
    (paths.INNOVATION, paths.INNOVATION_MAP, "By how far the next frame was missed (innovation, rms)"),
    (paths.RESIDUAL, paths.RESIDUAL_MAP, "How far the result is from the clicks (residual, rms)"),
)


def log(rec: rr.RecordingStream, run: Result, layout: Layout) -> None:
    """Innovations and residuals of each camera, normalised innovation with its band, likelihood, rows; lanes of gaps.

    Cameras are lines, and rows of a map, in which more than a few can be told apart.
    """
    t_s = run.t_s
    log_gaps(rec, run.tracks)
    if run.cameras:
        colors = [palette.SERIES[c % len(palette.SERIES)] for c in range(len(run.cameras))]
        for (lines, rows, _), values in zip(_ERRORS, layout.errors_px, strict=True):
            log_line(rec, lines, t_s, values.T, name=run.camera_names, color=colors)
            picture = amounts(values, usual_limit(values))
            log_row_map(rec, rows, picture, names=run.camera_names, t_s=t_s, size=WIDE)
    low, high = nis_band(run.n_rows)
    band = np.column_stack([low, high])
    log_line(rec, f"{paths.NIS}/band", t_s, band, name=("2.5 %", "97.5 %"), color=palette.GREY)
    log_line(rec, f"{paths.NIS}/value", t_s, _nis(run), name="NIS (expected 1)", color=palette.SKY_BLUE)
    log_line(rec, paths.LOG_LIKELIHOOD, t_s, run.log_likelihood, name="log-likelihood", color=palette.GREEN)
    log_line(rec, paths.ROWS, t_s, run.n_rows.astype(np.float64), name="rows", color=palette.ORANGE)


def tab(layout: Layout) -> rrb.Container:
    """Is the filter consistent, frame by frame?"""
    run, nis = layout.run, _nis(layout.run)
    limit = max(3.0, 1.2 * float(np.nanquantile(nis, 0.98))) if np.isfinite(nis).any() else 3.0
    views = [
        series_view(
            paths.NIS,
            "Are predictions as good as stated (NIS)? Between the grey lines: yes; above: worse; below: better",
            y_range=(0.0, limit),
        )
    ]
    for (lines, rows_, what), values in zip(_ERRORS, layout.errors_px, strict=True) if run.cameras else ():
        if len(run.cameras) <= 4:  # more cameras are rows of a map
            views.append(series_view(lines, f"{what}, each camera (px)", y_range=robust_range(values)))
        else:
            scale = f"dark 0 to yellow {usual_limit(values):.3g} px"
            views.append(row_map_view(rows_, f"{what}, each camera: {scale}", WIDE))
    views += [
        series_view(
            paths.LOG_LIKELIHOOD,
            "How well each frame fits (log-likelihood, nat): look at the dips",
            y_range=robust_range(run.log_likelihood),
            legend=False,
        ),
        series_view(paths.ROWS, "Measured coordinates used in each frame", legend=False),
        gap_lanes_view(),
    ]
    return rows(views, columns=2, name="Filter diagnostics")


def nis_band(n_rows: NDArray[np.int64]) -> Array:
    """(2, T) quantiles ``BAND`` of chi-square with ``n_rows`` degrees of freedom, a row; NaN without rows.

    Bar-Shalom, Li & Kirubarajan 2001, section 5.4.
    """
    rows, where = np.unique(n_rows, return_inverse=True)
    freedom = np.where(rows > 0, rows, 1)
    quantiles = np.array([chdtri(freedom, 1 - p) / freedom for p in BAND])
    return np.where(rows > 0, quantiles, np.nan)[:, where]


def _nis(run: Result) -> Array:
    """(T,) normalised innovation squared, a row."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(run.n_rows > 0, run.nis / run.n_rows, np.nan)
