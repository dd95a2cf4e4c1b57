"""A recording in memory, and its pixels converted to ideal (undistorted) ones."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Annotated, get_args

import numpy as np

from eal.arrays import Array
from eal.over_time import Time
from mocap import audit
from mocap.calibration.lens_of_tracks import TrackLens, lens_of_tracks
from mocap.cameras import origin, triangulate
from mocap.cameras.camera import Camera, scaled, stacked
from mocap.errors import CalibrationError, FormatError, MocapError
from mocap.findings import Finding
from mocap.io.contents import FileContents
from mocap.io.optical import UNIT_M
from mocap.io.unstated_unit import of_cameras
from mocap.pipeline import sentences
from mocap.records import MarkerTracks, PixelTracks
from mocap.skeleton import Skeleton
from mocap.stated import check_stated


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Recording:
    """A recording in memory, and what its user states about it, as ``mocap.read`` and ``mocap.from_arrays`` make it.

    Attributes:
        name: Of the recording.
        contents: Pixels or positions with every frame from first to last, markers named as in the skeleton.
        skeleton: What is known of the animal, at least the markers.
        cameras: The C calibrated cameras with their lenses; empty: none are known.
        calibration: What messages call the calibration, where it is given beside the tracks; None: it is not.
        findings: The first findings: how the files were read where they leave that open, and frames that they leave
            out.
        told: How the calibration and the pixels were read.
        file: The file of the tracks; None: they were never in one.
        inputs: All files that the user named.
        stored: Positions in a file of their own that are compared with those of the pixels; None: there are none.
        unit: Unit of lengths, as the user states it.
        pixel_origin: Where pixel rows are counted from.
        calibration_origin: The same for the coefficients.
        image_height_px: Image height for flips.
        pixel_sd: Standard deviation of a pixel; None: estimated.
        correct_lag: Whether cameras that run late by the audit are read between their frames.
        fit_lens: Whether radial distortion is estimated from the recording and corrected.
        mm_per_px: Millimetres a pixel of one film without a calibration; None: its positions are pixels.
    """

    name: str
    contents: FileContents
    skeleton: Skeleton
    cameras: tuple[Camera, ...] = ()
    calibration: str | None = None
    findings: tuple[Finding, ...] = ()
    told: tuple[Finding, ...] = ()
    file: Path | None = None
    inputs: tuple[Path, ...] = ()
    stored: FileContents | None = None
    unit: str | None = None
    pixel_origin: origin.PixelCorner | None = None
    calibration_origin: origin.PixelCorner | None = None
    image_height_px: float | None = None
    pixel_sd: float | None = None
    correct_lag: bool = False
    fit_lens: bool = False
    mm_per_px: float | None = None

    def __post_init__(self) -> None:
        """Check what is stated."""
        for name in ("pixel_sd", "image_height_px", "mm_per_px"):
            check_stated(name, getattr(self, name))
        for name in ("pixel_origin", "calibration_origin"):
            corner, corners = getattr(self, name), get_args(origin.PixelCorner)
            if corner not in (None, *corners):
                raise MocapError(f"`{name.removeprefix('pixel_')}` is {corner!r}, expected {' or '.join(corners)}")
        if self.mm_per_px is not None and not self.planar:
            raise MocapError("`mm_per_px` is the scale of one film without a calibration: leave it out")

    @property
    def where(self) -> str:
        """What messages call it: its file, or its name."""
        return self.name if self.file is None else self.file.name

    @property
    def filmed(self) -> bool:
        """Whether there are cameras, calibrated or not."""
        return self.calibration is not None or self.contents.pixels is not None

    @property
    def planar(self) -> bool:
        """Whether this is one film without a calibration."""
        found = self.contents
        one = found.pixels is not None and len(found.pixels.cameras) == 1
        return one and not self.cameras and self.calibration is None

    def without_needless_calibration(self) -> "Recording":
        """The same, without the calibration where it holds positions and no pixels."""
        return self if self.contents.pixels is not None else replace(self, calibration=None, cameras=())

    def in_unit(self, unit: str) -> "Recording":
        """The same with lengths, which nobody states the unit of, in this one."""
        contents = self.contents.with_unit(unit)
        return replace(self, unit=unit, contents=contents, cameras=scaled(self.cameras, UNIT_M[unit]))

    def summary(self) -> dict[str, str]:
        """What it holds, as a table of words: frames, markers, cameras, the share seen, what is unusual."""
        found = self.contents
        n_frames, seen = len(found.frames), found.seen
        rate = found.fps or 0.0
        there = {
            "file": f"{self.where} ({found.format})",
            "frames": f"{n_frames} ({n_frames / rate:.4g} s at {rate:g} a second)" if rate else str(n_frames),
            "markers": f"{len(found.names)}: {', '.join(found.names)}",
            "cameras": f"{len(found.pixels.cameras)}" if found.pixels is not None else "none: positions",
            "seen": f"{100 * seen.mean():.1f} % of samples" if seen.size else "nothing",
            "unit": self.unit or found.unit or "not stated",
        }
        there |= {} if self.calibration is None else {"calibration": self.calibration}
        there |= {"skeleton": self.skeleton.name} if self.skeleton.bones or self.skeleton.joints else {}
        findings = (*self.findings, *self.told, *found.findings)
        return there | ({"findings": "; ".join(map(str, findings))} if findings else {})

    def __repr__(self) -> str:
        """A line for each entry of the summary."""
        rows = self.summary()
        width = max(map(len, rows))
        return "\n".join([f"<Recording {self.name!r}>", *(f"  {key:{width}}  {text}" for key, text in rows.items())])

    def _repr_html_(self) -> str:
        cells = (f"<tr><th>{escape(key)}</th><td>{escape(text)}</td></tr>" for key, text in self.summary().items())
        return f"<table><caption>{escape(self.name)}</caption>{''.join(cells)}</table>"


@dataclass(frozen=True, eq=False, kw_only=True)
class Filmed:
    """Pixels with their cameras.

    Attributes:
        pixels: As recorded, markers named as in the skeleton.
        cameras: The C cameras.
        pixel_origin: Decision on where rows are counted from.
        ideal_px: (C, T, M, 2) undistorted pixels in the convention of the coefficients.
        late_frames: (C,) offsets that were taken out of ``ideal_px``; None: none was asked to be.
        told: How the calibration and the profile were read, where their text leaves that open.
        lens: What was estimated of the lenses from the pixels themselves and taken out of ``ideal_px``; None: nothing.
    """

    pixels: PixelTracks
    cameras: tuple[Camera, ...]
    pixel_origin: origin.PixelOrigin
    ideal_px: Annotated[Array, Time(1)]
    late_frames: Array | None = None
    told: tuple[Finding, ...] = ()
    lens: TrackLens | None = None

    @property
    def matrices(self) -> Array:
        """(C, 3, 4) projections."""
        return stacked(self.cameras)


def load_points(source: Recording) -> MarkerTracks:
    """The positions of a recording without cameras.

    Raises:
        FormatError: it holds none, or none is ever seen.
    """
    points = source.contents.points
    if points is None:
        raise FormatError(
            f"{source.where}: contains no tracks ({source.contents.format}): give a file of pixels or positions"
        )
    if not points.seen.any():
        raise FormatError(f"{source.where}: no marker is ever seen: there is nothing to track")
    return points


def load_filmed(source: Recording, *, iterations: int | None) -> Filmed:
    """Decide the pixel origin, undistort.

    Args:
        source: A recording with cameras.
        iterations: As in ``BrownLens.undistort``: 3 is what DLTdv does.

    Raises:
        FormatError: it contains no pixels.
        CalibrationError: pixels and coefficients do not belong together, or no sample is seen by two cameras.
    """
    pixels = source.contents.pixels
    if pixels is None:
        raise FormatError(
            f"{source.where}: contains positions ({source.contents.format}), not pixels: give the file of pixels "
            "(2D), or leave the calibration out"
        )
    if not source.cameras:
        project = source.contents.format == "dltdv-project"
        what = "a project without DLT coefficients" if project else "contains pixels without a calibration"
        raise CalibrationError(f"{source.where}: {what}: calibrate, or give `calibration`")
    if len(pixels.cameras) < 2:
        raise CalibrationError(
            f"{source.where}: contains one camera: 3D points need two or more views in one file, or a model of the "
            "animal from recordings with more (mocap learn): give `model`"
        )
    return film_of(
        pixels,
        source.cameras,
        name=source.where,
        iterations=iterations,
        pixel_origin=source.pixel_origin,
        calibration_origin=source.calibration_origin,
        image_height_px=source.image_height_px,
        correct_lag=source.correct_lag,
        usual_origin=source.contents.pixel_origin,
        fit_lens=source.fit_lens,
        told=source.told,
    )


def load_in_unit(source: Recording, *, iterations: int | None) -> tuple[Recording, Filmed]:
    """As ``load_filmed``, with the unit of a calibration that nobody states: by the animal's length, told first of all.

    Raises:
        FormatError: no unit makes it an animal.
    """
    filmed = load_filmed(source, iterations=iterations)
    if (source.unit or source.contents.unit) is not None:
        return source, filmed
    unit, said = of_cameras(filmed.matrices, filmed.ideal_px, where=source.calibration or source.where)
    if unit != "m":
        source = source.in_unit(unit)
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
    told: tuple[Finding, ...] = (),
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
        told: How they were read.

    Raises:
        FormatError: nothing is seen.
        CalibrationError: pixels and coefficients do not belong together, or no sample is seen by two cameras.
    """
    if not pixels.seen.any():
        raise FormatError(f"{name}: no marker is ever seen: there is nothing to track; digitise first")
    if not (pixels.seen.sum(axis=0) >= 2).any():
        raise CalibrationError(f"{name}: no marker is seen by two cameras at once: no point can be triangulated")

    def decided(uv_px: Array) -> origin.PixelOrigin:
        return origin.decide_origin(
            cameras,
            uv_px,
            origin=pixel_origin,
            coefficients=calibration_origin,
            height_px=image_height_px,
            usual=usual_origin,
        )

    try:
        decision = _decided_apart(pixels.uv_px, cameras, decided, correct_lag=correct_lag)
    except CalibrationError as error:
        error.args = (f"{name}: {error}",)
        raise
    ideal = decision.ideal(cameras, pixels.uv_px, iterations=iterations)
    lens, late = None, None
    if fit_lens:
        if any(c.lens is not None for c in cameras):
            raise CalibrationError("`fit_lens`: the cameras have lenses already: leave it out, or leave the lenses out")
        lens = lens_of_tracks(cameras, ideal)
        ideal = lens.straight(ideal)
        told += (sentences.estimated_lens(lens),)
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


