"""Unknowns, observations and results of bundle adjustment."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, frozen
from mocap.calibration.rig import RigCamera


@dataclass(frozen=True, eq=False, kw_only=True)
class Sightings:
    """Which camera saw which point of which body where; N of them.

    Attributes:
        camera: (N,) camera number.
        body: (N,) body number.
        local_m: (N, 3) the point in the body's own axes; zero for bodies that are points.
        uv_px: (N, 2) recorded pixels.
    """

    camera: NDArray[np.int64]
    body: NDArray[np.int64]
    local_m: Array
    uv_px: Array

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        n = len(self.camera)
        object.__setattr__(self, "camera", frozen("camera", self.camera, (n,), dtype=np.int64))
        object.__setattr__(self, "body", frozen("body", self.body, (n,), dtype=np.int64))
        object.__setattr__(self, "local_m", frozen("local_m", self.local_m, (n, 3)))
        object.__setattr__(self, "uv_px", frozen("uv_px", self.uv_px, (n, 2)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Lengths:
    """Known distances between bodies; K of them.

    Attributes:
        first: (K,) body number.
        second: (K,) body number.
        length_m: (K,) their distance.
        sd_m: (K,) its standard deviation.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    length_m: Array
    sd_m: Array


NO_LENGTHS = Lengths(first=np.zeros(0, int), second=np.zeros(0, int), length_m=np.zeros(0), sd_m=np.ones(0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """The unknowns.

    Attributes:
        cameras: The C cameras.
        rotation: (B, 3, 3) axes of the bodies to those of the world.
        position_m: (B, 3) places of the bodies in the world.
    """

    cameras: tuple[RigCamera, ...]
    rotation: Array
    position_m: Array


def point_scene(
    cameras: Sequence[RigCamera], points_m: Array, uv_px: Array, keep: NDArray[np.bool_]
) -> tuple[Scene, Sightings, NDArray[np.int64]]:
    """Points that are bodies without orientation, where cameras saw them, and (P,) the number of each body.

    Args:
        cameras: The C cameras.
        points_m: (P, 3) where to start.
        uv_px: (C, P, 2) recorded pixels; NaN where not seen.
        keep: (P,) points that are used.
    """
    number = np.cumsum(keep) - 1
    camera, point = np.nonzero(np.isfinite(uv_px).all(axis=-1) & keep)
    sightings = Sightings(
        camera=camera, body=number[point], local_m=np.zeros((len(camera), 3)), uv_px=uv_px[camera, point]
    )
    turns = np.broadcast_to(np.eye(3), (int(keep.sum()), 3, 3))
    return Scene(cameras=tuple(cameras), rotation=turns, position_m=points_m[keep]), sightings, number


@dataclass(frozen=True, kw_only=True)
class Free:
    """What may move.

    Attributes:
        focal: ``none``, ``one`` (fx and fy by one factor) or ``two``.
        centre: Whether principal points move.
        coefficients: For each camera which distortion coefficients move, in OpenCV's order; empty: none of any.
        orientation: Whether bodies turn (boards) or not (points).
        fixed: Camera whose pose is held, which fixes the world frame; None: no camera is.
    """

    focal: str = "two"
    centre: bool = True
    coefficients: tuple[tuple[bool, ...], ...] = ()
    orientation: bool = False
    fixed: int | None = 0


@dataclass(frozen=True, eq=False, kw_only=True)
class Adjusted:
    """An adjusted scene.

    Attributes:
        scene: The unknowns as found.
        error_px: (N, 2) recorded minus predicted pixels.
        weight: (N,) how far each sighting was believed, 0 to 1.
        length_weight: (K,) how far each length was.
        sd_px: Standard deviation of a pixel coordinate, from the median error and the share that the unknowns take up.
        converged: False where the steps ran out.
        lens_cov: (C) covariance of the free numbers of each lens: focal lengths, principal point, coefficients.
        f_sd_px: (C,) standard deviation of each focal length; 0 where it was not free.
    """

    scene: Scene
    error_px: Array
    weight: Array
    length_weight: Array
    sd_px: float
    converged: bool
    lens_cov: tuple[Array, ...]
    f_sd_px: Array


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
    finite = np.isfinite(places)
    if within is None:
        within = SAME * float(np.ptp(places[finite.all(axis=-1)], axis=0).max()) if finite.all(axis=-1).any() else 0.0
    out = np.full(len(places), -1, dtype=np.intp)
    count = 0
    for i in range(len(places)):
        if out[i] >= 0:
            continue
        both = finite & finite[i]
        apart = np.where(both, np.abs(places - places[i]), 0.0).max(axis=-1)
        out[(out < 0) & both.any(axis=-1) & (apart <= within)] = count
        out[i] = count
        count += 1
    return out
