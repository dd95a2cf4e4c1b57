"""Positions whose unit is stated by no file and no user: the length of the animal suggests the unit."""

import numpy as np

from eal.arrays import Array
from mocap.io.contents import FileContents
from mocap.io.optical import UNIT_M

LONGEST_M = 20.0
"""No animal is longer: what is, is no animal in metres."""
USUAL_M = (0.003, 8.0)
"""From a fly to a giraffe: the lengths that speak for a unit other than metres."""
LONG_M = 3.0
"""Few animals are longer."""
WIDEST_NOISE_M = 0.05
"""No system of cameras that follows one animal is so vague."""
_UNITS = ("mm", "cm")
"""Units that programs write beside metres, and do not state."""


def length(xyz: Array) -> float:
    """Median over frames of the greatest distance between two markers; of one marker how far it gets about.

    Args:
        xyz: (T, M, 3) positions; NaN where not seen.
    """
    seen = np.isfinite(xyz).all(axis=-1)
    two = np.flatnonzero(seen.sum(axis=1) >= 2)
    if not len(two):
        return float(np.linalg.norm(np.ptp(xyz[seen], axis=0))) if seen.any() else np.nan
    some = xyz[two[:: max(1, len(two) // 500)]]  # of 500 to 1000 frames: a median needs no more
    widest = np.zeros(len(some))
    for marker in range(some.shape[1]):
        apart = np.linalg.norm(some - some[:, marker, None], axis=-1)
        widest = np.fmax(widest, np.fmax.reduce(apart, axis=1))
    return float(np.median(widest))


def noise(xyz: Array) -> float:
    """Standard deviation of a coordinate by fourth differences, whose variance is 70 times its own; NaN if unknown."""
    size = np.abs(np.diff(xyz, n=4, axis=0)) / np.sqrt(70)
    known = size[np.isfinite(size)]
    return float(np.median(known) / 0.6745) if known.size else np.nan


def guessed(long: float) -> str:
    """The unit of an animal so long in it: metres, unless that is no animal and one other unit alone makes it one."""
    usual = [unit for unit in _UNITS if USUAL_M[0] <= long * UNIT_M[unit] <= USUAL_M[1]]
    return usual[0] if long > LONGEST_M and len(usual) == 1 else "m"


def in_metres(recording: FileContents, unit: str | None = None) -> tuple[FileContents, tuple[str, ...]]:
    """A recording with positions in metres, and findings on the unit where nobody states it.

    Args:
        recording: As read; only positions without cameras are guessed at.
        unit: As the user states it; None: not.

    Raises:
        FormatError: the unit is not known, or the file states another.
    """
    if unit is not None:
        return recording.with_unit(unit), ()
    if recording.points is None or recording.pixels is not None or recording.unit is not None:
        return recording, ()
    xyz = recording.points.xyz_m
    long, vague = length(xyz), noise(xyz)
    if not np.isfinite(long):
        return recording, ()
    unit, what = guessed(long), "the animal" if len(recording.names) > 1 else "the path of the marker"
    if unit != "m":
        return recording.with_unit(unit), (
            f"NO UNIT IS STATED: lengths are assumed to be in {unit}, so that {what} is {_m(long * UNIT_M[unit])} "
            f"long (in metres it would be {_m(long)}): state the unit (m, {', '.join(_UNITS)}), in particular if "
            "this is wrong",
        )
    others = ", ".join(f"{unit} if it is {_m(long * UNIT_M[unit])} long" for unit in _UNITS)
    if long > LONGEST_M or vague > WIDEST_NOISE_M:
        jitter = f" and jitters by {_m(vague)}" if vague > WIDEST_NOISE_M else ""
        return recording, (
            f"NO UNIT IS STATED: lengths are assumed to be in metres, so that {what} is {_m(long)} long{jitter}. If "
            f"that is wrong, all lengths below are wrong: state the unit: {others}",
        )
    doubt = f"; if that is wrong, state the unit: {others}" if long > LONG_M else ""
    return recording, (
        f"no unit is stated: lengths are assumed to be in metres, so that {what} is {_m(long)} long{doubt}",
    )


def too_long(xyz_m: Array) -> tuple[str, ...]:
    """A finding where cameras show an animal longer than any is: the calibration is in another unit."""
    long = length(xyz_m)
    if not long > LONGEST_M:
        return ()
    others = ", ".join(f"{unit} if it is {_m(long * UNIT_M[unit])} long" for unit in _UNITS)
    return (
        f"THE ANIMAL IS {_m(long)} LONG if the calibration is in metres, as is assumed. If that is wrong, all "
        f"lengths below are wrong: state the unit of the calibration: {others}",
    )


def _m(metres: float) -> str:
    """A length as people say it."""
    for unit, size in (("km", 1e3), ("m", 1.0), ("mm", 1e-3)):
        if metres >= size:
            return f"{metres / size:.3g} {unit}"
    return f"{metres * 1e6:.3g} um"
