"""Lens distortion: between the pixels that a camera records and those that a pinhole would.

Three models under one interface, with OpenCV's parameters and their order: Brown (k1 k2 p1 p2 k3), rational
(k1 k2 p1 p2 k3 k4 k5 k6) and fisheye (k1 k2 k3 k4).
"""

from mocap.cameras.lens.base import Lens
from mocap.cameras.lens.brown import BrownLens, RationalLens
from mocap.cameras.lens.fisheye import FisheyeLens

MODELS: dict[str, type[Lens]] = {lens.model: lens for lens in (BrownLens, RationalLens, FisheyeLens)}
"""Lens models by name."""

__all__ = ["MODELS", "BrownLens", "FisheyeLens", "Lens", "RationalLens"]
