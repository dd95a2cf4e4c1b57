"""What all lens models share: pixels to normalised coordinates and back, and the inverse of their bend."""

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
