"""A camera whose errors grow during a trial (knocked, out of focus, not synchronised) is reported and weighted down.

Every camera has a noise level in every frame. All levels are estimated together from the residuals of points that three
or more cameras see, each residual counted by the share of it that its own point does not take up: that names the camera
that disagrees with the rest, not those that agree with each other against it. With two cameras it cannot be known.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, true_runs
from mocap.cameras.triangulate import Linearised, PointFit, fit, linear, linearise
from mocap.cleaning.click_noise import USUAL_DOF

BAD, WORSE = 3.0, 2.0
"""A camera is bad from the frame in which its level exceeds WORSE times its good one, if it gets to BAD times. Chosen,
not measured."""
SHORTEST = 8
"""Frames that a camera must be bad for; shorter runs are single digitising errors. Chosen."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BadTime:
    """A run of frames in which a camera was bad.

    Attributes:
        camera: Its index.
        start: First frame.
        stop: One past the last frame.
        level_px: Standard deviation of a pixel coordinate in this time.
        good_px: The same in its good period.
        offset_px: (2,) mean of its residuals.
        offset_sd_px: Deviation of single rays about that offset.
    """

    camera: int
    start: int
    stop: int
    level_px: float
    good_px: float
    offset_px: Array
    offset_sd_px: float

    @property
    def moved(self) -> bool:
        """Whether all residuals point in one direction, as for a camera that was moved."""
        return float(np.linalg.norm(self.offset_px)) > 2 * self.offset_sd_px


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraHealth:
    """How much larger the errors of each camera are than in its good period.

    Attributes:
        factor: (C, T) 1 or more, by which the deviations of rays are to be multiplied.
        level_px: (C, T) standard deviation of a pixel coordinate; NaN where too few points are seen to tell.
        bad: Runs of frames that ``factor`` exceeds 1 in.
        known: Whether enough points are seen by three cameras to tell cameras apart.
    """

    factor: Array
    level_px: Array
    bad: tuple[BadTime, ...]
    known: bool


def camera_health(matrices: Array, uv_px: Array) -> CameraHealth:
    """Find cameras that go bad.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
    """
    shape = uv_px.shape[:3]
    none = CameraHealth(factor=np.ones(shape[:2]), level_px=np.full(shape[:2], np.nan), bad=(), known=False)
    seen = np.isfinite(uv_px[..., 0])
    many = np.count_nonzero(seen, axis=0) >= 3
    if many.sum() < 30 or shape[1] < 2 * SHORTEST:
        return none
    uv = uv_px[:, many]
    xyz = linear(matrices, uv)
    frame = np.nonzero(many)[0]
    problem = linearise(matrices, uv, xyz)
    first = fit(problem, np.ones(uv.shape[:2]))
    problem = linearise(matrices, uv, xyz + first.step_m)
    level, found = levels(problem, frame, shape[1])
    if not np.isfinite(level).any():
        return none
    miss = np.full(shape, np.nan)
    miss[:, many] = np.sqrt(2 * np.sum(found.residual**2, axis=-1) / np.maximum(found.redundancy, 1e-9))
    miss[:, many] = np.where(found.redundancy > 0.1, miss[:, many], np.nan)
    factor, good = _factors(level, miss, seen)
    bad = [
        _bad_time(camera, run, level, float(good[camera]), found, frame)
        for camera in range(shape[0])
        for run in true_runs(factor[camera] > 1.0)
    ]
    return CameraHealth(factor=factor, level_px=level, bad=tuple(bad), known=True)


def levels(problem: Linearised, frame: NDArray[np.int64], n_frames: int) -> tuple[Array, PointFit]:
    """Noise level of every camera in every frame, errors being of Student's t.

    Alternates between points and levels: s^2 = sum w r^2 / sum of redundancies over a window of five frames, with
    w = (nu + 2) / (nu + d^2) and d^2 = 2 r^2 / (redundancy s^2). Without w that is the estimate of variance components
    by Foerstner (1979) and Helmert; then a running median over nine frames, which keeps edges.

    Args:
        problem: K points.
        frame: (K,) their frames.
        n_frames: T.

    Returns:
        (C, T) standard deviations of a pixel coordinate, NaN where unknown; and the last fit.
    """
    n_cameras = len(problem.error)

    from scipy.ndimage import median_filter, uniform_filter1d

    def summed(values: Array) -> Array:
        return np.stack([np.bincount(frame, row, n_frames) for row in values]).astype(np.float64)

    redundant = problem.seen > 0
    scale = np.full((n_cameras, n_frames), 1.0)
    start = fit(problem, np.ones(problem.seen.shape))
    squares = np.sum(start.residual**2, axis=-1)
    usual = np.median(squares[redundant] / np.maximum(start.redundancy[redundant], 0.1))
    scale *= max(float(np.sqrt(usual)), 1e-9)
    weight = np.ones(problem.seen.shape)
    found, enough = start, np.zeros(scale.shape, dtype=bool)
    for _ in range(12):  # a level that is ten times too low doubles in each
        variance = scale[:, frame] ** 2
        found = fit(problem, weight / variance)
        squares = np.sum(found.residual**2, axis=-1)
        distance = 2 * squares / (np.maximum(found.redundancy, 0.1) * variance)
        weight = (USUAL_DOF + 2) / (USUAL_DOF + distance)
        over = uniform_filter1d(summed(weight * squares * redundant), 5, axis=1, mode="constant") * 5
        under = uniform_filter1d(summed(found.redundancy), 5, axis=1, mode="constant") * 5
        enough = under >= 12.0  # redundant errors in a window of five frames
        scale = np.asarray(np.sqrt(np.maximum(over, 1e-18) / np.maximum(under, 1e-9)))
        scale = _filled(np.where(enough, scale, np.nan))
        scale = np.maximum(median_filter(scale, size=(1, 9), mode="nearest"), 1e-9)
    return np.where(enough, scale * np.sqrt(USUAL_DOF / (USUAL_DOF - 2)), np.nan), found


