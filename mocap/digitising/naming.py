"""Which dot is which marker: one frame, all cameras together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from eal.arrays import Array

NAME_GATE = 2 * np.log(1e4)
"""Chi-square of two degrees of freedom that one right dot in ten thousand exceeds: the window of a marker."""
NAME_MARGIN = 7.0
"""A name is given where every other one is less likely by exp(3.5), 33 times."""
WITHOUT_DOT = NAME_GATE + np.log(5.0**4)
"""Cost of a marker without a dot: that of a dot at the edge of a window of 5 px."""
IMPOSSIBLE = 1e6
"""Cost of what cannot be: above all that can, squares of a few tens."""
MERGED = 0.25
"""Standard deviation of a dot of two markers in one, as a share of the distance at which two dots are apart.
Chosen, not measured."""


@dataclass(frozen=True, eq=False)
class Named:
    """What one frame shows of M markers.

    Attributes:
        dot: (C, M) number of the dot in its camera; -1: none that is certain.
        xyz_m: (M, 3) positions, predicted and observed.
        cov_m2: (M, 3, 3) their covariances.
        doubtful: (M,) True where a dot lies in the marker's window, but belongs to it or to another.
        surprise: (M,) squared distance between prediction and rays, over its expectation; NaN where not named.
        rays: (M,) number of cameras that show the marker.
        merged: (C, M) True where the dot may be that of two markers in one, whose middle is no place of either.
    """

    dot: NDArray[np.int64]
    xyz_m: Array
    cov_m2: Array
    doubtful: NDArray[np.bool_]
    surprise: Array
    rays: NDArray[np.int64]
    merged: NDArray[np.bool_]


def seen_from(matrices: Array, xyz_m: Array) -> tuple[Array, Array]:
    """Ideal pixels (C, M, 2) of points, and their derivatives (C, M, 2, 3); NaN behind a camera."""
    h = xyz_m @ np.swapaxes(matrices[:, :, :3], 1, 2) + matrices[:, None, :, 3]
    depth = np.where(h[..., 2:] > 1e-6, h[..., 2:], np.nan)
    uv = h[..., :2] / depth
    jacobian = (matrices[:, None, :2, :3] - uv[..., None] * matrices[:, None, 2:, :3]) / depth[..., None]
    return uv, jacobian


def window_cov(jacobian: Array, cov_m2: Array, sd_px: float) -> Array:
    """(C, M, 2, 2) covariance of where markers are in the images, the error of a dot included."""
    s = jacobian @ cov_m2 @ np.swapaxes(jacobian, -1, -2)
    s[..., 0, 0] += sd_px**2
    s[..., 1, 1] += sd_px**2
    return s


def name_dots(
    matrices: Array,
    dots: Array,
    xyz_m: Array,
    cov_m2: Array,
    *,
    sd_px: Array,
    reach_px: float,
    clicked_dots: NDArray[np.int64] | None = None,
    clicks: Array | None = None,
    barred: NDArray[np.bool_] | None = None,
    owner: NDArray[np.int64] | None = None,
    textured: NDArray[np.bool_] | None = None,
    faint: Array | None = None,
    guessed: NDArray[np.bool_] | None = None,
) -> Named:
    """Name the dots of a frame.

    In each camera dots and markers are assigned (Hungarian method); the cost of a pair is -2 log of the density of the
    dot in the predicted window (the squared Mahalanobis distance and log det of its covariance), and of the strength of
    its response where it is weaker than a marker's usually is. A name is sure if no
    exchange with another marker or another dot is nearly as likely. What is
    sure in one camera narrows the windows of all others, and the assignment is done again; a ray that misses what the
    others say (epipolar consistency) is dropped.

    Args:
        matrices: (C, 3, 4) projections.
        dots: (C, K, 2) ideal pixels of dots; NaN where there are fewer.
        xyz_m: (M, 3) predicted positions.
        cov_m2: (M, 3, 3) covariances of the predictions.
        sd_px: (C, K) standard deviation of each dot's coordinate.
        reach_px: Markers that are predicted closer to each other in an image than this may be one dot there.
        clicked_dots: (C, M) dots whose marker is known, by a click; -1: not.
        clicks: (C, M, 2) places that a person clicked where there is no dot; NaN: none.
        barred: (C, M) True where a person said that the marker is not to be seen.
        owner: (C, K) marker whose texture was followed there; -1: a dot, which may be any marker's; None: all are dots.
        textured: (M,) True for markers without a dot, which are nowhere but where their texture is.
        faint: (C, K) what the strength of a dot's response costs: ``dots.Strength.faintness``; None: nothing.
        guessed: (C, M) True where ``known`` comes from rays that meet, not from a click; None: nowhere.
    """
    n_cameras, n_markers = len(matrices), len(xyz_m)
    clicked_dots = np.full((n_cameras, n_markers), -1) if clicked_dots is None else clicked_dots
    prior = np.linalg.inv(cov_m2)
    least = 1.5 * float(np.nanmin(sd_px)) if np.isfinite(sd_px).any() else 1.0
    at, cov = xyz_m, cov_m2
    chosen = clicked_dots.copy()
    doubtful = np.zeros(n_markers, dtype=bool)
    assigned: NDArray[np.int64] | None = None
    merged = np.zeros(clicked_dots.shape, dtype=bool)
    textured = np.zeros(n_markers, dtype=bool) if textured is None else textured
    others = np.zeros((n_cameras, n_markers, dots.shape[1]), dtype=bool)
    if barred is not None:
        others |= barred[..., None]
    if owner is not None and textured.any():
        mine = owner[:, None] == np.arange(n_markers)[:, None]
        others |= ~mine & (textured[:, None] | (owner >= 0)[:, None])
    for _ in range(3):
        before = assigned
        uv, jacobian = seen_from(matrices, at)
        # rays that a marker has already were used for its own position: their windows are those of the prediction
        s = window_cov(jacobian, cov, least)
        assigned, doubtful = _assigned(uv, s, dots, clicked_dots, others, textured, faint, reach_px=reach_px)
        if before is not None and (assigned == before).all():
            break
        merged = _merged(uv, dots, assigned, textured, reach_px=reach_px)
        if guessed is not None:
            merged &= guessed | (clicked_dots < 0)
        loose = np.where(merged, MERGED * reach_px, 0.0)
        at, cov, chosen = _fused(matrices, dots, assigned, clicked_dots, xyz_m, cov_m2, prior, sd_px, clicks, loose)
    rays = (chosen >= 0).sum(axis=0)
    if clicks is not None:
        rays = rays + np.isfinite(clicks[..., 0]).sum(axis=0)
    moved = at - xyz_m
    spread = cov_m2 - cov
    spread[:, [0, 1, 2], [0, 1, 2]] += 1e-12
    with np.errstate(invalid="ignore"):
        surprise = np.einsum("mi,mi->m", moved, moved) / np.maximum(np.trace(spread, axis1=1, axis2=2), 1e-15)
    return Named(chosen, at, cov, doubtful & (rays < 2), np.where(rays >= 2, surprise, np.nan), rays, merged)


def away2(s: Array, dots: Array, uv: Array) -> tuple[Array, Array]:
    """Squared Mahalanobis distances (C, M, K) of dots (C, K, 2) from (C, M, 2), and log det (C, M) of (C, M, 2, 2)."""
    du = dots[:, None, :, 0] - uv[:, :, None, 0]
    dv = dots[:, None, :, 1] - uv[:, :, None, 1]
    det = s[..., 0, 0] * s[..., 1, 1] - s[..., 0, 1] ** 2
    uu, uw, ww = (np.asarray(x / det)[..., None] for x in (s[..., 1, 1], -2 * s[..., 0, 1], s[..., 0, 0]))
    return (uu * du + uw * dv) * du + ww * dv**2, np.log(det)


def _assigned(
    uv: Array,
    s: Array,
    dots: Array,
    clicked_dots: NDArray[np.int64],
    others: NDArray[np.bool_],
    textured: NDArray[np.bool_],
    faint: Array | None,
    *,
    reach_px: float,
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Sure names (C, M), and markers with a dot in their window that is not sure; ``others`` (C, M, K): not theirs.

    Where no two markers of a camera are nearest to the same dot, these dots are the assignment of least cost.
    """
    n_markers, n_dots = uv.shape[1], dots.shape[1]
    if not n_dots:
        return np.full(uv.shape[:2], -1, dtype=np.int64), np.zeros(n_markers, dtype=bool)
    d2, log_det = away2(s, dots, uv)
    cost = np.where(d2 < NAME_GATE, d2 + log_det[..., None], IMPOSSIBLE)  # NaN compares false
    if faint is not None:
        cost += faint[:, None]
    cost[others] = IMPOSSIBLE
    fixed = clicked_dots >= 0
    if fixed.any():
        camera, marker = np.nonzero(fixed)
        cost[camera, :, clicked_dots[camera, marker]] = IMPOSSIBLE
        cost[fixed] = IMPOSSIBLE
    pick = cost.argmin(axis=2)
    mine = np.take_along_axis(cost, pick[..., None], axis=2)[..., 0]
    pick = np.where(mine < WITHOUT_DOT, pick, -1)
    for c, row in enumerate(pick):
        taken = row[row >= 0]
        if np.bincount(taken, minlength=1).max() > 1:
            pick[c] = _least_cost(cost[c])
    has = pick >= 0
    # [c, m, n]: cost of the dot of n for m
    of_others = np.take_along_axis(cost, np.broadcast_to(np.maximum(pick, 0)[:, None], (*pick.shape, n_markers)), 2)
    mine = np.where(has, np.einsum("cmm->cm", of_others), IMPOSSIBLE)
    # exchange of two markers, another dot for this marker, another marker for this dot
    total = mine[:, :, None] + mine[:, None]
    exchange = np.where(has[:, None], of_others + np.swapaxes(of_others, 1, 2) - total, np.inf)
    i = np.arange(n_markers)
    exchange[:, i, i] = np.inf
    used = np.zeros((len(uv), n_dots), dtype=bool)
    used[np.nonzero(has)[0], pick[has]] = True
    other_dot = np.where(used[:, None], IMPOSSIBLE, cost).min(axis=2)
    other_marker = np.where(has[:, :, None], IMPOSSIBLE, of_others).min(axis=1)
    rival = np.minimum(exchange.min(axis=2), np.minimum(other_dot, other_marker) - mine)
    sure = has & (rival > NAME_MARGIN)
    # two markers so close that their dots are one: the dot of one is no place of either
    lone = ~sure & ~fixed & ~textured
    if lone.any():
        gap = uv[:, :, None] - uv[:, None]
        near = np.asarray(gap[..., 0] ** 2 + gap[..., 1] ** 2 < reach_px**2)
        sure &= textured | ~(near & lone[:, None]).any(axis=2)
    return np.where(fixed, clicked_dots, np.where(sure, pick, -1)), (has & ~sure).any(axis=0)


