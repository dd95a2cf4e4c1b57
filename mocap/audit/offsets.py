"""Cameras that start, or run, early or late: by whole frames or a fraction of one, estimated from moving markers."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.fft import irfft, rfft
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.camera import Camera, stacked
from mocap.cameras.triangulate import linear, linearise
from mocap.findings import Finding, Kind, alarm

BLOCKS = 12
"""Stretches of a recording, to see how far results of parts of it differ: a deviation to 1 / sqrt(2 * 11) = 21 %."""
CLEAR_SD = 4.0
"""An offset is believed where it is more than a frame and so many standard deviations: by chance 1 in 16,000 is."""
_I, _J, _TWICE = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2], np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
"""Entries of a symmetric matrix, and how often each is in it."""


def start_offsets(matrices: Array, ideal_px: Array) -> tuple[Array, Array]:
    """By how many whole frames cameras start late: those at which points lie on each other's epipolar lines.

    The squared distance of a pixel x of one camera from the line l of another's is x'Ll'x with L = l l', a product of
    what each camera shows by itself, so that its sum over a recording is a correlation: by Fourier transform for all
    lags at once. With n samples in common and a mean square s the log likelihood of a lag beats that of a random one by
    n / 2 log(s_all / s); the lag of a pair of cameras is the likeliest, offsets are those of the pairs that tell most
    (a spanning tree).

    Args:
        matrices: (C, 3, 4) projections.
        ideal_px: (C, T, M, 2) ideal pixels; NaN where not seen.

    Returns:
        (C,) offsets in whole frames, as of ``mocap.audit.offsets``: row n of camera c shows what happened at frame
        n + offset, and (C,) their standard deviations, by a jackknife over blocks of time along the tree; infinite
        where two cameras never see a marker, even apart.
    """
    n_cameras = len(ideal_px)
    pairs = []
    for a, b in combinations(range(n_cameras), 2):
        lag, sd, gain = _pair(matrices[a], matrices[b], ideal_px[a], ideal_px[b])
        pairs.append((gain, a, b, lag, sd))
    offset, variance = np.full(n_cameras, np.nan), np.full(n_cameras, np.inf)
    offset[0], variance[0] = 0.0, 0.0
    while True:  # the most telling pair of a camera that is placed and one that is not
        steps = [pair for pair in pairs if np.isnan(offset[pair[1]]) != np.isnan(offset[pair[2]])]
        if not steps or max(steps)[0] <= 0:
            break
        _, a, b, lag, sd = max(steps)
        if np.isnan(offset[b]):
            offset[b], variance[b] = offset[a] - lag, variance[a] + sd**2
        else:
            offset[a], variance[a] = offset[b] + lag, variance[b] + sd**2
    offset, sd = np.nan_to_num(offset), np.sqrt(variance)
    offset -= np.sort(offset)[(n_cameras - 1) // 2]
    certain = (offset == 0) | (np.abs(offset) > np.maximum(CLEAR_SD * sd, 1.0))
    if not certain.all() or not np.isfinite(sd).all():
        return np.zeros(n_cameras), np.zeros(n_cameras)
    return offset, sd


def moved(uv_px: Array, offset_frames: Array) -> Array:
    """(C, T, M, 2) tracks as if all cameras had started at once; rows that no camera filmed are NaN."""
    out = np.full_like(uv_px, np.nan)
    for c, by in enumerate(offset_frames.astype(int)):
        n = uv_px.shape[1] - abs(by)
        if n > 0:
            out[c, max(by, 0) : max(by, 0) + n] = uv_px[c, max(-by, 0) : max(-by, 0) + n]
    return out


def _pair(one: Array, other: Array, uv: Array, uv_other: Array) -> tuple[int, float, float]:
    """Lag k at which row n of a camera and row n + k of another show one moment, its deviation, and what it gains."""
    centre = np.append(np.linalg.solve(one[:, :3], -one[:, 3]), 1.0)
    epipole = other @ centre
    cross = np.cross(np.eye(3), epipole)  # cross @ x = epipole x x, but for its sign
    fundamental = cross @ other @ np.linalg.pinv(one)
    line = np.concatenate([uv, np.ones((*uv.shape[:2], 1))], axis=-1) @ fundamental.T
    line = line / np.linalg.norm(line[..., :2], axis=-1, keepdims=True)
    point = np.concatenate([uv_other, np.ones((*uv_other.shape[:2], 1))], axis=-1)
    seen, seen_other = (np.asarray(np.isfinite(x).all(axis=-1)) for x in (line, point))
    line, point = np.where(seen[..., None], line, 0.0), np.where(seen_other[..., None], point, 0.0)
    n_frames = len(uv)
    size = 1 << (2 * n_frames - 1).bit_length()  # no lag wraps around, and transforms are fast
    block = np.equal(np.arange(n_frames) * BLOCKS // n_frames, np.arange(BLOCKS)[:, None])

    def sums(blocks: NDArray[np.bool_]) -> tuple[Array, Array]:
        """(B, size) sums of squared distances, and of samples in common, of each lag; over blocks of a camera."""
        squares, count = np.zeros((2, len(blocks), size // 2 + 1), dtype=complex)
        for m in range(uv.shape[1]):  # one marker's spectra at a time are in memory
            far = rfft(point[:, m, _I].T * point[:, m, _J].T, size)
            near = (_TWICE * line[:, m, _I] * line[:, m, _J]).T
            squares += (rfft(near[:, None] * blocks, size).conj() * far[:, None]).sum(axis=0)
            count += rfft((blocks & seen[:, m]).astype(float), size).conj() * rfft(seen_other[:, m].astype(float), size)
        return irfft(squares, size), irfft(count, size)

    def likeliest(squares: Array, count: Array) -> tuple[int, float]:
        total, n = np.maximum(squares.sum(axis=0), 0.0), np.round(count.sum(axis=0))
        if not n.any():
            return 0, 0.0
        usual = total.sum() / n.sum()
        gain = n / 2 * np.log(usual / np.maximum(total / np.maximum(n, 1), 1e-9 * usual + 1e-300))
        gain[n == 0] = -np.inf
        k = int(np.argmax(gain))
        return (k if k < n_frames else k - size), float(gain[k])

    lag, gain = likeliest(*sums(np.ones((1, n_frames), dtype=bool)))
    if abs(lag) <= 1:  # fractions of a frame are found otherwise
        return lag, 0.5, gain
    squares, count = sums(block)
    half, rest = (likeliest(squares[first::2], count[first::2])[0] for first in (0, 1))
    if abs(half - rest) > 1:  # by chance they agree so in 3 of as many cases as there are lags
        return lag, np.inf, gain
    return lag, float(np.hypot(half - rest, 1 / np.sqrt(3))) / 2, gain


if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

LEAST_FRAMES = 0.1
"""A camera is named from so many frames on. Chosen: of cameras late by 0.3 frames half are found
(docs/experiments/audit_measured.md)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Offsets:
    """How late each camera is.

    Attributes:
        offset_frames: (C,) offsets; row n of camera c shows what happened at frame n + offset. Their mean is 0.
        sd_frames: (C,) standard deviations, from blocks of the recording left out in turn.
        before_px: Root mean square error of the rays as they are.
        after_px: The same with the offsets applied.
        samples: Number of pixels used.
    """

    offset_frames: Array
    sd_frames: Array
    before_px: float
    after_px: float
    samples: int


