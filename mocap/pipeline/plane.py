"""One film without a calibration: markers in the plane of its picture, in pixels or with a stated scale."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from eal.arrays import Array
from mocap.pipeline.recording import Recording
from mocap.pipeline.run import Plane, Run
from mocap.records import MarkerTracks, marker_tracks
from mocap.skeleton import Measures

_SAID = {
    "seen in 3D": "seen",
    "0 cameras": "one film",
    "positions without cameras: their noise": "their noise",
}
"""What a report of positions in space says, and what it says of one film."""
_PIXEL_M = 1e-3
"""A pixel without a scale goes through the chain as a millimetre."""
LEAST_LIKELIHOOD = 0.6
"""Clicks below are rejected: without a second camera nothing tells what a likelihood is worth (DeepLabCut's cutoff)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class InPlane:
    """The clicks of one film as positions whose third coordinate is 0.

    Attributes:
        plane: Unit and scale.
        tracks: The positions.
        findings: Sentences for the report.
    """

    plane: Plane
    tracks: MarkerTracks
    findings: tuple[str, ...]


def in_plane(source: Recording) -> InPlane:
    """The pixels of one film as positions in its picture, in the axes of the file."""
    pixels = source.contents.pixels
    assert pixels is not None
    plane = Plane(mm_per_px=source.mm_per_px)
    uv, told = pixels.uv_px[0], []
    likelihood = source.contents.score
    if likelihood is not None and likelihood.shape == pixels.seen.shape:
        unlikely = pixels.seen[0] & (likelihood[0] < LEAST_LIKELIHOOD)
        uv = np.where(unlikely[..., None], np.nan, uv)
        if unlikely.any():
            told.append(
                f"{unlikely.sum()} clicks ({unlikely.sum() / pixels.seen.sum():.1%}) have a likelihood below "
                f"{LEAST_LIKELIHOOD:g} and were not used"
            )
    flat = np.where(np.isfinite(uv[..., :1]), 0.0, np.nan)
    tracks = marker_tracks(pixels.names, pixels.t_s, plane.unit_m * np.concatenate([uv, flat], axis=-1))
    if plane.mm_per_px is None:
        said = "one film without a calibration: positions are pixels of its picture"
    else:
        said = (
            f"one film without a calibration: positions are in the plane of its picture, {plane.mm_per_px:g} mm per "
            "pixel as stated; what moves nearer to the camera or away from it, or turns out of the plane, is wrong in "
            "proportion"
        )
    told.insert(0, f"{said}; x and y are those of the file, and the lens is not corrected")
    if source.skeleton.bones or source.skeleton.joints or source.skeleton.measures != Measures():
        told.append("bones, joints and measures were not used: lengths and angles in a picture change as they turn")
    return InPlane(plane=plane, tracks=tracks, findings=tuple(told))


def in_units(run: Run, plane: Plane) -> tuple[Array, Array]:
    """(T, M, 2) positions and (T, M, 2, 2) covariances in the unit of the plane."""
    markers = run.tracked.markers
    return plane.per_m * markers.xyz_m[..., :2], plane.per_m**2 * markers.cov_m2[..., :2, :2]


def run_in_plane(run: Run, plane: Plane) -> Run:
    """The run with a report in the unit of the plane."""
    said = {
        key: [f for f in cast(Sequence[str], run.report[key]) if "joints.csv" not in f] for key in ("wrong", "findings")
    }
    report = {**run.report, **said}
    text = "\n".join(line for line in run.report_text.split("\n") if "joints.csv" not in line)
    report, text = _changed(report, _of_one_film), _of_one_film(text)
    if plane.mm_per_px is None:
        report, text = _changed(report, _words), _words(text)
    report["plane"] = {"unit": plane.unit, "mm_per_px": plane.mm_per_px}
    return replace(run, plane=plane, report=report, report_text=text)


def _changed(value: Any, words: Callable[[str], str]) -> Any:
    """A report with other words, and keys that name the unit of pixels where the words do."""
    if isinstance(value, Mapping):
        pixels = words("mm") == "px"
        return {
            re.sub(r"(^|_)mm(_|$)", r"\1px\2", str(k)) if pixels else k: _changed(v, words) for k, v in value.items()
        }
    if isinstance(value, list | tuple):
        return [_changed(v, words) for v in value]
    return words(value) if isinstance(value, str) else value


def _of_one_film(text: str) -> str:
    for said, instead in _SAID.items():
        text = text.replace(said, instead)
    return text


def _words(text: str) -> str:
    """Lengths in a text in pixels, which it states in millimetres and metres."""

    def pixels(found: re.Match[str]) -> str:
        return f"{float(found[1]) / _PIXEL_M:.4g} px{found[2] or ''}"

    text = re.sub(r"(?<![\w.])(\d+(?:\.\d+)?(?:e[+-]?\d+)?) m(/s)?\b", pixels, text)
    return re.sub(r"\bmm\b", "px", text)
