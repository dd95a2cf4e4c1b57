"""The whole audit of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eal.arrays import Array
from mocap.audit.geometry import (
    HiddenLens,
    applied_lens,
    camera_findings,
    far_apart,
    fit_findings,
    foreign,
    hidden_lens,
)
from mocap.audit.names import exchanged_in_a_camera
from mocap.audit.offsets import offset_findings
from mocap.audit.samples import Jump, jump_findings, jumps, of_jumps, pixel_findings, point_findings, sizes
from mocap.audit.stored import stored_findings
from mocap.cameras.arrangement import ArrangementError
from mocap.cameras.camera import Camera, stacked, undistorted
from mocap.cameras.origin import PixelOptions, PixelOrigin, decide_origin
from mocap.cameras.triangulate import linear, residual_px
from mocap.errors import CalibrationError
from mocap.findings import Finding, Kind, alarm, alarms, worst_first
from mocap.io.contents import FileContents
from mocap.records import MarkerTracks, PixelTracks


@dataclass(frozen=True, kw_only=True)
class Audit:
    """What checks of pixels and cameras find, as numbers and in words.

    Attributes:
        jumps: Markers that jump.
        lens: Distortion that no file states; None: there is none, or cameras do not fit at all.
        findings: All that was found, alarms first.
    """

    jumps: tuple[Jump, ...]
    lens: HiddenLens | None
    findings: tuple[Finding, ...]


def origin_finding(decision: PixelOrigin) -> Finding:
    """Where pixel rows are counted from; an alarm where that was found from their residual, and could be stated."""
    return Finding(
        kind=Kind.PIXEL_ORIGIN,
        alarm=decision.guessed,
        text=decision.describe(),
        numbers={"residual_px": decision.residual_px}
        | ({"next_px": decision.next_px} if decision.next_px < float("inf") else {}),
    )


def audited(
    cameras: Sequence[Camera],
    pixels: PixelTracks,
    ideal_px: Array,
    decision: PixelOrigin,
    *,
    stored: MarkerTracks | None = None,
    stored_px: Array | None = None,
    named_px: Array | None = None,
    timed: bool = True,
    sized: bool = True,
    lens_known: bool = False,
    first: int = 0,
) -> Audit:
    """All checks of pixels, cameras and stored points against each other, and of the pixels alone.

    Args:
        cameras: The C cameras.
        pixels: As in the file.
        ideal_px: (C, T, M, 2) ideal pixels in the convention of the coefficients.
        decision: Where rows are counted from.
        stored: Points that were stored with them; None: there are none.
        stored_px: Ideal pixels as the program that stored the points made them; None: ``ideal_px``.
        named_px: Ideal pixels by the names of the file; None: ``ideal_px``.
        timed: Whether the frame rate is known.
        sized: Whether the unit of lengths is known.
        lens_known: Whether lenses were estimated from these pixels: no other is looked for.
        first: Frames of the recording before these.
    """
    found = [*pixel_findings(pixels), origin_finding(decision)]
    found += camera_findings(cameras, y_up=decision.y_up)
    late = offset_findings(cameras, ideal_px)
    explained = [f for f in late if f.alarm and 3 * f.numbers["after_px"] < f.numbers["before_px"]]
    alien = [] if explained else foreign(cameras, ideal_px)
    hidden = None
    if alien:
        found += alien
    else:
        bare = all(camera.lens is None for camera in cameras)
        hidden = hidden_lens(cameras, pixels.uv_px, decision) if bare and not lens_known else None
        lenses = [] if bare else applied_lens(cameras, pixels.uv_px, decision)
        lenses += [] if hidden is None else [hidden.finding()]
        found += [*late, *lenses, *([] if explained or alarms(lenses) else far_apart(cameras, ideal_px))]
    matrices = stacked(cameras)
    xyz = linear(matrices, ideal_px)
    # points whose rays meet about as those of most points do; NaN else
    miss = residual_px(matrices, ideal_px, xyz)
    usual = np.nanmedian(miss) if np.isfinite(miss).any() else np.nan
    believed = np.where((miss <= 5 * usual)[..., None], xyz, np.nan)
    named = ideal_px if named_px is None else named_px
    found += exchanged_in_a_camera(matrices, named, pixels.names, [c.name for c in cameras])
    jumped = jumps(believed, pixels.t_s)
    found += [*(sizes(xyz) if sized else []), *of_jumps(jumped, pixels.names, timed=timed, first=first)]
    if stored is not None and stored.xyz_m.shape[:2] == ideal_px.shape[1:3]:
        solved = ideal_px if stored_px is None else stored_px
        found += stored_findings(matrices, solved, stored, cameras=[c.name for c in cameras])
    return Audit(jumps=jumped, lens=hidden, findings=tuple(worst_first(found)))


def _meet(pixels: PixelTracks, cameras: Sequence[Camera]) -> bool:
    """Whether any point is seen by two of the cameras that are calibrated."""
    return len(pixels.cameras) == len(cameras) > 1 and bool((pixels.seen.sum(axis=0) >= 2).any())


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
        rest = [*pixel_findings(pixels), *camera_findings(cameras, y_up=None), *fit_findings(cameras, plain)]
        return worst_first([question, *rest])

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
