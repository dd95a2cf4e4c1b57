"""Recorded pixels to ideal ones by a table, as thousands of dots a second need it."""

from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera

STEP_PX = 4
"""Between the entries of a table; bilinear interpolation then errs by less than 0.01 px in the lenses of action
cameras."""


@dataclass(frozen=True, eq=False)
class Straightening:
    """Shifts from recorded to ideal pixels of one camera.

    Attributes:
        shift_px: (H, W, 2) shifts at every ``STEP_PX`` pixels from (0, 0); None: there is no lens.
    """

    shift_px: Array | None

    def __call__(self, uv_px: Array) -> Array:
        """(..., 2) ideal pixels of recorded ones; NaN stays NaN."""
        if self.shift_px is None or not uv_px.size:
            return uv_px
        height, width = self.shift_px.shape[:2]
        x = np.nan_to_num(uv_px) / STEP_PX
        u = np.clip(x[..., 0], 0, width - 1.001)
        v = np.clip(x[..., 1], 0, height - 1.001)
        i, j = u.astype(np.intp), v.astype(np.intp)
        a, b = (u - i)[..., None], (v - j)[..., None]
        s = self.shift_px
        top = s[j, i] * (1 - a) + s[j, i + 1] * a
        below = s[j + 1, i] * (1 - a) + s[j + 1, i + 1] * a
        return uv_px + top * (1 - b) + below * b


def straightening_of(camera: Camera, size_px: tuple[int, int]) -> Straightening:
    """The table of a camera with images of a size."""
    if camera.lens is None or camera.lens.is_identity:
        return Straightening(None)
    width, height = size_px[0] // STEP_PX + 3, size_px[1] // STEP_PX + 3
    at = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1) * float(STEP_PX)
    return Straightening(np.nan_to_num(camera.lens.undistort(at) - at))
