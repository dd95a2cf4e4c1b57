"""Gaps hidden in what one camera saw, and how they are filled: across the line of sight, which is all it measures."""

from dataclasses import replace

import numpy as np
from mocap.filters.hidden_gaps import gaps_like_own
from mocap.filters.hide import Hidden
from mocap.filters.interpolate import interpolated
from mocap.filters.models.base import TrialSet
from mocap.filters.models.one_camera import FittedViews
from mocap.filters.one_view import Views
from mocap.filters.poses import MarkerTrial
from mocap.filters.score import Residuals, Score, score
from numpy.typing import NDArray

from eal.arrays import Array
from eal.efforts import Progress


def filled_views(
    fitted: FittedViews, trials: TrialSet, views: Views, *, name: str, seed: int = 0, progress: Progress | None = None
) -> dict[str, Score]:
    """How well a model fills gaps that are hidden in what a camera saw, beside curves through its pixels; by name.

    Args:
        fitted: The model.
        trials: Trials; the last is the recording, with the positions that were found where a marker was seen.
        views: What was seen of it.
        name: What the model is called.
        seed: Where gaps are hidden, by the rule of all recordings (``gaps_like_own``).
        progress: Called with the share done.
    """
    for _, hidden in gaps_like_own(trials, times=1, seed=seed).hidden:
        first = int(np.searchsorted(trials.trials[-1].t_s, hidden.trial.t_s[0]))
        seen = views.frames(first + np.arange(len(hidden.trial.t_s)))
        shown = replace(seen, uv_px=_without(hidden, seen.uv_px))
        found = fitted.fill(shown, progress=progress)
        missed = across(hidden, seen, found.xyz_m, found.cov_m2, clicks_m=found.own["misfit"][3])
        missed = missed.some(np.isfinite(missed.error_m[:, 0]))  # poses unlike those of trials are left empty
        if len(missed.error_m):
            return _curves(hidden, seen, shown) | {name: missed.score()}
    return {}


def across(
    hidden: Hidden[MarkerTrial], views: Views, xyz_m: Array, cov_m2: Array, *, clicks_m: float = 0.0
) -> Residuals:
    """What positions (T, M, 3) with their covariance miss hidden pixels by, in metres across the line of sight.

    With h(x) the projection and H its slope at the estimate, a pixel misses by u - h(x), whose variance is H P H' and
    that of the pixel; a metre across is sqrt(s1 s2) pixels, by the singular values of H. Of Student's t with scale s
    and nu degrees of freedom the variance is s^2 nu / (nu - 2). Clicks that stay off by ``clicks_m`` are so in both.
    """
    where, (miss, slope) = _hidden_rays(hidden, views), views.seen_from(xyz_m)
    miss, slope = miss[where], slope[where]
    metre = _px_per_m(slope)
    cov = slope @ cov_m2[hidden.mask] @ np.swapaxes(slope, 1, 2)
    return Residuals(
        error_m=miss / metre[:, None],
        variance=np.diagonal(cov, axis1=1, axis2=2) / metre[:, None] ** 2,
        noise=((views.sd_px[where] / metre) ** 2 + clicks_m**2) * views.dof / (views.dof - 2),
        gap=hidden.gap[hidden.mask],
        length=hidden.length[hidden.mask],
    )


def _curves(hidden: Hidden[MarkerTrial], seen: Views, shown: Views) -> dict[str, Score]:
    """How curves through the pixels of each marker fill them, at the depth at which it was found."""
    where = _hidden_rays(hidden, seen)
    metre, out = _px_per_m(seen.seen_from(hidden.trial.xyz_m)[1][where]), {}
    for kind in ("linear", "cubic"):
        path = np.stack([interpolated(uv, hidden.trial.t_s, kind=kind) for uv in shown.uv_px])
        error = (path - seen.uv_px)[where] / metre[:, None]
        out[kind] = score(error[np.isfinite(error[:, 0])], None)
    return out


def _hidden_rays(hidden: Hidden[MarkerTrial], views: Views) -> tuple[NDArray[np.int64], ...]:
    """Camera, frame and marker of each hidden sample, in the order of ``hidden.mask``."""
    frame, marker = np.nonzero(hidden.mask)
    return views.seen[:, frame, marker].argmax(axis=0), frame, marker


def _px_per_m(slope: Array) -> Array:
    """(n,) pixels of a metre across the line of sight, by slopes (n, 2, 3) of the projection."""
    (a, b), (c, d) = np.moveaxis(slope @ np.swapaxes(slope, 1, 2), 0, -1)
    return (a * d - b * c) ** 0.25


def _without(hidden: Hidden[MarkerTrial], uv_px: Array) -> Array:
    """(C, T, M, 2) pixels without those that are hidden."""
    out = uv_px.copy()
    for gap in hidden.gaps:
        out[:, gap.frames, gap.hidden] = np.nan
    return out
