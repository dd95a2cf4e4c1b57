"""Which cameras have the names of two markers exchanged, frame by frame: a hidden Markov model, and how sure it is.

A network or a digitiser exchanges two markers in one camera, in several, or in all, and each of them by itself. What
the rays show of a frame is the same for a set of cameras and for its complement; in which the names are right, the
paths of the clicks in each image tell, as they go on smoothly where names do not change. An exchange is undone only
where its probability, given all frames, is close to one; where it is in between, clicks are left out and reported.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, true_runs
from mocap.cameras.triangulate import Triangulation, robust
from mocap.cleaning.swapped_rays import agreement, exchange_rays, exchanged_rays, extent_px
from mocap.cleaning.swaps import (
    WAY_FRAMES,
    Swap,
    exchange,
    exchanged_markers,
    student_log,
    usual_length,
    without_edited,
)

Mask = NDArray[np.bool_]
Pair = tuple[int, int]

CAMERAS = 4
"""Sets of exchanged cameras are gone through for so many cameras at most: 16 sets. Chosen, not measured."""
STATE_CHANGE = 7.0
"""Negative log probability that two names change in one camera between two frames: one in 1100.
Chosen; with it 2 of 179 repairs were wrong (docs/experiments/arena.md)."""
SAME_ERROR_FRAMES = 4.0
"""Errors of a ray persist: so many frames count as one. Chosen, not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Settled:
    """What was decided of two markers.

    Attributes:
        exchanged: (C, T) cameras and frames in which their names are exchanged for certain.
        doubtful: (C, T) cameras and frames in which that cannot be told.
        odds: (T,) log odds of the most probable set of cameras.
    """

    exchanged: Mask
    doubtful: Mask
    odds: Array


def settle(
    matrices: Array, uv_px: Array, xyz_m: Array, pair: Pair, *, sd_px: float, relative: Array, extent_px: float
) -> Settled:
    """Decide in which cameras and frames the names of two markers are exchanged.

    The state of a frame is the set of cameras in which they are. Its log density: how the rays of both markers meet
    (``_fits``) and how far the markers are from the others (``_distances``), over ``SAME_ERROR_FRAMES``; from frame to
    frame how the clicks of each move in each image (``_moves``), less ``STATE_CHANGE`` for each camera that changes.
    Probabilities of states follow from all frames by the forward-backward recursions (Rabiner 1989).

    Undone are only exchanges in half of the cameras or fewer, in runs that begin and end with all names right and in
    which at no time all cameras are exchanged (of others it cannot be told which side is right), and of these only
    frames whose own rays do not object.

    Args:
        matrices: (C, 3, 4) projections, at most ``CAMERAS``.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        xyz_m: (T, M, 3) points as they are named; NaN where unknown.
        pair: The two markers.
        sd_px: Standard deviation of a pixel coordinate.
        relative: (C, T, M) deviations of rays relative to it.
        extent_px: Width of the region in which clicks lie.
    """
    states = np.array(list(product((0, 1), repeat=len(matrices))))
    uv, spread = uv_px[:, :, list(pair)], relative[:, :, list(pair)]
    fits, points = _fits(matrices, uv, spread, states, sd_px, extent_px)
    # of two equal explanations the shorter is right
    own = (fits + _distances(xyz_m, points, pair)) / SAME_ERROR_FRAMES - 0.03 * states.sum(axis=1)
    between = _moves(uv, _drift(uv_px), states) - STATE_CHANGE * np.abs(states[:, None] - states[None]).sum(axis=-1)
    sure = _posterior(own, between)  # (T, S)
    count = states.sum(axis=1)
    some = (count > 0) & (count < len(matrices))  # in all cameras: rays say nothing of it
    best = np.argmax(sure, axis=1)
    certain = (sure.max(axis=1) >= 0.995) & some[best] & _returns(count[best], len(matrices))
    certain &= 2 * count[best] <= len(matrices)  # most cameras are right
    certain &= np.take_along_axis(fits, best[:, None], 1)[:, 0] >= fits[:, 0]  # the frame's own rays do not object
    seen = np.isfinite(uv[..., 0]).any(axis=2)
    apart = np.linalg.norm(uv[:, :, 0] - uv[:, :, 1], axis=-1)
    tells = ~(apart < 3 * sd_px * spread.max(axis=2))  # otherwise it is all the same
    exchanged = certain & (states[best].T > 0) & seen
    chance = (sure * some) @ states  # (T, C)
    doubtful = (chance.T > 0.05) & ~certain & seen & tells  # neither certain nor excluded
    most = np.clip(sure.max(axis=1), 0.0, 1 - 1e-12)
    return Settled(exchanged=exchanged, doubtful=doubtful, odds=np.log(most / (1 - most)))


