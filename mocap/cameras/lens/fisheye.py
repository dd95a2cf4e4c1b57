"""The fisheye of Kannala and Brandt."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from eal.arrays import Array
from mocap.cameras.lens.base import Lens


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
