"""Lens distortion: between the pixels that a camera records and those that a pinhole would.

Three models under one interface, with OpenCV's parameters and their order: Brown (k1 k2 p1 p2 k3), rational
(k1 k2 p1 p2 k3 k4 k5 k6) and fisheye (k1 k2 k3 k4).
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from eal.arrays import Array

_BLOCK = 1 << 15
"""Points that Newton's iteration treats at once: their arrays stay in the cache."""


@dataclass(frozen=True, kw_only=True)
class Lens(ABC):
    """A lens in front of a pinhole; x, y = (pixel - centre) / f are its normalised coordinates.

    Attributes:
        f_px: Focal lengths (fx, fy).
        centre_px: Principal point (cx, cy), origin upper-left.
    """

    f_px: tuple[float, float]
    centre_px: tuple[float, float]

    model: ClassVar[str]
    n_coefficients: ClassVar[int]

    @property
    @abstractmethod
    def coefficients(self) -> Array:
        """(n,) distortion coefficients in OpenCV's order."""

    @classmethod
    @abstractmethod
    def of(cls, f_px: Sequence[float], centre_px: Sequence[float], coefficients: Sequence[float] | Array) -> Self:
        """A lens from its focal lengths, principal point and (n,) coefficients in OpenCV's order."""

    @abstractmethod
    def bend(self, xy: Array) -> Array:
        """Ideal normalised coordinates to distorted ones; (..., 2) both."""

    @abstractmethod
    def by_xy(self, xy: Array) -> Array:
        """(..., 2, 2) derivatives of ``bend`` by the ideal coordinates; symmetric in all three models."""

    @abstractmethod
    def by_coefficients(self, xy: Array) -> Array:
        """(..., 2, n) derivatives of ``bend`` by the coefficients."""

    @property
    def is_identity(self) -> bool:
        """True where the lens moves no pixel."""
        return not self.coefficients.any()

    @property
    def if_bent(self) -> Self | None:
        """Itself; None where it moves no pixel."""
        return None if self.is_identity else self

    @property
    def intrinsic(self) -> Array:
        """(3, 3) camera matrix without skew."""
        (fx, fy), (cx, cy) = self.f_px, self.centre_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def distort(self, uv_px: Array) -> Array:
        """Ideal pixels to recorded ones; (..., 2) both."""
        return self.bend(self.normalised(uv_px)) * np.asarray(self.f_px) + np.asarray(self.centre_px)

    def undistort(self, uv_px: Array, *, iterations: int | None = None) -> Array:
        """Recorded pixels to ideal ones, solved to rounding.

        Args:
            uv_px: (..., 2) recorded pixels; NaN stays NaN.
            iterations: Brown's lens alone can do just so many of DLTdv's; the other models, which DLTdv does not know,
                converge whatever is asked.

        Returns:
            (..., 2) ideal pixels; NaN where no ray of a one-to-one lens reaches the pixel.
        """
        del iterations
        flat = self.normalised(uv_px).reshape(-1, 2)
        out = np.full(flat.shape, np.nan)
        seen = np.flatnonzero(np.isfinite(flat).all(axis=-1))
        for start in range(0, len(seen), _BLOCK):
            block = seen[start : start + _BLOCK]
            out[block] = self._straighten(flat[block])
        return out.reshape(np.shape(uv_px)) * np.asarray(self.f_px) + np.asarray(self.centre_px)

    def normalised(self, uv_px: Array) -> Array:
        """Pixels in units of the focal lengths from the principal point; (..., 2) both."""
        return (uv_px - np.asarray(self.centre_px)) / np.asarray(self.f_px)

    def _straighten(self, bent: Array) -> Array:
        """Inverse of ``bend`` for (n, 2) points, by Newton's method; a step that does not help is halved."""
        xy, active = bent.copy(), np.arange(len(bent))
        miss = self.bend(xy) - bent
        scale = np.ones(len(bent))
        for _ in range(50):
            slope = self.by_xy(xy[active])
            xx, cross, yy = slope[:, 0, 0], slope[:, 0, 1], slope[:, 1, 1]
            mx, my = miss[active].T
            with np.errstate(divide="ignore", invalid="ignore"):
                length = scale[active] / (xx * yy - cross * cross)
                step = np.stack([(yy * mx - cross * my) * length, (xx * my - cross * mx) * length], axis=-1)
            trial = xy[active] - step
            new = self.bend(trial) - bent[active]
            better = np.hypot(*new.T) < np.hypot(mx, my)
            moved = active[better]
            xy[moved], miss[moved] = trial[better], new[better]
            scale[active] = np.where(better, np.minimum(2 * scale[active], 1.0), scale[active] / 4)
            active = active[(np.abs(miss[active]).max(axis=-1) > 1e-14) & (scale[active] > 1e-4)]
            if not len(active):
                break
        slope = self.by_xy(xy)
        xx, cross, yy = slope[:, 0, 0], slope[:, 0, 1], slope[:, 1, 1]
        one_to_one = (xx * yy > cross * cross) & (xx + yy > 0)
        missed = np.abs(miss).max(axis=-1) > 1e-12 * (1 + np.abs(bent).max(axis=-1))
        return np.where((one_to_one & ~missed)[:, None], xy, np.nan)