def estimate_offsets(matrices: Array, ideal_px: Array) -> Offsets | None:
    """The time offsets of the cameras that minimise the triangulation residual of moving markers.

    A pixel of camera c at frame t is that of the marker at t + d_c: uv_c = h_c(x(t)) + d_c h_c'(x) x'(t). Its error
    less what a shift of the marker takes up is linear in d, as is a constant error of each camera, which is fitted with
    it, so that a camera that is off is not taken for one that is late. It begins at the likeliest whole frames
    (``start_offsets``), which may be the whole recording apart. Found offsets are applied to the tracks, and
    what is left is found again. Errors of a recording are slow; deviations come from a jackknife over blocks of time.

    Args:
        matrices: (C, 3, 4) projections.
        ideal_px: (C, T, M, 2) ideal pixels; NaN where not seen.

    Returns:
        The offsets; None where fewer than 50 pixels of moving markers are seen by two cameras, or rays give no points.
    """
    ideal = _window(ideal_px, 3000)  # so many frames in a row, where most is seen and moves
    often = np.isfinite(ideal[..., 0]).sum(axis=1, keepdims=True) >= 4  # as a cubic needs
    ideal = np.where(often[..., None], ideal, np.nan)
    n_cameras = len(ideal)
    delay, _ = start_offsets(matrices, ideal)
    apart = bool(delay.any())
    splines = _splines(ideal) if apart else None
    step = sd = np.zeros(n_cameras)
    before = after = 0.0
    samples = 0
    for turn in range(6):  # offsets are applied, and found again
        if turn == 1 and splines is None:
            splines = _splines(ideal)
        shifted = ideal if splines is None else _shifted(ideal, splines, -delay)
        system = _system(matrices, shifted)
        if system is None:
            return None
        rows, error, block, weight = system
        heavy = rows * weight[:, None]
        cuts = np.searchsorted(block, np.arange(BLOCKS + 1))
        spans = [slice(a, b) for a, b in pairwise(cuts)]
        normal = np.stack([heavy[s].T @ rows[s] for s in spans])
        right = np.stack([heavy[s].T @ error[s] for s in spans])
        if not (np.isfinite(normal).all() and np.isfinite(right).all()):
            return None
        step, best = _solve(normal.sum(axis=0), right.sum(axis=0))
        after = float(np.sqrt(np.average((error - rows @ best) ** 2, weights=weight)))
        samples = int(np.count_nonzero(weight))
        if turn == 0:
            raw = _system(matrices, ideal) if apart else system
            before = np.inf if raw is None else float(np.sqrt(np.average(raw[1] ** 2, weights=raw[3])))
        parts = [_solve(normal.sum(axis=0) - normal[b], right.sum(axis=0) - right[b])[0] for b in range(BLOCKS)]
        spread = np.stack(parts) - np.mean(parts, axis=0)
        sd = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum(spread**2, axis=0))
        delay = delay + step
        if np.abs(step).max() < 0.01 or (turn == 0 and (np.abs(step) < 3 * sd).all()):
            break  # tracks are not read between frames for nothing: that alone smooths them, and lowers every error
    return Offsets(offset_frames=delay - delay.mean(), sd_frames=sd, before_px=before, after_px=after, samples=samples)


