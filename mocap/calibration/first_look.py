"""First estimate of camera poses, given their lenses, from shared points alone: the start of bundle adjustment."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.calibration.chain import rigid
from mocap.cameras.triangulate import linear
from mocap.errors import CalibrationError

FEWEST_POINTS = 8


def first_stands(xy: Array, names: Sequence[str], f_px: Sequence[float]) -> tuple[list[Array], Array]:
    """Stands of cameras up to scale, and the points.

    The pair that starts is the one whose essential matrix (Nister 2004) explains most points that it sees from
    directions far enough apart; each further camera is placed by the points that the others gave (``solvePnP`` in
    RANSAC).

    Args:
        xy: (C, P, 2) normalised ideal coordinates; NaN where not seen.
        names: Of the cameras.
        f_px: Focal lengths, to which tolerances of some pixels are scaled.

    Returns:
        (C) transforms (4, 4) of the axes of the first pair's first camera to each camera's, and (P, 3) points in those
        axes; NaN where fewer than two cameras saw one.

    Raises:
        CalibrationError: too few points in common.
    """
    n = len(xy)
    seen: NDArray[np.bool_] = ~np.isnan(xy[..., 0])
    tries = [
        pair
        for i in range(n)
        for j in range(i + 1, n)
        if np.count_nonzero(seen[i] & seen[j]) >= FEWEST_POINTS
        and (pair := _pair(xy, seen[i] & seen[j], i, j, 5 / min(f_px[i], f_px[j]))) is not None
    ]
    if not tries:
        raise CalibrationError(
            f"no two cameras share {FEWEST_POINTS} points that determine their relative position: film the wand "
            "where views overlap"
        )
    _, i, j, T = max(tries, key=lambda t: t[0])
    found: dict[int, Array] = {i: np.eye(4), j: T}
    while len(found) < n:
        points = _points(found, xy)
        known = np.isfinite(points[:, 0])
        counts = {c: int(np.count_nonzero(seen[c] & known)) for c in range(n) if c not in found}
        c = max(counts, key=lambda c: counts[c])
        if counts[c] < 6:
            raise CalibrationError(
                f"camera {names[c]!r} shares {counts[c]} points with the others and needs 6: film the wand in its "
                "view again"
            )
        found[c] = _placed(points, xy[c], seen[c] & known, 8 / f_px[c], names[c])
    return [found[c] for c in range(n)], _points(found, xy)


def _pair(xy: Array, both: NDArray[np.bool_], i: int, j: int, near: float) -> tuple[float, int, int, Array] | None:
    a, b = np.ascontiguousarray(xy[i, both]), np.ascontiguousarray(xy[j, both])
    essential, inlier = cv2.findEssentialMat(a, b, np.eye(3), cv2.RANSAC, 0.9999, near)
    if essential is None or essential.shape != (3, 3):
        return None
    count, rotation, shift, kept, _ = cv2.recoverPose(essential, a, b, np.eye(3), distanceThresh=1e6, mask=inlier)
    if count < FEWEST_POINTS:
        return None
    good = np.ravel(kept) > 0
    rays = np.concatenate([a, np.ones((len(a), 1))], axis=1), np.concatenate([b, np.ones((len(b), 1))], axis=1)
    first, second = (r / np.linalg.norm(r, axis=1)[:, None] for r in rays)
    angle = np.arccos(np.clip(np.sum((first @ np.asarray(rotation).T) * second, axis=1), -1, 1))
    wide = float(np.median(angle[good]))
    return (
        count * min(1.0, wide / 0.3),
        i,
        j,
        rigid(np.asarray(rotation, dtype=float), np.ravel(np.asarray(shift, dtype=float))),
    )


def _points(found: dict[int, Array], xy: Array) -> Array:
    cameras = sorted(found)
    matrices = np.stack([found[c][:3] for c in cameras])
    points = linear(matrices, xy[cameras])
    depth = np.einsum("cj,pj->cp", matrices[:, 2, :3], np.nan_to_num(points)) + matrices[:, 2, 3:]
    behind = (np.isfinite(xy[cameras]).all(axis=-1) & (depth <= 0)).any(axis=0)
    return np.where(behind[:, None], np.nan, points)


def _placed(points: Array, xy: Array, at: NDArray[np.bool_], near: float, name: str) -> Array:
    found, rvec, tvec, _ = cv2.solvePnPRansac(
        points[at], np.ascontiguousarray(xy[at]), np.eye(3), None, reprojectionError=near, iterationsCount=2000
    )
    if not found:
        raise CalibrationError(
            f"camera {name!r} cannot be located from the points that the other cameras determine: check its lens "
            "and its points"
        )
    return rigid(np.asarray(cv2.Rodrigues(rvec)[0], dtype=float), np.ravel(np.asarray(tvec, dtype=float)))