def _returns(count: NDArray[np.int64], n_cameras: int) -> Mask:
    """(T,) frames between two in which all names are right, without one between them in which all are exchanged.

    Args:
        count: (T,) exchanged cameras of the most probable states.
        n_cameras: Of all.
    """
    out = np.zeros(len(count), dtype=bool)
    for start, stop in true_runs(count > 0):
        out[start:stop] = start > 0 and stop < len(count) and not (count[start:stop] == n_cameras).any()
    return out


def _fits(
    matrices: Array, uv: Array, spread: Array, states: NDArray[np.int64], sd_px: float, extent_px: float
) -> tuple[Array, Array]:
    """(T, S) log density of the rays of two markers in each state, but for terms that names do not change.

    And the (T, S, 2, 3) points that they make.
    """
    detail = max(float(np.log(extent_px / (np.sqrt(2 * np.pi) * sd_px))), 0.0)
    out, points = np.zeros((uv.shape[1], len(states))), np.zeros((uv.shape[1], len(states), 2, 3))
    for number, state in enumerate(states):
        if state[0]:
            complement = np.flatnonzero((states == 1 - state).all(axis=1))[0]
            out[:, number], points[:, number] = out[:, complement], points[:, complement, ::-1]
            continue
        flip = state.astype(bool)
        named, width = uv.copy(), spread.copy()
        named[flip], width[flip] = uv[flip][:, :, ::-1], spread[flip][:, :, ::-1]
        out[:, number], points[:, number] = agreement(matrices, named, width, sd_px=sd_px, detail=detail)
    return out, points


def _distances(xyz_m: Array, points: Array, pair: Pair) -> Array:
    """(T, S) log density of the distances of two markers from all others, given how they usually are.

    Student's t about the median with the robust deviation, 5 % of the distance or more.
    """
    others = [m for m in range(xyz_m.shape[1]) if m not in pair]
    total, count = np.zeros(points.shape[:2]), np.zeros(points.shape[:2])
    for number, marker in enumerate(pair):
        usual = np.linalg.norm(xyz_m[:, [marker]] - xyz_m[:, others], axis=-1)
        now = np.linalg.norm(points[:, :, number, None] - xyz_m[:, None, others], axis=-1)  # (T, S, M - 2)
        for k, column in enumerate(usual.T):
            if (centre := usual_length(column)) is None:
                continue
            median, sd = centre
            seen = np.isfinite(now[..., k])
            off = np.where(seen, (np.nan_to_num(now[..., k]) - median) / sd, 0.0)
            total += np.where(seen, student_log(off**2, 1) - np.log(sd), 0.0)
            count += seen
    return total / np.maximum(count / 2, 1)  # they depend on each other: all count as one


def _drift(uv_px: Array) -> Array:
    """(C, T, 2) median motion of all clicks in each image since the frame before; 0 where unknown."""
    step = np.diff(uv_px, axis=1)
    out = np.zeros((*uv_px.shape[:2], 2))
    finite = np.isfinite(step[..., 0]).any(axis=2)
    out[:, 1:][finite] = np.nanmedian(step[finite], axis=1)
    return out


