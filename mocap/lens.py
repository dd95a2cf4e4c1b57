"""Lens distortion: between the pixels that a camera records and those that a pinhole would."""

from dataclasses import dataclass

import cv2
import numpy as np

from mocap.arrays import Array


@dataclass(frozen=True, kw_only=True)
class BrownLens:
    """Brown's radial and tangential distortion, as OpenCV, Argus, easyWand and DLTdv parametrise it.

    With x, y = (pixel - centre) / f and r^2 = x^2 + y^2, the distorted point is
    x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and likewise y with p1, p2 exchanged.

    Attributes:
        f_px: Focal lengths (fx, fy).
        centre_px: Principal point (cx, cy), origin upper-left.
        k: Radial coefficients (k1, k2, k3).
        p: Tangential coefficients (p1, p2).
    """

    f_px: tuple[float, float]
    centre_px: tuple[float, float]
    k: tuple[float, float, float] = (0.0, 0.0, 0.0)
    p: tuple[float, float] = (0.0, 0.0)

    @property
    def is_identity(self) -> bool:
        """True where the lens moves no pixel."""
        return not any(self.k) and not any(self.p)

    def distort(self, uv_px: Array) -> Array:
        """Ideal pixels to recorded ones; (..., 2) both."""
        xy = (uv_px - np.asarray(self.centre_px)) / np.asarray(self.f_px)
        return self._bend(xy) * np.asarray(self.f_px) + np.asarray(self.centre_px)

    def undistort(self, uv_px: Array, *, iterations: int | None = None) -> Array:
        """Recorded pixels to ideal ones.

        Args:
            uv_px: (..., 2) recorded pixels; NaN stays NaN.
            iterations: None solves to convergence (OpenCV). A number does just so many fixed-point iterations and takes
                f = mean(fx, fy), which is what DLTdv does with 3.

        Returns:
            (..., 2) ideal pixels.
        """
        if iterations is None:
            return self._undistort_converged(uv_px)
        f_px = float(np.mean(self.f_px))
        start = (uv_px - np.asarray(self.centre_px)) / f_px
        xy = start
        for _ in range(iterations):
            x, y = xy[..., 0], xy[..., 1]
            radial, tangential = self._parts(x, y)
            xy = (start - tangential) / radial[..., None]
        return xy * f_px + np.asarray(self.centre_px)

    def _undistort_converged(self, uv_px: Array) -> Array:
        out = np.full_like(uv_px, np.nan)
        ok = np.isfinite(uv_px).all(axis=-1)
        if ok.any():
            camera = np.array([[self.f_px[0], 0, self.centre_px[0]], [0, self.f_px[1], self.centre_px[1]], [0, 0, 1.0]])
            coefficients = np.array([self.k[0], self.k[1], *self.p, self.k[2]])
            stop = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
            points = np.ascontiguousarray(uv_px[ok].reshape(-1, 1, 2))
            out[ok] = cv2.undistortPoints(points, camera, coefficients, P=camera, criteria=stop).reshape(-1, 2)
        return out

    def _parts(self, x: Array, y: Array) -> tuple[Array, Array]:
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k[0] + r2 * (self.k[1] + r2 * self.k[2]))
        p1, p2 = self.p
        tangential = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=-1)
        return radial, tangential

    def _bend(self, xy: Array) -> Array:
        radial, tangential = self._parts(xy[..., 0], xy[..., 1])
        return xy * radial[..., None] + tangential
