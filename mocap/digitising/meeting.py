"""Where rays of dots that have no name yet meet in space, and which markers these points are."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mocap.arrays import Array
from mocap.digitising.naming import MARGIN, seen_from

MOST_RAYS = 24
_GATE = 16.3
"""Chi-square of three degrees of freedom that one right point in a thousand exceeds."""
_FAR = 1e6


@dataclass(frozen=True, eq=False)
class Lengths:
    """Lengths of rigid bones.

    Attributes:
        ends: (B, 2) markers.
        length_m: (B,) their distances; NaN: not known yet.
        sd_m: (B,) standard deviations of these.
    """

    ends: NDArray[np.int64]
    length_m: Array
    sd_m: Array


def meetings(matrices: Array, dots: Array, free: NDArray[np.bool_], *, sd_px: float) -> tuple[Array, NDArray[np.int64]]:
    """Points at which rays of free dots meet.

    Two rays that pass each other closely make a point; the dots of all other cameras that lie where it projects belong
    to it. Points of the same dots are one; a point of two dots counts only if both are in no point of three.

    Args:
        matrices: (C, 3, 4) projections.
        dots: (C, K, 2) ideal pixels.
        free: (C, K) dots to consider.
        sd_px: Standard deviation of a dot's coordinate.

    Returns:
        (N, 3) points, and the dots that make them (N, C), -1 for none.
    """
    n_cameras = len(matrices)
    inverse = np.linalg.inv(matrices[:, :, :3])
    eyes = -np.einsum("cij,cj->ci", inverse, matrices[:, :, 3])
    where = [np.flatnonzero(row)[:MOST_RAYS] for row in free]
    rays = []
    for c, k in enumerate(where):
        d = np.column_stack([dots[c, k], np.ones(len(k))]) @ inverse[c].T
        rays.append(d / np.linalg.norm(d, axis=1, keepdims=True))
    points = []
    for a, b in combinations(range(n_cameras), 2):
        if not len(where[a]) or not len(where[b]):
            continue
        da, db, base = rays[a][:, None], rays[b][None], eyes[b] - eyes[a]
        cos = np.sum(da * db, axis=-1)
        bottom = np.maximum(1 - cos**2, 1e-9)
        along_a, along_b = np.sum(da * base, axis=-1), np.sum(db * base, axis=-1)
        s = (along_a - cos * along_b) / bottom
        t = (cos * along_a - along_b) / bottom
        points.append((0.5 * (eyes[a] + s[..., None] * da + eyes[b] + t[..., None] * db)).reshape(-1, 3))
    if not points:
        return np.zeros((0, 3)), np.zeros((0, n_cameras), dtype=np.int64)
    xyz = np.concatenate(points)
    uv, _ = seen_from(matrices, xyz)
    made = np.full((len(xyz), n_cameras), -1)
    for c, k in enumerate(where):
        if len(k):
            away = np.linalg.norm(uv[c][:, None] - dots[c, k], axis=-1)
            best = np.argmin(np.nan_to_num(away, nan=np.inf), axis=1)
            close = away[np.arange(len(xyz)), best] < 3.5 * max(sd_px, 0.3)
            made[close, c] = k[best[close]]
    count = (made >= 0).sum(axis=1)
    made = np.unique(made[count >= 2], axis=0)
    count = (made >= 0).sum(axis=1)
    # a subset of another point's dots is that point
    keep = np.ones(len(made), dtype=bool)
    for i in np.flatnonzero(count < count.max(initial=0)):
        has = made[i] >= 0
        inside = (made[:, has] == made[i, has]).all(axis=1)
        keep[i] = not (inside & (count > count[i])).any()
    made = made[keep]
    return _solved(matrices, eyes, rays, where, made), made


def _solved(
    matrices: Array, eyes: Array, rays: list[Array], where: list[NDArray[np.int64]], made: NDArray[np.int64]
) -> Array:
    """(N, 3) points nearest to their rays."""
    normal, right = np.zeros((len(made), 3, 3)), np.zeros((len(made), 3))
    for c in range(len(matrices)):
        has = np.flatnonzero(made[:, c] >= 0)
        if len(has):
            d = rays[c][np.searchsorted(where[c], made[has, c])]
            across = np.eye(3) - d[:, :, None] * d[:, None, :]
            normal[has] += across
            right[has] += across @ eyes[c]
    return np.linalg.solve(normal + 1e-12 * np.eye(3), right[..., None])[..., 0] if len(made) else np.zeros((0, 3))


def name_points(
    xyz_m: Array,
    made: NDArray[np.int64],
    markers: NDArray[np.int64],
    at: Array,
    cov_m2: Array,
    sure: NDArray[np.bool_],
    bones: Lengths,
    *,
    error_m: float,
) -> list[tuple[int, int]]:
    """Which markers the points are: pairs of a marker and a point that are sure.

    The cost of a pair is -2 log of the density of the point in the marker's prediction, and of the lengths of the bones
    to markers that are sure; a point of only two rays needs such a bone.

    Args:
        xyz_m: (N, 3) points.
        made: (N, C) their dots.
        markers: (L,) markers without a name.
        at: (M, 3) positions of all markers.
        cov_m2: (M, 3, 3) their covariances.
        sure: (M,) markers that are named.
        bones: Lengths.
        error_m: Standard deviation of a point.
    """
    if not len(xyz_m) or not len(markers):
        return []
    away = xyz_m[None] - at[markers, None]
    spread = cov_m2[markers] + error_m**2 * np.eye(3)
    d2 = np.einsum("lni,lij,lnj->ln", away, np.linalg.inv(spread), away)
    count = (made >= 0).sum(axis=1)
    cost = np.where(d2 < _GATE, d2 + np.log(np.linalg.det(spread / error_m**2))[:, None], _FAR)
    cost -= 8.0 * (count - 2)  # a chance meeting of a further ray is rare
    held = np.zeros(cost.shape, dtype=bool)
    for row, marker in enumerate(markers):
        for a, b in ((0, 1), (1, 0)):
            mine = np.flatnonzero((bones.ends[:, a] == marker) & np.isfinite(bones.length_m))
            for bone in mine:
                other = bones.ends[bone, b]
                if not sure[other]:
                    continue
                long = np.linalg.norm(xyz_m - at[other], axis=1) - bones.length_m[bone]
                error = (long / np.hypot(bones.sd_m[bone], 1.5 * error_m)) ** 2
                cost[row] = np.where(error < 16, cost[row] + error, _FAR)
                held[row] |= error < 9
    cost[(count[None] < 3) & ~held] = _FAR
    ok = cost < _FAR / 2
    if not ok.any():
        return []
    nothing = 30.0
    padded = np.concatenate([cost, np.full((len(markers), len(markers)), nothing)], axis=1)
    rows, columns = linear_sum_assignment(padded)
    out = []
    taken = {int(c) for c in columns}
    for r, c in zip(rows.tolist(), columns.tolist(), strict=True):
        if c >= len(xyz_m) or not ok[r, c]:
            continue
        mine = cost[r, c]
        clash = ((made == made[c]) & (made[c] >= 0)).any(axis=1)
        others = cost[r].copy()
        others[c] = np.inf
        others[[j for j in taken if j < len(xyz_m) and j != c and not clash[j]]] = np.inf
        swap = min(
            (
                cost[r, d] + cost[q, c] - mine - cost[q, d]
                for q, d in zip(rows.tolist(), columns.tolist(), strict=True)
                if q != r and d < len(xyz_m)
            ),
            default=np.inf,
        )
        idle = [q for q, d in zip(rows.tolist(), columns.tolist(), strict=True) if q != r and d >= len(xyz_m)]
        rival = min((cost[q, c] for q in idle), default=np.inf) - mine
        if min(others.min(initial=np.inf) - mine, swap, rival) > MARGIN:
            out.append((int(markers[r]), c))
    return out


def violated(at: Array, cov_m2: Array, bones: Lengths) -> NDArray[np.int64]:
    """(V, 2) bones between named markers that are not as long as they are, by five standard deviations."""
    a, b = bones.ends.T
    gap = at[a] - at[b]
    long = np.linalg.norm(gap, axis=1)
    along = gap / np.maximum(long, 1e-9)[:, None]
    variance = np.einsum("bi,bij,bj->b", along, cov_m2[a] + cov_m2[b], along) + bones.sd_m**2
    with np.errstate(invalid="ignore"):
        return bones.ends[np.abs(long - bones.length_m) > 5 * np.sqrt(variance)]
