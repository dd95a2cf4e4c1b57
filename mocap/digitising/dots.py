"""Dots in an image: painted markers or reflective tape, bright or dark, to a fraction of a pixel."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array

Grey = NDArray[np.uint8] | NDArray[np.uint16]
_RADII_PX = (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.5, 8.5, 11.0)  # a grid: a disc responds to its neighbours nearly as much


@dataclass(frozen=True, kw_only=True)
class DotLook:
    """What the dots of a video look like.

    Attributes:
        radius_px: Their radius.
        bright: Whether they are brighter than what is around them.
        least: Least response (grey levels) of a dot; those of the clicked ones are about four times that.
    """

    radius_px: float
    bright: bool
    least: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Strength:
    """How strongly the dots of markers respond in each camera: a log-normal.

    Attributes:
        log_median: (C,) logarithm of the median response (grey levels).
        log_sd: (C,) standard deviation of the logarithm among the weaker half.
    """

    log_median: Array
    log_sd: Array

    def faintness(self, found: Array) -> Array:
        """Squared deviations (C, K) of log responses (C, K) below the median, in variances; 0 above it, or for NaN."""
        with np.errstate(invalid="ignore"):
            below = (self.log_median[:, None] - np.log(np.maximum(found, 1e-3))) / self.log_sd[:, None]
        return np.maximum(np.nan_to_num(below), 0.0) ** 2


def strength_of(found: Array, before: Strength) -> Strength:
    """How strongly dots respond that are named: medians, and how far below them the 16th percentiles are.

    Args:
        found: (C, N) responses of named dots; NaN: none.
        before: What holds for cameras with fewer than 30 of them.
    """
    log_median, log_sd = before.log_median.copy(), before.log_sd.copy()
    for c, row in enumerate(found):
        levels = np.log(np.maximum(row[np.isfinite(row)], 1e-3))
        if len(levels) >= 30:
            low, log_median[c] = np.quantile(levels, (0.16, 0.5))
            log_sd[c] = max(log_median[c] - low, 0.15)  # of a logarithm, at least
    return Strength(log_median=log_median, log_sd=log_sd)


def response(grey: Grey, radius_px: float, *, bright: bool) -> NDArray[np.float32]:
    """Difference of two Gaussian blurs, which is greatest at the centre of a disc of that radius.

    The Laplacian of a Gaussian of s = r / sqrt(2) responds most to a disc of radius r; the difference of Gaussians of
    0.8 s and 1.6 s approximates it (Lindeberg 1998; Lowe 2004).
    """
    s = radius_px / np.sqrt(2)
    signal = grey.astype(np.float32)
    inner = cv2.GaussianBlur(signal, (0, 0), 0.8 * s)
    outer = cv2.GaussianBlur(signal, (0, 0), 1.6 * s)
    found = inner - outer if bright else outer - inner
    return np.asarray(found, dtype=np.float32)


def find_dots(grey: Grey, look: DotLook, *, corner: tuple[int, int] = (0, 0)) -> Array:
    """Find the dots of an image or of a window of it.

    A dot is a local maximum of ``response``; its place is the top of the parabola through the logarithms of the 3 x 3
    responses about it.

    Args:
        grey: (h, w) grey levels.
        look: What dots look like.
        corner: Column and row of the window's first pixel in the image.

    Returns:
        (K, 3) column and row, counted from 0, and the response; strongest first.
    """
    if min(grey.shape) < 5:
        return np.zeros((0, 3))
    found = response(grey, look.radius_px, bright=look.bright)
    size = 2 * max(1, round(0.6 * look.radius_px)) + 1
    top = cv2.dilate(found, np.ones((size, size), np.uint8))
    # many times faster than np.nonzero of an image
    v, u = np.divmod(np.flatnonzero((found >= top) & (found > look.least)), grey.shape[1])
    inside = (u > 0) & (v > 0) & (u < grey.shape[1] - 1) & (v < grey.shape[0] - 1)
    u, v = u[inside], v[inside]
    strength = found[v, u]
    order = np.argsort(-strength)[:250]  # the strongest
    u, v, strength = u[order], v[order], strength[order]
    around = np.log(np.maximum([[found[v + j, u + i] for i in (-1, 0, 1)] for j in (-1, 0, 1)], 1e-3))
    du, dv = _top(around.mean(axis=0)), _top(around.mean(axis=1))
    return np.column_stack([u + du + corner[0], v + dv + corner[1], strength]).astype(np.float64)


def _top(three: Array) -> Array:
    """(K,) place of the top of the parabola through values (3, K) at -1, 0, 1; within half a pixel."""
    bend = three[0] - 2 * three[1] + three[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        place = 0.5 * (three[0] - three[2]) / bend
    return np.clip(np.where(bend < 0, place, 0.0), -0.5, 0.5)


def look_of(pictures: Sequence[Grey], clicks: Sequence[Array], *, reach_px: float = 3.0) -> DotLook | None:
    """What dots look like, from places where a person clicked on them.

    Args:
        pictures: Images.
        clicks: (K, 2) places in each, counted from 0.
        reach_px: So far from a click its dot may be.

    Returns:
        None: there is nothing like a dot at most of the places.
    """
    best: tuple[float, DotLook] | None = None
    reach, margin = round(reach_px), 40
    parts = []
    for picture, places in zip(pictures, clicks, strict=True):
        for u, v in np.rint(places).astype(int):
            left, top = max(u - margin, 0), max(v - margin, 0)
            part = picture[top : v + margin, left : u + margin]
            if part.size:
                parts.append(
                    (
                        part,
                        slice(max(v - top - reach, 0), v - top + reach + 1),
                        slice(max(u - left - reach, 0), u - left + reach + 1),
                    )
                )
    if not parts:
        return None
    for radius in _RADII_PX:
        found = [(response(part, radius, bright=True), rows, columns) for part, rows, columns in parts]
        for bright, sign in ((True, 1.0), (False, -1.0)):
            usual = float(np.median([(sign * f[rows, columns]).max(initial=0.0) for f, rows, columns in found]))
            # of responses that are nearly equal that of the smaller dot: it tells neighbours apart
            if usual > 0 and (best is None or usual > 1.1 * best[0]):
                best = usual, DotLook(radius_px=radius, bright=bright, least=0.25 * usual)
    return None if best is None or best[0] < 4.0 else best[1]


def dot_at(grey: Grey, place: Array, *, reach_px: float = 3.0) -> Array | None:
    """(2,) the dot that a click means: the strongest near it that stands out of what is about it.

    Args:
        grey: (h, w) grey levels.
        place: (2,) column and row, counted from 0.
        reach_px: So far from the click it may be.

    Returns:
        Its column and row; None: nothing stands out there.
    """
    look = look_of([grey], [place[None]], reach_px=reach_px)
    if look is None:
        return None
    left, top = (max(0, round(x) - 40) for x in place)
    part = grey[top : top + 81, left : left + 81]
    found = find_dots(part, look, corner=(left, top))
    levels = response(part, look.radius_px, bright=look.bright)
    usual = 1.4826 * float(np.median(np.abs(levels)))  # the standard deviation of a normal noise
    # of 25 places of pure noise one exceeds six of them once in 40 million
    near = found[(np.linalg.norm(found[:, :2] - place, axis=1) <= reach_px) & (found[:, 2] > 6 * usual)]
    return None if not len(near) else near[0, :2]
