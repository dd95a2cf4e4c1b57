"""Which measurements are of one place: what was recorded twice tells nothing new, and cannot check a fit."""

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array

SAME = 1e-3
"""Places are one where they are nearer to each other than that share of the extent of all."""
CLICK_PX = 2.0
"""Pixels of a thing that did not move differ by no more than that: as far as clicks and detections scatter."""


def distinct(places: Array, *, within: float | None = None) -> NDArray[np.intp]:
    """(n,) number of the place of each measurement, from 0 in the order of first appearance.

    Args:
        places: (n, d) coordinates; NaN where not known. Two measurements are compared by what both have, and are apart
            where that is nothing.
        within: Distance below which two are one, in each coordinate; None: ``SAME`` of the largest extent.
    """
    known = np.isfinite(places)
    if within is None:
        within = SAME * float(np.ptp(places[known.all(axis=-1)], axis=0).max()) if known.all(axis=-1).any() else 0.0
    out = np.full(len(places), -1, dtype=np.intp)
    count = 0
    for i in range(len(places)):
        if out[i] >= 0:
            continue
        both = known & known[i]
        apart = np.where(both, np.abs(places - places[i]), 0.0).max(axis=-1)
        out[(out < 0) & both.any(axis=-1) & (apart <= within)] = count
        out[i] = count
        count += 1
    return out