def _filled(values: Array) -> Array:
    """(C, T) with NaN replaced by the nearest known value of the row; a row without any takes the median of all."""
    out = np.full(values.shape, np.nanmedian(values) if np.isfinite(values).any() else 1.0)
    for row, value in zip(out, values, strict=True):
        at = np.flatnonzero(np.isfinite(value))
        if len(at):
            nearest = np.searchsorted((at[1:] + at[:-1]) / 2, np.arange(len(value)))
            row[:] = value[at[nearest]]
    return np.asarray(out, dtype=np.float64)


def _factors(level: Array, miss_px: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """(C, T) factors, 1 but for runs in which a camera is bad, and (C,) its good level.

    The good level is the lower quartile of its own, but no more than twice the median camera's. What all cameras suffer
    at once is no camera's fault, and what comes and goes slowly is its calibration's, which errs by place: the animal
    flies through (``mocap.cleaning.bias`` removes that). A camera is bad where misses of the same markers jump at one
    end of the run at least.
    """
    own = np.array([np.quantile(row[np.isfinite(row)], 0.25) if np.isfinite(row).any() else np.nan for row in level])
    good = np.minimum(own, 2 * np.nanmedian(own))
    shared = np.maximum(np.nan_to_num(_others(level / own[:, None]), nan=1.0), 1.0)
    relative = level / good[:, None] / shared
    factor = np.ones(level.shape)
    for camera, row in enumerate(relative):
        finite = np.isfinite(row)
        if not finite.any():
            continue
        all_over, miss = _filled(row[None])[0], miss_px[camera]
        runs = list[tuple[int, int]]()
        for start, stop in true_runs(all_over > WORSE):  # without gaps of up to twice the shortest
            joins = bool(runs) and start - runs[-1][1] <= 2 * SHORTEST
            runs = [*runs[:-1], (runs[-1][0], stop)] if joins else [*runs, (start, stop)]
        for start, stop in runs:
            inside = row[start:stop][finite[start:stop]]
            sudden = max(_step(miss, seen, start), _step(miss[::-1], seen[:, ::-1], len(row) - stop))
            if np.count_nonzero(inside > BAD) >= SHORTEST and sudden > WORSE:
                factor[camera, start:stop] = np.maximum(all_over[start:stop], 1.0)
    return factor, good


def _step(miss_px: Array, seen: NDArray[np.bool_], at: int) -> float:
    """By how much (T, M) misses in one camera rise within ``SHORTEST`` frames at a frame, the median marker's.

    A marker counts while the cameras that see it stay the same (but for one in five): cameras contradict each other by
    place, so that a point moves when one joins.
    Levels of five frames feel a change two frames ahead: those between are left out. 0 where fewer than 4
    count on both sides.
    """
    if at < 1:
        return 0.0
    sides = []
    for frames in (slice(max(at - SHORTEST, 0), at), slice(at + 4, at + 4 + SHORTEST)):
        changed = np.count_nonzero(seen[:, frames] != seen[:, at - 1, None], axis=0)
        same = np.where(changed <= len(seen) // 5, miss_px[frames], np.nan)
        count = np.isfinite(same).sum(axis=0)
        size = np.sqrt(np.nansum(same**2, axis=0) / np.maximum(count, 1))
        sides.append(np.where(count >= 2, np.maximum(size, 1e-9), np.nan))
    rise = sides[1] / sides[0]
    rise = rise[np.isfinite(rise)]
    return float(np.median(rise)) if len(rise) >= 4 else 0.0


def _others(values: Array) -> Array:
    """(C, T) for each camera the median over the others."""
    out = np.full(values.shape, np.nan)
    for camera in range(len(values)):
        rest = np.delete(values, camera, axis=0)
        finite = np.isfinite(rest).any(axis=0)
        out[camera, finite] = np.nanmedian(rest[:, finite], axis=0)
    return out


def _bad_time(
    camera: int,
    run: tuple[int, int],
    level: Array,
    good: float,
    found: PointFit,
    frame: NDArray[np.int64],
) -> BadTime:
    start, stop = run
    # levels of five frames feel a change two frames ahead
    start, stop = start + 2 * (start > 0), stop - 2 * (stop < level.shape[1])
    inside = (frame >= start) & (frame < stop) & (found.redundancy[camera] > 0.1)
    # a ray misses the point of all others by 2 / redundancy of its residual
    miss = found.residual[camera, inside] * (2 / found.redundancy[camera, inside])[:, None]
    offset = np.median(miss, axis=0) if len(miss) else np.zeros(2)
    scatter = 1.4826 * float(np.median(np.abs(miss - offset))) if len(miss) else np.inf
    return BadTime(
        camera=camera,
        start=start,
        stop=stop,
        level_px=float(np.nanmedian(level[camera, start:stop])),
        good_px=good,
        offset_px=offset,
        offset_sd_px=scatter,
    )


def shifted_back(uv_px: Array, health: CameraHealth) -> Array:
    """(C, T, M, 2) pixels without the offsets of cameras that were moved.

    Even with a small weight, an error that all frames share would not average out over them.
    """
    out = uv_px.copy()
    for bad in health.bad:
        if bad.moved:
            out[bad.camera, bad.start : bad.stop] -= bad.offset_px
    return out
