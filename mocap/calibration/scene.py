"""Cameras as calibration parametrises them; unknowns, observations and results of bundle adjustment."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eal.arrays import Array, frozen
from mocap.cameras.camera import Camera, decompose, pinhole_lens
from mocap.cameras.lens import FisheyeLens, Lens


@dataclass(frozen=True, eq=False, kw_only=True)
class RigCamera:
    """A camera whose pinhole is that of its lens.

    Attributes:
        name: Unique in its rig.
        lens: Focal lengths, principal point and distortion.
        rotation: (3, 3) world axes to camera axes; determinant -1 where the world or the pixels are mirrored.
        translation_m: (3,) camera coordinates of the world's origin.
        size_px: Image width and height; None: not known.
        shear: Skew of the pixel axes over the focal length; 0 but for cameras made from free DLT coefficients.
    """

    name: str
    lens: Lens
    rotation: Array
    translation_m: Array
    size_px: tuple[int, int] | None = None
    shear: float = 0.0

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "rotation", frozen("rotation", self.rotation, (3, 3)))
        object.__setattr__(self, "translation_m", frozen("translation_m", self.translation_m, (3,)))

    @property
    def position_m(self) -> Array:
        """(3,) centre of projection in the world."""
        return -self.rotation.T @ self.translation_m

    def camera(self) -> Camera:
        """As one projection with its lens in front."""
        intrinsic = self.lens.intrinsic
        intrinsic[0, 1] = self.shear * intrinsic[0, 0]
        matrix = intrinsic @ np.column_stack([self.rotation, self.translation_m])
        return Camera(name=self.name, matrix=matrix, lens=self.lens.if_bent, size_px=self.size_px)

    def record(self, xyz_m: Array) -> Array:
        """Pixels (..., 2) that it records of world points (..., 3)."""
        axes = xyz_m @ self.rotation.T + self.translation_m
        xy = axes[..., :2] / axes[..., 2:]
        xy[..., 0] += self.shear * xy[..., 1]
        return self.lens.bend(xy) * np.asarray(self.lens.f_px) + np.asarray(self.lens.centre_px)


def rig_camera(camera: Camera) -> RigCamera:
    """The camera taken apart.

    A camera whose lens has a pinhole of its own (DLT coefficients fitted to undistorted pixels rarely have the lens's
    focal length) cannot be held whole: give it without its lens, with undistorted pixels.

    Raises:
        ValueError: the lens and the projection disagree on the pinhole.
    """
    parts = decompose(camera)
    intrinsic = parts.intrinsic
    lens = camera.lens
    if lens is not None and not np.allclose(lens.intrinsic, intrinsic, rtol=1e-6, atol=1e-3):
        raise ValueError(
            f"camera {camera.name!r}: the focal length or principal point of its coefficients (f "
            f"{intrinsic[0, 0]:.1f} px) differs from that of its lens (f {lens.f_px[0]:.1f} px): undistort the pixels "
            "and give the camera without its lens"
        )
    return RigCamera(
        name=camera.name,
        lens=rig_lens(camera),
        rotation=parts.rotation,
        translation_m=parts.translation_m,
        size_px=camera.size_px,
        shear=0.0 if lens is not None else intrinsic[0, 1] / intrinsic[0, 0],
    )


def rig_lens(camera: Camera) -> Lens:
    """The lens of a camera; of one that bends nothing, an identity with the camera's pinhole."""
    return pinhole_lens(camera) if camera.lens is None else camera.lens


def upside_down(camera: RigCamera, height_px: float) -> RigCamera:
    """The same camera for pixel rows counted from the other edge of the image, v -> height - v."""
    lens = camera.lens
    coefficients = lens.coefficients.copy()
    if not isinstance(lens, FisheyeLens):
        coefficients[2] *= -1  # p1 is odd in y
    return replace(
        camera,
        lens=type(lens).of(lens.f_px, (lens.centre_px[0], height_px - lens.centre_px[1]), coefficients),
        rotation=np.diag([1.0, -1.0, 1.0]) @ camera.rotation,
        translation_m=camera.translation_m * [1.0, -1.0, 1.0],
        shear=-camera.shear,
    )


def turn(vector: Array) -> Array:
    """(..., 3, 3) rotations by rotation vectors (..., 3)."""
    flat = np.array(vector, dtype=float).reshape(-1, 3)  # a copy: SciPy before 1.17 turns by no read-only arrays
    return Rotation.from_rotvec(flat).as_matrix().reshape(*np.shape(vector)[:-1], 3, 3)


def turned_rad(rotation: Array) -> Array:
    """(...) angles by which rotations (..., 3, 3) turn."""
    return np.arccos(np.clip((np.trace(rotation, axis1=-2, axis2=-1) - 1) / 2, -1, 1))


def in_world(cameras: Sequence[RigCamera], T_to_from: Array) -> tuple[RigCamera, ...]:
    """The same cameras in another world frame.

    Args:
        cameras: In the old frame.
        T_to_from: (4, 4) old world coordinates to new ones: a rotation (or reflection) times a scale, and a shift.
    """
    scale = np.abs(np.linalg.det(T_to_from[:3, :3])) ** (1 / 3)
    turned = T_to_from[:3, :3] / scale
    out = []
    for c in cameras:
        rotation = c.rotation @ turned.T
        out.append(
            replace(c, rotation=rotation, translation_m=scale * c.translation_m - rotation @ T_to_from[:3, 3]),
        )
    return tuple(out)


def similarity(source_m: Array, target_m: Array, *, scaled: bool = True) -> Array:
    """The (4, 4) rotation, scale and shift that brings points (n, 3) nearest to others (Umeyama 1991).

    Raises:
        ValueError: fewer than three points.
    """
    if len(source_m) < 3:
        raise ValueError(f"a frame needs 3 points, but there are {len(source_m)}")
    a, b = source_m - source_m.mean(axis=0), target_m - target_m.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ np.diag(sign) @ vt
    scale = float((s * sign).sum() / np.sum(a**2)) if scaled else 1.0
    T = np.eye(4)
    T[:3, :3] = scale * rotation
    T[:3, 3] = target_m.mean(axis=0) - T[:3, :3] @ source_m.mean(axis=0)
    return T


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
class KnownLengths:
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


NO_LENGTHS = KnownLengths(first=np.zeros(0, int), second=np.zeros(0, int), length_m=np.zeros(0), sd_m=np.ones(0))


@dataclass(frozen=True, eq=False, kw_only=True)
class RigScene:
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
) -> tuple[RigScene, Sightings, NDArray[np.int64]]:
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
    return RigScene(cameras=tuple(cameras), rotation=turns, position_m=points_m[keep]), sightings, number


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

    scene: RigScene
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
