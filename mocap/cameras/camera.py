"""Cameras: one 3 x 4 projection each, whether it comes from DLT coefficients or from a pinhole calibration."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from eal.arrays import Array, frozen
from mocap.cameras.lens import BrownLens, Lens
from mocap.cameras.project import project
from mocap.errors import CalibrationError

FLATTEST = 1e-10
"""Least over greatest singular value of a projection's left 3 x 3 part; of a lens of 1e5 px it is about 1e-5."""
FARTHEST = 1e9
"""No focal length or principal point in pixels, and no distance of a camera from the world's origin, is so great."""
LARGEST_DLT = 1e15
"""L1 to L8 are at most ``FARTHEST`` px over how far before the camera the world's origin lies, as a share of its
distance; of a millionth tables of six digits tell nothing."""
PARALLEL = "a parallel projection (L9 = L10 = L11 = 0: no rays that meet in a camera), which mocap cannot use"


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera:
    """A camera: an ideal projection, and the lens in front of it.

    Attributes:
        name: Unique among its cameras.
        matrix: (3, 4) projection of homogeneous world points in metres to ideal pixels; any scale.
        lens: Distortion between ideal and recorded pixels; None: recorded pixels are ideal.
        size_px: Image width and height; None: not known.
    """

    name: str
    matrix: Array
    lens: Lens | None = None
    size_px: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "matrix", frozen("matrix", self.matrix, (3, 4)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Pinhole:
    """A projection taken apart: pixel ~ intrinsic (rotation_camera_from_world x + translation_m).

    Attributes:
        intrinsic: (3, 3) upper triangular, last entry 1, focal lengths positive.
        rotation: (3, 3) world axes to camera axes (x right, y down, z forward).
        translation_m: (3,) camera coordinates of the world origin.
        mirrored: True where no rotation but only a reflection explains the projection: the world is left-handed or
            the pixel y axis points up (both at once cancel). ``rotation`` then has determinant -1.
    """

    intrinsic: Array
    rotation: Array
    translation_m: Array
    mirrored: bool

    @property
    def position_m(self) -> Array:
        """(3,) centre of projection in the world."""
        return -self.rotation.T @ self.translation_m


def dlt_camera(name: str, coefficients: Array, *, lens: Lens | None = None) -> Camera:
    """A camera from its 11 DLT coefficients L1..L11.

    u = (L1 x + L2 y + L3 z + L4) / (L9 x + L10 y + L11 z + 1), v = (L5 x + ... + L8) / (same)
    (Abdel-Aziz & Karara 1971; Hedrick 2008).

    Raises:
        CalibrationError: a coefficient is of no camera, beside the 1 that is the last of them.
    """
    matrix = np.append(frozen("coefficients", coefficients, (11,)), 1.0).reshape(3, 4)
    most = float(np.abs(matrix).max())
    if most > LARGEST_DLT:  # NaN is no number: ``check_cameras`` says it
        raise CalibrationError(
            f"camera {name!r} has DLT coefficients up to {most:.3g}, expected less than {LARGEST_DLT:.0e}: no camera "
            "has them, whatever its unit: export the calibration again, or calibrate again"
        )
    return Camera(name=name, matrix=matrix, lens=lens)


def dlt_coefficients(camera: Camera) -> Array:
    """The (11,) DLT coefficients of a camera, inverse of ``dlt_camera``.

    Raises:
        ValueError: the world origin lies in the plane of the camera's centre, where no DLT coefficients exist.
    """
    scale = camera.matrix[2, 3]
    if abs(scale) < 1e-12 * np.abs(camera.matrix).max():
        raise ValueError(
            f"camera {camera.name!r} has no DLT coefficients: the world origin projects to infinity; move the origin"
        )
    return (camera.matrix / scale).ravel()[:11]


def pinhole_camera(
    name: str,
    *,
    intrinsic: Array,
    rotation: Array,
    translation_m: Array,
    lens: Lens | None = None,
    size_px: tuple[int, int] | None = None,
) -> Camera:
    """A camera from its intrinsic matrix (3, 3), rotation camera_from_world (3, 3) and translation (3,) in metres."""
    matrix = intrinsic @ np.column_stack([rotation, translation_m])
    return Camera(name=name, matrix=matrix, lens=lens, size_px=size_px)


def decompose(camera: Camera) -> Pinhole:
    """Take a projection apart by RQ decomposition (Hartley & Zisserman, section 6.2.4).

    The sign of the projection is chosen so that the world's depth along the optical axis is positive where
    ``matrix[2] @ (x, 1)`` is, which for DLT coefficients is the side of the calibrated volume.
    """
    # RQ from QR with rows and columns in reverse; SciPy's rq would triple the time that importing cameras takes
    q, r = np.linalg.qr(camera.matrix[::-1, :3].T)
    intrinsic, rotation = r.T[::-1, ::-1], q.T[::-1]
    signs = np.sign(np.diag(intrinsic))
    signs[signs == 0] = 1
    intrinsic, rotation = intrinsic * signs, signs[:, None] * rotation
    scale = intrinsic[2, 2]
    translation = np.linalg.solve(intrinsic, camera.matrix[:, 3])
    return Pinhole(
        intrinsic=intrinsic / scale,
        rotation=rotation,
        translation_m=translation,
        mirrored=bool(np.linalg.det(rotation) < 0),
    )


def pinhole_lens(camera: Camera) -> BrownLens:
    """A lens that bends nothing, with the focal lengths and the principal point of a camera's projection."""
    k = decompose(camera).intrinsic
    return BrownLens(f_px=(k[0, 0], k[1, 1]), centre_px=(k[0, 2], k[1, 2]))


def picture_size(camera: Camera) -> Array:
    """(2,) width and height of a camera's image; where not known twice the principal point."""
    return np.array(camera.size_px or 2 * decompose(camera).intrinsic[:2, 2], dtype=float)


def check_cameras(cameras: Sequence[Camera], where: str) -> None:
    """Refuse cameras that no rig can have, before anything is triangulated with them.

    Args:
        cameras: The C cameras.
        where: The file or argument that they are from, for the message.

    Raises:
        CalibrationError: coefficients are not finite, make no camera (a projection without a centre), or are of
            magnitudes that no camera has; or two cameras stand in one place.
    """
    again = "export the calibration again, or calibrate again"
    for camera in cameras:
        if not np.isfinite(camera.matrix).all():
            raise CalibrationError(
                f"{where}: camera {camera.name!r} has a coefficient that is not a finite number: {again}"
            )
        size = np.abs(camera.matrix[:, :3]).max()
        left = np.linalg.svd(camera.matrix[:, :3] / size, compute_uv=False) if size > 0 else np.zeros(3)
        if not left[2] > FLATTEST * left[0]:
            if left[1] > FLATTEST * left[0] and np.abs(camera.matrix[2, :3]).max() <= FLATTEST * size:
                raise CalibrationError(f"{where}: the coefficients of camera {camera.name!r} are {PARALLEL}")
            spread = f"up to {np.abs(camera.matrix).max():.3g}" if left[0] > 0 else "all 0"
            raise CalibrationError(
                f"{where}: camera {camera.name!r} has coefficients that describe no camera (they are {spread}, and "
                "project "
                f"space to a line or a point): {again}"
            )
        far = np.abs(camera.matrix[:, 3]).max() / size  # where the camera stands, in its own focal lengths
        found = decompose(Camera(name=camera.name, matrix=camera.matrix / size)) if far < FARTHEST else None
        if found is None or not (np.abs([*found.intrinsic.ravel(), *found.position_m]) < FARTHEST).all():
            raise CalibrationError(
                f"{where}: camera {camera.name!r} has coefficients up to {np.abs(camera.matrix).max():.3g}, which "
                f"would place it, or give it a focal length, beyond those of any real camera: {again}"
            )
    centres = [decompose(camera).position_m for camera in cameras]
    if len(cameras) > 1 and not any(np.any(centre) for centre in centres):
        raise CalibrationError(
            f"{where}: contains lenses, but all cameras are at the origin: run mocap calibrate places with these lenses"
        )
    for (a, one), (b, other) in combinations(zip(cameras, centres, strict=True), 2):
        if np.linalg.norm(one - other) <= 1e-9 * max(np.linalg.norm(one), np.linalg.norm(other)):
            raise CalibrationError(
                f"{where}: cameras {a.name!r} and {b.name!r} are at the same place, as if one camera were given "
                "twice, so they cannot measure depth: give each camera its own coefficients"
            )


def scaled(cameras: Sequence[Camera], unit_m: float) -> tuple[Camera, ...]:
    """Cameras whose lengths are in a unit of so many metres, for positions in metres."""
    world = np.diag([1 / unit_m, 1 / unit_m, 1 / unit_m, 1.0])
    return tuple(replace(camera, matrix=camera.matrix @ world) for camera in cameras)


def stacked(cameras: Sequence[Camera]) -> Array:
    """(C, 3, 4) projections, each scaled so that its third row's normal has length 1."""
    matrices = np.stack([c.matrix for c in cameras])
    return matrices / np.linalg.norm(matrices[:, 2, :3], axis=1)[:, None, None]


def record(cameras: Sequence[Camera], xyz_m: Array) -> Array:
    """Pixels as the cameras record them, distortion included; shapes as in ``project``."""
    uv = project(stacked(cameras), xyz_m)
    return np.stack([uv[i] if c.lens is None else c.lens.distort(uv[i]) for i, c in enumerate(cameras)])


def undistorted(cameras: Sequence[Camera], uv_px: Array, *, iterations: int | None = None) -> Array:
    """Ideal pixels of recorded ones.

    Args:
        cameras: The C cameras.
        uv_px: (C, ..., 2) recorded pixels; NaN where not seen.
        iterations: As in ``BrownLens.undistort``: None converges, 3 is what DLTdv does.

    Returns:
        (C, ..., 2) ideal pixels.
    """
    return np.stack(
        [
            uv_px[i] if c.lens is None else c.lens.undistort(uv_px[i], iterations=iterations)
            for i, c in enumerate(cameras)
        ]
    )


def flipped(uv_px: Array, height_px: float | None) -> Array:
    """Pixels with v -> H - v.

    Raises:
        CalibrationError: the height is not known.
    """
    if height_px is None:
        raise CalibrationError("pixels must be flipped, but the image height is not known: give `image_height_px`")
    out = uv_px.copy()
    out[..., 1] = height_px - out[..., 1]
    return out


def cropped_camera(camera: Camera, corner_px: Array) -> Camera:
    """The camera whose image is a window of another's.

    Its pixels are those of the whole image less the corner, and so are its principal point and that of its lens; its
    size is not known.

    Args:
        camera: Of the whole image.
        corner_px: (2,) column and row of the window's upper left corner in it.
    """
    x, y = map(float, corner_px)
    shift = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]])
    lens = camera.lens
    if lens is not None:
        lens = replace(lens, centre_px=(lens.centre_px[0] - x, lens.centre_px[1] - y))
    return replace(camera, matrix=shift @ camera.matrix, lens=lens, size_px=None)


