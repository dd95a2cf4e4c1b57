"""What smoothing makes of a recording: positions, velocities, status, and how far they are from what was measured."""

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.filters.moving import Rates
from mocap.filters.velocities import Asked, Motion
from mocap.pipeline.recording import Recording
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


FAR = 3.0
"""A sample is not called measured if it lies more than so many standard deviations from where it was measured."""
MOVED = {"moved": f"the track lies more than {FAR:g} standard deviations from where the sample was measured"}
"""Why a sample was rejected here, by the key that reports use."""


def moved(recording: Recording, xyz_m: Array, cov_m2: Array) -> tuple[Array, NDArray[np.bool_]]:
    """How (T, M, 3) positions with their (T, M, 3, 3) covariance lie from the measured ones, NaN without one.

    (T, M, 3) metres from the points of the believed clicks, or the positions of the file; and whether their length is
    more than ``FAR`` standard deviations.

    The distance of a measurement from its estimate has at most the covariance of both together; its deviation here is
    the root mean square over the three coordinates.
    """
    off = xyz_m - recording.xyz_m
    total = np.trace(cov_m2 + recording.cov_m2, axis1=-2, axis2=-1) / 3
    with np.errstate(invalid="ignore"):
        return off, np.linalg.norm(off, axis=-1) > FAR * np.sqrt(total)


def moved_report(recording: Recording, markers: MarkerTracks) -> dict[str, object]:
    """Median, 90 % and largest distance in mm of all that was measured and believed, and where the largest is."""
    off_m, far = moved(recording, markers.xyz_m, markers.cov_m2)
    distance_m = np.linalg.norm(off_m, axis=-1)
    rejected = np.any(list(recording.rejected.values()), axis=0)
    far &= (markers.status == Status.REJECTED) & ~rejected
    known = ((markers.status == Status.MEASURED) | far) & np.isfinite(distance_m)
    if not known.any():
        return {"median_mm": None, "90%_mm": None, "largest": None, "beyond_3_sd": 0, "samples": []}
    distance = np.where(known, 1e3 * distance_m, -1.0)
    frame, marker = (int(i) for i in np.unravel_index(np.argmax(distance), distance.shape))
    return {
        "median_mm": float(np.median(distance[known])),
        "90%_mm": float(np.quantile(distance[known], 0.9)),
        "largest": {"frame": frame + 1, "marker": markers.names[marker], "mm": float(distance[frame, marker])},
        "beyond_3_sd": int(far.sum()),
        "samples": [
            {"frame": int(t) + 1, "marker": markers.names[m], "mm": float(distance[t, m])} for t, m in np.argwhere(far)
        ],
    }


def jump_cov(recording: Recording, xyz_m: Array, origin: NDArray[np.int8]) -> Array:
    """(T, M, 3, 3) covariance of what was filled across a jump, from the last believed sample to the next.

    The marker is at one place or at the other, d apart: half of that either way, a covariance of d d^T / 4.

    Args:
        recording: The recording; ``audited`` has its jumps.
        xyz_m: (T, M, 3) positions of the track.
        origin: (T, M) origin of each sample.
    """
    out = np.zeros((*origin.shape, 3, 3))
    for jump in (f for f in recording.audited if f.kind == "jump"):
        for marker in (recording.names.index(name) for name in jump.markers):
            believed = np.flatnonzero(origin[:, marker] == Status.MEASURED)
            before, after = believed[believed < jump.frames[1] - 1], believed[believed >= jump.frames[1] - 1]
            if len(before) and len(after):
                far = (xyz_m[after[0], marker] - xyz_m[before[-1], marker]) / 2
                out[before[-1] + 1 : after[0], marker] += np.outer(far, far)
    return out
