"""What a human digitiser makes of the images: noise with a heavy tail, lost, mis-clicked and swapped markers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Digitiser:
    """How well markers are digitised. The defaults are the heavy tail of human digitisers: SD twice the core.

    Attributes:
        core_px: Standard deviation of a careful click.
        tail_px: Standard deviation of a careless click.
        tail_share: Share of careless clicks.
        miss_share: Share of visible markers that are not clicked, one by one.
        bursts_per_s: Rate at which a marker is lost from most or all cameras for a while.
        burst_frames: Shortest and longest such loss; lengths are log-uniform between them.
        camera_bursts_per_s: Rate at which a marker is lost from one camera alone for a while.
        camera_burst_frames: Shortest and longest such loss.
        grazing_rad: A marker on a membrane is not clicked where the ray meets it at less than this angle.
        misclick_share: Share of clicks that land elsewhere.
        misclick_px: Least and greatest distance of those.
        swap_share: Share of clicks exchanged with those of the nearest other marker in the image.
        lasting_px: Standard deviation of errors that last, as a network's do: of each marker in each camera.
        lasting_frames: Shortest and longest time in which these lose all but 1/e of their correlation; log-uniform.
    """

    core_px: float = 0.6
    tail_px: float = 3.34
    tail_share: float = 0.1
    miss_share: float = 0.02
    bursts_per_s: float = 1.4
    burst_frames: tuple[int, int] = (5, 60)
    camera_bursts_per_s: float = 0.0
    camera_burst_frames: tuple[int, int] = (2, 60)
    grazing_rad: float = 0.0
    misclick_share: float = 0.0025
    misclick_px: tuple[float, float] = (20.0, 80.0)
    swap_share: float = 0.0005
    lasting_px: float = 0.0
    lasting_frames: tuple[float, float] = (10.0, 60.0)

    @property
    def sd_px(self) -> float:
        """Standard deviation of a click that is not an outlier, without errors that last."""
        return float(np.sqrt((1 - self.tail_share) * self.core_px**2 + self.tail_share * self.tail_px**2))


PERFECT = Digitiser(core_px=0, tail_px=0, tail_share=0, miss_share=0, bursts_per_s=0, misclick_share=0, swap_share=0)


WIND_TUNNEL = Digitiser(
    miss_share=0.0,
    bursts_per_s=0.7,
    burst_frames=(2, 60),
    camera_bursts_per_s=3.0,
    grazing_rad=float(np.deg2rad(8.0)),
)
"""As three flights of a real bat were clicked at 700 Hz (``docs/experiments/simulated_animals.md`` says how near)."""


def click_noise(rng: np.random.Generator, shape: tuple[int, ...], digitiser: Digitiser) -> Array:
    """(*shape, 2) errors in pixels: normal, of the core or (one click in ``1 / tail_share``) of the tail width."""
    careless = rng.random(shape) < digitiser.tail_share
    width = np.where(careless, digitiser.tail_px, digitiser.core_px)
    return width[..., None] * rng.standard_normal((*shape, 2))


def lasting_errors(rng: np.random.Generator, shape: tuple[int, int, int], digitiser: Digitiser) -> Array:
    """(C, T, M, 2) errors in pixels that last: autoregressive of the first order, begun at their usual size."""
    n_cameras, n_frames, n_markers = shape
    errors = np.zeros((*shape, 2))
    if digitiser.lasting_px == 0:
        return errors  # and draw nothing: recordings of a seed stay what they are
    from scipy.signal import lfilter

    for camera, marker in np.ndindex(n_cameras, n_markers):
        kept = np.exp(-1 / np.exp(rng.uniform(*np.log(digitiser.lasting_frames))))
        kicks = rng.standard_normal((n_frames, 2)) * np.sqrt(1 - kept**2)
        kicks[0] /= np.sqrt(1 - kept**2)
        series = np.asarray(lfilter([1.0], [1.0, -kept], kicks, axis=0))
        errors[camera, :, marker] = digitiser.lasting_px * series
    return errors


def lost(
    rng: np.random.Generator,
    shape: tuple[int, int, int],
    digitiser: Digitiser,
    *,
    fps: float,
    neighbours: Sequence[tuple[int, int]],
    clusters: Sequence[Sequence[int]],
) -> NDArray[np.bool_]:
    """Markers that are visible but not digitised.

    Losses come in bursts: 60 % of one marker, 25 % of two neighbours, 15 % of a cluster. Two in three bursts are in
    all cameras, the others in each camera with probability 0.75.

    Args:
        rng: Source of chance.
        shape: (C, T, M).
        digitiser: Rates and lengths.
        fps: Frames a second.
        neighbours: Pairs of marker indices, at least one.
        clusters: Sets of marker indices, at least one.

    Returns:
        (C, T, M) True where lost.
    """
    n_cameras, n_frames, n_markers = shape
    missing = rng.random(shape) < digitiser.miss_share
    mean_size = 0.6 + 0.25 * 2 + 0.15 * np.mean([len(c) for c in clusters])
    expected = digitiser.bursts_per_s * n_frames / fps * n_markers / mean_size
    for _ in range(rng.poisson(expected)):
        kind = rng.random()
        if kind < 0.6:
            markers = [int(rng.integers(n_markers))]
        else:
            groups = neighbours if kind < 0.85 else clusters
            markers = list(groups[int(rng.integers(len(groups)))])
        frames = _burst(rng, digitiser.burst_frames, n_frames)
        blind = np.ones(n_cameras, dtype=bool) if rng.random() < 2 / 3 else rng.random(n_cameras) < 0.75
        for marker in markers:
            missing[blind, frames, marker] = True
    if digitiser.camera_bursts_per_s > 0:
        for _ in range(rng.poisson(digitiser.camera_bursts_per_s * missing.size / fps)):
            frames = _burst(rng, digitiser.camera_burst_frames, n_frames)
            missing[rng.integers(n_cameras), frames, rng.integers(n_markers)] = True
    return missing


def _burst(rng: np.random.Generator, lengths: tuple[int, int], n_frames: int) -> slice:
    """Frames of a loss, of a length between two, evenly by its logarithm; it may have begun before the first."""
    length = round(np.exp(rng.uniform(*np.log(lengths))))
    start = int(rng.integers(-length, n_frames))
    return slice(max(start, 0), start + length)


def misplace(rng: np.random.Generator, uv_px: Array, digitiser: Digitiser) -> tuple[Array, NDArray[np.bool_]]:
    """Mis-click some markers and swap some others.

    Args:
        rng: Source of chance.
        uv_px: (C, T, M, 2) pixels; NaN where not seen.
        digitiser: Shares and distances.

    Returns:
        (C, T, M, 2) pixels with outliers, and (C, T, M) True where they are.
    """
    uv_px = uv_px.copy()
    seen = ~np.isnan(uv_px[..., 0])
    outlier = seen & (rng.random(seen.shape) < digitiser.misclick_share)
    n_outliers = int(outlier.sum())
    angle, distance = rng.uniform(0, 2 * np.pi, n_outliers), rng.uniform(*digitiser.misclick_px, n_outliers)
    uv_px[outlier] += distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    # a swap spoils two clicks
    for c, t, m in np.argwhere(seen & (rng.random(seen.shape) < digitiser.swap_share / 2)):
        away = np.linalg.norm(uv_px[c, t] - uv_px[c, t, m], axis=-1)
        away[outlier[c, t] | ~seen[c, t]] = np.inf
        away[m] = np.inf
        other = int(np.argmin(away))
        if outlier[c, t, m] or not np.isfinite(away[other]):
            continue
        uv_px[c, t, [m, other]] = uv_px[c, t, [other, m]]
        outlier[c, t, [m, other]] = True
    return uv_px, outlier
