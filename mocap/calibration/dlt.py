"""DLT coefficients from points of known position, and their residuals."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from eal.arrays import Array
from mocap.calibration.scene import SAME, distinct
from mocap.cameras.camera import FLATTEST, PARALLEL, Camera
from mocap.cameras.triangulate import project
from mocap.errors import CalibrationError

FEWEST_DLT_POINTS = 6  # two equations each for eleven coefficients
CHECKED_FROM = FEWEST_DLT_POINTS + 2
"""Places from which on each is left out of the fit in turn: the others then still have some to spare."""
OPEN = float(np.sqrt(np.finfo(np.float64).eps))
"""Least over greatest singular value of equations that leave something open: half of the digits are lost."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DltFit:
    """A camera from known points.

    Attributes:
        camera: Its projection, of 11 free parameters.
        error_px: (n, 2) what its pixels miss by; NaN where not seen.
        places: Number of different places among its points.
        rms_px: sqrt(sum of squares / (2 n - 11)), n clicks, of which those listed twice count once.
        left_out_px: Root mean square error of points with a camera fitted without their places; NaN with fewer than 8
            places, or where no place can be spared.
        gain: Pixels by which a click that misses by 1 px moves what lies between known points, at most.
    """

    camera: Camera
    error_px: Array
    places: int
    rms_px: float
    left_out_px: float
    gain: float


def fit_dlt(name: str, xyz_m: Array, uv_px: Array) -> DltFit:
    """The 11 parameters that project known points nearest to their ideal pixels.

    Linear least squares with normalised coordinates (Hartley & Zisserman, algorithm 7.1), then the smallest
    reprojection error. Points may be listed, or clicked, more than once: places are counted, and left out, whole.

    Args:
        name: Of the camera.
        xyz_m: (n, 3) known places.
        uv_px: (n, 2) ideal pixels; NaN where not seen.

    Raises:
        CalibrationError: points of fewer than 6 places, points that do not determine the parameters (nearly in one
            plane, or all but one, or nearly in one place), or pixels that do not belong to the points.
    """
    seen = np.isfinite(uv_px).all(axis=-1) & np.isfinite(xyz_m).all(axis=-1)
    x, u = np.split(np.unique(np.concatenate([xyz_m[seen], uv_px[seen]], axis=1), axis=0), [3], axis=1)
    place = distinct(x)
    places = int(place.max(initial=-1)) + 1
    if places < FEWEST_DLT_POINTS:
        listed = f" (listed in {seen.sum()} rows)" if seen.sum() > places else ""
        raise CalibrationError(
            f"camera {name!r} sees {places} different known points{listed}, and {FEWEST_DLT_POINTS} are needed: "
            "digitise more"
        )
    spread = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    if spread[2] < SAME * spread[0]:
        raise CalibrationError(
            f"camera {name!r}: its {places} known points lie in one plane (to {spread[2] / np.sqrt(len(x)):.3g} m), so "
            "the coefficients are not determined: add points outside that plane"
        )
    found = _fitted(name, x, u)
    # pixels that what lies between known points moves by where a click misses by 1 px. Of 100 cameras each: 6 random
    # points 2.5 (median), 20 (99 %); 12 of which all but one lie in a plane to 1/1000 of its size 73 (median)
    if found is None or found[1] > 20.0:
        how = "" if found is None else f" (an error of 1 px moves points between them by {found[1]:.0f} px)"
        raise CalibrationError(
            f"camera {name!r}: its {places} known points do not determine the coefficients{how}, as where all but one "
            "lie in a plane, or some nearly in one place: add points that span the volume"
        )
    matrix, gain = found
    error = np.full(uv_px.shape, np.nan)
    error[seen] = uv_px[seen] - project(matrix[None], xyz_m[seen])[0]
    rms = float(np.sqrt(np.sum((u - project(matrix[None], x)[0]) ** 2) / max(2 * len(x) - 11, 1)))
    size = np.ptp(u, axis=0).max()
    if rms > max(0.05 * size, 3.0):
        raise CalibrationError(
            f"camera {name!r}: the reprojection error of its known points is {rms:.0f} px, while they span "
            f"{size:.0f} px: check that both files list the same points in the same order"
        )
    miss = []
    for i in range(places if places >= CHECKED_FROM else 0):
        mine = place == i
        if (without := _fitted(name, x[~mine], u[~mine])) is not None:
            miss.append(np.sum((u[mine] - project(without[0][None], x[mine])[0]) ** 2, axis=-1))
    left_out = float(np.sqrt(np.mean(np.concatenate(miss)))) if miss else np.nan
    camera = Camera(name=name, matrix=matrix)
    return DltFit(camera=camera, error_px=error, places=places, rms_px=rms, left_out_px=left_out, gain=gain)


def _fitted(name: str, x: Array, u: Array) -> tuple[Array, float] | None:
    """The (3, 4) projection of known points, and its gain (``DltFit``); None where they leave it open."""
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
    _, size, axes = np.linalg.svd(rows, full_matrices=False)
    if size[10] < OPEN * size[0]:
        return None

    def miss(p: Array) -> Array:
        h = homogeneous @ p.reshape(3, 4).T
        return ((h[:, :2] / h[:, 2:]) - un).ravel()

    try:
        with np.errstate(all="ignore"):
            best = least_squares(miss, axes[-1], method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    except ValueError:  # errors that are no numbers: a point in the plane of the camera
        return None
    p = best.x.reshape(3, 4) / np.linalg.norm(best.x)
    matrix = np.linalg.solve(to_u, p) @ to_x
    if not np.linalg.norm(matrix[2, :3]) > FLATTEST * np.linalg.norm(matrix[:2, :3]):
        raise CalibrationError(f"camera {name!r}: its known points are seen in {PARALLEL}")
    matrix = matrix / np.linalg.norm(matrix[2, :3])
    return matrix * np.sign((matrix[2, :3] @ x.mean(axis=0)) + matrix[2, 3]), _gain(p, homogeneous)


def _gain(p: Array, homogeneous: Array) -> float:
    """Largest standard deviation of a pixel midway between two of (n, 4) known points, for clicks of deviation 1."""

    def slopes(h: Array) -> Array:
        """(n, 2, 12) derivatives of pixels by the entries of the projection."""
        to = h @ p.T
        ray, uv = h / to[:, 2:], to[:, :2] / to[:, 2:]
        none = np.zeros_like(ray)
        return np.stack(
            [
                np.concatenate([ray, none, -uv[:, :1] * ray], axis=1),
                np.concatenate([none, ray, -uv[:, 1:] * ray], axis=1),
            ],
            axis=1,
        )

    _, size, axes = np.linalg.svd(slopes(homogeneous).reshape(-1, 12), full_matrices=False)
    if size[10] < OPEN * size[0]:
        return float("inf")
    first, second = np.triu_indices(len(homogeneous), k=1)
    some = slice(None, None, max(1, len(first) // 2000))
    middle = (homogeneous[first[some]] + homogeneous[second[some]]) / 2
    moved = slopes(middle) @ axes[:11].T / size[:11]  # the twelfth is the scale of the projection, which moves nothing
    return float(np.sqrt((moved**2).sum(axis=-1).max()))


def _normaliser(points: Array) -> Array:
    """Homogeneous transform that centres points and makes their mean distance sqrt(dimension)."""
    d = points.shape[1]
    scale = np.sqrt(d) / np.linalg.norm(points - points.mean(axis=0), axis=1).mean()
    T = np.eye(d + 1)
    T[:d, :d] *= scale
    T[:d, d] = -scale * points.mean(axis=0)
    return T
