"""Colours that colour-blind people can tell apart, on a dark ground."""

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from eal.arrays import Array
from eal.plot import COLORS

Rgb = tuple[int, int, int]

# Okabe & Ito 2008, "Color universal design"
SKY_BLUE: Rgb = (86, 180, 233)
ORANGE: Rgb = (230, 159, 0)
GREEN: Rgb = (0, 158, 115)
YELLOW: Rgb = (240, 228, 66)
BLUE: Rgb = (0, 114, 178)
VERMILLION: Rgb = (213, 94, 0)
PURPLE: Rgb = (204, 121, 167)
RED: Rgb = (221, 51, 34)
"""Near to the red of Tol 2021, "Colour schemes": nobody takes it for the orange of a side."""

WHITE: Rgb = (235, 238, 242)
GREY: Rgb = (150, 156, 166)
DIM: Rgb = (84, 92, 106)
GROUND: Rgb = (16, 18, 23)

SERIES: tuple[Rgb, ...] = (SKY_BLUE, ORANGE, GREEN, YELLOW, PURPLE, VERMILLION, BLUE, WHITE)
"""In the order in which lines of a plot take them; more lines start over."""

ORIGIN: dict[str, Rgb] = {"measured": SKY_BLUE, "filled": YELLOW, "rejected": RED}
"""Colour of each class of samples (``paths.ORIGINS``): light, middle and dark also without hue."""

DIM_ORIGIN: dict[str, Rgb] = {**ORIGIN, "measured": (38, 76, 99)}
"""The same for large areas, where what was measured recedes."""


SIDE: dict[str, Rgb] = {"left": PURPLE, "right": ORANGE, "trunk": WHITE}
"""Of angles; blue is what was measured, and nothing else."""

TRAIL: dict[str, Rgb] = {"left": (122, 72, 100), "right": (140, 96, 0), "trunk": DIM}
"""The same, darker."""


def depth(value: Array) -> NDArray[np.uint8]:
    """Colours of a potential between 0 (yellow: where the animal goes) and 1 (dark violet: nothing holds there).

    Args:
        value: (...) numbers; outside of 0..1 they are clipped.

    Returns:
        (..., 3) red, green, blue.
    """
    return colormaps[COLORS](np.clip(value, 0, 1), bytes=True)[..., :3]
