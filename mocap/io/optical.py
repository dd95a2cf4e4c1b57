"""What the readers of optical motion-capture systems share: units, and records from positions with their origin."""

import re
from collections.abc import Sequence
from itertools import count
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.lines import number

UNIT_M = {"mm": 1e-3, "cm": 1e-2, "dm": 1e-1, "m": 1.0, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
"""Metres in a unit."""
_IN_WORDS = re.compile(r"(milli|centi|deci|micro|)met(?:er|re)s?")
_TIME_WORDS = re.compile(r"(milli|micro|nano|[munµμ])?(?:s|secs?|seconds?)")
_TIME_S = {None: 1.0, "milli": 1e-3, "m": 1e-3, "nano": 1e-9, "n": 1e-9} | dict.fromkeys(("micro", *"uµμ"), 1e-6)
_PREFIXES = {"milli": "mm", "centi": "cm", "deci": "dm", "micro": "um", "": "m"}


def unit_of(text: str) -> str | None:
    """The unit of ``UNIT_M`` that a text names, in short or in full; None: it names none."""
    text = text.strip().lower()
    words = _IN_WORDS.fullmatch(text)
    short = _PREFIXES[words[1]] if words else text
    return short if short in UNIT_M else None


def time_unit_s(text: str) -> float | None:
    """Seconds in a unit of time that a text names, in short or in full; None: it names none."""
    words = _TIME_WORDS.fullmatch(text.strip().lower())
    return _TIME_S[words[1]] if words else None


def metres(path: Path, unit: str) -> float:
    """Length of a unit in metres.

    Raises:
        FormatError: the unit is not known.
    """
    if (short := unit_of(unit)) is None:
        units = ", ".join(UNIT_M)
        raise FormatError(f"{path.name}: lengths are in {unit!r}, which is not a known unit ({units}): state the unit")
    return UNIT_M[short]


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


RATES_HZ = (1e-4, 1e7)  # a picture in three hours, and the fastest cameras
SLOW, SLOW_HZ = "ARE TIMES SECONDS?", 1.0
"""How a finding begins on times that a second or more lies between, as seconds: few animals are filmed so slowly."""


def told_apart(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names of which none is empty or another's (U_1, U_2, ... are unnamed), and findings on what was changed."""
    found, changed = [], []
    unnamed = (new for new in map("U_{}".format, count(1)) if new not in names)
    for place, name in enumerate(names, start=1):
        new = name or next(unnamed)
        while new in found:
            new = f"{new}_{place}"
        if new != name:
            changed.append(f"{name!r} -> {new!r}")
        found.append(new)
    shown = ", ".join(changed[:5]) + (", ..." if len(changed) > 5 else "")
    return found, [f"{len(changed)} points without a unique name were renamed: {shown}"] if changed else []


def _rounded_rate(t_s: Array) -> float:
    """The rate with the fewest digits of which even times in seconds are multiples, as far as they are rounded.

    Files round times: 0.001429, 0.002857, ... are of 700 frames a second, not of 699.999999.
    """
    fps = (len(t_s) - 1) / (t_s[-1] - t_s[0])
    decimals = next((d for d in range(12) if np.allclose(t_s, np.round(t_s, d), rtol=0, atol=1e-13)), 12)
    for digits in range(9):
        simple = round(fps, digits)
        off = np.abs(t_s - t_s[0] - np.arange(len(t_s)) / (simple or np.inf))
        if simple and off.max() <= 10.0**-decimals:
            return simple
    return fps


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
    fps = 1 / np.median(steps) if uneven else _rounded_rate(t_s)
    notes = [f"times are uneven: steps of {steps.min():.4g} to {steps.max():.4g} s"] if uneven else []
    if fps <= SLOW_HZ:
        counts = "if they count frames, their rate is not known"
        unit, size = ("milliseconds", 1e3) if fps > SLOW_HZ / 1e3 else ("microseconds", 1e6)
        other = counts if (steps == 1).all() else f"if they are {unit}, {fps * size:.6g}"
        notes.append(f"{SLOW} as such they give {fps:.4g} frames a second; {other}: state `fps`")
    return float(f"{fps:.9g}"), notes
