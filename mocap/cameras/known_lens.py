"""A camera's lens as calibrated by itself, and how well it is known."""

from dataclasses import dataclass, field

import numpy as np

from eal.arrays import Array, frozen
from mocap.cameras.lens import Lens


@dataclass(frozen=True, eq=False, kw_only=True)
class KnownLens:
    """A lens, with the covariance of those of its numbers that were fitted.

    The numbers are fx, fy, cx, cy, then the distortion coefficients in OpenCV's order.

    Attributes:
        name: Of the camera.
        lens: The lens.
        size_px: Width and height of its pictures; None: not known.
        free: (k) places among the numbers of those that were fitted; empty: the lens is taken as exact.
        cov: (k, k) their covariance.
    """

    name: str
    lens: Lens
    size_px: tuple[int, int] | None = None
    free: tuple[int, ...] = ()
    cov: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "cov", frozen("cov", self.cov, (len(self.free), len(self.free))))

    @property
    def numbers(self) -> Array:
        """(4 + n) fx, fy, cx, cy and the coefficients."""
        return np.concatenate([self.lens.f_px, self.lens.centre_px, self.lens.coefficients])

    @property
    def sd(self) -> Array:
        """(4 + n) standard deviation of each number; 0 of those that were not fitted."""
        out = np.zeros(len(self.numbers))
        out[list(self.free)] = np.sqrt(np.diag(self.cov))
        return out

    def moved(self, step: Array) -> Lens:
        """The lens with (k,) steps of its fitted numbers."""
        numbers = self.numbers
        numbers[list(self.free)] += step
        return type(self.lens).of(tuple(numbers[:2]), tuple(numbers[2:4]), numbers[4:])
