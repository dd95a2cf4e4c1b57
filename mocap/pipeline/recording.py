"""The files of a recording, read and converted to ideal (undistorted) pixels."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from pathlib import Path

import numpy as np

from eal.arrays import Array, unique
from mocap import audit
from mocap.calibration.lens_of_tracks import TrackLens, lens_of_tracks
from mocap.cameras import origin, triangulate
from mocap.cameras.camera import Camera, check_cameras, stacked
from mocap.errors import CalibrationError, FormatError, MocapError, NoRateError, SkeletonError
from mocap.io import dltdv
from mocap.io.contents import FileContents
from mocap.io.every_frame import every_frame
from mocap.io.format import Hints
from mocap.io.profile import with_profile
from mocap.io.registry import as_table, read
from mocap.io.together import joined
from mocap.io.unstated_unit import in_metres, of_cameras
from mocap.pipeline.whole_picture import counted_from_one, in_whole_picture
from mocap.records import MarkerTracks, PixelTracks
from mocap.skeleton import Skeleton, read_skeleton
from mocap.stated import check_rate, check_stated
from mocap.text import as_text


@dataclass(frozen=True, kw_only=True, repr=False)
class Recording:
    """The files of one recording, and what their user states about them.

    Attributes:
        tracks: Pixels or positions, of any format; a project of DLTdv8 holds its cameras too.
        fps: Frames a second; None: as the file says.
        calibration: Calibration, of any format; None: ``tracks`` holds it, or positions.
        profile: Camera profile.
        skeleton: Skeleton TOML.
        pixel_origin: Where pixel rows are counted from.
        calibration_origin: The same for the coefficients.
        image_height_px: Image height for flips.
        stored_points: xyzpts to audit; None: the file beside ``tracks`` that is named so.
        pixel_sd: Standard deviation of a pixel; None: estimated.
        unit: Unit of lengths, where the files do not state it; None: metres.
        correct_lag: Whether cameras that run late by the audit are read between their frames.
        hints: What else the user states of ``tracks``: columns, format, number of cameras, sheet.
        views: Further pixel files of the same trial, where each holds one camera; their calibration, too.
        crop: Files or folders with crop offsets (``mocap.io.crop``); empty: those beside the tracks, if any.
        mm_per_px: Millimetres a pixel of one film without a calibration; None: its positions are pixels.
        fit_lens: Whether radial distortion is estimated from the recording and corrected.
    """

    tracks: Path
    fps: float | None = None
    calibration: Path | None = None
    profile: Path | None = None
    skeleton: Path | None = None
    pixel_origin: origin.PixelCorner | None = None
    calibration_origin: origin.PixelCorner | None = None
    image_height_px: float | None = None
    stored_points: Path | None = None
    pixel_sd: float | None = None
    unit: str | None = None
    correct_lag: bool = False
    hints: Hints = field(default_factory=Hints)
    views: tuple[Path, ...] = ()
    crop: tuple[Path, ...] = ()
    mm_per_px: float | None = None
    fit_lens: bool = False

    def __post_init__(self) -> None:
        """Check what is stated."""
        stated = {"fps": self.fps, "pixel_sd": self.pixel_sd, "image_height_px": self.image_height_px}
        stated["mm_per_px"] = self.mm_per_px
        for name, value in stated.items():
            check_stated(name, value)
        cameras = {"profile": self.profile, "origin": self.pixel_origin, "calibration_origin": self.calibration_origin}
        for name, value in cameras.items():
            if value is not None and self.calibration is None and self.tracks.suffix.lower() in (".csv", ".tsv"):
                raise MocapError(f"`{name}` concerns cameras, but no calibration is given: give `calibration`")

    @cached_property
    def _read(self) -> tuple[FileContents, tuple[str, ...]]:
        recording = self._whole()
        recording, told = in_metres(recording, self.unit)
        if self.fps is None and recording.fps is None:
            raise NoRateError(f"{self.tracks.name}: the frame rate is not in the file: give `fps`")
        if self.fps is None and recording.fps is not None:
            check_rate(recording.fps, self.tracks.name)
        recording, left_out = every_frame(recording if self.fps is None else recording.with_rate(self.fps))
        return recording, (*told, *recording.assumed, *left_out)

    def _whole(self) -> FileContents:
        """The tracks, with those of further views in the order of the calibration where names tell."""
        if not self.views:
            return read(self.tracks, self.hints)
        files = [read(path, self.hints) for path in (self.tracks, *self.views)]
        other = next((f for f in files if f.pixels is None and not f.cameras and not f.lenses), None)
        if other is not None:
            raise FormatError(
                f"{other.paths[0].name}: contains no pixels and no calibration ({other.format}); several files of one "
                "trial must each contain the pixels of one camera, or their calibration"
            )
        if self.calibration is None:
            return joined(files)
        cameras = _calibration(self.calibration)
        files.append(replace(cameras, names=(), frames=np.zeros(0, np.int64), pixels=None, points=None, lenses=()))
        return replace(joined(files), cameras=(), unit=None)

    @property
    def contents(self) -> FileContents:
        """What the file of the tracks holds, with every frame from first to last.

        Raises:
            FormatError: it cannot be read.
            MocapError: neither the file nor the user states the frame rate.
        """
        return self._read[0]

    @property
    def frame_findings(self) -> tuple[str, ...]:
        """The first findings: how the file was read where it leaves that open, and frames that it leaves out."""
        return self._read[1]

    @property
    def filmed(self) -> bool:
        """Whether there are cameras, calibrated or not."""
        return self.calibration is not None or self.contents.pixels is not None

    @property
    def planar(self) -> bool:
        """Whether this is one film without a calibration.

        Raises:
            MocapError: a scale is stated for something else.
        """
        found = self.contents
        one = found.pixels is not None and len(found.pixels.cameras) == 1 and not found.cameras
        if self.mm_per_px is not None and not (one and self.calibration is None):
            raise MocapError("`mm_per_px` is the scale of one film without a calibration: leave it out")
        return one and self.calibration is None

    def without_needless_calibration(self) -> "Recording":
        """The same, without the calibration where the file holds positions and no pixels."""
        return self if self.contents.pixels is not None else replace(self, calibration=None)

    @property
    def inputs(self) -> tuple[Path | None, ...]:
        """The files that the user named."""
        named = (self.tracks, *self.views, self.calibration, self.profile, self.skeleton, self.stored_points)
        return (*named, *(path for path in self.crop if path.is_file()))

    def summary(self) -> dict[str, str]:
        """What it holds, as a table of words: frames, markers, cameras, the share seen, what is unusual."""
        found = self.contents
        n_frames, seen = len(found.frames), found.seen
        rate = found.fps or 0.0
        there = {
            "file": f"{self.tracks.name} ({found.format})",
            "frames": f"{n_frames} ({n_frames / rate:.4g} s at {rate:g} a second)" if rate else str(n_frames),
            "markers": f"{len(found.names)}: {', '.join(found.names)}",
            "cameras": f"{len(found.pixels.cameras)}" if found.pixels is not None else "none: positions",
            "seen": f"{100 * seen.mean():.1f} % of samples" if seen.size else "nothing",
            "unit": self.unit or found.unit or "not stated",
        }
        for title, path in (("calibration", self.calibration), ("skeleton", self.skeleton), ("profile", self.profile)):
            if path is not None:
                there[title] = path.name
        if self.crop:
            there["crop offsets"] = ", ".join(path.name for path in self.crop)
        stated = {"the file does not state the frame rate"} if self.fps else set()
        findings = [f for f in (*self.frame_findings, *found.findings) if f not in stated]
        return there | ({"findings": "; ".join(findings)} if findings else {})

    def __repr__(self) -> str:
        """A line for each entry of the summary."""
        rows = self.summary()
        width = max(map(len, rows))
        return "\n".join([f"<Recording {self.name!r}>", *(f"  {key:{width}}  {text}" for key, text in rows.items())])

    def _repr_html_(self) -> str:
        cells = (f"<tr><th>{escape(key)}</th><td>{escape(text)}</td></tr>" for key, text in self.summary().items())
        return f"<table><caption>{escape(self.name)}</caption>{''.join(cells)}</table>"

    @property
    def name(self) -> str:
        """Name of the recording, from that of the file."""
        stem = as_text(self.tracks.stem)
        return re.sub(r"xyz?pts$", "", stem, flags=re.IGNORECASE).rstrip("_-. ") or stem


@dataclass(frozen=True, eq=False, kw_only=True)
class Filmed:
    """Pixels with their cameras.

    Attributes:
        pixels: As recorded, markers named as in the skeleton.
        cameras: The C cameras.
        pixel_origin: Decision on where rows are counted from.
        ideal_px: (C, T, M, 2) undistorted pixels in the convention of the coefficients.
        late_frames: (C,) offsets that were taken out of ``ideal_px``; None: none was asked to be.
        told: Sentences on how the calibration and the profile were read, where their text leaves that open.
        lens: What was estimated of the lenses from the pixels themselves and taken out of ``ideal_px``; None: nothing.
    """

    pixels: PixelTracks
    cameras: tuple[Camera, ...]
    pixel_origin: origin.PixelOrigin
    ideal_px: Array
    late_frames: Array | None = None
    told: tuple[str, ...] = ()
    lens: TrackLens | None = None

    @property
    def matrices(self) -> Array:
        """(C, 3, 4) projections."""
        return stacked(self.cameras)


def load_skeleton(path: Path | None, names: Sequence[str]) -> tuple[Skeleton, tuple[str, ...]]:
    """The skeleton, and the file's marker names in its terms; without a file a skeleton of markers only.

    Raises:
        SkeletonError: the skeleton cannot be read, or uses markers that the recording lacks.
    """
    if path is None:
        return Skeleton(name="markers only", markers=tuple(names)), tuple(names)
    skeleton = read_skeleton(path)
    renamed = skeleton.renamed(names)
    try:
        unique("marker", renamed)
    except ValueError as error:
        raise SkeletonError(f"{path}: after renaming by its aliases, {error}") from None
    return skeleton.for_markers(renamed, source="the recording"), renamed


def _pixels_and_cameras(source: Recording) -> tuple[PixelTracks, tuple[Camera, ...], str, tuple[str, ...]]:
    """Pixels, cameras, the file these are from, and how it was read; a given calibration replaces a project's own."""
    recording = source.contents
    if recording.pixels is None:
        raise FormatError(
            f"{source.tracks.name}: contains positions ({recording.format}), not pixels: give the file of pixels "
            "(2D), or leave the calibration out"
        )
    if source.calibration is not None:
        calibration = _calibration(source.calibration)
        calibration = calibration if source.unit is None else calibration.with_unit(source.unit)
        if not calibration.cameras:
            raise FormatError(
                f"{source.calibration.name}: contains no cameras ({calibration.format}): give a calibration"
            )
        told = tuple(f"{source.calibration.name}: {said}" for said in calibration.assumed)
        return recording.pixels, calibration.cameras, source.calibration.name, told
    if not recording.cameras:
        project = recording.format == "dltdv-project"
        what = "a project without DLT coefficients" if project else "contains pixels without a calibration"
        raise CalibrationError(f"{source.tracks.name}: {what}: calibrate, or give `calibration`")
    return recording.pixels, recording.cameras, source.tracks.name, ()


