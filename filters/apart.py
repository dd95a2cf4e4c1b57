"""Markers that move independently of each other: filtered and smoothed side by side, at a cost that is linear in them.

The state of a model such as constant velocity falls into one block [position (3), velocity (3)] a marker: no dynamics,
no noise and no observation joins two of them, so that the covariance of all is zero between markers at all times. What
``track`` does with one matrix of size 6M is done here with M matrices of size 6 (9 with accelerations), and
gives the same numbers to rounding.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from mocap.filters.moving import EVERY, Rates, between
from mocap.filters.observations import Observations, Sights
from mocap.filters.observe import Observed, gate_groups, unused
from mocap.filters.records import Estimate
from mocap.filters.velocities import Asked
from numpy.typing import NDArray

from eal.arrays import Array

Progress = Callable[[float], None]


class MarkersApart(Protocol):
    """A linear model whose state is [position (3), velocity (3), ...] of each of M markers, independent of each other.

    The state of a marker has n components: 6, or 9 with accelerations.
    """

    def starts(self) -> tuple[Array, Array]:
        """Mean (M, n), and lower factor (M, n, n) of the covariance, before anything is seen."""
        ...

    def steps(self, dt_s: float) -> tuple[Array, Array]:
        """Transition (n, n) of every marker, and covariance (M, n, n) of the process noise of one step."""
        ...


@dataclass(frozen=True, eq=False)
class _Block:
    """Filtered frames.

    Attributes:
        mean: (T, M, n) filtered means.
        factor: (T, M, n, n) lower factors of the filtered covariances.
        ahead: (T, M, n) predictions of the frames.
        ahead_factor: (T, M, n, n) lower factors of these; the first frame of a recording has none (zeros).
        observed: What was seen.
    """

    mean: Array
    factor: Array
    ahead: Array
    ahead_factor: Array
    observed: list[Observed]


def smooth_apart(
    model: MarkersApart,
    observations: Observations,
    t_s: Array,
    *,
    gate_sd: float = 6.0,
    most_bytes: float = 1e9,
    asked: Asked | None = None,
    progress: Progress | None = None,
) -> Estimate:
    """Filter and smooth; arguments and result as in ``mocap.filters.track.smooth``.

    Smoothing back x(t) = m + K (x(t+1) - F m) + r, K = P F' (P-)^-1, the smoothed covariance is the sum of squares
    D D' + K Q K' + K Ps K' with D = (1 - K F) L (Rauch, Tung & Striebel 1965, in the form of Joseph).

    Memory for states is at most ``most_bytes``: a longer recording is filtered in blocks, of which the state before
    each is kept, and all blocks but the last are filtered once more on the way back.
    """
    n_frames, (mean, factor) = observations.n_frames, model.starts()
    count, size = mean.shape
    length = max(2, int(most_bytes / (8 * count * (2 * size**2 + 2 * size + 3 * 36))))
    blocks = [range(max(0, stop - length), stop) for stop in range(n_frames, 0, -length)][::-1]
    before, observed, block = [(mean, factor)], [], None
    for frames in blocks:
        tell = None if progress is None else (lambda frame: progress(0.5 * frame / n_frames))
        block = _filter(model, observations, t_s, frames, before[-1], gate_sd, keep=frames is blocks[-1], tell=tell)
        before.append((block.mean[-1], block.factor[-1]))
        observed.extend(block.observed)
    xyz, cov = np.empty((n_frames, count, 3)), np.empty((n_frames, count, 3, 3))
    keeper = None if asked is None else _Keeper(asked, count, n_frames)
    later = None
    for i in range(len(blocks) - 1, -1, -1):
        if block is None or i < len(blocks) - 1:
            block = _filter(model, observations, t_s, blocks[i], before[i], gate_sd, keep=True, tell=None)
        later = _back(model, t_s, blocks[i], block, later, xyz, cov, keeper)
        if progress is not None:
            progress(1 - 0.5 * blocks[i].start / n_frames)
    rates = None if keeper is None else keeper.rates()
    return Estimate(xyz_m=xyz, cov_m2=cov, observed=observed, rates=rates)


def _filter(
    model: MarkersApart,
    observations: Observations,
    t_s: Array,
    frames: range,
    before: tuple[Array, Array],
    gate_sd: float,
    *,
    keep: bool,
    tell: Callable[[int], None] | None,
) -> _Block:
    """Filter frames from the state before them; without ``keep`` only the last state is kept."""
    mean, factor = before
    size = len(frames) if keep else 1
    means, factors = np.empty((size, *mean.shape)), np.empty((size, *factor.shape))
    ahead, ahead_factor = np.zeros_like(means), np.zeros_like(factors)
    observed, known = [], {}
    for i, frame in enumerate(frames):
        k = i if keep else 0
        if frame:
            dt = round(float(t_s[frame] - t_s[frame - 1]), 12)
            if dt not in known:
                known[dt] = model.steps(dt)
            move, noise = known[dt]
            mean, moved = mean @ move.T, move @ factor
            factor = np.linalg.cholesky(moved @ np.swapaxes(moved, 1, 2) + noise)
            ahead[k], ahead_factor[k] = mean, factor
        mean, factor, seen = _observe(mean, factor, observations, frame, gate_sd)
        means[k], factors[k] = mean, factor
        observed.append(seen)
        if tell is not None:
            tell(frame)
    return _Block(means, factors, ahead, ahead_factor, observed)


def _observe(
    mean: Array, factor: Array, observations: Observations, frame: int, gate_sd: float, *, rounds: int = 3
) -> tuple[Array, Array, Observed]:
    """Condition each marker on what a frame shows of it: ``mocap.filters.observe.observe``, by marker."""
    lower = factor[:, :3, :3]
    cov = lower @ np.swapaxes(lower, 1, 2)
    sights = observations.sights(frame, mean[:, :3], cov)
    marker = sights.where[:, 1]
    if not len(marker):
        return mean, factor, unused(sights)
    white, y = sights.slope / sights.sd[..., None], sights.innovation / sights.sd
    predicted = 1 + np.sum((white @ cov[marker]) * white, axis=2)
    far = (np.abs(y) > gate_sd * np.sqrt(predicted)).any(axis=1)
    used = gate_groups(np.sum(y**2 / predicted, axis=1), far, sights.where, sights.apart)
    if not used.any():
        return mean, factor, unused(sights)
    weight = used.astype(float)
    heavy = used & np.isfinite(sights.dof) & (rounds > 0)
    freedom = sights.dof[heavy] + sights.size[heavy]
    for _ in range(rounds if heavy.any() else 0):
        inverse, solved, _, _ = _posterior(white, y, weight, marker, lower)
        shift = np.einsum("mij,mj->mi", lower, solved)
        miss = y - np.einsum("gri,gi->gr", white, shift[marker])
        rows = white @ (lower @ np.swapaxes(inverse, 1, 2))[marker]
        squared = np.sum(miss**2, axis=1) + np.sum(rows**2, axis=(1, 2))
        weight[heavy] = freedom / (sights.dof[heavy] + squared[heavy])
    information = np.ones(len(used))
    information[heavy] = freedom / (freedom + 2)
    weight *= information
    inverse, solved, explained, log_det = _posterior(white, y, weight, marker, lower)
    factor = factor.copy()
    mean = mean + np.einsum("mij,mj->mi", factor[:, :, :3], solved)
    factor[:, :, :3] = factor[:, :, :3] @ np.swapaxes(inverse, 1, 2)
    return mean, factor, _seen(sights, y, used, weight, information, explained, log_det)


def _posterior(
    white: Array, y: Array, weight: Array, marker: NDArray[np.int64], lower: Array
) -> tuple[Array, Array, float, float]:
    """With C = 1 + L' J L = U U' of each marker: U^-1, C^-1 L' j, sum |U^-1 L' j|^2, and log det of all C.

    J = sum w W' W and j = sum w W' y are over the rows W of a marker with the innovations y and weights w.
    """
    scaled = weight[:, None, None] * white
    both = np.zeros((len(lower), 3, 4))
    np.add.at(both, marker, np.swapaxes(scaled, 1, 2) @ np.concatenate([white, y[..., None]], axis=2))
    turned = np.swapaxes(lower, 1, 2)
    c = np.eye(3) + turned @ both[..., :3] @ lower
    upper = np.linalg.cholesky(c[:, ::-1, ::-1])[:, ::-1, ::-1]
    inverse = np.linalg.inv(upper)
    w = np.einsum("mij,mjk,mk->mi", inverse, turned, both[..., 3])
    solved = np.einsum("mji,mj->mi", inverse, w)
    return inverse, solved, float(np.sum(w**2)), 2 * float(np.log(np.einsum("mii->mi", upper)).sum())


def _seen(
    sights: Sights,
    y: Array,
    used: NDArray[np.bool_],
    weight: Array,
    information: Array,
    explained: float,
    log_det: float,
) -> Observed:
    """The same numbers as ``mocap.filters.observe.observe`` gives."""
    n_rows = int(sights.size[used].sum())
    nis = float(np.sum(weight[:, None] * y**2)) - explained
    log_sd = np.log(sights.sd[used]).sum() - 0.5 * (sights.size[used] * np.log(weight[used])).sum()
    log_likelihood = -0.5 * (n_rows * np.log(2 * np.pi) + 2 * log_sd + log_det + nis)
    nis *= n_rows / float(sights.size[used] @ information[used])
    return Observed(sights.where, sights.innovation, weight, nis, n_rows, float(log_likelihood))


def _back(
    model: MarkersApart,
    t_s: Array,
    frames: range,
    block: _Block,
    later: "_Later | None",
    xyz: Array,
    cov: Array,
    keeper: "_Keeper | None",
) -> "_Later":
    """Smooth a block, from what was smoothed after it; positions are written into ``xyz`` and ``cov``."""
    known = {}
    for i in range(len(frames) - 1, -1, -1):
        frame = frames[i]
        mean, factor = block.mean[i], block.factor[i]
        gain = left = np.zeros(())
        if later is None:
            smoothed, spread = mean, factor @ np.swapaxes(factor, 1, 2)
        else:
            dt = round(float(t_s[frame + 1] - t_s[frame]), 12)
            if dt not in known:
                known[dt] = model.steps(dt)
            move, noise = known[dt]
            moved = move @ factor
            half = np.linalg.solve(later.ahead_factor, moved)
            gain = np.swapaxes(np.linalg.solve(np.swapaxes(later.ahead_factor, 1, 2), half), 1, 2)
            gain = factor @ gain
            rest = factor - gain @ moved
            left = rest @ np.swapaxes(rest, 1, 2) + gain @ noise @ np.swapaxes(gain, 1, 2)
            smoothed = mean + np.einsum("mij,mj->mi", gain, later.mean - later.ahead)
            spread = left + gain @ later.cov @ np.swapaxes(gain, 1, 2)
        xyz[frame], cov[frame] = smoothed[:, :3], spread[:, :3, :3]
        if keeper is not None:
            keeper.take(frame, smoothed, spread, gain, left, later)
        later = _Later(smoothed, spread, block.ahead[i], block.ahead_factor[i], gain, left, later)
        if later.after is not None and later.after.after is not None:
            later.after.after.after = None  # two frames are looked back on
    if later is None:
        raise ValueError("a block has at least one frame")
    return later


@dataclass(eq=False)
class _Later:
    """A smoothed frame: mean, covariance, the prediction of it, its gain to the next and what that leaves."""

    mean: Array
    cov: Array
    ahead: Array
    ahead_factor: Array
    gain: Array
    left: Array
    after: "_Later | None"


class _Keeper:
    """Velocities and joint covariances, as ``moving.RateKeeper`` keeps them of states that are not apart."""

    def __init__(self, asked: Asked, count: int, n_frames: int) -> None:
        """Room for all frames."""
        self.asked, self._weights = asked, asked.all_weights
        points = len(self._weights)
        self._pairs = np.array(asked.pairs, dtype=np.int64).reshape(-1, 2)
        self._shared = self._weights[self._pairs[:, 0]] * self._weights[self._pairs[:, 1]]
        self._velocity = np.empty((n_frames, points, 3))
        self._own = np.empty((n_frames, points, 6, 6), dtype=np.float32)
        self._cross = np.empty((n_frames, len(self._pairs), 6, 6), dtype=np.float32)
        self._kept: dict[int, Array] = {}
        self._count = count

    def take(self, frame: int, mean: Array, cov: Array, gain: Array, left: Array, later: "_Later | None") -> None:
        """One frame, after the one that follows it."""
        weights = self._weights
        flat = cov[:, :6, :6].reshape(self._count, 36)
        self._velocity[frame] = weights @ mean[:, 3:6]
        self._own[frame] = (weights**2 @ flat).reshape(-1, 6, 6)
        self._cross[frame] = (self._shared @ flat).reshape(-1, 6, 6)
        if frame % EVERY == 0 and later is not None and later.after is not None:
            # x(t) = K x(t+1) + r, x(t+1) = K' x(t+2) + r': of v(t+2) - v(t) with x(t+2), r and r' independent
            last = later.after
            speed = slice(3, 6)
            hold = gain[:, speed] @ later.gain
            change = np.eye(mean.shape[1])[speed] - hold
            variance = np.einsum("mii->mi", left)[:, speed] + np.einsum(
                "mij,mjk,mik->mi", gain[:, speed], later.left, gain[:, speed]
            )
            variance = variance + np.einsum("mij,mjk,mik->mi", change, last.cov, change)
            both = np.einsum("mii->mi", cov)[:, speed] + np.einsum("mii->mi", last.cov)[:, speed]
            share = (weights**2 @ variance) / np.maximum(weights**2 @ both, 1e-300)
            self._kept[frame + 1] = np.clip(share, 0.0, 2.0)

    def rates(self) -> Rates:
        """All frames."""
        shape = self._velocity.shape
        kept = between(self._kept, shape)
        return Rates(asked=self.asked, velocity_m_s=self._velocity, own=self._own, cross=self._cross, kept=kept)
