"""Cameras that start whole seconds apart, as phones do: found from the motion of the points themselves."""

from itertools import combinations

import numpy as np
from numpy.fft import irfft, rfft
from numpy.typing import NDArray

from eal.arrays import Array

BLOCKS = 12
"""Stretches of a recording, to see how far results of parts of it differ."""
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
