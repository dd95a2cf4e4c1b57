"""A recording whose truth is known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, frozen
from mocap.cameras.camera import Camera
from mocap.records import MarkerTracks, PixelTracks
from mocap.skeleton import Skeleton


@dataclass(frozen=True, eq=False, kw_only=True)
class SyntheticRecording:
    """What the cameras recorded, what was digitised, and what was true.

    Attributes:
        name: Short name; file names begin with it.
        pixels: Pixels as digitised: distorted, noisy, with markers missing and misplaced.
        cameras: The C cameras with lens and size.
        skeleton: The animal.
        truth: Every marker in every frame.
        fps: Frames a second.
        start_s: (C,) time by which each camera starts late; its frame n is taken at ``pixels.t_s[n] + start_s``.
        occluded: (C, T, M) True where the animal or its surroundings hide the marker, or it is out of the picture.
        lost: (C, T, M) True where the digitiser lost it, hidden or not.
        outlier: (C, T, M) True where it was digitised in a wrong place.
        contact: (T, M) True where a marker stands still on the ground.
        card: Species, rig, units, rates, seed, faults injected and their statistics; ready for JSON.
    """

    name: str
    pixels: PixelTracks
    cameras: tuple[Camera, ...]
    skeleton: Skeleton
    truth: MarkerTracks
    fps: float
    start_s: Array
    occluded: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    outlier: NDArray[np.bool_]
    contact: NDArray[np.bool_]
    card: dict

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        shape = self.pixels.uv_px.shape[:3]
        for name in ("occluded", "lost", "outlier"):
            object.__setattr__(self, name, frozen(name, getattr(self, name), shape, dtype=np.bool_))
        object.__setattr__(self, "start_s", frozen("start_s", self.start_s, shape[:1]))
        object.__setattr__(self, "contact", frozen("contact", self.contact, shape[1:], dtype=np.bool_))
