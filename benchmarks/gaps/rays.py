"""What cameras still see of markers that are hidden in 3D: no ray, one, or two that disagree."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mocap.filters.hide import Gap, Hidden

from benchmarks.gaps.method import Film, Trial
from eal.arrays import Array

RAYS = (0, 1, 2)
"""Cameras that are left: none (the marker is dark), one, or two of which the second was clicked in a wrong place."""
CLICK_PX = 1.0
"""Deviation of a wrong click from that of the marker which was taken for the right one: nobody clicks twice alike."""
SEES = 0.9
"""A camera is drawn among those that see such a share of what is hidden."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Shown(Hidden[Trial]):
    """A trial with gaps, and the rays that are left in them.

    Attributes:
        rays: How many (``RAYS``); more than 0 only where the trial has a film.
        cameras: (camera that is left, camera with the wrong clicks) in each gap.
    """

    rays: int = 0
    cameras: tuple[tuple[int, int], ...] = ()

    @cached_property
    def shown(self) -> Trial:
        """The trial without what is hidden; what the cameras that are left see stays in its film."""
        blank = Hidden(trial=self.trial, gaps=self.gaps).shown
        if self.trial.film is None:
            return blank
        uv_px = np.array(self.trial.film.pixels.uv_px)
        for gap in self.gaps:
            uv_px[:, gap.frames, gap.hidden] = np.nan
        for gap, (right, wrong) in zip(self.gaps, self.cameras if self.rays else (), strict=bool(self.rays)):
            seen = self.trial.film.pixels.uv_px[:, gap.frames]
            uv_px[right, gap.frames, gap.hidden] = seen[right][:, gap.hidden].swapaxes(0, 1)
            if self.rays > 1:
                noise = np.random.default_rng(gap.start).normal(0, CLICK_PX, seen[wrong].shape)
                uv_px[wrong, gap.frames, gap.hidden] = (wrong_clicks(seen[wrong]) + noise)[:, gap.hidden].swapaxes(0, 1)
        pixels = replace(self.trial.film.pixels, uv_px=uv_px)
        return replace(blank, film=replace(self.trial.film, pixels=pixels))


def with_rays(copy: Shown, rays: int, rng: np.random.Generator) -> Shown:
    """A trial whose gaps keep the rays of a camera, or of two, drawn for each gap.

    Args:
        copy: The trial and its gaps.
        rays: How many are left.
        rng: Which cameras; the same draw has the same first camera whether one ray is left or two.
    """
    film = copy.trial.film
    drawn = () if film is None else tuple(_draw(film, gap, rng) for gap in copy.gaps)
    return Shown(trial=copy.trial, gaps=copy.gaps, rays=rays, cameras=drawn)


def _draw(film: Film, gap: Gap, rng: np.random.Generator) -> tuple[int, int]:
    """Two cameras at random, of those that see most of what is compared in a gap if there are two."""
    share = film.pixels.seen[:, gap.frames][:, :, gap.scored].mean(axis=(1, 2))
    order = rng.permutation(len(share))
    good = [int(c) for c in order if share[c] >= SEES]
    rest = sorted((int(c) for c in order if share[c] < SEES), key=lambda c: -share[c])
    first, second, *_ = [*good, *rest]
    return first, second


def wrong_clicks(uv_px: Array) -> Array:
    """(T, M, 2) clicks of one camera, each put on the marker that is nearest to it in the picture; NaN where none is.

    Args:
        uv_px: (T, M, 2) pixels as they were clicked.
    """
    apart = np.linalg.norm(uv_px[:, :, None] - uv_px[:, None], axis=-1)
    apart[:, np.arange(uv_px.shape[1]), np.arange(uv_px.shape[1])] = np.nan
    nearest = np.argmin(np.where(np.isnan(apart), np.inf, apart), axis=2)
    clicked = np.take_along_axis(uv_px, nearest[..., None], axis=1)
    return np.where(np.isfinite(apart).any(axis=2)[..., None], clicked, np.nan)