def late_cameras(found: Offsets) -> Array:
    """(C,) offsets of the cameras that clearly differ from the median camera; 0 for the others."""
    offset = found.offset_frames - np.median(found.offset_frames)
    return np.where(np.abs(offset) > np.maximum(CLEAR_SD * found.sd_frames, LEAST_FRAMES), offset, 0.0)


def in_step(ideal_px: Array, offset_frames: Array) -> Array:
    """(C, T, M, 2) ideal pixels as if no camera were late: each track is read at t - offset, by a cubic.

    A sample without neighbours within two frames before and after is lost if its camera is shifted.
    """
    return _shifted(ideal_px, _splines(ideal_px), -offset_frames)


def offset_findings(cameras: Sequence[Camera], ideal_px: Array) -> list[Finding]:
    """Offsets clearly larger than their uncertainty; they are reported, and applied only when asked.

    A camera is named where its offset is 4 deviations and a tenth of a frame or more, and where the offsets take away a
    twentieth of the rays' errors or more.
    """
    found = estimate_offsets(stacked(cameras), ideal_px)
    if found is None:
        return []
    names = [c.name for c in cameras]
    numbers = {f"{n}_frames": float(d) for n, d in zip(names, found.offset_frames, strict=True)}
    numbers |= {f"{n}_sd_frames": float(s) for n, s in zip(names, found.sd_frames, strict=True)}
    numbers |= {"before_px": found.before_px, "after_px": found.after_px}
    each = ", ".join(
        f"{n} {d:+.2f} ± {s:.2f}" for n, d, s in zip(names, found.offset_frames, found.sd_frames, strict=True)
    )
    clear = (np.abs(found.offset_frames) > np.maximum(CLEAR_SD * found.sd_frames, LEAST_FRAMES)) & (
        found.after_px < 0.95 * found.before_px  # chosen, not measured
    )
    if not clear.any():
        return [
            Finding(
                kind=Kind.CAMERA_OFFSETS,
                alarm=False,
                text=f"cameras are synchronised: offsets {each} frames",
                numbers=numbers,
            )
        ]
    return [
        alarm(
            kind=Kind.CAMERA_OFFSETS,
            text=f"cameras are not synchronised: offsets {each} frames (RMS triangulation residual "
            f"{found.before_px:.2f} px, with these offsets {found.after_px:.2f} px): not corrected; `correct_lag` does",
            numbers=numbers,
            cameras=tuple(n for n, c in zip(names, clear, strict=True) if c),
        )
    ]


