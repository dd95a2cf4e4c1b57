"""The lens of a recording from its own marker tracks: the radial distortion with which its rays meet."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, pinhole_lens, stacked
from mocap.cameras.lens import BrownLens
from mocap.cameras.triangulate import linear, misses, project
from mocap.errors import CalibrationError
from mocap.text import number_of

STRETCHES = 8
"""Stretches of frames that are left out in turn: what an animal does in one says little of the others."""
_LEAST = 60  # points: chosen, not measured
_OWN = 0.9
"""A coefficient for each camera needs residuals lower by this factor than one for all: cameras mostly bear like lenses,
and errors of calibration look like lenses that differ."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackLens:
    """Radial distortion k1 (Brown) of each camera, about the principal point of its coefficients.

    Attributes:
        lenses: The C lenses.
        k1: (C,) their coefficients; one number for all cameras, or one each.
        cov: (C, C) covariance of ``k1``, from stretches left out in turn.
        before_px: Median residual of stretches that the fit did not see, without a lens.
        after_px: The same with the lens fitted to the other stretches.
        by_camera: Whether each camera has its own.
    """

    lenses: tuple[BrownLens, ...]
    k1: Array
    cov: Array
    before_px: float
    after_px: float
    by_camera: bool

    @property
    def sd(self) -> Array:
        """(C,) standard deviation of each coefficient."""
        return np.sqrt(np.diag(self.cov))

    def straight(self, uv_px: Array, steps: Array | float = 0.0) -> Array:
        """(C, ..., 2) ideal pixels of recorded ones, with steps (C,) of the coefficients."""
        return _straight(self.lenses, uv_px, self.k1 + steps)

    def cameras(self, cameras: Sequence[Camera], *, y_up: bool) -> tuple[Camera, ...]:
        """Cameras with these lenses, as a camera profile describes them: from the upper left.

        An image size that is not known is twice the principal point.

        Args:
            cameras: The C cameras that they were fitted to.
            y_up: Whether the coefficients count rows from the lower left.
        """
        found = []
        for camera, lens, k1 in zip(cameras, self.lenses, self.k1, strict=True):
            x, y = lens.centre_px
            size = camera.size_px or (round(2 * x), round(2 * y))
            centre = x, (size[1] - y if y_up else y)
            bent = replace(lens, k=(float(k1), 0.0, 0.0), centre_px=centre)
            found.append(replace(camera, lens=bent, size_px=size))
        return tuple(found)

    @property
    def words(self) -> str:
        """The coefficients with their standard deviations."""
        if not self.by_camera:
            return f"k1 {self.k1[0]:.3f} ± {self.sd[0]:.3f} in all cameras"
        return "k1 " + ", ".join(f"{k:.3f} ± {s:.3f}" for k, s in zip(self.k1, self.sd, strict=True)) + " by camera"


def moved_by_lens(cameras: Sequence[Camera], uv_px: Array, k1: float) -> Array:
    """(T, M, 3) by how much points lie elsewhere when pixels (C, T, M, 2) are straightened with k1; NaN if not seen."""
    matrices = stacked(cameras)
    straight = _straight([*map(pinhole_lens, cameras)], uv_px, np.full(len(cameras), k1))
    return linear(matrices, straight) - linear(matrices, uv_px)


def lens_covariance(cameras: Sequence[Camera], found: TrackLens, uv_px: Array) -> Array:
    """(T, M, 3, 3) covariance of points that the covariance of a fitted lens makes; ``uv_px`` are recorded pixels."""
    matrices = stacked(cameras)
    scale, directions = np.linalg.eigh(found.cov)
    out = np.zeros((*uv_px.shape[1:3], 3, 3))
    for variance, direction in zip(scale, directions.T, strict=True):
        if variance > 1e-6 * scale.max():
            step = np.sqrt(variance) * direction
            ahead, behind = (linear(matrices, found.straight(uv_px, sign * step)) for sign in (1, -1))
            half = (ahead - behind) / 2
            out += half[..., :, None] * half[..., None, :]
    return out