def _decided_apart(
    uv_px: Array, cameras: Sequence[Camera], decided: Callable[[Array], origin.PixelOrigin], *, correct_lag: bool
) -> origin.PixelOrigin:
    """The decision on the pixel origin, also of cameras that start apart, where that is asked to be corrected.

    Raises:
        CalibrationError: pixels and coefficients do not belong together; if they do where cameras start at once, it
            says by how much they do not.
    """
    try:
        return decided(uv_px)
    except CalibrationError as error:
        start = audit.start_offsets(stacked(cameras), uv_px)[0]  # lenses move pixels by less than motion does
        if not start.any():
            raise
        with suppress(CalibrationError):  # what was not the cause is not named
            found = decided(audit.moved(uv_px, start))
            if correct_lag:
                return found
            each = ", ".join(f"{c.name} {late:+.0f}" for c, late in zip(cameras, start, strict=True))
            error.args = (f"the cameras start apart, by {each} frames: give `correct_lag`",)
        raise


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


def audit_points(source: Recording, filmed: Filmed) -> tuple[tuple[audit.StalePoint, ...] | None, list[Finding]]:
    """Compare stored points with those that DLTdv's own triangulation gives, before anything is cleaned."""
    beside, where = source.contents, source.where
    if beside.points is None:
        if source.stored is None:
            return None, []
        beside, where = source.stored, source.stored.paths[0].name
    stored = (beside if source.unit is None else beside.with_unit(source.unit)).points
    if stored is None:
        return None, [sentences.stored_points(f"{where} was not compared: it contains no positions ({beside.format})")]
    ideal = filmed.pixel_origin.ideal(filmed.cameras, filmed.pixels.uv_px, iterations=3)
    if not stored.seen.any():
        return None, []
    xyz = triangulate.linear(filmed.matrices, ideal)
    elsewhere = audit.other_world(xyz, stored) if xyz.shape == stored.xyz_m.shape else None
    if elsewhere is not None:
        return None, [sentences.stored_points(f"{where}: {elsewhere.text}")]
    try:
        stale = audit.stale_points(xyz, stored)
    except ValueError as error:
        return None, [sentences.stored_points(f"{where} was not compared: {error}")]
    return tuple(stale), [sentences.compared_points(where, stale, int(stored.seen.sum()))]
