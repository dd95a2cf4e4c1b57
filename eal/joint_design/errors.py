"""What goes wrong in a design, and the words that its files share."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

Law = Literal["linear", "neo_hookean", "cable", "strut", "tape"]
"""Laws of ``eal.joint_design.laws``."""


class DesignError(ValueError):
    """A joint cannot be designed as asked; the message names the limit that binds."""
