"""Within which bounds a stated number may lie."""

import numpy as np

from mocap.errors import MocapError

BOUNDS = {
    "fps": (1e-6, 1e7),
    "pixel_sd": (1e-4, 1e4),
    "point_sd_mm": (1e-6, 1e5),
    "image_height_px": (1.0, 1e6),
    "mm_per_px": (1e-7, 1e5),
}
"""Least and greatest of each option: a frame in twelve days to the fastest cameras; a pixel's hair to a whole image;
a nanometre to a hundred metres; a row to a thousand times a camera's; an electron micrograph to a landscape."""


def check_stated(option: str, value: float | None) -> None:
    """Refuse a number that its option cannot have; None is not stated.

    Raises:
        MocapError: the number is none, or out of ``BOUNDS``.
    """
    if value is None:
        return
    least, most = BOUNDS[option]
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not (number and np.isfinite(value) and value > 0):
        came = f"{value:g}" if number else repr(value)
        raise MocapError(f"`{option}` must be a number above 0, but is {came}: correct it")
    if not least <= value <= most:
        raise MocapError(f"`{option}` must be between {least:g} and {most:g}, but is {value:g}: correct it")


def check_rate(fps: float, where: str) -> None:
    """Refuse a frame rate that a file states and no camera has.

    Raises:
        MocapError: it is out of the bounds of ``--fps``.
    """
    least, most = BOUNDS["fps"]
    if not least <= fps <= most:
        raise MocapError(f"{where}: states {fps:g} frames a second, which no camera takes: give the right `fps`")
