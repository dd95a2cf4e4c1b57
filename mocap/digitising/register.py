"""Which of a frame's points are which markers, when nothing is known but poses of the animal."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtri

from eal.arrays import Array
from mocap.digitising.pose import FEWEST_OF_POSE, PoseGaussian, rigid

POINT_GATE = float(chdtri(3, 1e-3))
"""Chi-square of three degrees of freedom that one right point in a thousand exceeds."""
POINT_MARGIN = 12.0
"""A name is given where every other one is less likely by exp(6), 400 times."""
_DOF = 5.0  # of Student's t; chosen, not measured


@dataclass(frozen=True, eq=False)
class Registration:
    """Points that were recognised.

    Attributes:
        point: (M,) point of each marker; -1: none.
        sure: (M,) True where no exchange with another marker or point is nearly as likely.
        cost: Of the assignment: squared distances in deviations, and ``POINT_GATE`` for each marker without a point.
        margin: By which the cost of the next best, different assignment is greater.
    """

    point: NDArray[np.int64]
    sure: NDArray[np.bool_]
    cost: float
    margin: float


def recognise(points: Array, poses: PoseGaussian) -> Registration | None:
    """Recognise an animal in a cloud of points, some of which are not its own.

    Three markers at nearly constant distances are looked for among all triples of points at these distances; each that
    fits puts the mean pose there, whose markers and points are then assigned (Hungarian method) and the pose is bent
    onto them, in turn.

    Args:
        points: (N, 3) points.
        poses: Poses of M markers.

    Returns:
        None: there are fewer than four points, or no assignment of 70 % of the markers or points.
    """
    if len(points) < FEWEST_OF_POSE:
        return None
    far = np.linalg.norm(points[:, None] - points, axis=-1)
    guesses = []
    for triple in _triples(poses):
        for three in _matching(far, poses, triple):
            rotation, shift = rigid(poses.mean[list(triple)], points[list(three)])
            at = poses.mean @ rotation.T + shift
            sd = np.sqrt(_spread(poses))
            near = (np.linalg.norm(at[:, None] - points, axis=-1) / sd[:, None]).min(axis=1)
            guesses.append((float(np.minimum(near**2, 3 * POINT_GATE).sum()), three, triple))
    guesses.sort(key=lambda guess: guess[0])
    found: dict[tuple[int, ...], float] = {}
    for _, three, triple in guesses[:40]:  # of speed; chosen
        point = np.full(len(poses.mean), -1)
        point[list(triple)] = three
        point, cost = settled(points, poses, point)
        key = tuple(point.tolist())
        found[key] = min(cost, found.get(key, np.inf))
    if not found:
        return None
    ranked = sorted(found.items(), key=lambda item: item[1])
    best = np.array(ranked[0][0])
    if (best >= 0).sum() < max(FEWEST_OF_POSE, 0.7 * min(len(points), len(best))):
        return None
    # an assignment that differs in a point or two only is the same one, less well settled
    others = [c for k, c in ranked[1:] if np.sum((np.array(k) != best) & (np.array(k) >= 0)) > 2]
    return Registration(
        best, _sure(points, poses, best), ranked[0][1], (others[0] if others else np.inf) - ranked[0][1]
    )


def unlikely(away: Array, cov_m2: Array) -> Array:
    """-2 log density of distances (..., 3) with covariances (..., 3, 3), in mm^-3, but for a constant.

    Student's t of ``_DOF`` degrees of freedom: poses that were not seen before are missed by more than a normal law
    allows, so that a name is not ruled out by distance alone.
    """
    d2 = np.einsum("...i,...ij,...j->...", away, np.linalg.inv(cov_m2), away)
    return (_DOF + 3) * np.log1p(d2 / _DOF) + np.log(np.linalg.det(cov_m2 / 1e-6))


def _sure(points: Array, poses: PoseGaussian, point: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(M,) markers whose point no exchange would explain nearly as well."""
    seen = point >= 0
    found = poses.given(np.where(seen[:, None], points[np.maximum(point, 0)], 0.0), seen)
    if found is None:
        return np.zeros(len(point), dtype=bool)
    cost = unlikely(
        points[None] - found[0][:, None], np.broadcast_to(found[1][:, None], (len(point), len(points), 3, 3))
    )
    mine = np.where(seen, cost[np.arange(len(point)), np.maximum(point, 0)], np.inf)
    out = seen.copy()
    for m in np.flatnonzero(seen):
        others = seen.copy()
        others[m] = False
        swap = cost[m, point[others]] + cost[others, point[m]] - mine[m] - mine[others]
        idle = cost[~seen, point[m]] - mine[m]
        free = np.delete(cost[m], point[seen]) - mine[m]
        out[m] = min(swap.min(initial=np.inf), idle.min(initial=np.inf), free.min(initial=np.inf)) > POINT_MARGIN
    return out


