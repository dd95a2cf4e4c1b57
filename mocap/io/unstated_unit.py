"""Lengths whose unit is stated by no file and no user: the length of the animal chooses the unit, and is told."""

import numpy as np

from eal.arrays import Array
from mocap.cameras.triangulate import linear, residual_px
from mocap.errors import NoUnitError
from mocap.findings import Finding, Kind
from mocap.io.contents import FileContents
from mocap.io.lines import UNIT_M

ANIMALS_M = (1e-4, 20.0)
"""From a mite to a whale: no animal whose markers are followed is shorter or longer."""
PATHS_M = (0.0, 300.0)
"""How far a single marker gets about."""
XRAYED_M = (0.003, 0.5)
"""What fits between an X-ray source and its image intensifier."""
LONG_M = 3.0
"""Few animals are longer."""
WIDEST_NOISE_M = 0.05
"""No system of cameras that follows one animal is so vague."""
UNSTATED = "no unit is stated: "
"""How sentences on an assumed unit begin, in capitals where it may well be wrong."""
_UNITS = ("m", "mm", "cm")


def length(xyz: Array) -> float:
    """Median over frames of the greatest distance between two of (T, M, 3) positions; of one how far it gets about."""
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
    finite = size[np.isfinite(size)]
    return float(np.median(finite) / 0.6745) if finite.size else np.nan


def guessed(long: float, vague: float = np.nan, *, bounds_m: tuple[float, float] = ANIMALS_M) -> str | None:
    """The unit of an animal so long in it: metres if it can be, else millimetres; of X-ray systems centimetres first.

    What is long with coordinates as noisy (``vague``, NaN: not known) is not in metres. None where no length in
    these units lies between ``bounds_m``.
    """
    if bounds_m == XRAYED_M:
        return next((unit for unit in ("cm", "mm", "m") if _within(long, unit, bounds_m)), None)
    noisy = long > LONG_M and vague > WIDEST_NOISE_M
    return next((u for u in ("m", "mm")[noisy:] if _within(long, u, bounds_m)), None)


def _within(long: float, unit: str, bounds_m: tuple[float, float]) -> bool:
    return bounds_m[0] <= long * UNIT_M[unit] <= bounds_m[1]


def assumed_unit(
    long: float, vague: float, *, bounds_m: tuple[float, float], where: str, what: str, more: str = ""
) -> tuple[str, Finding]:
    """The unit that is assumed, and a finding that says so, with the length of the animal in it and in others.

    ``long``, ``vague`` and ``bounds_m`` are as in ``guessed``; ``where`` is the file, ``what`` is so long, ``more``
    what else speaks against the unit.

    Raises:
        FormatError: no unit makes it an animal.
    """
    unit = guessed(long, vague, bounds_m=bounds_m)
    lengths = {u: length_text(long * UNIT_M[u]) for u in _UNITS}
    if unit is None:
        raise NoUnitError(
            f"{where}: no unit is stated, and none makes {what} one: it would be "
            f"{', '.join(f'{text} long in {u}' for u, text in lengths.items())}: state `unit`"
        )
    others = ", ".join(f"{u} if it is {text} long" for u, text in lengths.items() if u != unit)
    in_words = "metres" if unit == "m" else unit
    if vague * UNIT_M[unit] > WIDEST_NOISE_M:
        more += f", and jitters by {length_text(vague * UNIT_M[unit])}"
    sentence = f"lengths are assumed to be in {in_words}, so that {what} is {lengths[unit]} long{more}"
    if unit != "m" or more or long > ANIMALS_M[1]:
        wrong = "If that is wrong, all lengths below are wrong: state the unit"
        return unit, Finding(
            kind=Kind.ASSUMED_UNIT, alarm=True, text=f"{UNSTATED.upper()}{sentence}. {wrong}: {others}"
        )
    others = f"; if that is wrong, state the unit: {others}" if long > LONG_M else ""
    return unit, Finding(kind=Kind.ASSUMED_UNIT, text=f"{UNSTATED}{sentence}{others}", mends=("unit",))


def in_metres(recording: FileContents, unit: str | None = None) -> tuple[FileContents, tuple[Finding, ...]]:
    """A recording as read with positions in metres, and findings on the unit where nobody states it.

    Only positions without cameras are guessed at.

    Raises:
        FormatError: the unit is not known, the file states another, or the length fits no animal in any unit.
    """
    if unit is not None:
        return recording.with_unit(unit), ()
    if recording.points is None or recording.pixels is not None or recording.unit is not None:
        return recording, ()
    long, vague = length(recording.points.xyz_m), noise(recording.points.xyz_m)
    if not long > 0:
        return recording, ()
    several = len(recording.names) > 1
    bounds = PATHS_M if not several else XRAYED_M if recording.format.startswith("xmalab") else ANIMALS_M
    what = "the animal" if several else "the path of the marker"
    unit, finding = assumed_unit(long, vague, bounds_m=bounds, where=recording.paths[0].name, what=what)
    return recording if unit == "m" else recording.with_unit(unit), (finding,)


def of_cameras(matrices: Array, ideal_px: Array, *, where: str) -> tuple[str, tuple[Finding, ...]]:
    """The unit that a calibration is assumed to be in, by the same rule, and a finding that says so.

    Of (C, 3, 4) projections in the unknown unit and (C, T, M, 2) ideal pixels.

    Raises:
        FormatError: the length fits no animal in any unit.
    """
    some = ideal_px[:, :: max(1, ideal_px.shape[1] // 1000)]
    xyz = linear(matrices, some)
    miss = residual_px(matrices, some, xyz)
    if not np.isfinite(miss).any():
        return "m", ()
    xyz = np.where((miss <= 5 * np.nanmedian(miss) + 1e-6)[..., None], xyz, np.nan)  # without clicks that are wrong
    long = length(xyz)
    if not long > 0:
        return "m", ()
    several = xyz.shape[1] > 1
    places = -np.linalg.solve(matrices[:, :, :3], matrices[:, :, 3:])[..., 0]
    far = np.linalg.norm(places - np.nanmedian(xyz.reshape(-1, 3), axis=0), axis=-1)
    bounds = ANIMALS_M if several else PATHS_M
    unit = guessed(long, bounds_m=bounds) or "m"
    near, farthest = (length_text(distance * UNIT_M[unit]) for distance in (far.min(), far.max()))
    # from further away nobody tells markers apart
    more = f" and filmed from {near} to {farthest} away" if np.median(far) * UNIT_M[unit] > 100.0 else ""
    what = "the animal" if several else "the path of the marker"
    unit, finding = assumed_unit(long, np.nan, bounds_m=bounds, where=where, what=what, more=more)
    return unit, (finding,)


def length_text(metres: float) -> str:
    """A length as people say it."""
    for unit, size in (("km", 1e3), ("m", 1.0), ("mm", 1e-3)):
        if metres >= size:
            return f"{metres / size:.3g} {unit}"
    return f"{metres * 1e6:.3g} um"
