"""Implausible values, which are refused or reported in every format."""

from dataclasses import replace

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.contents import FileContents
from mocap.io.placeholders import without_placeholders
from mocap.schema import not_covariances
from mocap.text import visible

_FARTHEST_M = 1e8
"""The earth is 1.3e7 m wide: positions on it may be counted from its middle."""
_FARTHEST = 1e11
"""The same where the unit may be as small as a millimetre."""
_FARTHEST_PX = 1e7
_RATES_HZ = (1e-4, 1e7)
_MOST_SCORE = 2.0
"""Scores are between 0 and 1; some networks exceed 1 a little."""


def plausible(recording: FileContents) -> FileContents:
    """The recording without placeholders, with findings on what is unusual in its numbers.

    Raises:
        FormatError: a position, pixel, rate, covariance or other number is none that can have been measured.
    """
    recording = without_placeholders(recording)
    name, findings = recording.paths[0].name, []
    if recording.fps is not None and not _RATES_HZ[0] <= recording.fps <= _RATES_HZ[1]:
        raise FormatError(
            f"{name}: the frame rate is {recording.fps:g}; expected {_RATES_HZ[0]:g} to {_RATES_HZ[1]:g} frames a "
            "second: correct it and export again"
        )
    if recording.points is not None:
        most = _FARTHEST if recording.unit is None else _FARTHEST_M
        _check_size(recording, "", recording.points.xyz_m, most, "a unit" if recording.unit is None else "m")
        _check_covariances(recording, recording.points.cov_m2)
    if recording.pixels is not None:
        for camera, uv in zip(recording.pixels.cameras, recording.pixels.uv_px, strict=True):
            _check_size(recording, f" of {camera}", uv, _FARTHEST_PX, "px")
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
    if score is not None and ((score < 0) | (score > _MOST_SCORE)).any():
        findings.append(f"scores are {np.nanmin(score):g} to {np.nanmax(score):g}; expected 0 to 1")
    recording, told = _legible(recording)
    return replace(recording, findings=(*recording.findings, *findings, *told, *_frame_findings(recording)))


def _legible(recording: FileContents) -> tuple[FileContents, list[str]]:
    """The recording without characters that act on terminals or turn the writing in names, and a finding on them."""

    def shown(word: str) -> str:
        return "\r".join(map(visible, word.split("\r")))  # cells of tables have an escape of their own for line ends

    every = (*recording.names, *recording.camera_names, *(word for own in recording.animals for word in own))
    odd = {word for word in every if shown(word) != word}
    if not odd:
        return recording, []
    names, cameras = (tuple(map(shown, own)) for own in (recording.names, recording.camera_names))
    pixels, points = recording.pixels, recording.points
    pixels = None if pixels is None else replace(pixels, names=names, cameras=cameras)
    return replace(
        recording,
        names=names,
        camera_names=cameras,
        pixels=pixels,
        points=None if points is None else replace(points, names=names),
        animals=tuple((shown(animal), shown(name)) for animal, name in recording.animals),
    ), [f"{len(odd)} names contain characters that do not show or change how text reads: written as \\u202e is"]


def _check_size(recording: FileContents, which: str, values: Array, most: float, unit: str) -> None:
    """(T, M, ...) values are not larger than that."""
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
    known = ~np.isnan(cov[..., 0, 0])
    with np.errstate(all="ignore"):
        size = np.abs(cov).max(axis=(-1, -2))
    wrong = known & ~(size < _FARTHEST_M**2)
    wrong[known & ~wrong] = not_covariances(cov[known & ~wrong])
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
