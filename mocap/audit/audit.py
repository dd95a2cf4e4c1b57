"""The whole audit of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eal.arrays import Array
from mocap.audit.corner import origin_finding
from mocap.audit.geometry import (
    HiddenLens,
    applied_lens,
    camera_findings,
    far_apart,
    foreign,
    hidden_lens,
)
from mocap.audit.names import exchanged_in_a_camera
from mocap.audit.offsets import offset_findings
from mocap.audit.samples import Jump, jumps, of_jumps, pixel_findings, sizes
from mocap.audit.stored import stored_findings
from mocap.cameras.camera import Camera, stacked
from mocap.cameras.origin import PixelOrigin
from mocap.cameras.triangulate import linear, residual_px
from mocap.findings import Finding, alarms, worst_first
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