def _calibration(path: Path) -> FileContents:
    try:
        return read(path)
    except FormatError:
        if path.suffix.lower() in (".csv", ".xlsx"):
            with as_table(path) as (table, _):
                dltdv.read_coefficients(table)  # says what is wrong with them
        raise


def load_points(source: Recording) -> MarkerTracks:
    """The positions of a source without cameras.

    Raises:
        FormatError: it holds none.
    """
    recording = source.contents
    if recording.points is None:
        raise FormatError(
            f"{source.tracks.name}: contains no tracks ({recording.format}): give a file of pixels or positions"
        )
    return recording.points


def load_filmed(source: Recording, *, iterations: int | None) -> Filmed:
    """Read pixels and cameras, decide the pixel origin, undistort.

    Args:
        source: Files, with cameras.
        iterations: As in ``BrownLens.undistort``: 3 is what DLTdv does.

    Raises:
        FormatError: a file cannot be read.
        CalibrationError: pixels and coefficients do not belong together, or no sample is seen by two cameras.
    """
    pixels, cameras, told = calibrated_pixels(source)
    if len(pixels.cameras) < 2:
        raise CalibrationError(
            f"{source.tracks.name}: contains one camera: 3D points need two or more views in one file, or a model of "
            "the animal from recordings with more (mocap learn): give `model`"
        )
    return film_of(
        pixels,
        cameras,
        name=source.tracks.name,
        iterations=iterations,
        pixel_origin=source.pixel_origin,
        calibration_origin=source.calibration_origin,
        image_height_px=source.image_height_px,
        correct_lag=source.correct_lag,
        usual_origin=source.contents.pixel_origin,
        fit_lens=source.fit_lens,
        told=told,
    )