@dataclass(frozen=True, kw_only=True)
class RationalLens(Lens):
    """OpenCV's rational model, with r^2 = x^2 + y^2.

    x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and likewise y
    with p1, p2 exchanged.

    Attributes:
        k: Radial coefficients (k1 .. k6).
        p: Tangential coefficients (p1, p2).
    """

    k: tuple[float, ...] = (0.0,) * 6
    p: tuple[float, float] = (0.0, 0.0)

    model: ClassVar[str] = "rational"
    n_coefficients: ClassVar[int] = 8

    @property
    def coefficients(self) -> Array:
        """(8,) k1 k2 p1 p2 k3 k4 k5 k6; (5,) of Brown's lens."""
        return np.array([*self.k[:2], *self.p, *self.k[2:]])

    @classmethod
    def of(cls, f_px: Sequence[float], centre_px: Sequence[float], coefficients: Sequence[float] | Array) -> Self:
        """A lens from its focal lengths, principal point and coefficients in OpenCV's order."""
        k1, k2, p1, p2, *rest = (float(c) for c in coefficients)
        (fx, fy), (cx, cy) = f_px, centre_px
        k = (k1, k2, *rest)
        return cls(f_px=(float(fx), float(fy)), centre_px=(float(cx), float(cy)), k=k, p=(p1, p2))

    def bend(self, xy: Array) -> Array:
        """Ideal normalised coordinates to distorted ones; (..., 2) both."""
        radial, tangential = self._parts(xy)
        return xy * radial[..., None] + tangential

    def by_xy(self, xy: Array) -> Array:
        """(..., 2, 2) derivatives of ``bend`` by the ideal coordinates."""
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        above, below = self._polynomials(r2)
        radial = above / below
        k1, k2, k3, k4, k5, k6 = (*self.k, 0.0, 0.0, 0.0)[:6]
        change = (k1 + r2 * (2 * k2 + 3 * k3 * r2) - radial * (k4 + r2 * (2 * k5 + 3 * k6 * r2))) / below
        p1, p2 = self.p
        out = np.empty((*x.shape, 2, 2))
        out[..., 0, 0] = radial + 2 * x * x * change + 2 * p1 * y + 6 * p2 * x
        out[..., 1, 1] = radial + 2 * y * y * change + 6 * p1 * y + 2 * p2 * x
        out[..., 0, 1] = out[..., 1, 0] = 2 * (x * y * change + p1 * x + p2 * y)
        return out

    def by_coefficients(self, xy: Array) -> Array:
        """(..., 2, n) derivatives of ``bend`` by the coefficients."""
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        above, below = self._polynomials(r2)
        powers = np.stack([r2, r2**2, r2**3], axis=-1) / np.asarray(below)[..., None]
        shifts = np.stack([2 * x * y, r2 + 2 * x * x, r2 + 2 * y * y, 2 * x * y], axis=-1).reshape(*x.shape, 2, 2)
        up = xy[..., None] * powers[..., None, :]
        down = -(above / below)[..., None, None] * up
        return np.concatenate([up[..., :2], shifts, up[..., 2:], down], axis=-1)[..., : self.n_coefficients]

    def _polynomials(self, r2: Array) -> tuple[Array, Array | float]:
        k1, k2, k3, *low = self.k
        above = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return above, (1 + r2 * (low[0] + r2 * (low[1] + r2 * low[2]))) if low else 1.0

    def _parts(self, xy: Array) -> tuple[Array, Array]:
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        above, below = self._polynomials(r2)
        p1, p2 = self.p
        tangential = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=-1)
        return above / below, tangential


