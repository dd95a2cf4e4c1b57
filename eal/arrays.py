"""Arrays as records of this package keep them, and the checks that every entry point makes."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def frozen(value: ArrayLike) -> Array:
    """A read-only float64 copy."""
    array = np.array(value, dtype=np.float64)
    array.flags.writeable = False
    return array


def positive(name: str, value: float, unit: str = "") -> float:
    """A finite number above zero.

    Raises:
        ValueError: it is not; the message names it.
    """
    number = float(value)
    if not (np.isfinite(number) and number > 0.0):
        raise ValueError(f"{name} must be a finite number above 0{unit and ' ' + unit}, but is {value!r}")
    return number


def points(name: str, value: ArrayLike, dimension: int) -> Array:
    """Configurations as (..., d) float64.

    Raises:
        ValueError: the last axis is not the d coordinates.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != dimension:
        raise ValueError(
            f"{name} must have {dimension} coordinates on its last axis, but has shape {array.shape}: "
            "the potential was learned on samples of that dimension"
        )
    return array