def calibrated_pixels(source: Recording) -> tuple[PixelTracks, tuple[Camera, ...], tuple[str, ...]]:
    """Pixels as recorded, the camera of each view with its lens, and sentences on how they were read.

    Raises:
        FormatError: a file cannot be read.
        CalibrationError: pixels and coefficients do not belong together.
    """
    pixels, cameras, where, told = _pixels_and_cameras(source)
    if len(pixels.cameras) == 1:
        named = [camera for camera in cameras if camera.name == pixels.cameras[0]]
        cameras = tuple(named) if len(named) == 1 else cameras
    if len(cameras) != len(pixels.cameras):
        raise CalibrationError(
            f"{source.tracks.name}: {len(pixels.cameras)} cameras, but {where} has coefficients for "
            f"{len(cameras)}: give the coefficients of this recording (one column for each camera)"
        )
    check_cameras(cameras, where)
    if source.profile is not None:
        with as_table(source.profile) as (profile, said):
            cameras = with_profile(cameras, profile)
        told += tuple(f"{source.profile.name}: {s}" for s in said)
    pixels, counted = counted_from_one(source, pixels)
    pixels, cropped = in_whole_picture(source, pixels, cameras)
    return pixels, cameras, told + counted + cropped


def load_in_unit(source: Recording, *, iterations: int | None) -> tuple[Recording, Filmed]:
    """As ``load_filmed``, with the unit of a calibration that nobody states: by the animal's length, told first of all.

    Raises:
        FormatError: no unit makes it an animal.
    """
    filmed = load_filmed(source, iterations=iterations)
    stated = source.unit or source.contents.unit
    if stated is None and source.calibration is not None:
        stated = _calibration(source.calibration).unit
    if stated is not None:
        return source, filmed
    unit, said = of_cameras(filmed.matrices, filmed.ideal_px, where=(source.calibration or source.tracks).name)
    if unit != "m":
        source = replace(source, unit=unit)
        filmed = load_filmed(source, iterations=iterations)
    return source, replace(filmed, told=(*said, *filmed.told))