def may_be_cropped(cameras: Sequence[Camera], uv_px: Array) -> str | None:
    """A sentence where pixels lie in one corner of the calibrated images, in all cameras; None where they do not.

    Cropped videos count from the corner of their window: in no camera do pixels come near the far edges. That alone
    accuses nobody (an animal may stay in a corner); it is said where rays do not meet.

    Args:
        cameras: The C cameras.
        uv_px: (C, ..., 2) pixels as recorded.
    """
    uv = uv_px.reshape(len(uv_px), -1, 2)
    if not np.isfinite(uv).any():
        return None
    reach = np.nanmax(uv.reshape(-1, 2), axis=0)
    sizes = np.array([picture_size(camera) for camera in cameras])
    # pixels that span less of the calibrated images, in all cameras, may be of cropped ones
    if (reach > 0.75 * sizes.min(axis=0)).any():
        return None
    width, height = (f"{value:.0f}" for value in np.median(sizes, axis=0))
    return (
        f"pixels span {np.ceil(reach[0]):.0f} x {np.ceil(reach[1]):.0f}, the calibration {width} x {height}: cropped? "
        "give `crop`"
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class KnownLens:
    """A lens, with the covariance of those of its numbers that were fitted.

    The numbers are fx, fy, cx, cy, then the distortion coefficients in OpenCV's order.

    Attributes:
        name: Of the camera.
        lens: The lens.
        size_px: Width and height of its images; None: not known.
        free: (k) places among the numbers of those that were fitted; empty: the lens is taken as exact.
        cov: (k, k) their covariance.
    """

    name: str
    lens: Lens
    size_px: tuple[int, int] | None = None
    free: tuple[int, ...] = ()
    cov: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        object.__setattr__(self, "cov", frozen("cov", self.cov, (len(self.free), len(self.free))))

    @property
    def numbers(self) -> Array:
        """(4 + n) fx, fy, cx, cy and the coefficients."""
        return np.concatenate([self.lens.f_px, self.lens.centre_px, self.lens.coefficients])

    @property
    def sd(self) -> Array:
        """(4 + n) standard deviation of each number; 0 of those that were not fitted."""
        out = np.zeros(len(self.numbers))
        out[list(self.free)] = np.sqrt(np.diag(self.cov))
        return out

    def moved(self, step: Array) -> Lens:
        """The lens with (k,) steps of its fitted numbers."""
        numbers = self.numbers
        numbers[list(self.free)] += step
        return type(self.lens).of(tuple(numbers[:2]), tuple(numbers[2:4]), numbers[4:])
