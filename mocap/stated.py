"""Numbers that a user states: refused where no camera and no recording has them."""

import numpy as np

from mocap.errors import MocapError

BOUNDS = {"fps": (1e-6, 1e7), "pixel_sd": (1e-4, 1e4), "image_height_px": (1.0, 1e6), "mm_per_px": (1e-7, 1e5)}
"""Least and greatest of each option: a frame in twelve days to the fastest cameras; a pixel's hair to a whole picture;
a row to a thousand times a camera's; an electron micrograph to a landscape."""

FAR_OFF = 2.0
"""A standard deviation so many times another contradicts it."""


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


def contradiction(stated_px: float | None, *, low_px: float, high_px: float) -> list[str]:
    """A sentence where ``--pixel-sd`` is not what the pixels show, to a factor of ``FAR_OFF``; else nothing.

    Args:
        stated_px: As stated; None: not.
        low_px: Noise that rays show once their slow errors are taken out.
        high_px: Noise that rays show with all their errors.
    """
    if stated_px is None:
        return []
    if stated_px * FAR_OFF < low_px:
        return [
            f"`pixel_sd` {stated_px:g} contradicts the pixels, whose triangulation residuals correspond to "
            f"{low_px:.2g} px. Outliers are rejected by the residuals; intervals use the stated value and are "
            f"{low_px / stated_px:.0f} times too narrow for the residuals: leave it out, or check it"
        ]
    if stated_px > FAR_OFF * high_px:
        return [
            f"`pixel_sd` {stated_px:g} contradicts the pixels, whose triangulation residuals correspond to "
            f"{high_px:.2g} px. Intervals use the stated value and are {stated_px / high_px:.0f} times as wide as the "
            "residuals justify, and fewer outliers are rejected: leave it out, or check it"
        ]
    return []
