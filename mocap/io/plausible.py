"""Numbers that stand for a missing sample: (0, 0, 0), and others outside everything else that was recorded."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.contents import FileContents
from mocap.io.format import Zero
from mocap.io.lines import RATES_HZ, told_apart
from mocap.io.rounding import rounding
from mocap.records import Status
from mocap.schema import not_covariances
from mocap.text import number_of, visible

EXPLICIT = ("csv-wide", "csv-long", "parquet", "movement")
"""Formats of ours, in which a missing sample is empty and every other has its origin: there zero is a place."""
NAMED = 8
"""Markers that a finding names."""


def without_placeholders(recording: FileContents, zero: Zero | None = None) -> FileContents:
    """The recording, as its format reads it, with placeholders as missing samples, counted and named.

    Zeros stay where their marker moves through them, and where it alone is there in all of its samples: the origin of
    the others. What was decided is a finding, with counts. In formats that state zeros as places only what is stated
    counts.

    Args:
        recording: As read.
        zero: What samples at exactly zero are, where the user states it.
    """
    points, pixels, notes = recording.points, recording.pixels, []
    if recording.format in EXPLICIT and zero is None:
        return recording
    if points is not None:
        residual = recording.tables.get("residual_m")
        measured = None if residual is None else residual > 0
        lost = placeholders(points.xyz_m, measured=measured, saturated=recording.saturated, zero=zero, origin=True)
        notes += _kept_notes(points.xyz_m, lost, recording, zero)
        if lost.any():
            notes += _placeholder_notes(points.xyz_m, lost, recording, "", zero)
            points = replace(
                points,
                xyz_m=np.where(lost[..., None], np.nan, points.xyz_m),
                cov_m2=np.where(lost[..., None, None], np.nan, points.cov_m2),
                status=np.where(lost, Status.MISSING, points.status),
            )
    if pixels is not None:
        masks = [placeholders(uv, zero=zero) for uv in pixels.uv_px]
        for camera, uv, lost in zip(pixels.cameras, pixels.uv_px, masks, strict=True):
            notes += _placeholder_notes(uv, lost, recording, f" of camera {camera!r}", zero) if lost.any() else []
        if any(lost.any() for lost in masks):
            pixels = replace(pixels, uv_px=np.where(np.stack(masks)[..., None], np.nan, pixels.uv_px))
    if not notes:
        return recording
    findings, assumed = (*notes, *recording.findings), (*notes, *recording.assumed)
    return replace(recording, points=points, pixels=pixels, findings=findings, assumed=assumed)


def placeholders(
    values: Array,
    *,
    measured: NDArray[np.bool_] | None = None,
    saturated: NDArray[np.bool_] | None = None,
    zero: Zero | None = None,
    origin: bool = False,
) -> NDArray[np.bool_]:
    """(T, M) samples that stand for missing ones in (T, M, d) coordinates.

    All coordinates of such a sample are one number: zero; or one that occurs twice or more and lies outside the range
    of all other coordinates, as 9999.99 and -16512 do. Evidence that it is no place, each by itself:

    - its marker jumps there and back: the samples before and after are further off than the steps around them are long;
    - its residual is the largest that the file can hold;
    - other markers, too, are there in all of their samples: two markers cannot be in one place;
    - its marker is there in all of its samples, and another jumps there: the file writes missing samples so.

    One marker that is at zero in all of its samples, where none of this speaks against it, is the ``origin`` of the
    others: a pivot, or the root of coordinates that are relative to it. Images have no such place.

    Args:
        values: Coordinates.
        measured: (T, M) samples whose residual says that cameras saw them: that another marker jumps to zero is then
            no evidence.
        saturated: (T, M) samples whose residual is the largest that the file can hold.
        zero: What zeros are, where the user states it; other numbers are judged all the same.
        origin: Whether a marker can lie at zero: in space, and not in an image.
    """
    seen = np.isfinite(values).all(axis=-1)
    alike = seen & (values == values[..., :1]).all(axis=-1)
    out = np.zeros(seen.shape, dtype=bool)
    if not alike.any():
        return out
    numbers, counts = np.unique(values[alike][:, 0], return_counts=True)
    others = values[seen & ~alike]
    low, high = (others.min(), others.max()) if len(others) else (-np.inf, np.inf)
    beyond = np.maximum(low - numbers, numbers - high) > 0.1 * (high - low)
    chosen = numbers[(numbers == 0) | ((counts > 1) & beyond)]
    coarse = rounding(values) * np.sqrt(values.shape[-1]) if len(chosen) else 0.0
    for number in chosen:
        here = alike & (values[..., 0] == number)
        if number == 0 and zero is not None:
            out |= here & (zero == "missing")
            continue
        away = seen & ~here
        for m in np.flatnonzero(here.any(axis=0) & away.any(axis=0)):
            out[:, m] |= _elsewhere(values[:, m] - number, away[:, m], here[:, m], coarse)
        jumps = bool((out & here).any())
        always = here & ~away.any(axis=0)
        together = np.count_nonzero(always.any(axis=0)) > 1
        if number != 0:
            out |= always & (jumps or together)  # else it is a marker that lies still, for all that is known
            continue
        out |= here & (False if saturated is None else saturated)
        if together or not origin or not away.any():
            out |= always
        elif jumps:
            out |= always & (True if measured is None else ~measured)
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
        around = [i for i in range(k - 1 - 3, k + 3) if 0 <= i < len(step) and i != k - 1]
        usual = step[around].max() if around else step[k - 1] if 0 < k <= len(step) else 0.0
        sides = [(k - 1, run[0] - frames[k - 1])] if k > 0 else []
        sides += [(k, frames[k] - run[-1])] if k < len(frames) else []
        out[run] = any(far[i] > 2.0 * usual * off + coarse for i, off in sides)
    return out


def _placeholder_notes(
    values: Array, lost: NDArray[np.bool_], recording: FileContents, whose: str, zero: Zero | None
) -> list[str]:
    """A sentence for each number: how many samples of which markers are missing."""
    finite = np.isfinite(values[..., 0]) & ~lost
    found = []
    for number in np.unique(values[lost][:, 0]):
        mine = lost & (values[..., 0] == number)
        place = ", ".join([f"{number:g}"] * values.shape[-1])
        stated = ", as stated" if zero == "missing" and number == 0 else ""
        at = f"{whose} at exactly ({place})"
        count = number_of(
            int(mine.sum()), f"sample{at} stands for missing and was", f"samples{at} stand for missing and were"
        )
        found.append(f"{count} read so{stated}: {_counted(mine, finite, recording, ', which was never seen')}")
    return found


def _kept_notes(values: Array, lost: NDArray[np.bool_], recording: FileContents, zero: Zero | None) -> list[str]:
    """A sentence on how many samples at zero of which markers are positions."""
    mine = (values == 0).all(axis=-1) & ~lost
    if not mine.any():
        return []
    elsewhere = np.isfinite(values[..., 0]) & ~mine
    why = "as stated" if zero == "position" else "no other marker stays there and none jumps there and back"
    advice = "" if zero == "position" else "; if they stand for missing, give `zero` missing"
    at = "at exactly (0, 0, 0)"
    count = number_of(int(mine.sum()), f"sample {at} is a position and was", f"samples {at} are positions and were")
    return [f"{count} read so ({why}): {_counted(mine, elsewhere, recording, ', the origin of the others')}{advice}"]


def _counted(mine: NDArray[np.bool_], elsewhere: NDArray[np.bool_], recording: FileContents, always: str) -> str:
    """How many samples of which markers, and what those are that have no others ``elsewhere``."""
    words = [
        f"{mine[:, m].sum()} of {recording.names[m]!r} (from frame {recording.frames[mine[:, m].argmax()]} on)"
        if elsewhere[:, m].any()
        else f"all of {recording.names[m]!r}{always}"
        for m in np.flatnonzero(mine.any(axis=0))
    ]
    more = f", and of {len(words) - NAMED} more markers" if len(words) > NAMED else ""
    return ", ".join(words[:NAMED]) + more


MOST_LIKELY = 1.5
"""Likelihoods are at most 1; peaks of heat maps, which some networks give in their place, exceed it a little."""
_FARTHEST_M = 1e8
"""The earth is 1.3e7 m wide: positions on it may be counted from its middle."""
_FARTHEST = _FARTHEST_M / 1e-3  # where the unit may be as small as a millimetre


def plausible(recording: FileContents, zero: Zero | None = None) -> FileContents:
    """The recording without placeholders, with findings on what is unusual in its numbers.

    Args:
        recording: As its format reads it.
        zero: What samples at exactly zero are, where the user states it.

    Raises:
        FormatError: a position, pixel, rate, covariance or other number is none that can have been measured.
    """
    recording = replace(without_placeholders(recording, zero), saturated=None)
    name, findings = recording.paths[0].name, []
    if recording.fps is not None and not RATES_HZ[0] <= recording.fps <= RATES_HZ[1]:
        raise FormatError(
            f"{name}: the frame rate is {recording.fps:g}; expected {RATES_HZ[0]:g} to {RATES_HZ[1]:g} frames a "
            "second: correct it and export again"
        )
    if recording.points is not None:
        most = _FARTHEST if recording.unit is None else _FARTHEST_M
        _check_size(recording, "", recording.points.xyz_m, most, "a unit" if recording.unit is None else "m")
        _check_covariances(recording, recording.points.cov_m2)
    if recording.pixels is not None:
        for camera, uv in zip(recording.pixels.cameras, recording.pixels.uv_px, strict=True):
            _check_size(recording, f" of {camera}", uv, 1e7, "px")
    for title, table in recording.tables.items():
        with np.errstate(invalid="ignore"):
            if (np.abs(table) > _FARTHEST).any():
                raise FormatError(
                    f"{name}: the table {title} contains {np.nanmax(np.abs(table)):g}, which is too large: correct "
                    "it and export again"
                )
        if title not in ("offset_frames", "transforms", "quantities", "time_s") and (table < 0).any():
            findings.append(f"{(table < 0).sum()} numbers of the table {title} are below 0")
    for camera in recording.cameras:
        if not np.isfinite(camera.matrix).all():
            raise FormatError(f"{name}: camera {camera.name!r} has numbers that are not finite: calibrate again")
    score = recording.score
    if score is not None and ((score < 0) | (score > MOST_LIKELY)).any():
        findings.append(f"scores are {np.nanmin(score):g} to {np.nanmax(score):g}; expected 0 to 1")
    recording, notes = _legible(recording)
    return replace(recording, findings=(*recording.findings, *findings, *notes, *_frame_findings(recording)))


def _legible(recording: FileContents) -> tuple[FileContents, list[str]]:
    """The recording with names that can be written and read back, and findings on those that could not.

    Without characters that act on terminals, end lines or turn the writing; and each with a letter.
    """

    def shown(word: str) -> str:
        return visible(word).replace("\n", "\\n")

    every = (*recording.names, *recording.camera_names, *(word for own in recording.animals for word in own))
    odd = {word for word in every if shown(word) != word}
    if not odd and "" not in recording.names:
        return recording, []
    names, renamed = told_apart([*map(shown, recording.names)])
    names, cameras = tuple(names), tuple(map(shown, recording.camera_names))
    how = "contain characters that do not show, end a line or change how text reads: written as \\u202e is"
    notes = [f"{len(odd)} names {how}"] if odd else []
    pixels, points = recording.pixels, recording.points
    pixels = None if pixels is None else replace(pixels, names=names, cameras=cameras)
    return replace(
        recording,
        names=names,
        camera_names=cameras,
        pixels=pixels,
        points=None if points is None else replace(points, names=names),
        animals=tuple((shown(animal), shown(name)) for animal, name in recording.animals),
    ), [*notes, *renamed]


def _check_size(recording: FileContents, which: str, values: Array, most: float, unit: str) -> None:
    if not values.size or not max(-np.fmin.reduce(values, axis=None), np.fmax.reduce(values, axis=None)) > most:
        return
    row, marker, axis = np.argwhere(np.abs(values) > most)[0]
    raise FormatError(
        f"{recording.paths[0].name}: marker {recording.names[marker]!r}{which} is at {values[row, marker, axis]:g} "
        f"{unit} in frame {recording.frames[row]} (row {row + 1} of the tracks); expected less than {most:g}: correct "
        "it and export again"
    )


def _check_covariances(recording: FileContents, cov: Array) -> None:
    """(T, M, 3, 3) covariances, where they are known, are symmetric and have no negative variance in any direction."""
    finite = ~np.isnan(cov[..., 0, 0])
    with np.errstate(all="ignore"):
        size = np.abs(cov).max(axis=(-1, -2))
    wrong = finite & ~(size < _FARTHEST_M**2)
    wrong[finite & ~wrong] = not_covariances(cov[finite & ~wrong])
    if wrong.any():
        row, marker = np.argwhere(wrong)[0]
        raise FormatError(
            f"{recording.paths[0].name}: the covariance of marker {recording.names[marker]!r} in frame "
            f"{recording.frames[row]} is not a covariance (not positive definite): {np.array2string(cov[row, marker])}"
            .replace("\n", " ") + ": export it again"
        )  # fmt: skip


def _frame_findings(recording: FileContents) -> list[str]:
    frames = recording.frames
    steps = np.diff(frames)
    found = []
    if len(frames) and frames[0] < 0:
        found.append(f"the first frame number is {frames[0]}: frames before a trigger are counted so")
    if (steps != 1).any():
        at = int(np.argmax(steps))
        found.append(
            f"frame numbers jump {(steps != 1).sum()} times; the largest jump is from {frames[at]} to {frames[at + 1]}"
        )
    return found
