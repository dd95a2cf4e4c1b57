"""Which dot is which marker: one frame, all cameras together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mocap.arrays import Array

GATE = 18.4
"""Chi-square of two degrees of freedom that one right dot in ten thousand exceeds: the window of a marker."""
MARGIN = 7.0
"""A name is given where every other one is less likely by exp(3.5), 33 times."""
RAY_GATE = 16.0
UNSEEN = GATE + np.log(5.0**4)
"""Cost of a marker without a dot: that of a dot at the edge of a window of 5 px."""
_FAR = 1e6
ROUNDS = 3
NARROW_PX = 3.0
"""A dot that only one camera shows is named in windows of less than this standard deviation."""


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
    """

    dot: NDArray[np.int64]
    xyz_m: Array
    cov_m2: Array
    doubtful: NDArray[np.bool_]
    surprise: Array
    rays: NDArray[np.int64]


def seen_from(matrices: Array, xyz_m: Array) -> tuple[Array, Array]:
    """Ideal pixels (C, M, 2) of points, and their derivatives (C, M, 2, 3); NaN behind a camera."""
    h = np.einsum("cij,mj->cmi", matrices[:, :, :3], xyz_m) + matrices[:, None, :, 3]
    depth = np.where(h[..., 2:] > 1e-6, h[..., 2:], np.nan)
    uv = h[..., :2] / depth
    jacobian = (matrices[:, None, :2, :3] - uv[..., None] * matrices[:, None, 2:, :3]) / depth[..., None]
    return uv, jacobian


def window_cov(jacobian: Array, cov_m2: Array, sd_px: float) -> Array:
    """(C, M, 2, 2) covariance of where markers are in the pictures, the error of a dot included."""
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
    known: NDArray[np.int64] | None = None,
    clicks: Array | None = None,
) -> Named:
    """Name the dots of a frame.

    In each camera dots and markers are assigned (Hungarian method); the cost of a pair is -2 log of the density of the
    dot in the predicted window (the squared Mahalanobis distance and log det of its covariance). A name is sure if no
    exchange with another marker or another dot is nearly as likely. What is
    sure in one camera narrows the windows of all others, and the assignment is done again; a ray that misses what the
    others say (epipolar consistency) is dropped.

    Args:
        matrices: (C, 3, 4) projections.
        dots: (C, K, 2) ideal pixels of dots; NaN where there are fewer.
        xyz_m: (M, 3) predicted positions.
        cov_m2: (M, 3, 3) covariances of the predictions.
        sd_px: (C, K) standard deviation of each dot's coordinate.
        reach_px: Markers that are predicted closer to each other in a picture than this may be one dot there.
        known: (C, M) dots whose marker is known, by a click; -1: not.
        clicks: (C, M, 2) places that a person clicked where there is no dot; NaN: none.
    """
    n_cameras, n_markers = len(matrices), len(xyz_m)
    known = np.full((n_cameras, n_markers), -1) if known is None else known
    prior = np.linalg.inv(cov_m2)
    least = 1.5 * float(np.nanmin(sd_px)) if np.isfinite(sd_px).any() else 1.0
    at, cov = xyz_m, cov_m2
    chosen = known.copy()
    doubtful = np.zeros(n_markers, dtype=bool)
    for _ in range(ROUNDS):
        before = chosen
        uv, jacobian = seen_from(matrices, at)
        # rays that a marker has already were used for its own position: their windows are those of the prediction
        white = np.linalg.inv(window_cov(jacobian, cov, least))
        chosen, doubtful = _assigned(uv, white, dots, known, reach_px=reach_px)
        at, cov, chosen = _fused(matrices, dots, chosen, known, xyz_m, cov_m2, prior, sd_px, clicks)
        if (chosen == before).all():
            break
    rays = (chosen >= 0).sum(axis=0)
    if clicks is not None:
        rays = rays + np.isfinite(clicks[..., 0]).sum(axis=0)
    moved = at - xyz_m
    spread = cov_m2 - cov
    spread[:, [0, 1, 2], [0, 1, 2]] += 1e-12
    with np.errstate(invalid="ignore"):
        surprise = np.einsum("mi,mi->m", moved, moved) / np.maximum(np.trace(spread, axis1=1, axis2=2), 1e-15)
    return Named(chosen, at, cov, doubtful & (rays < 2), np.where(rays >= 2, surprise, np.nan), rays)