def _merged(
    uv: Array, dots: Array, assigned: NDArray[np.int64], textured: NDArray[np.bool_], *, reach_px: float
) -> NDArray[np.bool_]:
    """(C, M) True where another marker without a dot is predicted so near a marker's dot as to be in it."""
    if not dots.shape[1]:
        return np.zeros(assigned.shape, dtype=bool)
    lone = (assigned < 0) & ~textured
    place = np.take_along_axis(dots, np.maximum(assigned, 0)[..., None], axis=1)
    gap = place[:, :, None] - uv[:, None]
    with np.errstate(invalid="ignore"):
        near = np.asarray(gap[..., 0] ** 2 + gap[..., 1] ** 2 < reach_px**2)
    return (assigned >= 0) & ~textured & (near & lone[:, None]).any(axis=2)


def _least_cost(cost: Array) -> NDArray[np.int64]:
    """(M,) dots of the assignment of least cost (Hungarian method); -1: none, at the cost ``WITHOUT_DOT``."""
    out = np.full(len(cost), -1)
    rows, columns = np.flatnonzero((cost < IMPOSSIBLE).any(axis=1)), np.flatnonzero((cost < IMPOSSIBLE).any(axis=0))
    small = cost[np.ix_(rows, columns)]
    padded = np.concatenate([small, np.full((len(rows), len(rows)), WITHOUT_DOT)], axis=1)
    m, k = linear_sum_assignment(padded)
    real = (k < len(columns)) & (padded[m, k] < WITHOUT_DOT)
    out[rows[m[real]]] = columns[k[real]]
    return out


