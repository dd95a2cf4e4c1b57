"""The motion of a tracked recording: its markers with velocities and joint covariances."""

import numpy as np

from eal.arrays import Array
from mocap.filters.moving import Rates
from mocap.filters.velocities import Asked, Motion
from mocap.records import MarkerTracks, Status


def motion_of(
    markers: MarkerTracks, frames: slice, rates: Rates | None, asked: Asked, *, left_m_s: Array | float = 0.0
) -> Motion:
    """Velocities and joint covariances of the smoother, for the positions that were returned.

    Where the returned covariance of a marker's position is not the smoother's own (mixed and widened in gaps,
    calibration errors added), its block P is carried over as A P A' with A = C^(1/2) P^(-1/2), C the returned one,
    which keeps the correlations with other markers. Velocities keep the smoother's: an error of calibration that
    lasts moves positions alone. Where the track leaves measured points, either may be right: half of the square of
    their velocities' difference is added.

    Args:
        markers: The markers as returned.
        frames: Those that were tracked.
        rates: What the smoother knows; None: velocities are NaN.
        asked: Points and pairs of the whole recording.
        left_m_s: (T, M, 3) the track's velocity less that of the points that it leaves; 0 where it leaves none.
    """
    count, steps, n = len(markers.names), len(markers.t_s), len(asked.names)
    weights = asked.all_weights
    xyz = np.einsum("nm,tmi->tni", weights, np.nan_to_num(markers.xyz_m))
    uses = (weights > 0).astype(float)
    lost = np.einsum("nm,tm->tn", uses, np.isnan(markers.xyz_m[..., 0]).astype(float)) > 0.5
    other = np.einsum("nm,tm->tn", uses, (markers.status != Status.MEASURED).astype(float)) > 0.5
    xyz[lost] = np.nan
    velocity, kept = np.full((steps, n, 3), np.nan), np.ones((steps, n, 3))
    own = np.full((steps, n, 6, 6), np.nan, dtype=np.float32)
    pairs = np.array(asked.pairs if rates is not None else (), dtype=np.int64).reshape(-1, 2)
    cross = np.full((steps, len(pairs), 6, 6), np.nan, dtype=np.float32)
    if rates is not None:
        here = np.array([asked.names.index(name) for name in rates.asked.names])
        inside = np.ix_(np.arange(steps)[frames], here)
        velocity[inside], kept[inside] = rates.velocity_m_s, rates.kept
        scale = np.broadcast_to(np.eye(3), (steps, n, 3, 3)).copy()
        stated = np.full((steps, n, 3, 3), np.nan)
        stated[:, :count] = markers.cov_m2
        block = rates.own[..., :3, :3].astype(float)
        scale[inside] = _scales(stated[inside], block)
        mine = np.einsum("nm,tm->tn", weights**2, np.nan_to_num(np.trace(scale[:, :count], axis1=-2, axis2=-1) / 3))
        means = mine[:, count:] / np.sum(weights[count:] ** 2, axis=1)
        scale[:, count:] = means[..., None, None] * np.eye(3)
        done = _carried(scale[inside], rates.own, scale[inside])
        own[inside] = 0.5 * (done + np.swapaxes(done, -1, -2))  # products in single precision are skew by 1e-6
        column = {pair: i for i, pair in enumerate(map(tuple, pairs.tolist()))}
        for i, (a, b) in enumerate(rates.asked.pairs):
            pair, turned = (int(here[a]), int(here[b])), False
            if pair not in column:
                pair, turned = pair[::-1], True
            found = rates.cross[:, i]
            one, two = scale[frames, here[a]], scale[frames, here[b]]
            done = _carried(one, found, two)
            cross[frames, column[pair]] = np.swapaxes(done, 1, 2) if turned else done
        left = left_m_s * np.ones((steps, count, 3))
        own[..., 3:, 3:] += 0.5 * np.einsum("nm,tmi,tmj->tnij", weights**2, left, left, optimize=True)
        velocity[lost] = np.nan
    return Motion(
        names=asked.names,
        t_s=markers.t_s,
        xyz_m=xyz,
        velocity_m_s=velocity,
        own=own,
        pairs=pairs,
        cross=cross,
        kept=kept,
        measured=~other & ~lost,
    )


def _scales(stated: Array, smoothed: Array) -> Array:
    """(..., 3, 3) A = C^(1/2) P^(-1/2); 1 where either is unknown."""
    known = np.asarray(np.isfinite(stated + smoothed).all(axis=(-2, -1)))
    unit = np.eye(3)
    c, p = np.where(known[..., None, None], stated, unit), np.where(known[..., None, None], smoothed, unit)
    return _power(c, 0.5) @ _power(p, -0.5)


def _power(matrix: Array, power: float) -> Array:
    value, vectors = np.linalg.eigh(matrix)
    value = np.maximum(value, 1e-18)
    return (vectors * value[..., None, :] ** power) @ np.swapaxes(vectors, -1, -2)


def _carried(left: Array, block: np.ndarray, right: Array) -> np.ndarray:
    """(..., 6, 6) blocks with the position of both sides scaled."""
    done = block.copy()
    done[..., :3, :] = left.astype(np.float32) @ done[..., :3, :]
    done[..., :3] = done[..., :3] @ np.swapaxes(right.astype(np.float32), -1, -2)
    return done
