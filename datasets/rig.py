"""Where the cameras of both laboratories stand."""

from typing import Literal

import numpy as np
from mocap.datasets.linkage import turn, unit

from eal.arrays import Array
from mocap.cameras.camera import Camera, pinhole_camera
from mocap.cameras.lens import BrownLens, FisheyeLens, Lens

LensKind = Literal["brown", "fisheye"]

# Roberts' R2 sequence: the inverse powers of the plastic number cover the unit square evenly for any count
_R2 = np.array([0.7548776662466927, 0.5698402909980532])


def aimed(name: str, *, position_m: Array, target_m: Array, size_px: tuple[int, int], lens: Lens) -> Camera:
    """A camera at ``position_m`` (3,) that looks at ``target_m`` (3,), its image upright (x right, y down)."""
    forward = unit(target_m - position_m)
    upward = np.array([1.0, 0, 0]) if abs(forward[2]) > 0.95 else np.array([0, 0, 1.0])
    right = unit(np.cross(forward, upward))
    rotation = np.stack([right, np.cross(forward, right), forward])
    return pinhole_camera(
        name,
        intrinsic=lens.intrinsic,
        rotation=rotation,
        translation_m=-rotation @ position_m,
        lens=lens,
        size_px=size_px,
    )


def picture_size(camera: Camera) -> tuple[int, int]:
    """Width and height of a camera's image in pixels.

    Raises:
        ValueError: they are not known.
    """
    if camera.size_px is None:
        raise ValueError(f"camera {camera.name!r} has no size_px: give it, to tell what is in its image")
    return camera.size_px


def tunnel_cameras(n_cameras: int, *, lens: LensKind = "brown") -> tuple[Camera, ...]:
    """Wide action cameras on the walls and ceiling of a flight tunnel along x, about 0.7 m from its middle.

    Focal length and distortion vary by a per cent or two from one camera to the next, as they do among real ones. The
    Brown lenses see 107 degrees across, the fisheyes 117; a GoPro Hero 3 was measured to see 114 to 121.

    Args:
        n_cameras: 2 or more.
        lens: ``brown`` or ``fisheye``.

    Raises:
        ValueError: fewer than 2 cameras.
    """
    _at_least_two(n_cameras)
    cameras = []
    for i in range(n_cameras):
        along, around = np.mod(0.5 + _R2 * (i + 1), 1)
        # from 40 degrees below the horizontal on one side, over the ceiling, to 40 degrees below on the other
        angle = np.deg2rad(-40 + 260 * around)
        position = np.array([1.0 * (along - 0.5), 0.7 * np.cos(angle), 0.6 * np.sin(angle)])
        spread = np.sin(np.array([12.9898, 78.233, 37.719, 4.581]) * (i + 1))
        glass = _brown(spread) if lens == "brown" else _fisheye(spread)
        size_px, target_m = (1920, 1080), np.zeros(3)
        cameras.append(aimed(f"cam{i + 1}", position_m=position, target_m=target_m, size_px=size_px, lens=glass))
    return tuple(cameras)


def _brown(spread: Array) -> BrownLens:
    f_px = 880 + 10 * spread[0]
    return BrownLens(
        f_px=(f_px, f_px),
        centre_px=(960 + 8 * spread[1], 540 + 6 * spread[2]),
        k=(-0.25 + 0.004 * spread[3], 0.08 + 0.002 * spread[0], 0.0),
        p=(4e-4 * spread[2], -3e-4 * spread[1]),
    )


def _fisheye(spread: Array) -> FisheyeLens:
    f_px = 915 + 10 * spread[0]
    return FisheyeLens(
        f_px=(f_px, f_px),
        centre_px=(960 + 8 * spread[1], 540 + 6 * spread[2]),
        k=(0.03 + 0.002 * spread[3], -0.01 + 0.001 * spread[0], 0.004, -0.001),
    )


def wind_tunnel_cameras() -> tuple[Camera, ...]:
    """Four high-speed cameras about a bat that flies along x, as they stood in a wind tunnel at Brown University.

    From the calibration of the recordings that ``mocap data path bat_windtunnel_dltdv8`` names, to 5 cm and 1 %: two
    on the left before the bat, one of them low, one on the right, one behind and above; the fields overlap in 0.5 m.
    """
    positions_m = ((0.65, 0.55, -0.55), (0.55, 0.55, 0.15), (-0.35, -0.35, 0.6), (0.05, -0.95, 0.0))
    cameras = []
    for i, position_m in enumerate(positions_m):
        lens = BrownLens(f_px=(1710.0, 1710.0), centre_px=(1280.0, 800.0), k=(-0.1, 0.05, 0.0))
        position, target = np.array(position_m), np.zeros(3)
        cameras.append(aimed(f"cam{i + 1}", position_m=position, target_m=target, size_px=(2560, 1600), lens=lens))
    return tuple(cameras)


def tank_cameras(n_cameras: int, *, slope_rad: float) -> tuple[Camera, ...]:
    """High-speed cameras with long lenses around a tank, 0.75 m from the middle of a rod that rises along x.

    Args:
        n_cameras: 2 or more.
        slope_rad: Slope of the rod; the cameras stand around its normal, so that the animal's back faces all of them.

    Raises:
        ValueError: fewer than 2 cameras.
    """
    _at_least_two(n_cameras)
    cameras = []
    for i in range(n_cameras):
        azimuth = 2 * np.pi * (i + 0.5) / n_cameras
        elevation = np.deg2rad((38, 30)[i % 2])
        around = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        tilt = turn(1, np.array(-slope_rad))
        spread = np.sin(np.array([12.9898, 78.233, 37.719]) * (i + 1))
        f_px = 2150 + 15 * spread[0]
        lens = BrownLens(
            f_px=(f_px, f_px),
            centre_px=(512 + 5 * spread[1], 512 + 5 * spread[2]),
            k=(-0.06 + 0.004 * spread[2], 0.05, 0.0),
            p=(2e-4 * spread[1], 1e-4 * spread[0]),
        )
        cameras.append(
            aimed(
                f"cam{i + 1}",
                position_m=0.75 * tilt @ around,
                target_m=np.zeros(3),
                size_px=(1024, 1024),
                lens=lens,
            )
        )
    return tuple(cameras)


def _at_least_two(n_cameras: int) -> None:
    if n_cameras < 2:
        raise ValueError(f"n_cameras must be 2 or more to see in three dimensions, but is {n_cameras}")
