"""A recording whose truth is known, and the scene that it was filmed of."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mocap.datasets.occlusion import Solid
from numpy.typing import NDArray

from eal.arrays import Array, frozen
from mocap.cameras.camera import Camera
from mocap.records import MarkerTracks, PixelTracks, Status
from mocap.skeleton import Skeleton


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """An animal in motion.

    Attributes:
        skeleton: Its markers, M of them, in the order of ``xyz_m``.
        t_s: (T,) times.
        xyz_m: (T, M, 3) markers in the world: right-handed, z up, origin in the measured volume.
        triangles: (K, 3) marker indices of opaque membranes.
        solids: Opaque bodies.
        clearance_m: A membrane or surface this close to a marker does not hide it.
        clusters: Sets of markers that are lost together, such as a wing tip.
        contact: (T, M) True where a marker stands still on the ground.
    """

    skeleton: Skeleton
    t_s: Array
    xyz_m: Array
    triangles: NDArray[np.intp]
    solids: tuple[Solid, ...]
    clearance_m: float
    clusters: tuple[tuple[str, ...], ...]
    contact: NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        n_markers = len(self.skeleton.markers)
        object.__setattr__(self, "t_s", frozen("t_s", self.t_s, (None,)))
        object.__setattr__(self, "xyz_m", frozen("xyz_m", self.xyz_m, (len(self.t_s), n_markers, 3)))
        object.__setattr__(self, "triangles", frozen("triangles", self.triangles, (None, 3), dtype=np.intp))
        object.__setattr__(self, "contact", frozen("contact", self.contact, self.xyz_m.shape[:2], dtype=np.bool_))

    @property
    def truth(self) -> MarkerTracks:
        """The markers, complete and without error."""
        n_frames, n_markers = self.xyz_m.shape[:2]
        return MarkerTracks(
            names=self.skeleton.markers,
            t_s=self.t_s,
            xyz_m=self.xyz_m,
            cov_m2=np.zeros((n_frames, n_markers, 3, 3)),
            status=np.full((n_frames, n_markers), Status.MEASURED),
        )


Motion = Callable[[Array], Scene]
"""An animal over all time: from times (T,) to the scene at these times."""


def start_times(seed: np.random.SeedSequence, n_cameras: int, spread_s: float) -> Array:
    """(C,) times by which each camera starts late: the first at 0, the others uniform within ``spread_s`` about it.

    With a spread of up to a frame, equal frame numbers stay the nearest in time, as after matching frames by eye.

    Raises:
        ValueError: the spread is negative.
    """
    if not spread_s >= 0:
        raise ValueError(f"cameras start within {spread_s:g} s of each other: give 0 or more")
    late_s = np.random.default_rng(seed).uniform(-spread_s / 2, spread_s / 2, n_cameras)
    late_s[0] = 0.0
    return late_s


def frame_times(n_frames: int, fps: float) -> Array:
    """(T,) times of ``n_frames`` frames from 0 on.

    Raises:
        ValueError: no frames, or a rate that is not positive.
    """
    if n_frames < 1 or not fps > 0:
        raise ValueError(f"n_frames must be 1 or more and fps above 0, but they are {n_frames} and {fps:g}")
    return np.arange(n_frames) / fps


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
        occluded: (C, T, M) True where the animal or its surroundings hide the marker, or it is out of the image.
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
