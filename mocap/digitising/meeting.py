"""Where rays of dots that have no name yet meet in space, and which markers these points are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from eal.arrays import Array
from mocap.digitising.naming import IMPOSSIBLE, NAME_MARGIN, seen_from
from mocap.digitising.register import POINT_GATE


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

    Two rays make a point where they pass each other; the dots of all other cameras that lie where it projects belong
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
    nothing = np.zeros((0, 3)), np.zeros((0, n_cameras), dtype=np.int64)
    # dots are sorted by their response: the strongest
    camera, dot = np.nonzero(free & (np.cumsum(free, axis=1) <= 24))
    if not len(camera) or camera[0] == camera[-1]:
        return nothing
    inverse = np.linalg.inv(matrices[:, :, :3])
    eyes = -(inverse @ matrices[:, :, 3:])[..., 0]
    ray = (inverse[camera] @ np.append(dots[camera, dot], np.ones((len(dot), 1)), axis=1)[..., None])[..., 0]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    a, b = np.nonzero(camera[:, None] < camera)
    base = eyes[camera[b]] - eyes[camera[a]]
    cos, along_a, along_b = (np.sum(x * y, axis=1) for x, y in ((ray[a], ray[b]), (ray[a], base), (ray[b], base)))
    bottom = np.maximum(1 - cos**2, 1e-9)
    s, t = (along_a - cos * along_b) / bottom, (cos * along_a - along_b) / bottom
    xyz = 0.5 * (eyes[camera[a]] + s[:, None] * ray[a] + eyes[camera[b]] + t[:, None] * ray[b])
    uv, _ = seen_from(matrices, xyz)
    made = np.full((len(xyz), n_cameras), -1)
    for c in np.unique(camera):
        k = dot[camera == c]
        gap = uv[c][:, None] - dots[c, k]
        away2 = np.nan_to_num(gap[..., 0] ** 2 + gap[..., 1] ** 2, nan=np.inf)
        best = away2.argmin(axis=1)
        close = away2[np.arange(len(xyz)), best] < (3.5 * max(sd_px, 0.3)) ** 2
        made[close, c] = k[best[close]]
    made = made[(made >= 0).sum(axis=1) >= 2]
    if not len(made):
        return nothing
    made = np.unique(made, axis=0)
    count = (made >= 0).sum(axis=1)
    # a subset of another point's dots is that point
    keep = np.ones(len(made), dtype=bool)
    for i in np.flatnonzero(count < count.max()):
        has = made[i] >= 0
        inside = (made[:, has] == made[i, has]).all(axis=1)
        keep[i] = not (inside & (count > count[i])).any()
    made = made[keep]
    number = np.zeros(free.shape, dtype=np.int64)
    number[camera, dot] = np.arange(len(dot))
    has = made >= 0
    direction = ray[number[np.arange(n_cameras), np.maximum(made, 0)]]
    across = (np.eye(3) - direction[..., :, None] * direction[..., None, :]) * has[..., None, None]
    normal, right = across.sum(axis=1), (across @ eyes[..., None]).sum(axis=1)
    return np.linalg.solve(normal + 1e-12 * np.eye(3), right)[..., 0], made


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
    faint: Array | None = None,
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
        faint: (C, K) what the strength of a dot's response costs; None: nothing.
    """
    if not len(xyz_m) or not len(markers):
        return []
    away = xyz_m[None] - at[markers, None]
    spread = cov_m2[markers] + error_m**2 * np.eye(3)
    d2 = np.einsum("lni,lij,lnj->ln", away, np.linalg.inv(spread), away)
    count = (made >= 0).sum(axis=1)
    cost = np.where(d2 < POINT_GATE, d2 + np.log(np.linalg.det(spread / error_m**2))[:, None], IMPOSSIBLE)
    cost -= 8.0 * (count - 2)  # a chance meeting of a further ray is rare
    if faint is not None:
        cost += np.where(made >= 0, faint[np.arange(len(faint)), np.maximum(made, 0)], 0.0).sum(axis=1)
    expected = np.zeros(cost.shape, dtype=bool)
    for row, marker in enumerate(markers):
        for a, b in ((0, 1), (1, 0)):
            mine = np.flatnonzero((bones.ends[:, a] == marker) & np.isfinite(bones.length_m))
            for bone in mine:
                other = bones.ends[bone, b]
                if not sure[other]:
                    continue
                long = np.linalg.norm(xyz_m - at[other], axis=1) - bones.length_m[bone]
                error = (long / np.hypot(bones.sd_m[bone], 1.5 * error_m)) ** 2
                cost[row] = np.where(error < 16, cost[row] + error, IMPOSSIBLE)
                expected[row] |= error < 9
    cost[(count[None] < 3) & ~expected] = IMPOSSIBLE
    ok = cost < IMPOSSIBLE / 2
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
        if min(others.min(initial=np.inf) - mine, swap, rival) > NAME_MARGIN:
            out.append((int(markers[r]), c))
    return out


def violated(at: Array, cov_m2: Array, bones: Lengths, farthest_m: Array) -> NDArray[np.int64]:
    """(V, 2) pairs of markers at an impossible distance, by five standard deviations.

    The ends of a bone that is not as long as it is, and two markers that are farther apart than the bones between them
    are long together.

    Args:
        at: (M, 3) positions.
        cov_m2: (M, 3, 3) their covariances.
        bones: Lengths.
        farthest_m: (M, M) of ``reaches``.
    """
    gap = at[:, None] - at
    long = np.linalg.norm(gap, axis=2)
    along = gap / np.maximum(long, 1e-9)[..., None]
    variance = np.einsum("mni,mij,mnj->mn", along, cov_m2, along)
    variance = variance + variance.T
    a, b = bones.ends.T
    with np.errstate(invalid="ignore"):
        excess = long - farthest_m
        # 0.03: standard deviation of how long bones are together, as a share
        wrong = np.triu(excess > 5 * np.sqrt(variance + (0.03 * farthest_m) ** 2))
        wrong[a, b] = np.abs(long[a, b] - bones.length_m) > 5 * np.sqrt(variance[a, b] + bones.sd_m**2)
    return np.argwhere(wrong)


def reaches(bones: Lengths, n_markers: int) -> Array:
    """(M, M) greatest distances: sums of lengths along the shortest path of bones (Floyd 1962); infinite: no path."""
    out = np.full((n_markers, n_markers), np.inf)
    a, b = bones.ends.T
    out[a, b] = out[b, a] = np.nan_to_num(bones.length_m, nan=np.inf)
    for m in range(n_markers):
        out = np.minimum(out, out[:, m, None] + out[m])
    np.fill_diagonal(out, np.inf)
    return out
