"""How many decimals of a number are worth writing."""

import numpy as np

from eal.arrays import Array

HELD = 15
"""Significant decimal digits that a float64 holds whatever the number."""


def decimals_of(values: Array, sd: Array, *, least: int) -> int:
    """Decimals that keep two significant digits of the smallest standard deviation.

    Args:
        values: Numbers to write, of any shape; NaN where there is none.
        sd: Their standard deviations, of any shape; 0 and NaN tell nothing.
        least: Decimals that are written whatever the deviations.

    Returns:
        At least ``least``, and no more than the greatest number has in ``HELD`` significant digits.
    """
    known = sd[np.isfinite(sd) & (sd > 0)]
    wanted = int(np.ceil(-np.log10(known.min()))) + 1 if known.size else least
    return max(least, min(wanted, decimals_in(values, digits=HELD)))


def decimals_in(values: Array, *, digits: int) -> int:
    """Decimals that write the greatest of some numbers with so many significant digits."""
    size = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    return digits - 1 - int(np.floor(np.log10(size))) if size > 0 else 0