def _window(ideal: Array, most: int) -> Array:
    """The stretch of frames with most pixels seen by two cameras."""
    if ideal.shape[1] <= most:
        return ideal
    shared = (np.isfinite(ideal[..., 0]).sum(axis=0) >= 2).sum(axis=1)
    total = np.concatenate([[0], np.cumsum(shared)])
    start = int(np.argmax(total[most:] - total[:-most]))
    return ideal[:, start : start + most]


def _splines(ideal: Array) -> dict[tuple[int, int], tuple["CubicSpline", NDArray[np.int64]]]:
    """A cubic through each camera's track of each marker, and the frames that it rests on."""
    from scipy.interpolate import CubicSpline

    out = {}
    for c, m in np.ndindex(ideal.shape[0], ideal.shape[2]):
        at = np.flatnonzero(np.isfinite(ideal[c, :, m, 0]))
        if len(at) >= 4:
            out[c, m] = (CubicSpline(at, ideal[c, at, m]), at)
    return out


def _shifted(ideal: Array, splines: dict[tuple[int, int], tuple["CubicSpline", NDArray]], by: Array) -> Array:
    """Tracks read at frame t + by, where samples lie on both sides at most two frames away; untouched where by is 0."""
    out = np.full_like(ideal, np.nan)
    frames = np.arange(ideal.shape[1])
    for (c, m), (spline, at) in splines.items():
        if by[c] == 0:
            out[c, :, m] = ideal[c, :, m]
            continue
        t = frames + by[c]
        after = np.searchsorted(at, t)
        inside = (after > 0) & (after < len(at))
        ok = frames[inside][(at[after[inside]] - at[after[inside] - 1]) <= 2]
        out[c, ok, m] = spline(t[ok])
    return out


def _system(matrices: Array, uv: Array) -> tuple[Array, Array, NDArray[np.int64], Array] | None:
    """Rows (n, C offsets + 2 C constants), errors (n,), block and weight of each, markers' own shifts projected out."""
    xyz = linear(matrices, uv)
    speed = np.full_like(xyz, np.nan)
    speed[1:-1] = (xyz[2:] - xyz[:-2]) / 2
    moving = np.isfinite(speed).all(axis=-1) & np.isfinite(xyz[..., 0])
    if np.count_nonzero(moving) < 25:  # points, of two cameras each: 50 pixels, for 3 unknowns a camera
        return None
    problem = linearise(matrices, uv[:, moving], xyz[moving])
    n_cameras, n_points = problem.seen.shape
    drift = np.einsum("crik,ki->ckr", problem.slope, speed[moving])  # image velocity, px a frame
    own = np.moveaxis(problem.slope, -1, 0).reshape(n_points, 2 * n_cameras, 3)
    normal = np.swapaxes(own, 1, 2) @ own
    normal += 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    hat = own @ np.linalg.solve(normal, np.swapaxes(own, 1, 2))
    seen = np.repeat(problem.seen.T, 2, axis=1)  # (K, 2 C)
    columns = np.zeros((n_points, 2 * n_cameras, 3 * n_cameras))
    for c in range(n_cameras):
        columns[:, 2 * c : 2 * c + 2, c] = drift[c]
        columns[:, 2 * c, n_cameras + 2 * c] = columns[:, 2 * c + 1, n_cameras + 2 * c + 1] = problem.seen[c]
    rows = columns - hat @ columns
    error = problem.error.reshape(2 * n_cameras, n_points).T
    error = error - (hat @ error[..., None])[..., 0]
    block = np.repeat(np.arange(n_points) * BLOCKS // n_points, 2 * n_cameras)
    miss = np.sqrt(np.sum(error**2, axis=1))
    scale = 1.4826 * np.median(miss) + 1e-12
    weight = seen / (1 + (miss / (2 * scale))[:, None] ** 2)
    return rows.reshape(-1, 3 * n_cameras), error.ravel(), block, weight.ravel()


def _solve(normal: Array, right: Array) -> tuple[Array, Array]:
    """Least squares of least norm (a common delay or shift moves nothing): offsets with mean 0, and all unknowns."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-12 * np.diag(normal).max()))
    best = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-7, hermitian=True) @ (right / scale) / scale
    offset = best[: len(best) // 3]
    return offset - offset.mean(), best
