"""Recordings of which any stretch of frames can be had by itself: what is tracked in blocks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.findings import Finding
from mocap.io.tables_long import ParquetPoints
from mocap.pipeline.cleaning import clean
from mocap.pipeline.reading import animal
from mocap.pipeline.recording import Recording, of_points, with_ideal_pixels
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
        part: Frames to the recording of them, not cleaned.
        findings: On how the file was read.
    """

    name: str
    skeleton: Skeleton
    names: tuple[str, ...]
    t_s: Array
    part: Callable[[slice], Recording]
    findings: tuple[Finding, ...] = ()

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.t_s)

    @property
    def dt_s(self) -> float:
        """Time step."""
        return float(self.t_s[1] - self.t_s[0]) if len(self.t_s) > 1 else 1.0

    def seen(self, frames: slice) -> Mask:
        """(n, M) True where a position, or two rays, are given; nothing is cleaned."""
        part = self.part(frames)
        seen = part.seen
        return seen if not part.cameras else seen.sum(axis=0) >= 2

    def cleaned(self, frames: slice) -> Recording:
        """What ``mocap.clean`` makes of some frames, its findings with their numbers here."""
        return clean(self.part(frames), first=frames.start)


def long_recording(source: Recording) -> LongRecording:
    """A recording that is in memory, to be tracked in blocks; where pixels are counted from is decided on all of it.

    Raises:
        MocapError: pixels and calibration do not belong together, or nothing is seen.
    """
    findings = source.findings
    if source.filmed:
        source = with_ideal_pixels(source)
        assert source.rows is not None  # it was decided
        findings = (*source.told, *findings, pixel_origin(source.rows))
    elif not source.seen.any():
        raise FormatError(f"{source.where}: no marker is ever seen: there is nothing to track")
    bare = replace(source, findings=(), stored=None)
    return LongRecording(
        name=source.name,
        skeleton=source.skeleton,
        names=source.names,
        t_s=source.t_s,
        part=bare.at,
        findings=findings,
    )


def long_tracks(
    tracks: Callable[[slice], MarkerTracks],
    skeleton: Skeleton,
    *,
    name: str,
    t_s: Array,
    names: Sequence[str],
) -> LongRecording:
    """Positions that are had stretch by stretch, and never all of them.

    Args:
        tracks: Frames to positions, named as the skeleton names them.
        skeleton: What is known of the animal.
        name: Of the recording.
        t_s: (T,) times.
        names: The M markers.
    """
    return LongRecording(
        name=name,
        skeleton=skeleton,
        names=tuple(names),
        t_s=t_s,
        part=lambda frames: of_points(tracks(frames), skeleton, name=name),
    )


def long_parquet(path: Path, skeleton_file: Path | None = None) -> LongRecording:
    """Positions of a Parquet table that is read by range: the recording never is in memory.

    Args:
        path: mocap's long table (``mocap.io.tables_long``); samples that were not measured are left out.
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
