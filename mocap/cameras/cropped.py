"""Cropped pictures: cameras of them, and how pixels counted in them show where rays do not meet."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, picture_size

SMALL = 0.75
"""Pixels that span less than this share of the calibrated pictures, in all cameras, may be of cropped ones."""


def cropped_camera(camera: Camera, corner_px: Array) -> Camera:
    """The camera whose picture is a window of another's.

    Its pixels are those of the whole picture less the corner, and so are its principal point and that of its lens; its
    size is not known.

    Args:
        camera: Of the whole picture.
        corner_px: (2,) column and row of the window's upper left corner in it.
    """
    x, y = map(float, corner_px)
    shift = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]])
    lens = camera.lens
    if lens is not None:
        lens = replace(lens, centre_px=(lens.centre_px[0] - x, lens.centre_px[1] - y))
    return replace(camera, matrix=shift @ camera.matrix, lens=lens, size_px=None)


def may_be_cropped(cameras: Sequence[Camera], uv_px: Array) -> str | None:
    """A sentence where pixels lie in one corner of the calibrated pictures, in all cameras; None where they do not.

    Cropped films count from the corner of their window: in no camera do pixels come near the far edges. That alone
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
    if (reach > SMALL * sizes.min(axis=0)).any():
        return None
    width, height = (f"{value:.0f}" for value in np.median(sizes, axis=0))
    return (
        f"pixels span {np.ceil(reach[0]):.0f} x {np.ceil(reach[1]):.0f}, the calibration {width} x {height}: cropped? "
        "give `crop`"
    )
