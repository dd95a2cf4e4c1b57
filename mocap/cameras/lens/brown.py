"""OpenCV's rational model, and Brown's, which is the part of it that every format holds."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from eal.arrays import Array
from mocap.cameras.lens.base import Lens


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