def _moves(uv: Array, drift: Array, states: NDArray[np.int64]) -> Array:
    """(T, S, S) log density of how clicks move from the states of the frame before (rows) to those of a frame.

    Steps of each marker, less the drift of all, are of Student's t with the deviation that steps of these names usually
    have in that camera. A name that was not clicked in the frame before is compared with its last click up to
    ``WAY_FRAMES`` frames ago.
    """
    n_cameras, n_frames = uv.shape[:2]
    total = np.zeros((n_frames, len(states), len(states)))
    place = np.cumsum(drift, axis=1)
    for camera in range(n_cameras):
        still = uv[camera] - place[camera, :, None]
        last, age = _carried(still)
        usual = np.linalg.norm(np.diff(still, axis=0), axis=-1)
        usual = usual[np.isfinite(usual)]
        if len(usual) < 10:
            continue
        scale = max(float(np.median(usual)) / float(np.sqrt(2 * np.log(2))), 1e-9)
        by_change = np.zeros((2, n_frames))
        for changed in (0, 1):
            step = np.linalg.norm(still[1:] - (last[:-1, ::-1] if changed else last[:-1]), axis=-1)
            frames = 1 + (age[:-1, ::-1] if changed else age[:-1])
            by_change[changed, 1:] = np.where(
                np.isfinite(step), student_log((np.nan_to_num(step) / (scale * frames)) ** 2, 2), 0.0
            ).sum(axis=1)
        only = np.isfinite(still[1:, :, 0]) & np.isfinite(last[:-1, :, 0])
        both = only.all(axis=1)  # otherwise one name is compared in one case and none in the other
        by_change[:, 1:][:, ~both] = 0.0
        differ = np.abs(states[:, None, camera] - states[None, :, camera])
        total += np.moveaxis(by_change[differ], -1, 0)
    return total


def _carried(still: Array) -> tuple[Array, Array]:
    """(T, 2, 2) the last click of each name up to ``WAY_FRAMES`` frames ago, and (T, 2) how many."""
    last, age = still.copy(), np.zeros(still.shape[:2])
    for frame in range(1, len(still)):
        lost = ~np.isfinite(last[frame, :, 0]) & (age[frame - 1] < WAY_FRAMES)
        last[frame, lost], age[frame, lost] = last[frame - 1, lost], age[frame - 1, lost] + 1
    return last, age


def _posterior(own: Array, between: Array) -> Array:
    """(T, S) probabilities of states from their (T, S) and (T, S, S) log densities (before, now)."""
    from scipy.special import logsumexp

    n = len(own)
    forward, backward = own.copy(), np.zeros_like(own)
    for t in range(1, n):
        forward[t] += logsumexp(forward[t - 1][:, None] + between[t], axis=0)
    for t in range(n - 2, -1, -1):
        backward[t] = logsumexp(between[t + 1] + (own[t + 1] + backward[t + 1])[None], axis=1)
    total = forward + backward
    return np.exp(total - np.asarray(logsumexp(total, axis=1, keepdims=True)))


def runs(pair: Pair, settled: Settled) -> list[Swap]:
    """The exchanges as runs of frames; the gain is the log odds of the least certain frame."""
    return [
        Swap(
            a=pair[0],
            b=pair[1],
            frames=np.arange(start, stop),
            camera=camera,
            gain=float(settled.odds[start:stop].min()),
        )
        for camera, row in enumerate(settled.exchanged)
        for start, stop in true_runs(row)
    ]


def pairs_of(proposed: Iterable[Swap]) -> list[Pair]:
    """Pairs of the proposed exchanges, that with the largest gain first."""
    gain: dict[Pair, float] = {}
    for swap in proposed:
        gain[swap.a, swap.b] = gain.get((swap.a, swap.b), 0.0) + swap.gain
    return sorted(gain, key=lambda pair: -gain[pair])


def exchange_where(values: NDArray, pair: Pair, where: Mask) -> NDArray:
    """A copy of (C, T, M, ...) values with two markers exchanged in some cameras and frames."""
    out = values.copy()
    a, b = pair
    out[where, a], out[where, b] = values[where, b], values[where, a]
    return out