def settled(points: Array, poses: PoseGaussian, point: NDArray[np.int64]) -> tuple[NDArray[np.int64], float]:
    """Assign and bend in turn, until nothing changes; the points of the markers (M,), and the cost."""
    cost, wide = np.inf, 4.0
    for _ in range(10):
        seen = point >= 0
        if seen.sum() >= FEWEST_OF_POSE:
            found = poses.given(np.where(seen[:, None], points[np.maximum(point, 0)], 0.0), seen)
        else:
            rotation, shift = rigid(poses.mean[seen], points[point[seen]])
            found = poses.mean @ rotation.T + shift, _spread(poses)[:, None, None] * np.eye(3)
        if found is None:
            break
        at, cov = found
        away = points[None] - at[:, None]
        d2 = np.einsum("mni,mij,mnj->mn", away, np.linalg.inv(cov * wide), away)
        padded = np.concatenate([np.minimum(d2, 1e6), np.full((len(at), len(at)), POINT_GATE)], axis=1)
        rows, columns = linear_sum_assignment(padded)
        new = np.full(len(at), -1)
        good = (columns < len(points)) & (padded[rows, columns] < POINT_GATE)
        new[rows[good]] = columns[good]
        cost = float(padded[rows, columns].sum()) + float(np.log(wide) * 3 * good.sum())
        if (new == point).all() and wide == 1.0:
            break
        if new.max(initial=-1) < 0:
            return point, np.inf
        point, wide = new, max(1.0, wide / 2)
    return point, cost


def _spread(poses: PoseGaussian) -> Array:
    """(M,) variance of a coordinate of each marker over poses."""
    return np.mean(np.sum(poses.loading**2, axis=2), axis=1) + poses.left_m2


def distances(poses: PoseGaussian) -> tuple[Array, Array]:
    """(M, M) mean distances of markers and their standard deviations, to first order in the loadings."""
    gap = poses.mean[:, None] - poses.mean
    long = np.linalg.norm(gap, axis=-1)
    along = gap / np.maximum(long, 1e-9)[..., None]
    change = np.einsum("abi,abir->abr", along, poses.loading[:, None] - poses.loading[None])
    return long, np.sqrt(np.sum(change**2, axis=-1) + 2 * poses.noise_m2)


def _triples(poses: PoseGaussian) -> list[tuple[int, int, int]]:
    """Triples of markers at the most constant distances that are not in a line."""
    long, sd = distances(poses)
    size = np.median(long[long > 0])
    ranked = []
    for a, b, c in combinations(range(len(long)), 3):
        sides = np.array([long[a, b], long[b, c], long[a, c]])
        area = np.linalg.norm(np.cross(poses.mean[b] - poses.mean[a], poses.mean[c] - poses.mean[a]))
        thin = area / max(sides.max() ** 2, 1e-12)
        loose = (sd[a, b] + sd[b, c] + sd[a, c]) / min(sides.sum(), 3 * size)
        if thin > 0.08:
            ranked.append((float(loose / min(sides.sum() / size, 2.0)), (a, b, c)))
    ranked.sort()
    out: list[tuple[int, int, int]] = []
    used = np.zeros(len(long), dtype=int)
    for _, triple in ranked:
        if used[list(triple)].max() < 3:
            out.append(triple)
            used[list(triple)] += 1
        if len(out) == 10:
            break
    return out


def _matching(far: Array, poses: PoseGaussian, triple: tuple[int, int, int]) -> list[tuple[int, int, int]]:
    """Triples of points at the distances of three markers; the nearest to them."""
    long, sd = distances(poses)
    a, b, c = triple

    def misfit(i: int, j: int) -> Array:
        return ((far - long[i, j]) / (1.5 * sd[i, j] + 0.01 * long[i, j])) ** 2

    ab, bc, ac = misfit(a, b), misfit(b, c), misfit(a, c)
    p, q = np.nonzero(ab < 9)
    third = bc[q] + ac[p]
    which, r = np.nonzero((bc[q] < 9) & (ac[p] < 9))
    total = ab[p[which], q[which]] + third[which, r]
    order = np.argsort(total)[:1500]
    found = zip(p[which][order].tolist(), q[which][order].tolist(), r[order].tolist(), strict=True)
    return [(x, y, z) for x, y, z in found if len({x, y, z}) == 3]
