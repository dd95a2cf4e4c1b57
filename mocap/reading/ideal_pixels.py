"""What pixels and cameras tell of each other: where rows are counted from, the unit, lenses and lags; ideal pixels."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from eal.arrays import Array
from mocap.audit.corner import origin_finding
from mocap.audit.offsets import estimate_offsets, in_step, late_cameras, moved, start_offsets
from mocap.cameras.camera import Camera, scaled, stacked
from mocap.cameras.lens_of_tracks import TrackLens, lens_of_tracks
from mocap.cameras.origin import PixelOptions, PixelOrigin, decide_origin, origin_alone
from mocap.errors import CalibrationError, FormatError
from mocap.findings import Finding, Kind
from mocap.io.lines import UNIT_M
from mocap.io.unstated_unit import of_cameras
from mocap.reading.decided import decided
from mocap.recording import Recording, Source, dataset
from mocap.records import PixelTracks
from mocap.skeleton import Skeleton


def with_ideal_pixels(recording: Recording, options: PixelOptions) -> Recording:
    """Decide where pixels are counted from and the unit of the calibration, and take out lenses and lags.

    What has no cameras or pixels stays as it is.

    Args:
        recording: As its files are.
        options: What is stated of its pixels.

    Raises:
        FormatError: no unit makes it an animal.
        CalibrationError: pixels and coefficients do not belong together, or what was to be estimated cannot be.
        OriginError: the pixels do not tell where they are counted from.
    """
    if recording.pixels is None or not recording.seen.any():
        return recording
    alone = of_one_camera(recording)
    if alone or recording.planar:
        for name in ("fit_lens", "correct_lag"):
            if getattr(options, name):
                raise CalibrationError(f"`{name}`: needs markers that two cameras see: leave it out")
    if not recording.cameras:
        return recording
    if alone:
        return _alone(recording, options)
    own = without_hand(recording)
    found = _together(own, options)
    if (recording.source.unit or recording.data.attrs.get("space_unit")) is None:
        unit, assumed = of_cameras(found.matrices, found.ideal_px, where=recording.calibration or recording.where)
        if unit != "m":
            found = _together(replace(own, cameras=scaled(own.cameras, UNIT_M[unit])), options)
        if assumed:
            how = replace(decided(found), unit=unit, unit_from="assumed", assumed_unit=assumed[0])
            found = replace(found, data=found.data.assign_attrs(space_unit=unit)).with_part(how)
    return found.having(pixels=recording.data["pixels"].values) if own is not recording else found


def of_pixels(
    pixels: PixelTracks,
    cameras: Sequence[Camera],
    skeleton: Skeleton | None = None,
    *,
    name: str,
    score: Array | None = None,
    options: PixelOptions = PixelOptions(),  # noqa: B008
    **stated: object,
) -> Recording:
    """A recording of pixels that are in memory, decided as ``mocap.read`` decides files.

    Args:
        pixels: As digitised, named as the skeleton names them.
        cameras: Their cameras, in the same order.
        skeleton: What is known of the animal; None: the markers.
        name: Of the recording.
        score: (C, T, M) the clicking program's own likelihood of each click; None: it states none.
        options: What is stated of the pixels.
        **stated: Fields of ``Source``.
    """
    animal = Skeleton(name="markers only", markers=pixels.names) if skeleton is None else skeleton
    data = dataset(pixels.names, pixels.t_s, pixels=pixels, score=score, space_unit="m")
    source = Source(**stated)  # type: ignore[arg-type]
    made = Recording(name=name, data=data, skeleton=animal, cameras=tuple(cameras), source=source)
    return with_ideal_pixels(made, options)


def without_hand(recording: Recording) -> Recording:
    """The recording with the pixels of its file where a person placed markers; exchanges and deletions stay.

    Where the file shows no point by itself, all that a person placed stays, too.
    """
    if not recording.by_hand.any():
        return recording
    uv, own = recording.data["pixels"].values, recording.data["overruled"].values
    rest = np.where(recording.by_hand[..., None], own, uv)
    return recording.having(pixels=rest) if (np.isfinite(rest[..., 0]).sum(axis=0) >= 2).any() else recording


def of_one_camera(recording: Recording) -> bool:
    """Whether there are calibrated cameras of which no two see a marker at once."""
    pixels = recording.pixels if recording.cameras else None
    return pixels is not None and bool(pixels.seen.any()) and not (pixels.seen.sum(axis=0) >= 2).any()


def with_rays(recording: Recording) -> Recording:
    """The recording, refused where not two calibrated cameras see something at once.

    Raises:
        FormatError: it contains no pixels, or nothing is seen.
        CalibrationError: there is no calibration, or no sample is seen by two cameras.
    """
    where, pixels = recording.where, recording.pixels
    if pixels is None:
        raise FormatError(
            f"{where}: contains positions ({recording.format}), not pixels: give the file of pixels "
            "(2D), or leave the calibration out"
        )
    if not recording.cameras:
        project = recording.format == "dltdv-project"
        what = "a project without DLT coefficients" if project else "contains pixels without a calibration"
        raise CalibrationError(f"{where}: {what}: calibrate, or give `calibration`")
    if len(pixels.cameras) < 2:
        raise CalibrationError(
            f"{where}: contains one camera: 3D points need two or more views in one file, or a model of the "
            "animal from recordings with more (mocap learn): give `model`"
        )
    if not pixels.seen.any():
        raise FormatError(f"{where}: no marker is ever seen: there is nothing to track; digitise first")
    if of_one_camera(recording):
        raise CalibrationError(f"{where}: no marker is seen by two cameras at once: no point can be triangulated")
    return recording


def without_lens(recording: Recording, uv_px: Array, *, iterations: int | None = None) -> Array:
    """Pixels of a recording without lenses, in the convention of the coefficients, as was decided of the whole.

    Args:
        recording: With what ``with_ideal_pixels`` decided.
        uv_px: (C, ..., 2) pixels.
        iterations: As in ``BrownLens.undistort``: 3 is what DLTdv does.
    """
    how = decided(recording)
    assert how.rows is not None
    ideal = how.rows.ideal(recording.cameras, uv_px, iterations=iterations)
    return ideal if how.lens is None else how.lens.straight(ideal)


def straightened(recording: Recording, uv_px: Array) -> Array:
    """(C, T, M, 2) pixels of a recording as ideal ones, by what ``with_ideal_pixels`` decided of the whole."""
    late, ideal = recording.late_frames, without_lens(recording, uv_px)
    return ideal if late is None else in_step(ideal, late)


def _alone(recording: Recording, options: PixelOptions) -> Recording:
    """Where pixels are counted from is stated or taken as usual: nothing can tell from one camera."""
    rows = origin_alone(recording.cameras, options)
    ideal = rows.ideal(recording.cameras, recording.data["pixels"].values)
    known = options.origin or options.usual or all(camera.lens is None for camera in recording.cameras)
    how = decided(recording)
    told = () if known else (_unknown_corner(rows.pixels),)
    film = _counted(recording.having(ideal=ideal), rows)
    return film.with_part(replace(how, rows=rows, of_pixels=(*how.of_pixels, *told)))


def _counted(recording: Recording, rows: PixelOrigin) -> Recording:
    """The recording, which knows whether the rows of its ideal pixels run up."""
    return replace(recording, data=recording.data.assign_attrs(y_up=int(rows.coefficients == "lower-left")))


def _together(recording: Recording, options: PixelOptions) -> Recording:
    cameras, uv_px = recording.cameras, recording.data["pixels"].values
    try:
        rows = _decided_apart(uv_px, cameras, options)
    except CalibrationError as error:
        error.args = (f"{recording.where}: {error}",)
        raise
    how = decided(recording)
    ideal, findings, lens, late = rows.ideal(cameras, uv_px), how.of_pixels, None, None
    if options.fit_lens:
        if any(c.lens is not None for c in cameras):
            raise CalibrationError("`fit_lens`: the cameras have lenses already: leave it out, or leave the lenses out")
        lens = lens_of_tracks(cameras, ideal)
        ideal = lens.straight(ideal)
        findings += (_estimated_lens(lens),)
    if options.correct_lag and (lags := estimate_offsets(stacked(cameras), ideal)) is not None:
        late = late_cameras(lags)
        ideal = in_step(ideal, late)
    found = recording.having(ideal=ideal) if late is None else recording.having(ideal=ideal, late=late)
    told = (*findings, origin_finding(rows))
    return _counted(found, rows).with_part(replace(how, rows=rows, lens=lens, of_pixels=told))


def _decided_apart(uv_px: Array, cameras: Sequence[Camera], options: PixelOptions) -> PixelOrigin:
    """The decision on the pixel origin, also of cameras that start apart, where that is asked to be corrected.

    Raises:
        CalibrationError: pixels and coefficients do not belong together; if they do where cameras start at once, it
            says by how much they do not.
    """
    try:
        return decide_origin(cameras, uv_px, options)
    except CalibrationError as error:
        start = start_offsets(stacked(cameras), uv_px)[0]  # lenses move pixels by less than motion does
        if not start.any():
            raise
        with suppress(CalibrationError):  # what was not the cause is not named
            found = decide_origin(cameras, moved(uv_px, start), options)
            if options.correct_lag:
                return found
            each = ", ".join(f"{c.name} {late:+.0f}" for c, late in zip(cameras, start, strict=True))
            error.args = (f"the cameras start apart, by {each} frames: give `correct_lag`",)
            error.mends = ("correct_lag",)
        raise


def _estimated_lens(lens: TrackLens) -> Finding:
    """A lens that was estimated from the recording."""
    return Finding(
        kind=Kind.LENS,
        text=f"the lens was estimated from the recording itself: {lens.words}; median residual of stretches that the "
        f"fit did not see {lens.before_px:.2f} px before, {lens.after_px:.2f} px after; the result's "
        "camera_profile.txt holds it, for other trials of these cameras and for one camera (`profile`)",
    )


def _unknown_corner(corner: str) -> Finding:
    """Where pixels of one camera are taken to be counted from."""
    text = f"pixels were taken to be counted from the {corner} corner, which one camera cannot tell: state `origin`"
    return Finding(kind=Kind.PIXEL_ORIGIN, text=text, mends=("origin",))