def film_of(
    pixels: PixelTracks,
    cameras: Sequence[Camera],
    *,
    name: str,
    iterations: int | None = None,
    pixel_origin: origin.PixelCorner | None = None,
    calibration_origin: origin.PixelCorner | None = None,
    image_height_px: float | None = None,
    correct_lag: bool = False,
    usual_origin: origin.PixelCorner | None = None,
    fit_lens: bool = False,
    told: tuple[str, ...] = (),
) -> Filmed:
    """Pixels and cameras that are in memory: decide the pixel origin, undistort.

    Args:
        pixels: As recorded, C cameras.
        cameras: The C cameras.
        name: What errors call them.
        iterations: As in ``BrownLens.undistort``: 3 is what DLTdv does.
        pixel_origin: As in ``Recording``, as are the three that follow.
        calibration_origin: See above.
        image_height_px: See above.
        correct_lag: See above.
        usual_origin: Where the program that wrote the file counts pixels from.
        fit_lens: As in ``Recording``.
        told: Sentences on how they were read.

    Raises:
        FormatError: nothing is seen.
        CalibrationError: pixels and coefficients do not belong together, or no sample is seen by two cameras.
    """
    if not pixels.seen.any():
        raise FormatError(f"{name}: no marker is ever seen: there is nothing to track; digitise first")
    if not (pixels.seen.sum(axis=0) >= 2).any():
        raise CalibrationError(f"{name}: no marker is seen by two cameras at once: no point can be triangulated")
    try:
        decision = origin.decide_origin(
            cameras,
            pixels.uv_px,
            origin=pixel_origin,
            coefficients=calibration_origin,
            height_px=image_height_px,
            usual=usual_origin,
        )
    except CalibrationError as error:
        error.args = (f"{name}: {error}",)
        raise
    ideal = origin.ideal_pixels(
        cameras,
        pixels.uv_px,
        pixels=decision.pixels,
        coefficients=decision.coefficients,
        height_px=decision.height_px,
        iterations=iterations,
    )
    lens, late = None, None
    if fit_lens:
        if any(c.lens is not None for c in cameras):
            raise CalibrationError("`fit_lens`: the cameras have lenses already: leave it out, or leave the lenses out")
        lens = lens_of_tracks(cameras, ideal)
        ideal = lens.straight(ideal)
        told += (
            f"the lens was estimated from the recording itself: {lens.words}; median residual of stretches that the "
            f"fit did not see {lens.before_px:.2f} px before, {lens.after_px:.2f} px after",
        )
    if correct_lag and (found := audit.estimate_offsets(stacked(cameras), ideal)) is not None:
        late = audit.late_cameras(found)
        ideal = audit.in_step(ideal, late)
    return Filmed(
        pixels=pixels,
        cameras=tuple(cameras),
        pixel_origin=decision,
        ideal_px=ideal,
        late_frames=late,
        told=told,
        lens=lens,
    )