def _fused(
    matrices: Array,
    dots: Array,
    chosen: NDArray[np.int64],
    clicked_dots: NDArray[np.int64],
    xyz_m: Array,
    cov_m2: Array,
    prior: Array,
    sd_px: Array,
    clicks: Array | None,
    loose: Array,
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Positions and covariances with the chosen dots; dots that the other rays contradict are dropped."""
    chosen = chosen.copy()
    camera = np.arange(len(matrices))[:, None]
    clicked = np.asarray(np.zeros(chosen.shape, dtype=bool) if clicks is None else np.isfinite(clicks[..., 0]))
    # one ray tells nothing of its distance, and no other ray checks it
    alone = np.asarray((clicked_dots < 0).all(axis=0) & ~clicked.any(axis=0))
    narrow: NDArray[np.bool_] | None = None
    at, cov = xyz_m.copy(), cov_m2.copy()
    todo = np.arange(len(xyz_m))
    for attempt in range(4):
        single = alone[todo] & ((chosen[:, todo] >= 0).sum(axis=0) == 1)
        if single.any():
            narrow = _narrow(matrices, xyz_m, cov_m2) if narrow is None else narrow
            chosen[:, todo] = np.where(single & ~narrow[:, todo], -1, chosen[:, todo])
        dot = chosen[:, todo]
        has = dot >= 0
        if dots.shape[1]:
            seen = np.where(has[..., None], dots[camera, np.maximum(dot, 0)], np.nan)
            sd = np.where(has, sd_px[camera, np.maximum(dot, 0)], 1.0)
        else:
            seen, sd = np.full((*dot.shape, 2), np.nan), np.ones(dot.shape)
        sd = np.maximum(sd, np.where(has, loose[:, todo], 0.0))
        sd = np.where(alone[todo] & (has.sum(axis=0) == 1), np.maximum(sd, 1.0), sd)  # no other ray checks it
        if clicks is not None:
            seen = np.where(clicked[:, todo, None], clicks[:, todo], seen)
            sd = np.where(clicked[:, todo], 1.0, sd)
        at[todo], cov[todo] = update(matrices, seen, sd, xyz_m[todo], cov_m2[todo], prior[todo])
        if attempt == 3:
            break
        uv, _ = seen_from(matrices, at[todo])
        miss = np.where(has[..., None], seen - uv, 0.0)
        left = (miss[..., 0] ** 2 + miss[..., 1] ** 2) / sd**2
        worst = np.where(clicked_dots[:, todo] >= 0, 0.0, left)
        bad = worst.max(axis=0) > 16.0
        if not bad.any():
            break
        m, pair = todo[bad], has[:, bad].sum(axis=0) == 2
        chosen[worst[:, bad].argmax(axis=0), m] = -1
        both = m[pair]
        chosen[:, both] = clicked_dots[:, both]
        todo = m
    return at, cov, chosen


def _narrow(matrices: Array, xyz_m: Array, cov_m2: Array) -> NDArray[np.bool_]:
    """(C, M) True where the predicted window is so small that a dot in it needs no other camera."""
    _, jacobian = seen_from(matrices, xyz_m)
    s = window_cov(jacobian, cov_m2, 0.0)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.maximum(s[..., 0, 0], s[..., 1, 1]) < 3.0**2)


def update(
    matrices: Array, seen: Array, sd_px: Array, xyz_m: Array, cov_m2: Array, prior: Array
) -> tuple[Array, Array]:
    """Positions with the pixels that are seen: two iterations of the Gauss-Newton update, all markers at once.

    Args:
        matrices: (C, 3, 4) projections.
        seen: (C, M, 2) ideal pixels; NaN where not seen.
        sd_px: (C, M) their standard deviations.
        xyz_m: (M, 3) predicted positions.
        cov_m2: (M, 3, 3) covariances of the predictions.
        prior: (M, 3, 3) inverses of these.

    Returns:
        (M, 3) positions, (M, 3, 3) covariances.
    """
    has = np.isfinite(seen[..., 0])
    some = np.flatnonzero(has.any(axis=0))
    at, cov = xyz_m.copy(), cov_m2.copy()
    if not len(some):
        return at, cov
    has, prior = has[:, some], prior[some]
    weight = np.where(has, 1 / sd_px[:, some] ** 2, 0.0)[..., None]
    pixel = np.nan_to_num(seen[:, some])
    first = here = xyz_m[some]
    left = cov[some]
    for _ in range(2):
        uv, jacobian = seen_from(matrices, here)
        # (M, 2 C, 3) rows of all cameras
        rows = np.where(has[..., None, None], jacobian, 0.0)
        miss = np.where(has[..., None], pixel - uv, 0.0) * weight
        rows = np.moveaxis(rows, 0, 1).reshape(len(some), -1, 3)
        heavy = rows * np.moveaxis(np.broadcast_to(weight, miss.shape), 0, 1).reshape(len(some), -1, 1)
        across = np.swapaxes(rows, 1, 2)
        left = np.linalg.inv(prior + across @ heavy)
        pull = across @ np.moveaxis(miss, 0, 1).reshape(len(some), -1, 1) + prior @ (first - here)[..., None]
        here = here + (left @ pull)[..., 0]
    at[some], cov[some] = here, left
    return at, cov
