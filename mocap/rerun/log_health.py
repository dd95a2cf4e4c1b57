"""How well the filter agrees with what was seen, over time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from scipy.stats import chi2

from filters.records import TrackedMotion
from mocap.arrays import Array
from mocap.records import PixelTracks
from mocap.rerun import palette, paths
from mocap.rerun.columns import time_columns
from mocap.rerun.row_map import WIDE, amounts, log_row_map

BAND = (0.025, 0.975)
"""Quantiles of chi-square between which the normalised innovation of a consistent filter lies in 95 % of frames."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraErrors:
    """How far each camera's pixels are from what the filter says, root mean squares over the markers of a frame.

    Attributes:
        cameras: The C camera names.
        innovation_px: (C, T) before the update; NaN where a camera saw nothing.
        residual_px: (C, T) after smoothing.
    """

    cameras: tuple[str, ...]
    innovation_px: Array
    residual_px: Array


def camera_errors(tracked: TrackedMotion, pixels: PixelTracks) -> CameraErrors:
    """The errors of the samples in use."""
    residual = pixels.uv_px - tracked.reprojected_px
    return CameraErrors(
        cameras=pixels.cameras,
        innovation_px=rms_px(tracked.innovation_px, tracked.used),
        residual_px=rms_px(residual, tracked.used),
    )


def usual_limit(values: Array) -> float:
    """The end of a scale that 99 % of the numbers stay below; 1 where there are none."""
    known = values[np.isfinite(values)]
    return max(float(np.quantile(known, 0.99)), 1e-9) if known.size else 1.0


def log_health(rec: rr.RecordingStream, tracked: TrackedMotion, errors: CameraErrors | None) -> None:
    """Innovations and residuals of each camera, normalised innovation with its band, likelihood, rows.

    Cameras are lines, and rows of a map, in which more than a few can be told apart.
    """
    t_s = tracked.markers.t_s
    if errors is not None:
        colors = [palette.of_series(c) for c in range(len(errors.cameras))]
        for lines, rows, values in (
            (paths.INNOVATION, paths.INNOVATION_MAP, errors.innovation_px),
            (paths.RESIDUAL, paths.RESIDUAL_MAP, errors.residual_px),
        ):
            log_line(rec, lines, t_s, values.T, name=errors.cameras, color=colors)
            picture = amounts(values, usual_limit(values))
            log_row_map(rec, rows, picture, names=errors.cameras, t_s=t_s, size=WIDE)
    low, high = nis_band(tracked.n_rows)
    with np.errstate(divide="ignore", invalid="ignore"):
        nis = np.where(tracked.n_rows > 0, tracked.nis / tracked.n_rows, np.nan)
    band = np.column_stack([low, high])
    log_line(rec, f"{paths.NIS}/band", t_s, band, name=("2.5 %", "97.5 %"), color=palette.GREY)
    log_line(rec, f"{paths.NIS}/value", t_s, nis, name="NIS / rows", color=palette.SKY_BLUE)
    log_line(rec, paths.LOG_LIKELIHOOD, t_s, tracked.log_likelihood, name="log-likelihood", color=palette.GREEN)
    log_line(rec, paths.ROWS, t_s, tracked.n_rows.astype(np.float64), name="rows", color=palette.ORANGE)


def rms_px(differences_px: Array, used: NDArray[np.bool_]) -> Array:
    """Root mean square length of the differences in each camera and frame.

    Args:
        differences_px: (C, T, M, 2) differences; NaN where there is none.
        used: (C, T, M) those that count.

    Returns:
        (C, T) pixels; NaN where a camera saw nothing.
    """
    square = np.einsum("...i,...i->...", differences_px, differences_px)
    there = used & np.isfinite(square)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sqrt(np.where(there, square, 0.0).sum(axis=-1) / there.sum(axis=-1))


def nis_band(n_rows: NDArray[np.int64]) -> Array:
    """(2, T) quantiles ``BAND`` of chi-square with ``n_rows`` degrees of freedom, a row; NaN without rows.

    Bar-Shalom, Li & Kirubarajan 2001, section 5.4.
    """
    rows, where = np.unique(n_rows, return_inverse=True)
    freedom = np.where(rows > 0, rows, 1)
    quantiles = np.array([chi2.ppf(p, freedom) / freedom for p in BAND])
    return np.where(rows > 0, quantiles, np.nan)[:, where]


def log_line(
    rec: rr.RecordingStream,
    path: str,
    t_s: Array,
    values: Array,
    *,
    name: str | Sequence[str],
    color: palette.Rgb | Sequence[palette.Rgb],
) -> None:
    """One line, or several of one entity, over time.

    Args:
        rec: Where to.
        path: Entity.
        t_s: (T,) times.
        values: (T,) or (T, lines) numbers; NaN breaks the line.
        name: What the legend says, a line.
        color: Of all lines, or a line.
    """
    n_lines = 1 if values.ndim == 1 else values.shape[1]
    colors = [color] * n_lines if isinstance(color[0], int) else list(color)
    names = [name] if isinstance(name, str) else list(name)
    rec.log(path, rr.SeriesLines(names=names, colors=colors, widths=[1.5] * n_lines), static=True)
    rec.send_columns(path, indexes=time_columns(t_s), columns=rr.Scalars.columns(scalars=values))
