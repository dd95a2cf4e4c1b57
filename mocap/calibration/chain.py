"""Relative poses of cameras from boards that pairs of them saw; the pairs only need to form a chain."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.calibration.scene import turned_rad
from mocap.cameras.arrangement import FEWEST_SHARED
from mocap.cameras.triangulate import linear
from mocap.errors import CalibrationError
from mocap.text import number_of


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
        if np.count_nonzero(seen[i] & seen[j]) >= FEWEST_SHARED
        and (pair := _pair(xy, seen[i] & seen[j], i, j, 5 / min(f_px[i], f_px[j]))) is not None
    ]
    if not tries:
        raise CalibrationError(
            f"no two cameras share {FEWEST_SHARED} points that determine their relative position: film the wand "
            "where views overlap"
        )
    _, i, j, T = max(tries, key=lambda t: t[0])
    found: dict[int, Array] = {i: np.eye(4), j: T}
    while len(found) < n:
        points = _points(found, xy)
        finite = np.isfinite(points[:, 0])
        counts = {c: int(np.count_nonzero(seen[c] & finite)) for c in range(n) if c not in found}
        c = max(counts, key=lambda c: counts[c])
        if counts[c] < 6:  # as many as coefficients need (``dlt``)
            raise CalibrationError(
                f"camera {names[c]!r} shares {number_of(counts[c], 'point')} with the others and needs 6: film "
                "the wand in its view again"
            )
        found[c] = _placed(points, xy[c], seen[c] & finite, 8 / f_px[c], names[c])
    return [found[c] for c in range(n)], _points(found, xy)


def _pair(xy: Array, both: NDArray[np.bool_], i: int, j: int, near: float) -> tuple[float, int, int, Array] | None:
    a, b = np.ascontiguousarray(xy[i, both]), np.ascontiguousarray(xy[j, both])
    essential, inlier = cv2.findEssentialMat(a, b, np.eye(3), cv2.RANSAC, 0.9999, near)
    if essential is None or essential.shape != (3, 3):
        return None
    count, rotation, shift, kept, _ = cv2.recoverPose(essential, a, b, np.eye(3), distanceThresh=1e6, mask=inlier)
    if count < FEWEST_SHARED:
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


Seen = Mapping[tuple[int, str], Array]
"""By camera and instant: (4, 4) board axes to camera axes."""


def rigid(rotation: Array, translation: Array) -> Array:
    """(4, 4) transform."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation
    return T


def pair_of(seen: Seen, first: int, second: int, turn: Array | None) -> tuple[Array, int, int] | None:
    """The relative pose (4, 4), second from first, on which most common instants of two cameras agree.

    Two stands agree where they differ by less than a tenth of a radian, and in place by less than a tenth of the
    board's distance.

    Args:
        seen: Placements.
        first: A camera.
        second: Another.
        turn: (4, 4) board axes turned by 180 degrees, for boards that look the same so; None for others.

    Returns:
        The pose, the number of instants that agree with it and of all that both saw; None where they share none.
    """
    stems = [s for c, s in seen if c == first and (second, s) in seen]
    turns = [np.eye(4)] if turn is None else [np.eye(4), turn]
    if not stems:
        return None
    stands = np.stack(
        [np.stack([seen[second, s] @ t @ np.linalg.inv(seen[first, s]) for t in turns]) for s in stems]
    )  # (S, turns, 4, 4)
    distance = np.array([np.linalg.norm(seen[second, s][:3, 3]) for s in stems])
    best, fewest = None, (-1, np.inf)
    for candidate in stands.reshape(-1, 4, 4):
        off = np.maximum(
            turned_rad(stands[..., :3, :3] @ candidate[:3, :3].T),
            np.linalg.norm(stands[..., :3, 3] - candidate[:3, 3], axis=-1) / distance[:, None],
        )
        agree = off.min(axis=1) < 0.1
        score = (int(agree.sum()), -float(off.min(axis=1)[agree].sum()))
        if best is None or score > fewest:
            best, fewest = (candidate, agree), score
    assert best is not None
    return best[0], int(best[1].sum()), len(stems)


def chained(seen: Seen, names: Sequence[str], turn: Array | None) -> list[Array]:
    """(C) transforms of the first camera's axes to each camera's, along the pairs with most instants in common.

    Raises:
        CalibrationError: the cameras fall into groups that share no instant, or images of one name are not of one.
    """
    n = len(names)
    pairs = {(i, j): p for i in range(n) for j in range(n) if i != j and (p := pair_of(seen, i, j, turn)) is not None}
    found: dict[int, Array] = {0: np.eye(4)}
    while len(found) < n:
        edges = [(agree, -i, -j) for (i, j), (_, agree, _) in pairs.items() if i in found and j not in found]
        if not edges:
            lost = ", ".join(repr(names[i]) for i in range(n) if i not in found)
            rest = ", ".join(repr(names[i]) for i in sorted(found))
            raise CalibrationError(
                f"cameras {lost} never see the board at the same time as any of {rest}: film the board where both "
                "see it, or give images taken at the same time the same name"
            )
        _, i, j = max(edges)
        pose, agree, common = pairs[-i, -j]
        # of four instants or more half agree where images were taken at one time
        if common >= 4 and agree < 0.5 * common:
            raise CalibrationError(
                f"the boards of one name do not fit one scene: not of one instant? {names[-i]!r} and {names[-j]!r} "
                f"share {common} names, and at most {agree} of them agree on how the cameras stand: if "
                "each camera's images were taken by themselves, use mocap calibrate lenses, then mocap calibrate "
                "places; else give images taken at the same time the same name"
            )
        found[-j] = pose @ found[-i]
    return [found[i] for i in range(n)]
