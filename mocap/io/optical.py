"""What the readers of optical motion-capture systems share: units, and records from positions with their origin."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.lines import number

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
        raise FormatError(
            f"{path.name}: lengths are in {unit!r}, which is not a known unit ({known}): state the unit"
        ) from None


def rate(path: Path, value: object) -> float:
    """A frame rate in hertz.

    Raises:
        FormatError: it is no positive number.
    """
    try:
        hertz = number(value) if isinstance(value, str) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        hertz = np.nan
    if not (np.isfinite(hertz) and hertz > 0):
        raise FormatError(f"{path.name}: the frame rate is {value}; expected frames a second, above 0")
    return hertz


def told_apart(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names of which none is empty or another's, and findings on what was changed."""
    found, changed = [], []
    for place, name in enumerate(names, start=1):
        new = name or f"point{place}"
        while new in found:
            new = f"{new}_{place}"
        if new != name:
            changed.append(f"{name!r} -> {new!r}")
        found.append(new)
    shown = ", ".join(changed[:5]) + (", ..." if len(changed) > 5 else "")
    return found, [f"{len(changed)} points without a unique name were renamed: {shown}"] if changed else []


def rate_of_times(path: Path, t_s: Array) -> tuple[float | None, list[str]]:
    """Frames a second of times in seconds (None of fewer than two), and a finding where they are uneven.

    Raises:
        FormatError: they do not increase.
    """
    if len(t_s) < 2:
        return None, []
    steps = np.diff(t_s)
    if not (steps > 0).all():
        row = int(np.argmax(~(steps > 0)))
        raise FormatError(f"{path.name}: times do not increase: {t_s[row + 1]:g} s follows {t_s[row]:g} s")
    uneven = np.ptp(steps) > 0.5 * np.median(steps)
    fps = 1 / np.median(steps) if uneven else (len(t_s) - 1) / (t_s[-1] - t_s[0])
    told = [f"times are uneven: steps of {steps.min():.4g} to {steps.max():.4g} s"] if uneven else []
    return float(f"{fps:.9g}"), told
