"""What a recording holds beside arrays: potentials of joints, movies, the plane of one film."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eal.arrays import Array, short_repr
from eal.choice import Choice
from eal.over_time import OverTime
from eal.plot import plot_potential
from eal.potential import EmpiricalPotential
from mocap.io.movies import Movie
from mocap.sides import words


@dataclass(frozen=True, eq=False, kw_only=True)
class JointPotential:
    """The empirical potential V_z of one joint: 0 where it was seen, 1 far from there (EAL paper, equation 14).

    Attributes:
        joint: Joint name.
        frame: Frame of reference of the coordinates (see ``mocap.joints``).
        samples_m: (N, d) coordinates in metres; d = 2 in the planes of a limb, 3 in the body.
        potential: V_z on coordinates divided by ``scale_m``.
        scale_m: Metres a unit of the potential's coordinates.
        choice: How its kernel and lambda were chosen; None of one that was read back.
    """

    joint: str
    frame: str
    samples_m: Array
    potential: EmpiricalPotential
    scale_m: float
    choice: Choice | None = None

    __repr__ = short_repr

    def value(self, q_m: ArrayLike) -> Array:
        """V_z at (..., d) coordinates in metres: (...) values between 0 (where the joint was seen) and 1."""
        return self.potential.value(np.asarray(q_m) / self.scale_m)

    def gradient(self, q_m: ArrayLike) -> Array:
        """Gradient of V_z in 1/m at (..., d) coordinates in metres."""
        return self.potential.gradient(np.asarray(q_m) / self.scale_m) / self.scale_m

    def hessian(self, q_m: ArrayLike) -> Array:
        """Hessian of V_z in 1/m^2, (..., d, d), at (..., d) coordinates in metres."""
        return self.potential.hessian(np.asarray(q_m) / self.scale_m) / self.scale_m**2

    def plot(self, ax: Any = None) -> Any:
        """Map of V_z in the plane of the limb, in mm and degrees of flexion, with samples and limb; returns its axes.

        Raises:
            ValueError: it has more than two coordinates.
        """
        labels = ("along the limb (mm)", "across (mm)", "third (mm)")[: self.samples_m.shape[1]]
        ax = plot_potential(self.potential, ax, scale=1e3 * self.scale_m, labels=labels)
        ax.set_title(f"{words(self.joint)}: joint potential, low where the joint goes", fontsize=9)
        if self.samples_m.shape[1] == 2:
            self._draw_limb(ax)
        return ax

    def _draw_limb(self, ax: Any) -> None:
        """The segment before the joint, the mean of the next one, and flexion in degrees: 0 where both are in line."""
        x, y = 1e3 * self.samples_m.T
        length = float(np.median(np.hypot(x, y)))
        (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
        ax.set_facecolor(ax.collections[0].get_facecolors()[-1])  # that of 1, beyond the map
        ax.plot([-length, 0, x.mean()], [0, 0, y.mean()], "o-", color="white", linewidth=2, markersize=4, zorder=4)
        angle = np.sort(np.degrees(np.arctan2(y, x)))
        shown = [(-0.5 * length, -0.1 * length), (0.1 * length, 0.1 * length), (left, low), (right, high)]
        for degrees in range(30 * int(np.floor(angle[0] / 30)), 30 * int(np.ceil(angle[-1] / 30)) + 1, 30):
            way = length * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
            ax.plot(*np.outer(way, (1.22, 1.3)), color="white", linewidth=1)
            ax.text(*(1.42 * way), f"{degrees}°", fontsize=7, ha="center", va="center", color="white")
            shown.append(tuple(1.55 * way))
        (x0, y0), (x1, y1) = np.min(shown, axis=0), np.max(shown, axis=0)
        ax.set(xlim=(x0, x1), ylim=(y0, y1))


@dataclass(frozen=True, eq=False, kw_only=True)
class Footage:
    """The movie of one camera.

    Attributes:
        movie: The movie.
        frames: (T,) its frame, from 0, for each frame of the recording; outside of the movie there is no picture.
        straight: True where its pixels are ideal ones already: no lens, or undistorted before.
    """

    movie: Movie
    frames: OverTime[NDArray[np.int64]]
    straight: bool

    @property
    def there(self) -> NDArray[np.bool_]:
        """(T,) frames of the recording that have a picture."""
        return (self.frames >= 0) & (self.frames < self.movie.n_frames)


@dataclass(frozen=True, kw_only=True)
class Plane:
    """The picture of one film, in which markers move.

    Attributes:
        mm_per_px: Scale; None: not stated, and positions are pixels.
    """

    mm_per_px: float | None = None

    @property
    def unit(self) -> str:
        """Of positions in tables: ``m`` or ``px``."""
        return "px" if self.mm_per_px is None else "m"

    @property
    def length(self) -> str:
        """Of small lengths, in reports: ``mm`` or ``px``, which goes through the chain as a millimetre."""
        return "px" if self.mm_per_px is None else "mm"

    @property
    def unit_m(self) -> float:
        """Metres in which a pixel goes through the chain: 0.001 where no scale is stated."""
        return 1e-3 * (1.0 if self.mm_per_px is None else self.mm_per_px)

    @property
    def per_m(self) -> float:
        """Units of the tables a metre of the chain."""
        return 1e3 if self.mm_per_px is None else 1.0
