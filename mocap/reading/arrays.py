"""Recordings of numbers that are in memory already: arrays, tables of pandas, Datasets of movement."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eal.arrays import Array, unique
from mocap.bounds import check_stated
from mocap.cameras.camera import Camera, dlt_camera, scaled
from mocap.errors import CalibrationError, FormatError, NoRateError
from mocap.findings import Finding, readings
from mocap.io.contents import FileContents, pixel_recording, point_recording
from mocap.io.lines import even_times, metres
from mocap.io.movement import of_dataset
from mocap.io.plausible import MOST_LIKELY, plausible
from mocap.options import FilmedOptions, stated, taking
from mocap.reading.ideal_pixels import with_ideal_pixels
from mocap.reading.reading import animal, calibration_of, check_rig, complete, corners, dataset_of
from mocap.recording import Recording, Source
from mocap.skeleton import Skeleton
from mocap.text import unfit

TIMES = ("t_s", "time", "time_s")
"""Column or index of a table that holds the times in seconds."""
NUMBER = "frame"
"""Column or index of a table that holds the numbers of the frames."""


def from_arrays(
    xyz: Any,
    *,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    unit: str | None = None,
    skeleton: Skeleton | str | PathLike[str] | None = None,
    name: str = "recording",
    point_sd_mm: float | None = None,
) -> Recording:
    """A recording of positions that are in memory; ``mocap.track`` takes it as it takes one that was read.

    Args:
        xyz: (T, M, 3) positions, NaN where not seen; or a table of pandas, a row a frame, with columns ``NAME_x``,
            ``NAME_y``, ``NAME_z`` or with two levels (marker, axis); or an xarray Dataset as movement lays it out.
        names: The M markers; None: as the table or Dataset names them, else pt1, pt2, ...
        fps: Frames a second; None: as a column or index ``t_s`` or ``time`` (in seconds) or the Dataset says.
        unit: Unit of lengths (m, mm, cm, in, ft); None: as the Dataset says, else the animal's length chooses it.
        skeleton: A ``mocap.Skeleton``, or a skeleton TOML; None: markers only.
        name: Of the recording.
        point_sd_mm: As in ``mocap.read``.

    Raises:
        FormatError: it is no such array, table or Dataset, or a name or unit does not fit.
        SkeletonError: the skeleton names markers that the recording lacks.
        MocapError: the frame rate is not stated, or no camera has it.
    """
    contents = _contents(xyz, "xyz", name, names, fps)
    if contents.points is None:
        raise FormatError("`xyz` contains pixels (space x, y), expected positions (x, y, z): use mocap.from_pixels")
    check_stated("point_sd_mm", point_sd_mm)
    found = _recording(contents, (), (), name=name, fps=fps, unit=unit, skeleton=skeleton)
    return replace(found, source=replace(found.source, point_sd_mm=point_sd_mm))


@dataclass(frozen=True, kw_only=True)
class ArrayOptions(FilmedOptions):
    """What is stated of pixels in memory."""

    names: Sequence[str] | None = field(
        default=None, metadata=stated(None, "The M markers; None: as the Dataset names them, else pt1, pt2, ...")
    )
    likelihood: ArrayLike | None = field(
        default=None,
        metadata=stated(
            None, "(C, T, M) likelihoods of the pixels, between 0 and 1; None: as the Dataset says, else none."
        ),
    )
    name: str = field(default="recording", metadata=stated(None, "Of the recording."))


@taking(ArrayOptions)
def from_pixels(uv: Any, cameras: Any, options: ArrayOptions) -> Recording:
    """A recording of pixels that are in memory, with the calibration of their cameras.

    Args:
        uv: (C, T, M, 2) pixels, NaN where not seen; or an xarray Dataset as movement lays out views (``view``).
        cameras: (C, 11) DLT coefficients L1..L11 or (C, 3, 4) projections, a camera each; or a calibration file of any
            format; or ``Camera`` objects.
        options: What is stated.

    Raises:
        FormatError: it is no such array or Dataset, or a name or unit does not fit.
        CalibrationError: the cameras are none, or not those of the pixels.
        SkeletonError: the skeleton names markers that the recording lacks.
        MocapError: the frame rate is not stated, or no camera has it.
    """
    name, skeleton = options.name, options.skeleton
    contents = _contents(uv, "uv", name, options.names, options.fps)
    if contents.pixels is None:
        raise FormatError("`uv` contains positions (x, y, z), expected pixels (space x, y): use mocap.from_arrays")
    if options.likelihood is not None:
        score = _numbers(options.likelihood, "likelihood", contents.seen.shape, "cameras, frames, markers")
        contents = replace(contents, score=score)
    rig, own_unit, readings = _cameras(cameras, options.unit)
    check_rig(contents, rig, name, "`cameras`")
    if own_unit is not None:
        contents = replace(contents, unit=own_unit)
    pixels = replace(corners(options), usual=contents.pixel_origin)
    found = _recording(contents, rig, readings, name=name, fps=options.fps, unit=None, skeleton=skeleton)
    check_stated("pixel_sd", options.pixel_sd)
    return with_ideal_pixels(replace(found, source=replace(found.source, pixel_sd=options.pixel_sd)), pixels)


def _recording(
    contents: FileContents,
    cameras: tuple[Camera, ...],
    readings: tuple[Finding, ...],
    *,
    name: str,
    fps: float | None,
    unit: str | None,
    skeleton: Skeleton | str | PathLike[str] | None,
) -> Recording:
    if fps is None and contents.fps is None:
        raise NoRateError(f"{name}: the frame rate is not stated: give `fps`")
    if not contents.seen.any():
        raise FormatError(f"{name}: no marker is ever seen: all {contents.seen.size} samples are NaN")
    score = np.zeros(0) if contents.score is None else contents.score
    if (odd := score[(score < 0) | (score > MOST_LIKELY)]).size:  # NaN: the network gave none
        raise FormatError(
            f"{name}: a likelihood is {odd[0]:g}, expected 0 to 1, or NaN where there is none: divide all by their "
            "greatest value, or leave `likelihood` out"
        )
    called = [("recording", name), *(("marker", one) for one in contents.names), *(("camera", c.name) for c in cameras)]
    for what, one in called:
        if trouble := unfit(one):
            raise FormatError(f"{name}: the name of a {what}, {one!r}, {trouble}: rename it")
    contents, how = complete(plausible(contents), where=name, fps=fps, unit=unit)
    animal_skeleton, names = animal(skeleton, contents.names)
    return Recording(
        name=name,
        data=dataset_of(contents.renamed(names)),
        skeleton=animal_skeleton,
        cameras=cameras,
        source=Source(calibration="`cameras`" if cameras else None, unit=unit, unusual=contents.remarks),
    ).with_part(replace(how, of_pixels=readings))


def _contents(given: Any, argument: str, name: str, names: Sequence[str] | None, fps: float | None) -> FileContents:
    """An array, a table or a Dataset as what a file of it would hold."""
    kind = type(given).__name__
    where = Path(name)
    if isinstance(given, str | PathLike):
        raise FormatError(f"`{argument}` is a path ({given}): read files with mocap.read")
    if kind in ("Dataset", "DataArray"):
        found = of_dataset(given.to_dataset(name="position") if kind == "DataArray" else given, where)
        return found if names is None else found.renamed(_names(names, len(found.names)))
    if kind == "DataFrame":
        if argument == "uv":
            raise FormatError("`uv` is a table, expected (cameras, frames, markers, 2) numbers or a Dataset")
        return _of_table(given, where, names, fps)
    views = argument == "uv"
    shape = (None, None, None, 2) if views else (None, None, 3)
    values = _numbers(given, argument, shape, "cameras, frames, markers, 2" if views else "frames, markers, 3")
    count = values.shape[-2]
    marked = _names(names, count) if names is not None else [f"pt{i + 1}" for i in range(count)]
    if views:
        cameras = [f"cam{c + 1}" for c in range(len(values))]
        return pixel_recording(where, "array", names=marked, cameras=cameras, uv_px=values)
    return point_recording(where, "array", names=marked, xyz=values, unit=None)


def _numbers(given: Any, argument: str, shape: tuple[int | None, ...], expected: str) -> Array:
    """Finite numbers, or NaN, of a shape.

    Raises:
        FormatError: they are not; the message says what came.
    """
    try:
        if np.ma.asarray(given).dtype.kind in "cbMm":  # NumPy turns truth values and dates into numbers
            raise TypeError
        values = np.ma.filled(np.ma.array(given, dtype=np.float64), np.nan)
    except (TypeError, ValueError):
        raise FormatError(f"`{argument}` is {type(given).__name__}, expected ({expected}) numbers") from None
    fits = len(values.shape) == len(shape) and all(n in (None, m) for n, m in zip(shape, values.shape, strict=True))
    if not fits or 0 in values.shape:
        how, last = "", shape[-1]
        if last and values.ndim == len(shape) - 1 and values.shape[-1] in range(last, sys.maxsize, last):
            how = ": if its columns are the coordinates of one marker after the other, give "
            how += f"{argument}.reshape(*{argument}.shape[:-1], -1, {last})"
        raise FormatError(f"`{argument}` has the shape {values.shape}, expected ({expected}){how}")
    if np.isinf(values).any():
        raise FormatError(f"`{argument}` contains infinite numbers: write NaN where nothing was seen")
    return values


def _names(names: Sequence[str], count: int) -> list[str]:
    """Names of so many markers.

    Raises:
        FormatError: they are no list of texts, not as many, or one appears twice.
    """
    if isinstance(names, str) or not all(isinstance(one, str) for one in names):
        raise FormatError(f"`names` is {names!r}, expected a list of texts, one for each marker")
    if len(names) != count:
        raise FormatError(f"`names` has {len(names)} names for {count} markers: {', '.join(names)}")
    try:
        unique("marker", tuple(names))
    except ValueError as error:
        raise FormatError(f"`names`: {error}: rename one") from None
    return list(names)


def _of_table(table: Any, where: Path, names: Sequence[str] | None, fps: float | None) -> FileContents:
    """Positions of a table of pandas, a row a frame; further columns are left out and told."""
    flat = table.reset_index() if table.index.name in (*TIMES, NUMBER) else table
    titles = ["_".join(map(str, title)) if isinstance(title, tuple) else str(title) for title in flat.columns]
    titles = [title.rstrip("_") if title.rstrip("_") in (*TIMES, NUMBER) else title for title in titles]
    titles = [f"{title[:-2]}{title[-2:].lower()}" if title[-2:] in ("_X", "_Y", "_Z") else title for title in titles]
    flat = flat.set_axis(titles, axis=1)
    found = [title[:-2] for title in titles if title.endswith("_x")]
    marked = [one for one in found if {f"{one}_y", f"{one}_z"} <= set(titles)]
    marked = [one for one in marked if names is None or one in names]
    lost = [one for one in names or () if one not in marked]
    if lost or not marked or len(set(marked)) < len(marked):
        raise FormatError(
            f"`xyz`: the table has the columns {', '.join(titles[:12])}{', ...' if len(titles) > 12 else ''}; expected "
            f"{lost[0] if lost else 'NAME'}_x, _y, _z of each marker"
        )
    order = marked if names is None else list(names)
    used = [f"{one}_{axis}" for one in order for axis in "xyz"]
    values = _numbers(flat[used].to_numpy(), "xyz", (None, 3 * len(order)), "frames, columns")
    time = next((title for title in TIMES if title in titles), None)
    t_s = None if time is None else _numbers(flat[time].to_numpy(), time, (None,), "frames")
    frames = None if NUMBER not in titles else _numbers(flat[NUMBER].to_numpy(), NUMBER, (None,), "frames")
    own, notes = None, list[str]()
    if t_s is not None:
        t_s, own, notes = even_times(where, t_s, frames=frames, stated=fps)
    left = [title for title in titles if title not in (*used, time, NUMBER)]
    notes += [f"columns that are not used: {', '.join(left[:8])}{', ...' if len(left) > 8 else ''}"] if left else []
    return point_recording(
        where,
        "table",
        names=order,
        xyz=values.reshape(len(values), -1, 3),
        unit=None,
        frames=None if frames is None else frames.astype(np.int64),
        first=1 if frames is None else int(frames[0]),
        fps=own,
        t_s=t_s,
        findings=tuple(notes),
    )


def _cameras(given: Any, unit: str | None) -> tuple[tuple[Camera, ...], str | None, tuple[Finding, ...]]:
    """Cameras in metres, the unit that is known of them, and how their file was read."""
    if isinstance(given, str | PathLike):
        file = calibration_of(Path(given))
        file = file if unit is None else file.with_unit(unit)
        return file.cameras, file.unit, readings(file.assumed, where=Path(given).name)
    if not isinstance(given, np.ndarray) and all(isinstance(one, Camera) for one in given):
        cameras = tuple(given)
    else:
        try:
            if np.iscomplexobj(np.asarray(given)):
                raise TypeError
            values: Any = np.array(given, dtype=np.float64)
        except (TypeError, ValueError):
            values = np.zeros(0)
        if values.ndim == 2 and values.shape[1] == 11:
            cameras = tuple(dlt_camera(f"cam{c + 1}", one) for c, one in enumerate(values))
        elif values.ndim == 3 and values.shape[1:] == (3, 4):
            cameras = tuple(Camera(name=f"cam{c + 1}", matrix=one) for c, one in enumerate(values))
        else:
            shape = f"an array of the shape {values.shape}" if values.size else f"{type(given).__name__}"
            shape = "complex numbers" if np.iscomplexobj(np.asarray(given)) else shape
            raise CalibrationError(
                f"`cameras` is {shape}, expected (C, 11) DLT coefficients, (C, 3, 4) projections, Camera objects, or a "
                "calibration file"
            )
    return (cameras, None, ()) if unit is None else (scaled(cameras, metres(Path("`cameras`"), unit)), unit, ())