def settle_all(
    matrices: Array, uv_px: Array, proposed: Sequence[Swap], *, sd_px: float, relative: Array, extent_px: float
) -> tuple[Array, Array, list[Swap], Mask]:
    """Settle all pairs of proposed exchanges, one after the other.

    Returns:
        Pixels and ``relative`` with the certain exchanges undone, these as runs, and (C, T, M) doubtful clicks.
    """
    doubtful = np.zeros(uv_px.shape[:3], dtype=bool)
    found: list[Swap] = []
    for pair in pairs_of(proposed):
        xyz = robust(matrices, np.where(doubtful[..., None], np.nan, uv_px), sd_px=sd_px, relative=relative).xyz_m
        settled = settle(matrices, uv_px, xyz, pair, sd_px=sd_px, relative=relative, extent_px=extent_px)
        uv_px = exchange_where(uv_px, pair, settled.exchanged)
        relative = exchange_where(relative, pair, settled.exchanged)
        doubtful = exchange_where(doubtful, pair, settled.exchanged)
        for marker in pair:
            doubtful[..., marker] |= settled.doubtful
        found += runs(pair, settled)
    return uv_px, relative, found, doubtful


def mixed(swap: Swap, rays: Sequence[Swap], ambiguous: Mask) -> bool:
    """Whether names of two markers differ from camera to camera about the time in which all are to be exchanged."""
    pair = [swap.a, swap.b]
    first, last = int(swap.frames[0]) - 5, int(swap.frames[-1]) + 5  # frames about it
    if ambiguous[:, max(first, 0) : last + 1][:, :, pair].any():
        return True
    return any(
        {ray.a, ray.b} & set(pair) and ray.camera is not None and ray.frames[0] <= last and ray.frames[-1] >= first
        for ray in rays
    )


def names_put_right(
    matrices: Array, uv_px: Array, found: Triangulation, *, bones: NDArray[np.int64], edited: Mask, relative: Array
) -> tuple[Array, Triangulation, tuple[Swap, ...], Mask, Mask, Array]:
    """Undo exchanges of names in single cameras, then in all.

    Up to ``CAMERAS`` cameras a single ray says little: there exchanges are proposals, of which a model of all cameras'
    states decides.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        found: What ``robust`` made of them.
        bones: (B, 2) markers at a constant distance.
        edited: (T, M) samples that a person corrected.
        relative: (C, T, M) deviations of rays relative to each other.

    Returns:
        The pixels without ambiguous ones; their points; runs of frames that were undone; (T, M) samples and (C, T, M)
        clicks that may be of either of two markers; and the deviations of rays, exchanged as the rays are.
    """
    uv = uv_px
    rays = exchanged_rays(matrices, uv, found, relative=relative)
    ambiguous = np.zeros(uv.shape[:3], dtype=bool)
    few = len(uv) <= CAMERAS
    if rays and few:
        settled = settle_all(matrices, uv, rays, sd_px=found.sd_px, relative=relative, extent_px=extent_px(uv))
        uv, relative, rays, ambiguous = settled
        ambiguous &= np.isfinite(uv[..., 0]) & ~edited
        uv = np.where(ambiguous[..., None], np.nan, uv)
    elif rays:
        uv, relative = exchange_rays(uv, rays), exchange_rays(relative, rays)
    rays, undone = without_edited(rays, edited)
    uv, relative = exchange_rays(uv, undone), exchange_rays(relative, undone)
    if rays or ambiguous.any():
        found = robust(matrices, uv, sd_px=found.sd_px, relative=relative)
    doubtful = ambiguous.any(axis=0) & np.isnan(found.xyz_m[..., 0])
    points = exchanged_markers(found.xyz_m, bones)
    swaps, _ = without_edited(points.swaps, edited)
    swaps = [swap for swap in swaps if not (few and mixed(swap, rays, ambiguous))]
    if swaps:
        uv, relative = exchange_rays(uv, swaps), exchange_rays(relative, swaps)
        found = replace(
            found,
            xyz_m=exchange(found.xyz_m, swaps),
            cov_m2=exchange(found.cov_m2, swaps),
            residual_px=exchange(found.residual_px, swaps),
            rejected=exchange_rays(found.rejected, swaps),
        )
    doubtful = (points.unsure & ~edited) | (exchange(doubtful.astype(float), swaps) > 0)
    return uv, found, (*rays, *swaps), doubtful, ambiguous, relative
