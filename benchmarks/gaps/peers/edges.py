"""Blending a pose model into what was measured before and after a gap.

A pose model says where a missing marker is, from the markers that are seen in the same frame. At the edges of a gap it
is off by some residual, which changes slowly. The model is therefore asked about a few frames before and after the gap
as well, hiding from it what is hidden just inside, and the residual that shows there is carried into the gap by a
Gaussian process in time: it joins the measured track, and dies with the correlation time. Then the track through the
gap and its edges is smoothed (Whittaker), which holds on to the measured edges and trusts the model only for what is
slower than a cutoff: a gap shorter than its period is bridged by a cubic.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.whittaker import smooth_series
from numpy.typing import NDArray

from benchmarks.gaps.peers.coordinates import Placed
from eal.arrays import Array

EDGE = (0, 1, 2, 3, 5, 8)
"""Frames on each side of a gap, counted from its edge, at which the residual is taken."""


@dataclass(frozen=True)
class Blend:
    """How a model's answer is blended in.

    Attributes:
        length: Correlation time of the residual in frames.
        cutoff: Of the smoothing, in cycles a frame; None: no smoothing.
    """

    length: float = 20.0
    cutoff: float | None = 0.05


BLENDS = (
    *(Blend(length, cutoff) for length in (10.0, 40.0) for cutoff in (0.07, 0.02)),
    Blend(40.0, 0.006),
    Blend(10.0, None),
)
"""To choose from."""

HOLD = 1e4
"""Weight of a measured sample beside one of the model."""

Predict = Callable[[Array, NDArray[np.int64], NDArray[np.bool_]], tuple[Array, Array | None]]
"""(T, M, 3) positions with NaN, (N,) frames and (N, M) markers that may be looked at there, to complete poses (N, M, 3)
and the covariance (N, M, 3, 3) of the positions, None where the model has none."""


@dataclass(frozen=True)
class Gap:
    """Frames ``start`` to ``stop`` - 1 in which ``marker`` is not seen, and the edge frames asked on either side."""

    marker: int
    start: int
    stop: int
    before: tuple[int, ...]
    after: tuple[int, ...]


def gaps(seen: NDArray[np.bool_]) -> list[Gap]:
    """All gaps of (T, M) sightings, those at the ends of the trial included."""
    found = []
    for marker in range(seen.shape[1]):
        there = seen[:, marker]
        change = np.flatnonzero(np.diff(np.r_[True, there, True].astype(int)))
        for start, stop in zip(change[::2], change[1::2], strict=True):
            before = tuple(int(start - 1 - k) for k in EDGE if start - 1 - k >= 0 and there[start - 1 - k])
            after = tuple(int(stop + k) for k in EDGE if stop + k < len(seen) and there[stop + k])
            found.append(Gap(marker, int(start), int(stop), before, after))
    return found


def matern(distance: Array, length: float) -> Array:
    """Matern kernel of smoothness 3/2 (Rasmussen & Williams 2006, equation 4.17)."""
    scaled = np.sqrt(3) * np.abs(distance) / length
    return (1 + scaled) * np.exp(-scaled)


def carry(frames: Array, residual: Array, inside: Array, *, length: float, noise: float) -> tuple[Array, Array]:
    """Posterior mean (N, 3) and share of variance left (N,) of a residual inside a gap.

    Args:
        frames: (E,) edge frames.
        residual: (E, 3) residual there.
        inside: (N,) frames of the gap.
        length: Correlation time in frames.
        noise: Variance of a residual's noise over its own variance.
    """
    own = matern(frames[:, None] - frames, length) + noise * np.eye(len(frames))
    cross = matern(inside[:, None] - frames, length)
    weights = np.linalg.solve(own, cross.T).T
    return weights @ residual, np.clip(1 - np.sum(weights * cross, axis=1), 0.0, 1.0)


def shown(y: Array, frames: NDArray[np.int64], masks: NDArray[np.bool_]) -> Array:
    """(N, 3 M) poses of some frames, NaN where a mask (N, M) hides them."""
    return np.where(masks[..., None], y[frames], np.nan).reshape(len(frames), -1)


def fill_blended(placed: Placed, predict: Predict, blend: Blend, *, then: Predict | None = None) -> tuple[Array, Array]:
    """Fill all gaps of a trial with a pose model, blended at the edges.

    Markers come and go while another is missing, and the model would jump with them. So it is asked twice: first frame
    by frame with what the frame shows, then, gap by gap, with those markers that are seen in at least half of the gap,
    completed by the first answer.

    Args:
        placed: The trial.
        predict: The pose model.
        blend: How its answer is blended in.
        then: Another model for the second question; None: the same.

    Returns:
        (T, M, 3) positions, measured ones as they are, and covariances (T, M, 3, 3) of a measurement
        (of the noise alone, where the model has none).
    """
    seen = np.isfinite(placed.y[..., 0])
    found = gaps(seen)
    if not found:
        return placed.y.copy(), _noise(placed)
    y, spread = _pass(placed, placed.y, found, [None] * len(found), predict, blend)
    mostly = _mostly(seen, found)
    if then is None and all((m == seen[g.start : g.stop]).all() for g, m in zip(found, mostly, strict=True)):
        return y, spread
    return _pass(placed, y, found, mostly, then or predict, blend)


def refill(placed: Placed, values: Array, predict: Predict, blend: Blend) -> tuple[Array, Array]:
    """The second question of ``fill_blended`` alone, with another answer (T, M, 3) to the first."""
    seen = np.isfinite(placed.y[..., 0])
    found = gaps(seen)
    if not found:
        return placed.y.copy(), _noise(placed)
    return _pass(placed, values, found, _mostly(seen, found), predict, blend)


def _mostly(seen: NDArray[np.bool_], found: Sequence[Gap]) -> list[NDArray[np.bool_]]:
    """Of each gap the markers (M,) that are seen in at least half of its frames."""
    count = np.cumsum(np.vstack([np.zeros((1, seen.shape[1]), dtype=int), seen]), axis=0)
    return [2 * (count[g.stop] - count[g.start]) >= g.stop - g.start for g in found]


def _pass(
    placed: Placed,
    values: Array,
    found: Sequence[Gap],
    allowed: Sequence[NDArray[np.bool_] | None],
    predict: Predict,
    blend: Blend,
) -> tuple[Array, Array]:
    """Fill each gap from ``values``, looking at its allowed markers; None: at those that each frame shows."""
    seen = np.isfinite(placed.y[..., 0])
    questions: dict[tuple[int, bytes], int] = {}
    frames, masks = [], []

    def ask(frame: int, mask: NDArray[np.bool_]) -> int:
        key = (frame, mask.tobytes())
        if key not in questions:
            questions[key] = len(frames)
            frames.append(frame)
            masks.append(mask)
        return questions[key]

    def asked(span: Sequence[int], inside: int, mask: NDArray[np.bool_] | None) -> list[int]:
        return [ask(f, seen[f] & seen[inside] if mask is None else mask) for f in span]

    rows = [
        asked(range(g.start, g.stop), g.start, m)
        if m is not None
        else [ask(f, seen[f]) for f in range(g.start, g.stop)]
        for g, m in zip(found, allowed, strict=True)
    ]
    edges = [asked(g.before, g.start, m) + asked(g.after, g.stop - 1, m) for g, m in zip(found, allowed, strict=True)]
    mean, cov = predict(values, np.array(frames), np.array(masks))
    y, spread = placed.y.copy(), _noise(placed)
    for gap, inside, edge in zip(found, rows, edges, strict=True):
        m, span = gap.marker, np.arange(gap.start, gap.stop)
        y[span, m] = mean[inside, m]
        share = np.ones(len(span))
        if edge:
            at = np.array(gap.before + gap.after)
            residual = placed.y[at, m] - mean[edge, m]
            variance = np.mean(residual**2)
            if cov is not None:
                variance = max(variance, np.trace(cov[edge, m], axis1=-2, axis2=-1).mean() / 3)
            ratio = placed.trial.sd_m[m] ** 2 / max(float(variance), 1e-12) + 1e-9
            shift, share = carry(at * 1.0, residual, span * 1.0, length=blend.length, noise=ratio)
            y[span, m] += shift
        if edge and blend.cutoff is not None:
            y[span, m] = _smoothed(y[:, m], seen[:, m], gap, blend.cutoff)
        if cov is not None:
            spread[span, m] += share[:, None, None] * cov[inside, m]
    return y, spread


def _smoothed(track: Array, seen: NDArray[np.bool_], gap: Gap, cutoff: float) -> Array:
    """(N, 3) a gap of a track (T, 3) that is filled there, smoothed with the measured samples near it held."""
    window = slice(max(0, gap.start - 10), gap.stop + 10)
    inside = np.zeros(len(track), dtype=bool)
    inside[gap.start : gap.stop] = True
    weight = np.where(seen, HOLD, inside * 1.0)[window]
    return smooth_series(track[window], weight, dt_s=1.0, cutoff_hz=cutoff)[inside[window]]


def _noise(placed: Placed) -> Array:
    """(T, M, 3, 3) covariance of a measurement."""
    return np.repeat((placed.trial.sd_m**2)[None, :, None, None] * np.eye(3), len(placed.y), axis=0)
