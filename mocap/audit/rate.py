"""Whether a frame rate can be that of the camera: what a file states, and how fast the animal then moves."""

from math import isfinite, pi, sqrt

import numpy as np

from eal.arrays import Array, true_runs
from mocap.findings import Finding, Kind
from mocap.io.unstated_unit import length, length_text

PLAYED_HZ = (12.0, 62.0)
"""Videos of fast cameras are played at such rates: 15, 23.976, 24, 25, 29.97, 30, 50, 60 frames a second."""
PERIODIC = 0.4
"""Correlation of a distance with itself a cycle later, from which it is periodic: 0.6 to 0.9 of the shared flights."""
SLOW = 0.5
"""Limbs that move in cycles at less than so many times the frequency of a pendulum as long as the animal move more
slowly than animals of that size do: walking people 2.4, lizards 1.5 and more, the bats of the shared flights 8; a
bat's flight that is played at 25 frames a second 0.36."""
G_M_S2 = 9.81


def rate_findings(xyz_m: Array | None, fps: float, *, playback: bool, in_file: float | None = None) -> list[Finding]:
    """What speaks against a frame rate.

    An alarm where the motion contradicts a rate that may be that of playback; else the odd number is told.

    Args:
        xyz_m: (T, M, 3) positions; None: in the plane of an image, whose motion tells nothing.
        fps: Frames a second that are used.
        playback: Whether a file states them, of a program that may state the rate at which a video is played.
        in_file: What a file states, where the user states ``fps``; None: nothing.
    """
    if in_file is not None and abs(in_file / fps - 1) > 0.02:
        text = f"{fps:g} frames a second, as stated; the file states {in_file:g}"
        return [Finding(kind=Kind.FRAME_RATE, text=text, numbers={"fps": fps, "in_file": in_file})]
    if not playback or not PLAYED_HZ[0] <= fps <= PLAYED_HZ[1]:
        return []
    text = f"the file states {fps:g} frames a second, which may be the rate at which the video is played"
    long, cycle = (np.nan, np.nan) if xyz_m is None else (length(xyz_m), cycle_frames(xyz_m))
    if xyz_m is None or not (isfinite(cycle) and long > 0):
        return [_odd(f"{text}: state `fps`, that of the camera", fps=fps)]
    beat, swing = fps / cycle, sqrt(G_M_S2 / long) / (2 * pi)
    speed = _speed(xyz_m) * fps / long
    moves = f"{speed:.2g} body lengths a second, {beat:.2g} cycles of its limbs a second"
    if beat >= SLOW * swing:
        return [_odd(f"{text} ({moves}): state `fps`, that of the camera, if it is another", fps=fps)]
    return [
        Finding(
            kind=Kind.FRAME_RATE,
            alarm=True,
            text=f"{text}. At it an animal {length_text(long)} long moves {moves}, where a pendulum of its length "
            f"swings {swing:.2g} times: too slow, and all speeds with it: state `fps`, that of the camera",
            numbers={"fps": fps, "cycles_hz": beat, "pendulum_hz": swing, "lengths_a_second": speed},
        )
    ]


def _odd(text: str, **numbers: float) -> Finding:
    return Finding(kind=Kind.FRAME_RATE, text=text, numbers=numbers, mends=("fps",))


def _speed(xyz_m: Array) -> float:
    """Median way from frame to frame of the middle of all markers, by the median of theirs."""
    steps = np.diff(xyz_m, axis=0)
    shown = np.isfinite(steps[..., 0]).sum(axis=1) >= 2
    return float(np.median(np.linalg.norm(np.nanmedian(steps[shown], axis=1), axis=-1))) if shown.any() else np.nan


def cycle_frames(xyz_m: Array, *, most: int = 20) -> float:
    """Frames of a cycle of the limbs; NaN: no motion in cycles shows.

    The first peak of the autocorrelation of the distances between markers that change most, gaps left out; these must
    agree on it.

    Args:
        xyz_m: (T, M, 3) positions, NaN where not seen; of long recordings the first 4000 frames are looked at.
        most: Number of distances.
    """
    xyz = xyz_m[:4000]
    seen = np.isfinite(xyz[..., 0])
    often = np.argsort(-seen.sum(axis=0))[:30]  # of many markers those seen most
    changing: list[tuple[float, Array]] = []
    for k, i in enumerate(often):
        for j in often[:k]:
            both = seen[:, i] & seen[:, j]
            if both.sum() >= 30:
                apart = np.where(both, np.linalg.norm(xyz[:, i] - xyz[:, j], axis=-1), np.nan)
                changing.append((float(np.nanstd(apart) * sqrt(both.sum())), apart))
    changing.sort(key=lambda one: -one[0])
    lags = [lag for _, apart in changing[:most] if (lag := _first_peak(apart)) is not None]
    if len(lags) < max(3, min(most, len(changing)) / 2):
        return np.nan
    low, middle, high = np.quantile(lags, [0.25, 0.5, 0.75])
    return float(middle) if high <= 1.25 * low else np.nan


def _first_peak(values: Array) -> int | None:
    """The lag in frames at which a series with gaps is like itself again; None: it is not."""
    there = np.flatnonzero(np.isfinite(values))
    values = values[there[0] : there[-1] + 1]
    known = np.isfinite(values)
    off, size = np.where(known, values - np.nanmean(values), 0.0), 2 * len(values)
    products, pairs = (
        np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: len(values)] for x in (off, known.astype(float))
    )
    enough = pairs > max(10.0, 0.2 * known.sum())
    alike = np.where(enough, products / np.maximum(pairs, 1.0) / np.mean(off[known] ** 2), np.nan)
    left = np.flatnonzero(alike < 0)
    after = alike[left[0] : len(values) // 2] if len(left) else alike[:0]
    if not np.isfinite(after).any():
        return None
    # the shortest that is nearly as good as the best, which may be several cycles
    good = (after >= 0.8 * np.nanmax(after)) & (after > PERIODIC)
    first, stop = next(iter(true_runs(good)), (0, 0))
    return int(left[0] + first + np.nanargmax(after[first:stop])) if stop else None