@dataclass(frozen=True, kw_only=True)
class BrownLens(RationalLens):
    """Brown's radial and tangential distortion, as OpenCV, Argus, easyWand and DLTdv parametrise it.

    x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and likewise y with p1, p2 exchanged: the rational
    model with k4 = k5 = k6 = 0.

    Attributes:
        k: Radial coefficients (k1, k2, k3).
        p: Tangential coefficients (p1, p2).
    """

    k: tuple[float, ...] = (0.0, 0.0, 0.0)

    model: ClassVar[str] = "brown"
    n_coefficients: ClassVar[int] = 5

    def undistort(self, uv_px: Array, *, iterations: int | None = None) -> Array:
        """Recorded pixels to ideal ones.

        Args:
            uv_px: (..., 2) recorded pixels; NaN stays NaN.
            iterations: None solves to rounding. A number does just so many fixed-point iterations and takes
                f = mean(fx, fy), which is what DLTdv does with 3.

        Returns:
            (..., 2) ideal pixels.
        """
        if iterations is None:
            return super().undistort(uv_px)
        f_px = float(np.mean(self.f_px))
        start = (uv_px - np.asarray(self.centre_px)) / f_px
        xy = start
        for _ in range(iterations):
            radial, tangential = self._parts(xy)
            xy = (start - tangential) / radial[..., None]
        return xy * f_px + np.asarray(self.centre_px)


@dataclass(frozen=True, kw_only=True)
class FisheyeLens(Lens):
    """Kannala & Brandt (2006) as OpenCV's fisheye has it.

    With theta = atan(r), the distorted point lies in the direction of (x, y) at
    theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8).

    Attributes:
        k: Coefficients (k1, k2, k3, k4).
    """

    k: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    model: ClassVar[str] = "fisheye"
    n_coefficients: ClassVar[int] = 4

    @property
    def coefficients(self) -> Array:
        """(4,) k1 k2 k3 k4."""
        return np.array(self.k)

    @property
    def is_identity(self) -> bool:
        """Never: without coefficients it is equidistant."""
        return False

    @classmethod
    def of(cls, f_px: Sequence[float], centre_px: Sequence[float], coefficients: Sequence[float] | Array) -> Self:
        """A lens from its focal lengths, principal point and (4,) coefficients."""
        (fx, fy), (cx, cy), (k1, k2, k3, k4) = f_px, centre_px, (float(c) for c in coefficients)
        return cls(f_px=(float(fx), float(fy)), centre_px=(float(cx), float(cy)), k=(k1, k2, k3, k4))

    def bend(self, xy: Array) -> Array:
        """Ideal normalised coordinates to distorted ones; (..., 2) both."""
        r = np.hypot(xy[..., 0], xy[..., 1])
        with np.errstate(invalid="ignore", divide="ignore"):
            return xy * np.where(r > 0, self._reach(np.arctan(r)) / r, 1.0)[..., None]

    def by_xy(self, xy: Array) -> Array:
        """(..., 2, 2) derivatives of ``bend`` by the ideal coordinates."""
        r = np.maximum(np.hypot(xy[..., 0], xy[..., 1]), 1e-12)
        theta, unit = np.arctan(r), xy / r[..., None]
        ratio, outward = self._reach(theta) / r, self._reach_slope(theta) / (1 + r * r)
        along = unit[..., :, None] * unit[..., None, :]
        return ratio[..., None, None] * np.eye(2) + (outward - ratio)[..., None, None] * along

    def by_coefficients(self, xy: Array) -> Array:
        """(..., 2, 4) derivatives of ``bend`` by the coefficients."""
        r = np.maximum(np.hypot(xy[..., 0], xy[..., 1]), 1e-12)
        powers = np.arctan(r)[..., None] ** np.array([3, 5, 7, 9])
        return (xy / r[..., None])[..., :, None] * powers[..., None, :]

    def _reach(self, theta: Array) -> Array:
        k1, k2, k3, k4 = self.k
        t2 = theta * theta
        return theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))

    def _reach_slope(self, theta: Array) -> Array:
        k1, k2, k3, k4 = self.k
        t2 = theta * theta
        return 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))

    def _straighten(self, bent: Array) -> Array:
        """Newton's method for the angle, between 0 and 90 degrees."""
        reach = np.hypot(bent[:, 0], bent[:, 1])
        theta = np.minimum(reach, 1.5)
        for _ in range(50):
            slope = np.maximum(self._reach_slope(theta), 0.05)
            new = np.clip(theta - (self._reach(theta) - reach) / slope, 0.0, np.pi / 2)
            moved, theta = np.abs(new - theta).max(initial=0.0), new
            if moved < 1e-16:
                break
        good = (np.abs(self._reach(theta) - reach) < 1e-12 * (1 + reach)) & (self._reach_slope(theta) > 0)
        good &= theta < np.pi / 2 - 1e-9
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(reach > 0, np.tan(theta) / reach, 1.0)
        return np.where(good[:, None], bent * ratio[:, None], np.nan)


MODELS: dict[str, type[Lens]] = {lens.model: lens for lens in (BrownLens, RationalLens, FisheyeLens)}
"""Lens models by name."""