def by_pixels(filmed: Filmed, stated_px: float | None, relative: Array | float = 1.0) -> tuple[float, float | None]:
    """What rays show of the pixel noise, and the deviation to reject by: never below that, whatever is stated.

    Args:
        filmed: Pixels and cameras.
        stated_px: Standard deviation that the user states; None: nothing, and ``triangulate.robust`` finds its own.
        relative: Deviations of rays relative to it, broadcastable to (C, T, M).
    """
    if stated_px is None:
        return np.nan, None
    shown = triangulate.apparent_sd(filmed.matrices, filmed.ideal_px, relative=np.asarray(relative))
    return shown, max(stated_px, shown)


def stored_points(source: Recording) -> Path | None:
    """The xyzpts file to audit: the one given, or the sibling of the xypts file, if it is not our own refined one."""
    named = re.sub(r"xypts(?!.*xypts)", "xyzpts", source.tracks.name, flags=re.IGNORECASE)
    if source.stored_points is not None or named == source.tracks.name:
        return source.stored_points
    alike = sorted(path for path in source.tracks.parent.iterdir() if path.name.lower() == named.lower())
    there = (path for path in (source.tracks.with_name(named), *alike) if path.is_file())
    return next((path for path in there if not dltdv.holds_deviations(path)), None)


def audit_points(source: Recording, filmed: Filmed) -> tuple[tuple[audit.StalePoint, ...] | None, list[str]]:
    """Compare stored points with those that DLTdv's own triangulation gives, before anything is cleaned."""
    path = source.tracks if source.contents.points is not None else stored_points(source)
    if path is None:
        return None, []
    beside = source.contents if path is source.tracks else read(path)
    stored = (beside if source.unit is None else beside.with_unit(source.unit)).points
    if stored is None:
        return None, [f"{path.name} was not compared: it contains no positions ({beside.format})"]
    decision = filmed.pixel_origin
    ideal = origin.ideal_pixels(
        filmed.cameras,
        filmed.pixels.uv_px,
        pixels=decision.pixels,
        coefficients=decision.coefficients,
        height_px=decision.height_px,
        iterations=3,
    )
    if not stored.seen.any():
        return None, []
    xyz = triangulate.linear(filmed.matrices, ideal)
    elsewhere = audit.other_world(xyz, stored) if xyz.shape == stored.xyz_m.shape else None
    if elsewhere is not None:
        return None, [f"{path.name}: {elsewhere.text}"]
    try:
        stale = audit.stale_points(xyz, stored)
    except ValueError as error:
        return None, [f"{path.name} was not compared: {error}"]
    total = int(stored.seen.sum())
    if not stale:
        return (), [f"{path.name}: all {total} stored points agree with the triangulation of the pixels"]
    worst = max((s.off_m for s in stale if s.off_m is not None), default=0.0)
    why = (
        "out of date"
        if 2 * len(stale) < total
        else "of another calibration or lens than this one, of other pixels, or smoothed"
    )
    return tuple(stale), [
        f"{path.name}: {len(stale)} of {total} stored points differ from the triangulation of the pixels (by up to "
        f"{worst * 1e3:.1f} mm): they are {why}, and were computed again"
    ]
