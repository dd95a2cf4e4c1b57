"""What the readers of optical motion-capture systems share: units, and records from positions with their origin."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocap.arrays import Array
from mocap.errors import FormatError
from mocap.records import MarkerTracks, Origin

UNIT_M = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
"""Metres in a unit."""


def metres(path: Path, unit: str) -> float:
    """Length of a unit in metres.

    Raises:
        FormatError: the unit is not known.
    """
    try:
        return UNIT_M[unit.strip().lower()]
    except KeyError:
        known = ", ".join(UNIT_M)
        raise FormatError(f"{path.name}: lengths are in {unit!r}; expected one of {known}: state the unit") from None


def rate(path: Path, value: object) -> float:
    """A frame rate in hertz.

    Raises:
        FormatError: it is no positive number.
    """
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = np.nan
    if not (np.isfinite(number) and number > 0):
        raise FormatError(f"{path.name}: the frame rate is {value}; expected frames a second, above 0")
    return number


def marker_tracks(
    path: Path, names: Sequence[str], t_s: Array, xyz_m: Array, origin: NDArray | None = None
) -> MarkerTracks:
    """A record without covariances.

    Args:
        path: Of the file, for messages.
        names: The M marker names.
        t_s: (T,) times.
        xyz_m: (T, M, 3) positions; NaN where not seen.
        origin: (T, M) Origin codes; None: measured where there is a position.

    Raises:
        FormatError: a name appears twice, or times do not increase.
    """
    if origin is None:
        origin = np.where(np.isnan(xyz_m[..., 0]), Origin.MISSING, Origin.MEASURED)
    try:
        return MarkerTracks(
            names=tuple(names), t_s=t_s, xyz_m=xyz_m, cov_m2=np.full((*xyz_m.shape, 3), np.nan), origin=origin
        )
    except ValueError as error:
        raise FormatError(f"{path.name}: {error}; correct it and export again") from None
