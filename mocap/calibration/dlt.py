"""DLT coefficients from points of known position, and their residuals."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from eal.arrays import Array
from mocap.cameras.camera import Camera, project
from mocap.errors import CalibrationError

FEWEST_POINTS = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class DltFit:
    """A camera from known points.

    Attributes:
        camera: Its projection, of 11 free parameters.
        error_px: (n, 2) what its pixels miss by; NaN where not seen.
        rms_px: sqrt(sum of squares / (2 n - 11)).
        left_out_px: Root mean square error of points with a camera fitted without them; NaN with fewer than 8.
    """

    camera: Camera
    error_px: Array
    rms_px: float
    left_out_px: float


def fit_dlt(name: str, xyz_m: Array, uv_px: Array) -> DltFit:
    """The 11 parameters that project known points nearest to their ideal pixels.

    Linear least squares with normalised coordinates (Hartley & Zisserman, algorithm 7.1), then the smallest
    reprojection error.

    Args:
        name: Of the camera.
        xyz_m: (n, 3) known places.
        uv_px: (n, 2) ideal pixels; NaN where not seen.

    Raises:
        CalibrationError: fewer than 6 points, points (nearly) in one plane, or pixels that do not belong to the points.
    """
    seen = np.isfinite(uv_px).all(axis=-1) & np.isfinite(xyz_m).all(axis=-1)
    n = int(seen.sum())
    if n < FEWEST_POINTS:
        raise CalibrationError(f"camera {name!r} sees {n} known points, and {FEWEST_POINTS} are needed: digitise more")
    x, u = xyz_m[seen], uv_px[seen]
    spread = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    if spread[2] < 1e-3 * spread[0]:
        raise CalibrationError(
            f"camera {name!r}: its {n} known points lie in one plane (to {spread[2] / np.sqrt(n):.3g} m), so the "
            "coefficients are not determined: add points outside that plane"
        )
    matrix = _fitted(x, u)
    error = np.full(uv_px.shape, np.nan)
    error[seen] = u - project(matrix[None], x)[0]
    rms = float(np.sqrt(np.nansum(error**2) / max(2 * n - 11, 1)))
    size = np.ptp(u, axis=0).max()
    if rms > max(0.05 * size, 3.0):
        raise CalibrationError(
            f"camera {name!r}: the reprojection error of its known points is {rms:.0f} px, while they span "
            f"{size:.0f} px: check that both files list the same points in the same order"
        )
    left_out = np.nan
    if n >= FEWEST_POINTS + 2:
        others = [np.delete(np.arange(n), i) for i in range(n)]
        miss = [u[i] - project(_fitted(x[o], u[o])[None], x[i])[0] for i, o in enumerate(others)]
        left_out = float(np.sqrt(np.mean(np.sum(np.square(miss), axis=-1))))
    return DltFit(camera=Camera(name=name, matrix=matrix), error_px=error, rms_px=rms, left_out_px=left_out)


def _fitted(x: Array, u: Array) -> Array:
    to_x, to_u = _normaliser(x), _normaliser(u)
    xn, un = x @ to_x[:3, :3].T + to_x[:3, 3], u @ to_u[:2, :2].T + to_u[:2, 2]
    homogeneous = np.column_stack([xn, np.ones(len(xn))])
    zero = np.zeros_like(homogeneous)
    rows = np.concatenate(
        [
            np.concatenate([homogeneous, zero, -un[:, :1] * homogeneous], axis=1),
            np.concatenate([zero, homogeneous, -un[:, 1:] * homogeneous], axis=1),
        ]
    )
    start = np.linalg.svd(rows)[2][-1]

    def miss(p: Array) -> Array:
        h = homogeneous @ p.reshape(3, 4).T
        return ((h[:, :2] / h[:, 2:]) - un).ravel()

    best = least_squares(miss, start, method="lm" if 2 * len(x) >= 12 else "trf", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    matrix = np.linalg.solve(to_u, best.x.reshape(3, 4)) @ to_x
    matrix = matrix / np.linalg.norm(matrix[2, :3])
    return matrix * np.sign((matrix[2, :3] @ x.mean(axis=0)) + matrix[2, 3])


def _normaliser(points: Array) -> Array:
    """Homogeneous transform that centres points and makes their mean distance sqrt(dimension)."""
    d = points.shape[1]
    scale = np.sqrt(d) / np.linalg.norm(points - points.mean(axis=0), axis=1).mean()
    T = np.eye(d + 1)
    T[:d, :d] *= scale
    T[:d, d] = -scale * points.mean(axis=0)
    return T
