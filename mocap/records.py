"""The records that the stages of the chain hand to each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Z95, Array, frozen, increasing, short_repr, unique
from eal.over_time import OverTime, Time
from mocap.pixel_corner import PixelCorner as PixelCorner

BOTH: tuple[PixelCorner, PixelCorner] = ("upper-left", "lower-left")
LEAST_LIKELIHOOD = 0.6
"""Clicks of a lower likelihood are not believed where no second camera tells what it is worth: DeepLabCut's cutoff."""


class Status(IntEnum):
    """Where the value of one sample of one marker comes from."""

    MISSING = 0  # no value
    MEASURED = 1  # from the marker's own rays or file values
    INTERPOLATED = 2  # by a curve through its neighbours
    PREDICTED = 3  # by a motion model, before its first or after its last sighting
    SMOOTHED = 4  # by a motion model, between sightings: a filled gap
    REJECTED = 5  # a measurement was there and was not believed; the value, if any, is the model's


def unknown(sd: Array, widest: float) -> NDArray[np.bool_]:
    """Where nothing is known of a value: its 95 % interval is as wide as all that it can be.

    The one rule of what is too uncertain to be written, drawn or averaged: of angles ``widest`` is the range of the
    joint, of positions the length of the animal.
    """
    return sd > widest / (2 * Z95)


@dataclass(frozen=True, eq=False, kw_only=True)
class PixelTracks:
    """Where each camera saw each marker.

    Attributes:
        names: The M marker names, unique.
        cameras: The C camera names, unique.
        t_s: (T,) times in seconds, increasing.
        uv_px: (C, T, M, 2) pixels, in the convention of the file that they come from; NaN where not seen.
    """

    names: tuple[str, ...]
    cameras: tuple[str, ...]
    t_s: OverTime[Array]
    uv_px: Annotated[Array, Time(1)]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        unique("marker", self.names)
        unique("camera", self.cameras)
        object.__setattr__(self, "t_s", frozen("t_s", self.t_s, (None,)))
        shape = (len(self.cameras), len(self.t_s), len(self.names), 2)
        uv_px = np.array(self.uv_px, dtype=np.float64)
        uv_px[np.isnan(uv_px).any(axis=-1)] = np.nan
        object.__setattr__(self, "uv_px", frozen("uv_px", uv_px, shape))
        increasing("t_s", self.t_s)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(C, T, M) True where a camera saw a marker."""
        return ~np.isnan(self.uv_px[..., 0])


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkerTracks:
    """Positions of named markers over time.

    Attributes:
        names: The M marker names, unique.
        t_s: (T,) times in seconds, increasing.
        xyz_m: (T, M, 3) positions in metres in the world frame; NaN where there is no value.
        cov_m2: (T, M, 3, 3) covariance of each position; NaN where not known.
        status: (T, M) one Status code a sample.
    """

    names: tuple[str, ...]
    t_s: OverTime[Array]
    xyz_m: OverTime[Array]
    cov_m2: OverTime[Array]
    status: OverTime[NDArray[np.int8]]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        unique("marker", self.names)
        object.__setattr__(self, "t_s", frozen("t_s", self.t_s, (None,)))
        n_frames, n_markers = len(self.t_s), len(self.names)
        object.__setattr__(self, "xyz_m", frozen("xyz_m", self.xyz_m, (n_frames, n_markers, 3)))
        object.__setattr__(self, "cov_m2", frozen("cov_m2", self.cov_m2, (n_frames, n_markers, 3, 3)))
        object.__setattr__(self, "status", frozen("status", self.status, (n_frames, n_markers), dtype=np.int8))
        increasing("t_s", self.t_s)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(T, M) True where there is a position."""
        return ~np.isnan(self.xyz_m[..., 0])

    @property
    def sd_m(self) -> Array:
        """(T, M) root mean square of the three standard deviations of each position, in metres."""
        return np.sqrt(np.trace(self.cov_m2, axis1=-2, axis2=-1) / 3)


def marker_tracks(
    names: Sequence[str], t_s: Array, xyz_m: Array, *, cov_m2: Array | None = None, status: NDArray | None = None
) -> MarkerTracks:
    """Tracks of which no more is known than this.

    Args:
        names: The M marker names.
        t_s: (T,) times.
        xyz_m: (T, M, 3) positions; NaN where not seen.
        cov_m2: (T, M, 3, 3) covariances; None: not known.
        status: (T, M) Status codes; None: measured where there is a position.
    """
    return MarkerTracks(
        names=tuple(names),
        t_s=t_s,
        xyz_m=xyz_m,
        cov_m2=np.broadcast_to(np.nan, (*xyz_m.shape, 3)) if cov_m2 is None else cov_m2,
        status=np.where(np.isnan(xyz_m[..., 0]), Status.MISSING, Status.MEASURED) if status is None else status,
    )


ENERGIES = ("energy_j", "v_z", "v_z_bound")
"""Columns of a Lagrangian."""
PARTS = {0: (), 1: ("bend",), 2: ("across_1", "across_2"), 3: ("across_1", "across_2", "twist")}
"""What the coordinates of a joint are called, by how many it has."""


def angle_names(ends: Sequence[tuple[str, str]], freedoms: Sequence[int]) -> tuple[str, ...]:
    """Names of the coordinates of joints, each with the names of its marker and of the end of its segment."""
    return tuple(f"{a}_{b}_{part}" for (a, b), k in zip(ends, freedoms, strict=True) for part in PARTS[k])


@dataclass(frozen=True, kw_only=True)
class Plane:
    """The image of one video, in which markers move.

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

    def in_units(self, markers: MarkerTracks) -> tuple[Array, Array]:
        """(T, M, 2) positions and (T, M, 2, 2) covariances in the unit of the tables."""
        return self.per_m * markers.xyz_m[..., :2], self.per_m**2 * markers.cov_m2[..., :2, :2]
