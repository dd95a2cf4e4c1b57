"""Recordings of which any stretch of frames can be had by itself: what is tracked in blocks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from eal.over_time import at_frames
from mocap.findings import Finding
from mocap.io.parquet_range import ParquetPoints
from mocap.pipeline.prepare import Prepared, prepare_filmed, prepare_tracks
from mocap.pipeline.reading import animal
from mocap.pipeline.recording import Filmed, Recording, load_in_unit, load_points
from mocap.pipeline.sentences import pixel_origin
from mocap.records import MarkerTracks, Status
from mocap.skeleton import Skeleton
from mocap.text import as_text

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class LongRecording:
    """A recording in stretches.

    Attributes:
        name: Of the recording.
        skeleton: Its skeleton.
        names: The M markers, named as in the skeleton.
        t_s: (T,) times.
        seen: Frames to (n, M) True where a position, or two rays, are given; nothing is cleaned.
        prepared: Frames to what is prepared of them (``mocap.pipeline.prepare``), its findings with their numbers here.
        findings: On how the file was read.
    """

    name: str
    skeleton: Skeleton
    names: tuple[str, ...]
    t_s: Array
    seen: Callable[[slice], Mask]
    prepared: Callable[[slice], Prepared]
    findings: tuple[Finding, ...] = ()

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.t_s)

    @property
    def dt_s(self) -> float:
        """Time step."""
        return float(self.t_s[1] - self.t_s[0]) if len(self.t_s) > 1 else 1.0


def long_points(
    tracks: MarkerTracks, skeleton: Skeleton, *, name: str, findings: Sequence[Finding] = ()
) -> LongRecording:
    """Positions that are in memory, or mapped into it from a file.

    Args:
        tracks: Positions, named as the skeleton names them.
        skeleton: What is known of the animal.
        name: Of the recording.
        findings: On how they were read.
    """
    stretch = partial(at_frames, tracks)
    return long_tracks(stretch, skeleton, name=name, t_s=tracks.t_s, names=tracks.names, findings=findings)


def long_pixels(
    filmed: Filmed,
    skeleton: Skeleton,
    *,
    name: str,
    pixel_sd: float | None = None,
    likelihood: Array | None = None,
    findings: Sequence[Finding] = (),
) -> LongRecording:
    """Pixels of calibrated cameras that are in memory; where they are counted from was decided on all of them.

    Args:
        filmed: Pixels, named as the skeleton names them, and cameras.
        skeleton: What is known of the animal.
        name: Of the recording.
        pixel_sd: Standard deviation of a pixel that the user states; None: estimated in each stretch.
        likelihood: (C, T, M) likelihoods of clicks; None: there are none.
        findings: On how they were read.
    """

    def part(frames: slice) -> Prepared:
        return prepare_filmed(
            at_frames(filmed, frames),
            skeleton,
            first=frames.start,
            name=name,
            pixel_sd=pixel_sd,
            likelihood=None if likelihood is None else likelihood[:, frames],
        )

    return LongRecording(
        name=name,
        skeleton=skeleton,
        names=filmed.pixels.names,
        t_s=filmed.pixels.t_s,
        seen=lambda frames: np.isfinite(filmed.ideal_px[:, frames, :, 0]).sum(axis=0) >= 2,
        prepared=part,
        findings=tuple(findings),
    )


def long_tracks(
    tracks: Callable[[slice], MarkerTracks],
    skeleton: Skeleton,
    *,
    name: str,
    t_s: Array,
    names: Sequence[str],
    findings: Sequence[Finding] = (),
) -> LongRecording:
    """Positions that are had stretch by stretch, and never all of them; other arguments as in ``long_points``."""
    return LongRecording(
        name=name,
        skeleton=skeleton,
        names=tuple(names),
        t_s=t_s,
        seen=lambda frames: tracks(frames).seen,
        prepared=lambda frames: prepare_tracks(tracks(frames), skeleton, name=name, first=frames.start),
        findings=tuple(findings),
    )


def long_recording(source: Recording) -> LongRecording:
    """A recording, to be tracked in blocks.

    Raises:
        MocapError: pixels and calibration do not belong together.
    """
    if not source.filmed:
        return long_points(load_points(source), source.skeleton, name=source.name, findings=source.findings)
    source, filmed = load_in_unit(source, iterations=None)
    return long_pixels(
        filmed,
        source.skeleton,
        name=source.name,
        pixel_sd=source.pixel_sd,
        likelihood=source.contents.score,
        findings=(*filmed.told, *source.findings, pixel_origin(filmed.pixel_origin)),
    )


def long_parquet(path: Path, skeleton_file: Path | None = None) -> LongRecording:
    """Positions of a Parquet table that is read by range: the recording never is in memory.

    Args:
        path: mocap's long table (``mocap.io.parquet_range``); samples that were not measured are left out.
        skeleton_file: Skeleton TOML; None: none.

    Raises:
        FormatError: the file is none, or is not sorted.
        SkeletonError: the skeleton cannot be read, or names markers that the recording lacks.
    """
    points = ParquetPoints(path)
    skeleton, names = animal(skeleton_file, points.names)

    def tracks(frames: slice) -> MarkerTracks:
        found, _ = points.read(frames)
        measured = found.status == Status.MEASURED
        return replace(
            found,
            names=names,
            xyz_m=np.where(measured[..., None], found.xyz_m, np.nan),
            cov_m2=np.where(measured[..., None, None], found.cov_m2, np.nan),
            status=np.where(measured, found.status, Status.MISSING),
        )

    return long_tracks(tracks, skeleton, name=as_text(path.stem), t_s=points.t_s, names=names)
