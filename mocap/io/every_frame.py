"""Recordings that leave out frames in which nothing was seen, with these as frames that show nothing."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.contents import FileContents
from mocap.records import Status

MOST = 50
"""A recording does not become longer than that many times itself."""


def frame_steps(t_s: Array) -> NDArray[np.int64]:
    """(T - 1,) whole numbers of frames between times; empty where no step fits them all to 0.3 of itself.

    The step is the mean of those less than 1.5 times the smallest, then that of all: times may be rounded.
    """
    steps = np.diff(t_s)
    if not len(steps):
        return np.zeros(0, dtype=np.int64)
    step = steps[steps < 1.5 * steps.min()].mean()
    step = steps.sum() / np.maximum(np.rint(steps / step), 1).sum()
    ratio = steps / step
    whole = np.rint(ratio)
    fits = (whole >= 1) & ((np.abs(ratio - whole) <= 0.3) | (ratio > 10))
    return whole.astype(np.int64) if fits.all() else np.zeros(0, dtype=np.int64)


def every_frame(recording: FileContents) -> tuple[FileContents, tuple[str, ...]]:
    """The recording with all frames from first to last, and sentences on what was missing.

    Speeds, delays and lengths of gaps count frames. Where times have no common step they stay as they are.

    Raises:
        FormatError: so many frames are missing that these are no frames of one recording.
    """
    tracks = recording.pixels if recording.pixels is not None else recording.points
    if tracks is None or len(tracks.t_s) < 3:
        return recording, ()
    t_s, whole = tracks.t_s, frame_steps(tracks.t_s)
    if not len(whole):
        steps = np.diff(t_s)
        return recording, (
            f"times are uneven: steps of {steps.min():.4g} to {steps.max():.4g} s without a common divisor; speeds "
            "are computed as if they were even: export at a constant rate",
        )
    if (whole == 1).all():
        return recording, ()
    place = np.concatenate([[0], np.cumsum(whole)])
    total, widest = int(place[-1]) + 1, int(np.argmax(whole))
    before, after = recording.frames[widest : widest + 2]
    if total > MOST * len(t_s):
        raise FormatError(
            f"{recording.paths[0].name}: has {len(t_s)} frames, of {total} by their times (the longest pause is from "
            f"frame {before} to {after}): split it into recordings that were filmed without a pause"
        )

    def spread(values: Array, axis: int) -> Array:
        shape = list(values.shape)
        shape[axis] = total
        out = np.full(shape, np.nan)
        np.moveaxis(out, axis, 0)[place] = np.moveaxis(values, axis, 0)
        return out

    every = np.interp(np.arange(total), place, t_s)
    frames = np.rint(np.interp(np.arange(total), place, recording.frames)).astype(np.int64)
    if (np.diff(frames) < 1).any():
        frames = recording.frames[0] + np.arange(total)
    pixels, points, score = recording.pixels, recording.points, recording.score
    if pixels is not None:
        pixels = replace(pixels, t_s=every, uv_px=spread(pixels.uv_px, 1))
    if points is not None:
        origin = np.full((total, len(points.names)), int(Status.MISSING), dtype=np.int8)
        origin[place] = points.status
        xyz, cov = spread(points.xyz_m, 0), spread(points.cov_m2, 0)
        points = replace(points, t_s=every, xyz_m=xyz, cov_m2=cov, status=origin)
    whole_recording = replace(
        recording,
        frames=frames,
        pixels=pixels,
        points=points,
        score=None if score is None else spread(score, score.ndim - 2),
        tables={name: spread(table, 0) for name, table in recording.tables.items()},
    )
    return whole_recording, (
        f"{total - len(t_s)} of {total} frames are not in the file (most on end between {before} and {after}): they "
        "count as frames in which nothing was seen",
    )
