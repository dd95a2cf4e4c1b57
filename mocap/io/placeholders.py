"""Numbers that stand for a missing sample: (0, 0, 0), and others outside everything else that was recorded."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.io.contents import FileContents
from mocap.records import Status

EXPLICIT = ("csv-wide", "csv-long", "parquet", "movement")
"""Formats of ours, in which a missing sample is empty and every other has its origin: there zero is a place."""
AROUND = 3
"""Steps before and after a sample that tell how its marker moves there."""
FASTER = 2.0
"""A marker's step may be longer than those around it by that factor."""
OUTSIDE = 0.1
"""Other numbers than zero lie beyond the range of all others by more than that share of it."""
NAMED = 8
"""Markers that a finding names."""


def without_placeholders(recording: FileContents) -> FileContents:
    """The recording, as its format reads it, with placeholders as missing samples, counted and named.

    Zeros stay where their marker moves through them, and where cameras measured them throughout (a marker at the origin
    whose samples have residuals above 0). A marker that is at zero in all of its samples was never seen: noise leaves
    no measured marker there, not even one that lies still.
    """
    points, pixels, told = recording.points, recording.pixels, []
    if recording.format in EXPLICIT:
        return recording
    if points is not None:
        residual = recording.tables.get("residual_m")
        lost = placeholders(points.xyz_m, None if residual is None else residual > 0)
        if lost.any():
            told += _told(points.xyz_m, lost, recording, "")
            points = replace(
                points,
                xyz_m=np.where(lost[..., None], np.nan, points.xyz_m),
                cov_m2=np.where(lost[..., None, None], np.nan, points.cov_m2),
                status=np.where(lost, Status.MISSING, points.status),
            )
    if pixels is not None:
        masks = np.stack([placeholders(uv) for uv in pixels.uv_px]) if len(pixels.cameras) else np.zeros((), dtype=bool)
        for camera, uv, lost in zip(pixels.cameras, pixels.uv_px, masks, strict=True) if masks.any() else ():
            told += _told(uv, lost, recording, f" of camera {camera!r}")
        if masks.any():
            pixels = replace(pixels, uv_px=np.where(masks[..., None], np.nan, pixels.uv_px))
    if not told:
        return recording
    findings, assumed = (*told, *recording.findings), (*told, *recording.assumed)
    return replace(recording, points=points, pixels=pixels, findings=findings, assumed=assumed)


def placeholders(values: Array, measured: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """(T, M) samples that stand for missing ones in (T, M, d) coordinates.

    All coordinates of such a sample are one number: zero; or one that occurs twice or more and lies outside the range
    of all other coordinates, as 9999.99 and -16512 do. The marker does not move there: the samples before and after are
    further off than the steps around them are long. Of (T, M) samples known to be ``measured`` only those count whose
    marker is elsewhere before or after.
    """
    seen = np.isfinite(values).all(axis=-1)
    alike = seen & (values == values[..., :1]).all(axis=-1)
    out = np.zeros(seen.shape, dtype=bool)
    if not alike.any():
        return out
    numbers, counts = np.unique(values[alike][:, 0], return_counts=True)
    others = values[seen & ~alike]
    low, high = (others.min(), others.max()) if len(others) else (-np.inf, np.inf)
    beyond = np.maximum(low - numbers, numbers - high) > OUTSIDE * (high - low)
    chosen = numbers[(numbers == 0) | ((counts > 1) & beyond)]
    coarse = rounding(values) * np.sqrt(values.shape[-1]) if len(chosen) else 0.0
    for number in chosen:
        here = alike & (values[..., 0] == number)
        away = seen & ~here
        for m in np.flatnonzero(here.any(axis=0) & away.any(axis=0)):
            out[:, m] |= _elsewhere(values[:, m] - number, away[:, m], here[:, m], coarse)
        if number == 0:
            always = here & ~away.any(axis=0)
            out |= always if measured is None else always & ~measured
        elif (out & here).any():  # else they are markers that lie still, for all that is known
            out |= here & ~away.any(axis=0)
    return out


def _elsewhere(places: Array, away: NDArray[np.bool_], here: NDArray[np.bool_], coarse: float) -> NDArray[np.bool_]:
    """(T,) samples ``here`` at a placeholder that their marker does not move through.

    Args:
        places: (T, d) coordinates, from the placeholder.
        away: (T,) samples elsewhere.
        here: (T,) samples at the placeholder.
        coarse: How far rounded coordinates are apart at least.
    """
    frames, zeros = np.flatnonzero(away), np.flatnonzero(here)
    far = np.linalg.norm(places[frames], axis=-1)
    hole = np.diff(frames)
    step = np.linalg.norm(np.diff(places[frames], axis=0), axis=-1) / hole
    out = np.zeros(len(places), dtype=bool)
    after = np.searchsorted(frames, zeros)
    for k in np.unique(after):
        run = zeros[after == k]
        around = [i for i in range(k - 1 - AROUND, k + AROUND) if 0 <= i < len(step) and i != k - 1]
        usual = step[around].max() if around else step[k - 1] if 0 < k <= len(step) else 0.0
        sides = [(k - 1, run[0] - frames[k - 1])] if k > 0 else []
        sides += [(k, frames[k] - run[-1])] if k < len(frames) else []
        out[run] = any(far[i] > FASTER * usual * off + coarse for i, off in sides)
    return out


def rounding(values: Array) -> float:
    """The smallest difference between two numbers of a table: 1 of whole numbers, next to nothing of others.

    0 where it is more than a hundredth of their range: of few numbers it tells nothing.
    """
    known = values[np.isfinite(values)]
    steps = np.diff(np.unique(known[:: max(1, len(known) // 100_000)]))
    return float(steps.min()) if len(steps) and 100 * steps.min() < steps.sum() else 0.0


def _told(values: Array, lost: NDArray[np.bool_], recording: FileContents, whose: str) -> list[str]:
    """A sentence for each number: how many samples of which markers."""
    known = np.isfinite(values[..., 0]) & ~lost
    found = []
    for number in np.unique(values[lost][:, 0]):
        mine = lost & (values[..., 0] == number)
        words = [
            f"{mine[:, m].sum()} of {recording.names[m]!r} (from frame {recording.frames[mine[:, m].argmax()]} on)"
            if known[:, m].any()
            else f"all of {recording.names[m]!r}, which was never seen"
            for m in np.flatnonzero(mine.any(axis=0))
        ]
        more = f", and of {len(words) - NAMED} more markers" if len(words) > NAMED else ""
        place = ", ".join([f"{number:g}"] * values.shape[-1])
        found.append(
            f"{mine.sum()} samples{whose} at exactly ({place}) stand for missing and were read so: "
            f"{', '.join(words[:NAMED])}{more}"
        )
    return found
