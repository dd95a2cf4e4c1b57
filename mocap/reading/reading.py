"""From files to a recording: everything that they hold, or leave open, is decided here."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eal.arrays import unique
from mocap.bounds import check_rate, check_stated
from mocap.cameras.camera import Camera, check_cameras
from mocap.cameras.origin import OriginError, PixelOptions
from mocap.errors import CalibrationError, FormatError, MocapError, NoRateError, SkeletonError
from mocap.findings import Finding, Kind, readings
from mocap.io import dltdv
from mocap.io.contents import FileContents
from mocap.io.every_frame import every_frame
from mocap.io.format import Hints
from mocap.io.lines import slow_rate
from mocap.io.profile import with_profile
from mocap.io.registry import as_table
from mocap.io.registry import read as read_file
from mocap.io.rigid import with_bodies
from mocap.io.together import joined, point_names
from mocap.io.unstated_unit import in_metres
from mocap.options import FilmedOptions, PathText, ReadOptions, flags_of, options_of, taking
from mocap.reading.decided import Decided, decided
from mocap.reading.edits_of_movement import any_log
from mocap.reading.ideal_pixels import with_ideal_pixels
from mocap.reading.whole_picture import counted_from_one, in_whole_picture
from mocap.recording import Recording, Source, dataset, with_variables
from mocap.records import PixelCorner
from mocap.skeleton import Skeleton
from mocap.skeleton_files import is_model, read_skeleton
from mocap.text import as_text, with_options

if TYPE_CHECKING:
    import xarray as xr


@taking(ReadOptions)
def read(tracks: PathText | Sequence[PathText], options: ReadOptions) -> Recording:
    """Read pixels or positions of any known format, with the calibration and skeleton that belong to them.

    The same options as ``mocap track`` takes. All files are read now; the result shows as a table in a notebook, and
    ``mocap.track`` and ``mocap.learn`` take it.

    Args:
        tracks: Pixels or positions; a project of DLTdv8 holds its calibration too. Several files: the views of one
            trial, a camera each, or positions with XMALab's (or QTM's) rigid bodies and coordinate systems in them.
        options: What is stated.

    Raises:
        FormatError: a file cannot be read, an edit names what is not in it, or edits are of another recording.
        CalibrationError: pixels and calibration do not belong together, or what was to be estimated cannot be.
        SkeletonError: the skeleton cannot be read, or names markers that the recording lacks.
        MocapError: the frame rate is in no file and not stated, or a number is out of all bounds.
    """
    for name in ("fps", "pixel_sd", "point_sd_mm", "mm_per_px"):
        check_stated(name, getattr(options, name))
    pixels = corners(options)
    files, crops = _paths("tracks", tracks), _paths("crop", options.crop)
    if not files:
        raise MocapError(f"`tracks` is {tracks!r}, expected a file, or several")
    beside = ("calibration", "profile", "stored_points", "edits")
    given = ((name, getattr(options, name)) for name in beside)
    rig, lenses, points, log = (None if path is None else _path(name, path) for name, path in given)
    for name in ("profile", "origin", "calibration_origin"):
        if getattr(options, name) is not None and rig is None and files[0].suffix.lower() in (".csv", ".tsv"):
            raise MocapError(f"`{name}` concerns cameras, but no calibration is given: give `calibration`")
    contents, how = _tracks(files, rig, options)
    skeleton, names = animal(options.skeleton, contents.names, bodies=contents.bodies)
    contents, cameras, notes = _with_cameras(contents.renamed(names), files[0], rig, lenses, options.unit)
    if how.unit is None and contents.unit is not None:
        how = replace(how, unit=contents.unit, unit_from="file")
    contents, further = _in_whole_picture(contents, cameras, files, (rig, lenses), crops, options.origin)
    animal_file = None if isinstance(options.skeleton, Skeleton | None) else Path(options.skeleton)
    named = (*files, rig, lenses, points, log, animal_file, *(path for path in crops if path.is_file()))
    found = Recording(
        name=recording_name(files[0]),
        data=dataset_of(contents),
        skeleton=skeleton,
        cameras=cameras,
        source=Source(
            file=files[0],
            inputs=tuple(path for path in named if path is not None),
            calibration=None if rig is None else rig.name,
            unit=options.unit,
            pixel_sd=options.pixel_sd,
            point_sd_mm=options.point_sd_mm,
            mm_per_px=contents.plane_mm if rig is None and options.mm_per_px is None else options.mm_per_px,
            unusual=contents.remarks,
            bodies=contents.bodies,
        ),
    ).with_part(replace(how, of_pixels=(*notes, *further), beside=_stored(contents, cameras, files[0], points)))
    found = found if log is None else any_log(log).replayed(found, anyway=options.edits_anyway)
    return with_ideal_pixels(found, replace(pixels, usual=contents.pixel_origin))


def corners(options: FilmedOptions) -> PixelOptions:
    """What is stated of pixels alone."""
    return PixelOptions(
        origin=options.origin,
        calibration_origin=options.calibration_origin,
        image_height_px=options.image_height_px,
        correct_lag=options.correct_lag,
        fit_lens=options.fit_lens,
    )


def _tracks(files: Sequence[Path], rig: Path | None, options: ReadOptions) -> tuple[FileContents, Decided]:
    """What the files of the tracks hold, of the animal that is meant, and what was decided for that.

    Raises:
        FormatError: they hold no markers, or are a calibration.
    """
    hints = replace(options.hints or Hints(), fps=options.fps)
    contents, how = complete(_whole(files, rig, hints), where=files[0].name, fps=options.fps, unit=options.unit)
    contents = contents.of_animal(hints.individual)
    if not contents.names and rig is not None and contents.cameras and read_file(rig, hints).names:
        raise FormatError(
            f"{files[0].name}: is a calibration, and {rig.name}, given as `calibration`, holds tracks: exchange them"
        )
    if not contents.names:
        raise contents.without_markers()
    return contents, how


OPTIONS = {name: flags_of(name, one)[0] for name, one in options_of(ReadOptions).items() if one.of is not None}
OPTIONS |= {one.name: f"--{one.name}" for one in fields(Hints)}
"""The options of the command line that are the arguments of ``read``, and what hints state."""


def in_options(text: str) -> str:
    """A sentence of a report, which names arguments of ``read``, as files and pages name them: by their options."""
    return with_options(text, OPTIONS)


def in_arguments(text: str) -> str:
    """A report as files have it, in which each option is the argument between backquotes again."""
    longest = sorted(OPTIONS.items(), key=lambda one: -len(one[1]))
    for name, option in longest:
        text = re.sub(rf"(?<![\w-]){re.escape(option)}(?![\w-])", f"`{name}`", text)
    return text


def of_session(trials: Iterable[Callable[..., Recording | None]]) -> Iterator[Recording]:
    """Recordings of one session, read one after the other.

    Where the pixels of one do not tell which corner they are counted from the others tell, and it comes last.

    Args:
        trials: Each reads one, with ``origin`` and ``calibration_origin`` where these are known; None: it is left out.

    Raises:
        OriginError: the others do not tell, either.
    """
    doubt: list[tuple[Callable[..., Recording | None], OriginError]] = []
    decisions = set()
    for trial in trials:
        try:
            recording = trial()
        except OriginError as error:
            doubt.append((trial, error))
            continue
        if recording is None:
            continue
        if (rows := decided(recording).rows) is not None:
            decisions.add((rows.pixels, rows.coefficients))
        yield recording
    for trial, error in doubt:
        if len(decisions) != 1:
            raise error
        ((corner, calibrated),) = decisions
        recording = trial(origin=corner, calibration_origin=calibrated)
        same = Finding(
            kind=Kind.PIXEL_ORIGIN, text=f"pixel origin {corner}, as in the other recordings of this session"
        )
        if recording is not None:
            how = decided(recording)
            yield recording.with_part(replace(how, of_pixels=(same, *how.of_pixels)))


def uncropped(files: Sequence[Path], crops: Sequence[Path], *, fps: float | None, hints: Hints) -> FileContents:
    """Pixels of cropped videos in the whole image, to be converted; findings say what was added.

    Raises:
        FormatError: a file cannot be read, or offsets do not belong to the videos.
    """
    hints = replace(hints, fps=fps)
    contents, _ = complete(_whole(files, None, hints), where=files[0].name, fps=fps or 1.0, unit=None)
    contents, cameras, findings = _with_cameras(contents, files[0], None, None, None)
    contents, further = _in_whole_picture(contents, cameras, files, (), crops, None)
    return replace(contents, findings=(*contents.findings, *map(str, (*findings, *further))))


def _in_whole_picture(
    contents: FileContents,
    cameras: tuple[Camera, ...],
    files: Sequence[Path],
    rig: Sequence[Path | None],
    crops: Sequence[Path],
    corner: PixelCorner | None,
) -> tuple[FileContents, tuple[Finding, ...]]:
    """Pixels counted as the calibration counts them, with crop offsets added, and what was decided."""
    if contents.pixels is None or not (cameras or crops):
        return contents, ()
    contents, counted = counted_from_one(contents, [path for path in rig if path is not None])
    contents, cropped = in_whole_picture(contents, cameras, files, crops, pixel_origin=corner)
    return contents, (*readings(counted), *readings(cropped))


def _stored(contents: FileContents, cameras: Sequence[Camera], tracks: Path, given: Path | None) -> FileContents | None:
    """Positions that are compared with those of the pixels: of the same file, or of the one beside it."""
    if contents.points is not None:
        return contents if contents.pixels is not None else None
    path = stored_file(tracks, given) if cameras else None
    return None if path is None else read_file(path)


def _path(argument: str, given: object) -> Path:
    """The file of an argument.

    Raises:
        MocapError: it is none.
    """
    if isinstance(given, str | PathLike):
        return Path(given)
    how = ": mocap.from_arrays and mocap.from_pixels take numbers in memory" if argument == "tracks" else ""
    how = " or a mocap.Skeleton(markers=[...], ...)" if argument == "skeleton" else how
    raise MocapError(f"`{argument}` is {type(given).__name__}, expected a file{how}")


def _paths(argument: str, given: PathText | Sequence[PathText] | None) -> tuple[Path, ...]:
    if given is None:
        return ()
    several = given if isinstance(given, list | tuple) else (given,)
    return tuple(_path(argument, one) for one in several)


def recording_name(file: Path) -> str:
    """Name of the recording, from that of the file."""
    stem = as_text(file.stem)
    return re.sub(r"xyz?pts$", "", stem, flags=re.IGNORECASE).rstrip("_-. ") or stem


def complete(
    contents: FileContents, *, where: str, fps: float | None, unit: str | None
) -> tuple[FileContents, Decided]:
    """What was read in metres, in seconds and with every frame, and what was decided for that.

    Args:
        contents: As read.
        where: What messages call it.
        fps: Frames a second, as the user states it.
        unit: Unit of lengths, as the user states it.

    Raises:
        FormatError: the unit is not known, or frames are of no one recording.
        MocapError: the frame rate is not known, or no camera has it.
    """
    check_stated("fps", fps)
    own, rate_in_file = contents.unit, None
    contents, assumed = in_metres(contents, unit)
    rate_from, slow = "stated", list[str]()
    if fps is None:
        if contents.fps is None:
            raise NoRateError(f"{where}: the frame rate is not in the file: give `fps`")
        check_rate(contents.fps, where)
        tracks = contents.points if contents.pixels is None else contents.pixels
        slow = [] if tracks is None else slow_rate(contents.fps, tracks.t_s)
        rate_from = "playback" if contents.playback else "file"
    else:
        rate_in_file = contents.fps
        contents = contents.with_rate(fps)
    contents, left_out = every_frame(contents)
    rates = (Finding(kind=Kind.FRAME_RATE, alarm=True, text=text) for text in slow)
    return contents, Decided(
        unit=contents.unit,
        unit_from="stated" if unit else "file" if own else "assumed" if assumed else "nowhere",
        rate_from=rate_from,  # type: ignore[arg-type]
        rate_in_file=rate_in_file,
        assumed_unit=next(iter(assumed), None),
        of_files=(*rates, *readings((*contents.assumed, *left_out))),
    )


def dataset_of(contents: FileContents) -> "xr.Dataset":
    """What files hold, as a Dataset: pixels, or positions where there are none."""
    tracks = contents.points if contents.pixels is None else contents.pixels
    edited = contents.tables.get("edited")
    found = dataset(
        contents.names,
        np.zeros(0) if tracks is None else tracks.t_s,
        pixels=contents.pixels,
        points=contents.points,
        score=contents.score,
        frames=contents.frames if tracks is not None else None,
        format=contents.format,
        **({} if contents.fps is None else {"fps": contents.fps}),
        **({} if contents.unit is None else {"space_unit": contents.unit}),
    )
    return found if edited is None or tracks is None else with_variables(found, {"edited": edited > 0})


def _whole(files: Sequence[Path], rig: Path | None, hints: Hints) -> FileContents:
    """The tracks, with those of further views in the order of the calibration where names tell."""
    found = [read_file(path, hints) for path in files]
    if len(found) == 1:
        return found[0]
    bodies = [f for f in found if "transforms" in f.tables]
    if bodies and len(bodies) == len(found) - 1:
        return with_bodies(next(f for f in found if f not in bodies), bodies)
    other = next((f for f in found if f.pixels is None and not f.cameras and not f.lenses), None)
    if other is not None:
        raise FormatError(
            f"{other.paths[0].name}: contains no pixels and no calibration ({other.format}); several files of one "
            "trial must each contain the pixels of one camera, or their calibration"
        )
    if rig is None:
        return joined(found)
    cameras = calibration_of(rig)
    found.append(replace(cameras, names=(), frames=np.zeros(0, np.int64), pixels=None, points=None, lenses=()))
    return replace(joined(found), cameras=(), unit=None)


def calibration_of(path: Path) -> FileContents:
    """A calibration of any format.

    Raises:
        FormatError: it cannot be read.
    """
    try:
        return read_file(path)
    except FormatError:
        if path.suffix.lower() in (".csv", ".xlsx"):
            with as_table(path) as (table, _):
                dltdv.read_coefficients(table)  # says what is wrong with them
        raise


def animal(
    given: PathText | Skeleton | None, names: Sequence[str], *, bodies: Mapping[str, Iterable[str]] | None = None
) -> tuple[Skeleton, tuple[str, ...]]:
    """The skeleton, and the file's marker names in its terms; where none is given one of markers and the file's bodies.

    Raises:
        SkeletonError: the skeleton cannot be read, or uses markers that the recording lacks.
    """
    if given is None:
        rigid = {body: tuple(own) for body, own in (bodies or {}).items()}
        return Skeleton(name="markers only", markers=tuple(names), bodies=rigid), tuple(names)
    if not isinstance(given, Skeleton) and Path(given).suffix.lower() in (".txt", ".csv", ".tsv"):
        path = _path("skeleton", given)  # names are half a skeleton
        called = tuple(point_names(path, len(names)))
        return Skeleton(name=path.stem, markers=called), called
    skeleton = given if isinstance(given, Skeleton) else read_skeleton(_path("skeleton", given))
    renamed = skeleton.renamed(names)
    try:
        unique("marker", renamed)
    except ValueError as error:
        where = f"skeleton {skeleton.name!r}" if isinstance(given, Skeleton) else given
        raise SkeletonError(f"{where}: after renaming by its aliases, {error}") from None
    try:
        return skeleton.for_markers(renamed, source="the recording"), renamed
    except SkeletonError as error:
        if isinstance(given, Skeleton) or not is_model(Path(given)):
            raise
        raise SkeletonError(f"{error}: first mocap skeleton {given} > {Path(given).stem}.toml, which can") from None


def _with_cameras(
    contents: FileContents, tracks: Path, rig: Path | None, profile: Path | None, unit: str | None
) -> tuple[FileContents, tuple[Camera, ...], tuple[Finding, ...]]:
    """The contents with the unit of the calibration, its cameras with the profile's lenses, and how both were read.

    A given calibration replaces a project's own.
    """
    cameras, where, findings = contents.cameras, tracks.name, tuple[Finding, ...]()
    if contents.pixels is None:
        return contents, cameras, findings
    if rig is not None:
        given = calibration_of(rig)
        given = given if unit is None else given.with_unit(unit)
        if not given.cameras:
            raise FormatError(f"{rig.name}: contains no cameras ({given.format}): give a calibration")
        cameras, where, findings = given.cameras, rig.name, readings(given.assumed, where=rig.name)
        contents = replace(contents, unit=contents.unit or given.unit)
    if len(contents.camera_names) == 1:
        cameras = tuple(camera for camera in cameras if camera.name == contents.camera_names[0]) or cameras
    if cameras:
        check_rig(contents, cameras, tracks.name, where)
    if cameras and profile is not None:
        with as_table(profile) as (table, notes):
            cameras = with_profile(cameras, table)
        findings += readings(notes, where=profile.name)
    return contents, cameras, findings


def check_rig(contents: FileContents, cameras: Sequence[Camera], tracks: str, where: str) -> None:
    """Refuse pixels and cameras that do not belong together.

    Args:
        contents: Pixels.
        cameras: Calibrated cameras.
        tracks: What messages call the pixels.
        where: What messages call the calibration.

    Raises:
        CalibrationError: there is another number of cameras, or one that no rig can have.
    """
    views = contents.camera_names
    if len(cameras) != len(views):
        raise CalibrationError(
            f"{tracks}: {len(views)} cameras, but {where} has coefficients for {len(cameras)}: give the coefficients "
            "of this recording (one column for each camera)"
        )
    check_cameras(cameras, where)


def stored_file(tracks: Path, given: Path | None) -> Path | None:
    """The xyzpts file to audit: the one given, or the sibling of the xypts file, if it is not our own refined one."""
    named = re.sub(r"xypts(?!.*xypts)", "xyzpts", tracks.name, flags=re.IGNORECASE)
    if given is not None or named == tracks.name:
        return given
    alike = sorted(path for path in tracks.parent.iterdir() if path.name.lower() == named.lower())
    there = (path for path in (tracks.with_name(named), *alike) if path.is_file())
    return next((path for path in there if not dltdv.holds_deviations(path)), None)