def lens_of_tracks(cameras: Sequence[Camera], uv_px: Array, *, each: bool = True) -> TrackLens:
    """Fit k1 so that rays meet, the cameras' coefficients held; one number, or one each where that predicts better.

    Least squares with Cauchy's loss on the residuals of triangulation (points are eliminated: each is triangulated anew
    for every k1). The recording's points are split into ``STRETCHES`` of frames; leaving out each in turn gives
    residuals that the fit has not seen, by which the model is chosen, and the covariance (jackknife, Efron & Stein
    1981), which contains errors that go together within a stretch. Errors of the coefficients are in none of the
    stretches alone: where one number is fitted, the spread of numbers that are fitted to each camera by itself (median
    absolute deviation, over the root of their number) is added.

    Args:
        cameras: The C cameras, without lenses.
        uv_px: (C, T, M, 2) pixels in the convention of the coefficients; NaN where not seen.
        each: Whether cameras may have a number each; else one is fitted for all.

    Raises:
        CalibrationError: too few points, or the recording does not determine the lens.
    """
    lenses = [*map(pinhole_lens, cameras)]
    uv = uv_px.reshape(len(uv_px), -1, 2)
    uv = uv[:, np.isfinite(uv[..., 0]).sum(axis=0) >= 2]
    if uv.shape[1] < _LEAST:
        raise CalibrationError(
            f"`fit_lens`: {number_of(uv.shape[1], 'point is', 'points are')} seen by two cameras, and {_LEAST} are "
            "needed: give the profile"
        )
    uv = uv[:, np.linspace(0, uv.shape[1] - 1, min(uv.shape[1], 1200)).astype(int)]
    matrices, n = stacked([Camera(name=c.name, matrix=c.matrix) for c in cameras]), len(cameras)
    block = np.arange(uv.shape[1]) * STRETCHES // uv.shape[1]
    kept = [uv[:, block != b] for b in range(STRETCHES)]
    left = [uv[:, block == b] for b in range(STRETCHES)]
    before = _median([misses(matrices, u) for u in left])

    def by_stretches(whole: Array) -> tuple[float, Array]:
        """The residual of stretches left out, and (BLOCKS, C) coefficients without each."""
        parts = [_fitted(lenses, matrices, u, whole) for u in kept]
        left_out = [misses(matrices, _straight(lenses, u, _each(k, n))) for k, u in zip(parts, left, strict=True)]
        return _median(left_out), np.stack([_each(k, n) for k in parts])

    best = _fitted(lenses, matrices, uv, np.zeros(1))
    after, parts = by_stretches(best)
    own = _fitted(lenses, matrices, uv, np.repeat(best, n)) if each and n > 1 else None
    if own is not None and _median([misses(matrices, _straight(lenses, uv, own))]) < _OWN * after:
        after_own, parts_own = by_stretches(own)
        if after_own < _OWN * after:
            after, best, parts = after_own, own, parts_own
    off = parts - parts.mean(axis=0)
    cov = (STRETCHES - 1) / STRETCHES * off.T @ off
    if own is not None and len(best) == 1:
        cov = cov + (1.4826 * np.median(np.abs(own - np.median(own)))) ** 2 / n
    k1, sd = _each(best, n), np.sqrt(np.diag(cov))
    if not after < 0.97 * before:  # chosen, as are the limits below
        raise CalibrationError(
            f"`fit_lens`: no lens reduces the reprojection error: the median residual of stretches left out of the "
            f"fit is {after:.2f} px with k1 {k1[0]:.3f} and {before:.2f} px without: leave it out"
        )
    # undetermined, or stronger than any lens
    if (sd > np.maximum(0.03, np.abs(k1) / 3)).any() or (np.abs(k1) > 0.6).any():
        worst = int(np.argmax(sd))
        raise CalibrationError(
            f"`fit_lens`: this recording does not determine the lens (camera {cameras[worst].name!r}: k1 "
            f"{k1[worst]:.2f} ± {sd[worst]:.2f}): the animal must be seen in all parts of the images; give the "
            "profile, or film a board: mocap calibrate lenses"
        )
    return TrackLens(lenses=tuple(lenses), k1=k1, cov=cov, before_px=before, after_px=after, by_camera=len(best) > 1)


def _each(k: Array, n: int) -> Array:
    return np.broadcast_to(k, (n,)) if len(k) == 1 else k


def _straight(lenses: Sequence[BrownLens], uv: Array, k1: Array) -> Array:
    """Ideal pixels; a pixel that no ray of so strong a lens reaches is far from all others."""
    out = []
    for lens, k, seen in zip(lenses, k1, uv, strict=True):
        bent = BrownLens(f_px=lens.f_px, centre_px=lens.centre_px, k=(float(k), 0.0, 0.0))
        ideal = bent.undistort(seen)
        out.append(np.where(np.isnan(ideal) & np.isfinite(seen), seen, ideal))
    return np.stack(out)


def _fitted(lenses: Sequence[BrownLens], matrices: Array, uv: Array, start: Array) -> Array:
    n = len(lenses)
    sd = max(_median([misses(matrices, _straight(lenses, uv, _each(start, n)))]), 1e-3)
    seen = np.isfinite(uv[..., 0])

    def residual(k: Array) -> Array:
        ideal = _straight(lenses, uv, _each(k, n))
        return ((ideal - project(matrices, linear(matrices, ideal)))[seen] / sd).ravel()

    if len(start) == 1 and not start.any():
        grid = np.linspace(-0.4, 0.4, 9)
        start = np.array([min(grid, key=lambda k: float(np.median(np.abs(residual(np.array([k]))))))])
    from scipy.optimize import least_squares

    return least_squares(
        residual, start, loss="cauchy", diff_step=1e-4, x_scale=0.1, xtol=1e-4, ftol=1e-6, max_nfev=20
    ).x


def _median(parts: Sequence[Array]) -> float:
    return float(np.median(np.concatenate(parts)))