def _assigned(
    uv: Array, white: Array, dots: Array, known: NDArray[np.int64], *, reach_px: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Sure names (C, M), and markers with a dot in their window that is not sure."""
    n_cameras, n_markers = uv.shape[:2]
    out = np.full((n_cameras, n_markers), -1, dtype=np.int64)
    doubtful = np.zeros(n_markers, dtype=bool)
    if not dots.shape[1]:
        return out, doubtful
    away = dots[:, None] - uv[:, :, None]
    d2 = np.einsum("cmki,cmij,cmkj->cmk", away, white, away)
    with np.errstate(invalid="ignore"):
        width = -np.log(np.linalg.det(white))[..., None]
        cost = np.where(d2 < GATE, d2 + width, _FAR)  # NaN compares false
    near = np.linalg.norm(uv[:, :, None] - uv[:, None], axis=-1) < reach_px
    for c in range(n_cameras):
        fixed = known[c] >= 0
        table = cost[c].copy()
        table[:, known[c][fixed]] = _FAR
        table[fixed] = _FAR
        rows, columns = np.nonzero(table < _FAR)
        if not len(rows):
            out[c] = known[c]
            continue
        markers, some = np.unique(rows), np.unique(columns)
        small = table[np.ix_(markers, some)]
        # a marker may have no dot, at the cost of the gate
        padded = np.concatenate([small, np.full((len(markers), len(markers)), UNSEEN)], axis=1)
        m, k = linear_sum_assignment(padded)
        real = k < len(some)
        m, k = m[real], k[real]
        mine = small[m, k]
        good = mine < UNSEEN
        m, k, mine = m[good], k[good], mine[good]
        # exchange of two markers, another dot for this marker, another marker for this dot
        exchange = small[m][:, k] + small[m][:, k].T - mine[:, None] - mine[None, :]
        np.fill_diagonal(exchange, np.inf)
        free = np.ones(len(some), dtype=bool)
        free[k] = False
        other_dot = small[m][:, free].min(axis=1, initial=_FAR) - mine
        idle = np.ones(len(markers), dtype=bool)
        idle[m] = False
        other_marker = small[idle][:, k].min(axis=0, initial=_FAR) - mine
        sure = (exchange.min(axis=1, initial=_FAR) > MARGIN) & (other_dot > MARGIN) & (other_marker > MARGIN)
        # two markers so close that their dots are one: the dot of one is no place of either
        lone = ~np.isin(np.arange(n_markers), markers[m])
        merged = (near[c][markers[m]] & lone & ~fixed).any(axis=1)
        sure &= ~merged
        out[c, markers[m][sure]] = some[k[sure]]
        out[c, fixed] = known[c, fixed]
        doubtful[markers[m][~sure]] = True
    return out, doubtful


def _fused(
    matrices: Array,
    dots: Array,
    chosen: NDArray[np.int64],
    known: NDArray[np.int64],
    xyz_m: Array,
    cov_m2: Array,
    prior: Array,
    sd_px: Array,
    clicks: Array | None,
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Positions and covariances with the chosen dots; dots that the other rays contradict are dropped."""
    chosen = chosen.copy()
    camera = np.arange(len(matrices))[:, None]
    narrow = _narrow(matrices, xyz_m, cov_m2)
    for attempt in range(4):
        # one ray tells nothing of its distance, and no other ray checks it
        alone = ((chosen >= 0).sum(axis=0) == 1) & (known < 0).all(axis=0)
        if clicks is not None:
            alone &= ~np.isfinite(clicks[..., 0]).any(axis=0)
        chosen = np.where(alone & ~narrow, -1, chosen)
        has = chosen >= 0
        seen = (
            np.where(has[..., None], dots[camera, np.maximum(chosen, 0)], np.nan)
            if dots.shape[1]
            else np.full((*chosen.shape, 2), np.nan)
        )
        sd = np.where(has, sd_px[camera, np.maximum(chosen, 0)], 1.0) if dots.shape[1] else np.ones(chosen.shape)
        if clicks is not None:
            clicked = np.isfinite(clicks[..., 0])
            seen, sd = np.where(clicked[..., None], clicks, seen), np.where(clicked, 1.0, sd)
        at, cov = update(matrices, seen, sd, xyz_m, cov_m2, prior)
        if attempt == 3:
            break
        uv, _ = seen_from(matrices, at)
        miss = np.where(has[..., None], seen - uv, 0.0)
        left = np.sum(miss**2, axis=-1) / sd**2
        worst = np.where(known >= 0, 0.0, left)
        m = np.flatnonzero(worst.max(axis=0) > RAY_GATE)
        if not len(m):
            break
        pair = has[:, m].sum(axis=0) == 2
        chosen[worst[:, m].argmax(axis=0), m] = -1
        both = m[pair]
        chosen[:, both] = known[:, both]
    return at, cov, chosen


def _narrow(matrices: Array, xyz_m: Array, cov_m2: Array) -> NDArray[np.bool_]:
    """(C, M) True where the predicted window is so small that a dot in it needs no other camera."""
    _, jacobian = seen_from(matrices, xyz_m)
    s = window_cov(jacobian, cov_m2, 0.0)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.maximum(s[..., 0, 0], s[..., 1, 1]) < NARROW_PX**2)


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
    weight = (has / sd_px**2)[:, some]
    pixel = np.nan_to_num(seen[:, some])
    here = xyz_m[some]
    for _ in range(2):
        uv, jacobian = seen_from(matrices, here)
        jacobian = np.where(has[:, some][..., None, None], jacobian, 0.0)
        heavy = jacobian * weight[..., None, None]
        information = prior[some] + np.einsum("cmij,cmik->mjk", heavy, jacobian)
        miss = np.where(has[:, some][..., None], pixel - uv, 0.0)
        pull = np.einsum("cmij,cmi->mj", heavy, miss) + np.einsum("mij,mj->mi", prior[some], xyz_m[some] - here)
        left = np.linalg.inv(information)
        here = here + np.einsum("mij,mj->mi", left, pull)
    at[some], cov[some] = here, left
    return at, cov
