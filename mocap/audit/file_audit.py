"""The audit of a file, or of files that belong together, as it stands there."""

from collections.abc import Sequence
from dataclasses import replace

from eal.arrays import Array
from mocap.audit.audit import audited
from mocap.audit.geometry import camera_findings, fit_findings
from mocap.audit.samples import jump_findings, pixel_findings, point_findings
from mocap.cameras.arrangement import ArrangementError
from mocap.cameras.camera import Camera, undistorted
from mocap.cameras.origin import OriginError, PixelOptions, decide_origin
from mocap.errors import CalibrationError
from mocap.findings import Finding, Kind, alarm, worst_first
from mocap.io.contents import FileContents
from mocap.records import PixelTracks


def audit_recording(recording: FileContents, options: PixelOptions = PixelOptions()) -> list[Finding]:  # noqa: B008
    """All checks of a file, or of files that belong together; alarms first.

    Lengths are judged only where their unit is known.

    Args:
        recording: The file's contents.
        options: What the user states about corners and image height, as ``mocap track`` takes it.
    """
    pixels, points, cameras = recording.pixels, recording.points, recording.cameras
    if not recording.names:  # of angles, forces or cameras alone
        pixels = points = None
    if pixels is None or not cameras or not _meet(pixels, cameras):
        found = [] if pixels is None else pixel_findings(pixels)
        found += [] if len(cameras) < 2 else camera_findings(cameras, y_up=None)
        if points is not None:
            found += point_findings(points, sized=recording.unit is not None)
            found += jump_findings(points.xyz_m, points.t_s, points.names, timed=recording.fps is not None)
        return worst_first(found)
    try:
        decision = decide_origin(cameras, pixels.uv_px, replace(options, usual=recording.pixel_origin))
    except ArrangementError as error:
        arrangement = error.arrangement
        numbers = {"residual_px": arrangement.residual_px, "undone_px": arrangement.undone_px}
        named = alarm(kind=arrangement.kind, text=str(error), numbers=numbers, cameras=arrangement.cameras)
        return [named, *pixel_findings(pixels), *camera_findings(cameras, y_up=None)]
    except CalibrationError as error:
        question = alarm(kind=Kind.PIXEL_ORIGIN, text=str(error), mends=error.mends)
        plain = undistorted(cameras, pixels.uv_px)
        fit = fit_findings(cameras, plain)
        if not isinstance(error, OriginError):  # which has told that the two do not belong together
            fit = [one for one in fit if one.kind is not Kind.FOREIGN_CALIBRATION]
        return worst_first([question, *pixel_findings(pixels), *camera_findings(cameras, y_up=None), *fit])

    def ideal(iterations: int | None) -> Array:
        return decision.ideal(cameras, pixels.uv_px, iterations=iterations)

    found = audited(
        cameras,
        pixels,
        ideal(None),
        decision,
        stored=points,
        stored_px=ideal(3),
        timed=recording.fps is not None,
        sized=recording.unit is not None,
    )
    return [*found.findings]


def _meet(pixels: PixelTracks, cameras: Sequence[Camera]) -> bool:
    """Whether any point is seen by two of the cameras that are calibrated."""
    return len(pixels.cameras) == len(cameras) > 1 and bool((pixels.seen.sum(axis=0) >= 2).any())
