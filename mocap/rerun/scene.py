"""The world and its cameras as a viewer can draw them: right-handed, rotations proper, pixels running down.

A recording may be left-handed (easyWand writes such worlds), have pixels that run up (DLTdv's lower-left origin), both,
or a camera that looks into a mirror. A viewer knows none of these, so here one world axis is turned round where most
cameras say that the world is mirrored, v becomes height - v where pixels run up, and u becomes width - u for a camera
that is still a reflection. Points and pixels go through the same turns, hence every 3D point is drawn at the pixel
where the camera model of the recording puts it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, decompose


@dataclass(frozen=True, eq=False, kw_only=True)
class ViewCamera:
    """A camera in the scene.

    Attributes:
        name: Its name.
        intrinsic: (3, 3) focal lengths and principal point in view pixels; no skew.
        world_from_camera: (3, 3) camera axes (right, down, forward) in the scene: a rotation, sheared if the sensor is.
        position_m: (3,) centre of projection in the scene.
        size_px: (2,) image width and height.
        pixel_signs: (2,) view pixel = pixel_signs * recorded pixel + pixel_offset_px.
        pixel_offset_px: (2,) see ``pixel_signs``.
    """

    name: str
    intrinsic: Array
    world_from_camera: Array
    position_m: Array
    size_px: Array
    pixel_signs: Array
    pixel_offset_px: Array

    def pixels(self, uv_px: Array) -> Array:
        """(..., 2) pixels of the recording to pixels of the view."""
        return uv_px * self.pixel_signs + self.pixel_offset_px

    @property
    def is_rigid(self) -> bool:
        """True where ``world_from_camera`` is a rotation."""
        return bool(np.allclose(self.world_from_camera.T @ self.world_from_camera, np.eye(3), atol=1e-9))


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """The world as it is drawn.

    Attributes:
        signs: (3,) scene point = signs * world point.
        up: (3,) the signed axis that points up in the scene.
        centre_m: (3,) middle of all positions in the scene.
        radius_m: Half the diagonal of the box that holds them; positive.
        ground_m: Height of a ground under them, along ``up``.
        body_m: Half the diagonal of the box that holds the positions of a frame, in the median; positive.
        cameras: The cameras.
    """

    signs: Array
    up: Array
    centre_m: Array
    radius_m: float
    ground_m: float
    body_m: float
    cameras: tuple[ViewCamera, ...]

    def points(self, xyz_m: Array) -> Array:
        """(..., 3) world points to points of the scene."""
        return xyz_m * self.signs


def make_scene(cameras: Sequence[Camera], *, xyz_m: Array, uv_px: Array | None, y_up: bool) -> Scene:
    """The scene of a recording.

    Args:
        cameras: The C cameras.
        xyz_m: (..., 3) positions that the scene frames; NaN where unknown.
        uv_px: (C, ..., 2) ideal pixels, NaN where not seen; None without cameras.
        y_up: True where the pixel y axis of the recording points up.
    """
    points = xyz_m[np.isfinite(xyz_m).all(axis=-1)]
    sizes = [image_size_px(c, None if uv_px is None else uv_px[i]) for i, c in enumerate(cameras)]
    flip = np.array([1.0, -1.0 if y_up else 1.0])
    turned = [_turned(_facing(c, points), flip, s) for c, s in zip(cameras, sizes, strict=True)]
    poses = [decompose(c) for c in turned]
    # the signed axis nearest to where the cameras' upper image edges point; z where they do not agree
    directions = [-p.rotation[1] for p in poses]
    mean = np.mean(directions, axis=0) if directions else np.zeros(3)
    up = np.zeros(3)
    if np.linalg.norm(mean) < 0.7:
        up[2] = 1.0
    else:
        axis = int(np.argmax(np.abs(mean)))
        up[axis] = np.sign(mean[axis])
    signs = np.ones(3)
    if poses and np.mean([p.mirrored for p in poses]) > 0.5:
        signs[0 if up[1] else 1] = -1.0  # an axis that lies on the ground: up stays up
    view = tuple(_view_camera(c, s, signs, y_up=y_up) for c, s in zip(turned, sizes, strict=True))
    low, high = np.quantile(points * signs, (0.005, 0.995), axis=0) if len(points) else np.zeros((2, 3))
    radius_m = max(float(np.linalg.norm(high - low)) / 2, 1e-3)
    return Scene(
        signs=signs,
        up=up,
        centre_m=(low + high) / 2,
        radius_m=radius_m,
        ground_m=float(min(low @ up, high @ up)) - 0.3 * radius_m,
        body_m=min(_body_m(xyz_m), radius_m),
        cameras=view,
    )


def _body_m(xyz_m: Array) -> float:
    """Half the diagonal of the box that holds the markers of a frame, in the median of frames that show half of them.

    Args:
        xyz_m: (..., M, 3) positions; NaN where unknown.
    """
    frames = xyz_m.reshape(int(np.prod(xyz_m.shape[:-2])), *xyz_m.shape[-2:])
    finite = np.isfinite(frames).all(axis=-1)
    frames = frames[finite.sum(axis=1) > max(1, frames.shape[1] // 2)]
    if not len(frames):
        return np.inf
    size = np.linalg.norm(np.nanmax(frames, axis=1) - np.nanmin(frames, axis=1), axis=-1)
    return max(float(np.median(size)) / 2, 1e-3)


def image_size_px(camera: Camera, uv_px: Array | None) -> Array:
    """(2,) width and height of a camera's image.

    Without a known size: twice the principal point, or as much more as the pixels of the tracks need. A principal point
    outside of the image (a poor DLT) is not believed.

    Args:
        camera: The camera.
        uv_px: (..., 2) its ideal pixels; None: none known.
    """
    if camera.size_px is not None:
        return np.asarray(camera.size_px, dtype=np.float64)
    size = 2 * decompose(camera).intrinsic[:2, 2]
    seen = np.zeros((0, 2)) if uv_px is None else uv_px[np.isfinite(uv_px).all(axis=-1)]
    largest = np.quantile(seen, 0.995, axis=0) * 1.05 if len(seen) else np.zeros(2)
    size = np.where((size > 0) & ((largest <= 0) | (size < 5 * largest)), np.maximum(size, largest), largest)
    return np.ceil(np.maximum(size, 1.0) - 1e-6)  # a whole number stays one after rounding


def _facing(camera: Camera, points: Array) -> Camera:
    """The same projection, its overall sign such that the points lie in front."""
    depth = points @ camera.matrix[2, :3] + camera.matrix[2, 3]
    return replace(camera, matrix=-camera.matrix) if len(depth) and np.median(depth) < 0 else camera


def _turned(camera: Camera, signs: Array, size_px: Array) -> Camera:
    """The camera whose pixel is ``signs * pixel``, plus the image's size where the sign is negative."""
    turn = np.diag([*signs, 1.0])
    turn[:2, 2] = np.where(signs < 0, size_px, 0.0)
    return replace(camera, matrix=turn @ camera.matrix)


def _view_camera(camera: Camera, size_px: Array, signs: Array, *, y_up: bool) -> ViewCamera:
    camera = replace(camera, matrix=camera.matrix * np.append(signs, 1.0))
    pixel_signs = np.array([1.0, -1.0 if y_up else 1.0])
    if decompose(camera).mirrored:
        pixel_signs[0] = -1.0
        camera = _turned(camera, np.array([-1.0, 1.0]), size_px)
    pose = decompose(camera)
    intrinsic = pose.intrinsic.copy()
    intrinsic[0, 1] = 0.0
    shear = np.linalg.solve(intrinsic, pose.intrinsic)  # K = intrinsic @ shear
    world_from_camera = np.linalg.inv(shear @ pose.rotation)
    return ViewCamera(
        name=camera.name,
        intrinsic=intrinsic,
        world_from_camera=np.asarray(world_from_camera, dtype=np.float64),
        position_m=pose.position_m,
        size_px=size_px,
        pixel_signs=pixel_signs,
        pixel_offset_px=np.where(pixel_signs < 0, size_px, 0.0),
    )
