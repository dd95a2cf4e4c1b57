"""The contents of a file of any format, in one record; and in figures, as ``mocap info`` prints them."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, frozen
from mocap.cameras.camera import Camera, scaled
from mocap.cameras.lens import Lens
from mocap.errors import FormatError
from mocap.io.lines import metres, rate
from mocap.records import MarkerTracks, PixelCorner, PixelTracks, Status, marker_tracks
from mocap.text import file_names, number_of

Bodies = Mapping[str, Mapping[str, Array]]
"""Places (3,) of a body's markers in its axes, by its name and theirs; NaN where only the markers are stated."""
FILLED = (Status.INTERPOLATED, Status.PREDICTED, Status.SMOOTHED, Status.REJECTED)
"""Origins of samples whose value was not measured."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FileContents:
    """What a file holds, or several that belong together.

    Attributes:
        format: Name of the format in the registry.
        paths: The files.
        names: The M markers (or rigid bodies).
        frames: (T,) frame numbers as the file counts them.
        fps: Frames a second; None: the file does not say, and times of tracks are in frames.
        unit: Unit of lengths that the file states; None: it does not, and lengths of tracks are in that unit.
        pixels: Pixel tracks as the file has them; None: it holds none.
        points: Positions, in metres where the unit is known; None: it holds none.
        camera_names: The C cameras of the pixels, or of a calibration alone.
        cameras: The C cameras' calibration in the same unit; empty where the file holds none.
        lenses: (lens, image width and height) of each camera, where the file holds lenses without projections.
        pixel_origin: Corner that pixel rows are counted from, where the format fixes it.
        animals: (individual, keypoint) of each marker, where the file holds several individuals or names one.
        score: (C, T, M) confidence of pixels or (T, M) of points, between 0 and 1; None: there is none.
        tables: Other arrays: ``residual_px`` (T, M) and ``residual_m`` (T, M) of points, ``interval`` (T, M, 3) half
            widths in the unit of the points, ``edited`` (T, M) 1 where a person corrected it, ``offset_frames`` (T, C),
            ``transforms`` (T, M, 4, 4) world from body.
        saturated: (T, M) samples whose residual is the largest that the file can hold, until it was judged whether
            they are places (``mocap.io.plausible``); None: the format holds none.
        bodies: Rigid bodies that the file states, in the unit of the points.
        findings: Sentences on what is unusual; ``remarks`` adds what the file does not state.
        assumed: Those of them that tell how the file was read where it leaves that open; a report begins with them.
        playback: Whether its program may state the rate at which a video is played in place of the camera's.
    """

    format: str
    paths: tuple[Path, ...]
    names: tuple[str, ...] = ()
    frames: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    fps: float | None = None
    unit: str | None = None
    pixels: PixelTracks | None = None
    points: MarkerTracks | None = None
    camera_names: tuple[str, ...] = ()
    cameras: tuple[Camera, ...] = ()
    lenses: tuple[tuple[Lens, tuple[int, int] | None], ...] = ()
    pixel_origin: PixelCorner | None = None
    animals: tuple[tuple[str, str], ...] = ()
    score: Array | None = None
    tables: Mapping[str, Array] = field(default_factory=dict)
    saturated: NDArray[np.bool_] | None = None
    bodies: Bodies = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    playback: bool = False

    def __post_init__(self) -> None:
        """Freeze and check that the parts have one size."""
        object.__setattr__(self, "frames", frozen("frames", self.frames, (None,), dtype=np.int64))
        for tracks in (self.pixels, self.points):
            if tracks is not None and (tracks.names != self.names or len(tracks.t_s) != len(self.frames)):
                raise ValueError("tracks and recording disagree on names or frames")
        if self.cameras and len(self.cameras) != len(self.camera_names):
            raise ValueError("cameras and their names disagree")

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(C, T, M) of pixels, else (T, M) of points or bodies: True where there is a value."""
        if self.pixels is not None:
            return self.pixels.seen
        if self.points is not None:
            return self.points.seen
        tables = [table for name, table in self.tables.items() if name != "offset_frames"]
        shape = (len(self.frames), len(self.names))
        if not tables:
            return np.zeros(shape, dtype=bool)
        return ~np.isnan(tables[0].reshape(*shape, -1)).any(axis=-1)  # type: ignore[return-value]

    @property
    def _may_be_plane(self) -> bool:
        """Whether pixels may be lengths in a plane: of a plain table, or of a program that scales its image."""
        flat = self.points is None and not self.cameras and len(self.camera_names) == 1
        return flat and self.format in ("csv", "kinovea")

    @property
    def plane_mm(self) -> float | None:
        """Millimetres in the unit of 2D coordinates that are lengths in a plane; None: they are pixels."""
        if self.unit is None or self.pixels is None or not self._may_be_plane:
            return None
        return 1e3 * metres(self.paths[0], self.unit)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is unusual, and what the files do not state."""
        unsaid = ("the frame rate of the cameras is not stated",) if self.fps is None and len(self.frames) else ()
        if self.unit is None and (self.points is not None or self.cameras):
            unsaid += ("the unit of lengths is not stated",)
        return (*self.findings, *unsaid)

    def grid(self) -> tuple[list[str], list[str], list[int]]:
        """Individuals (``id_0`` where none is told), body parts, and each marker's place in individuals x parts."""
        pairs = list(self.animals) or [("id_0", name) for name in self.names]
        animals = list(dict.fromkeys(a or "id_0" for a, _ in pairs))
        parts = list(dict.fromkeys(p for _, p in pairs))
        return animals, parts, [animals.index(a or "id_0") * len(parts) + parts.index(p) for a, p in pairs]

    def of_animal(self, individual: str | None) -> "FileContents":
        """Of several animals one, its markers called by their body parts; what holds one animal stays as it is.

        Raises:
            FormatError: none is chosen, or there is none of that name.
        """
        there = list(dict.fromkeys(animal for animal, _ in self.animals if animal))
        if individual is None and len(there) < 2:
            return self
        if individual not in there:
            what = f"no animal {individual!r}" if individual else f"{len(there)} animals, which are no one recording"
            raise FormatError(
                f"{self.paths[0].name}: holds {what} ({', '.join(there) or 'none is named'}): give `individual`"
            )
        index = [i for i, (animal, _) in enumerate(self.animals) if animal in (individual, "")]
        kept: dict[str, Any] = {
            "names": tuple(self.animals[i][1] for i in index),
            "animals": tuple(self.animals[i] for i in index),
        }
        n_markers = len(self.names)
        for what in ("pixels", "points"):
            if (tracks := getattr(self, what)) is not None:
                axis = {"uv_px": 2, "xyz_m": 1, "cov_m2": 1, "status": 1}
                own = {k: np.take(getattr(tracks, k), index, axis=a) for k, a in axis.items() if hasattr(tracks, k)}
                kept[what] = replace(tracks, names=kept["names"], **own)
        if self.score is not None:
            kept["score"] = np.take(self.score, index, axis=-1)
        if self.saturated is not None:
            kept["saturated"] = self.saturated[:, index]
        kept["tables"] = {
            name: table if name == "offset_frames" or table.shape[1:2] != (n_markers,) else table[:, index]
            for name, table in self.tables.items()
        }
        return replace(self, **kept)

    def without_markers(self) -> FormatError:
        """Why there is nothing to track or to write, of a file that holds no marker."""
        why = "; ".join((*self.findings, "give a file of pixels or positions"))
        return FormatError(f"{self.paths[0].name}: contains no markers ({self.format}): {why}")

    def frames_from_0(self) -> NDArray[np.int64]:
        """(T,) numbers of the frames as video programs count them: 0 at time 0."""
        tracks = self.pixels if self.points is None else self.points
        first = 0.0 if tracks is None else float(tracks.t_s[0]) * (self.fps or 1.0)
        return self.frames - int(self.frames[0]) + round(first)

    def length_m(self, path: Path) -> float:
        """Metres in the unit of lengths, of ``path`` for messages; 1 where it is not known: lengths are then in it."""
        return metres(path, self.unit) if self.unit else 1.0

    def renamed(self, names: Sequence[str]) -> "FileContents":
        """With other names of the markers, in their order."""
        pixels = None if self.pixels is None else replace(self.pixels, names=tuple(names))
        points = None if self.points is None else replace(self.points, names=tuple(names))
        called = dict(zip(self.names, names, strict=True))
        bodies = {body: {called[name]: at for name, at in own.items()} for body, own in self.bodies.items()}
        return replace(self, names=tuple(names), pixels=pixels, points=points, bodies=bodies)

    def with_rate(self, fps: float) -> "FileContents":
        """Times in seconds, where the file does not hold the rate; a rate that it holds is replaced.

        Raises:
            FormatError: the rate is no positive number.
        """
        factor = (self.fps or 1.0) / rate(self.paths[0], fps)
        pixels = None if self.pixels is None else replace(self.pixels, t_s=self.pixels.t_s * factor)
        points = None if self.points is None else replace(self.points, t_s=self.points.t_s * factor)
        return replace(self, fps=float(fps), pixels=pixels, points=points)

    def with_unit(self, unit: str) -> "FileContents":
        """Lengths of the points and the cameras in metres, where the file does not state their unit.

        Raises:
            FormatError: the unit is not known, or the file states another.
        """
        if self.unit is None and self.pixels is not None and self._may_be_plane:
            note = f"two columns a point, in {unit} as stated: lengths in a plane, and not pixels"
            metres(self.paths[0], unit)
            return replace(self, unit=unit, findings=(note, *self.findings), assumed=(note, *self.assumed))
        if self.unit is not None:
            if metres(self.paths[0], unit) != metres(self.paths[0], self.unit):
                raise FormatError(
                    f"{self.paths[0].name}: states lengths in {self.unit}, not in {unit}: leave the unit out"
                )
            return self
        scale = metres(self.paths[0], unit)
        points, tables = self.points, dict(self.tables)
        if points is not None:
            points = replace(points, xyz_m=points.xyz_m * scale, cov_m2=points.cov_m2 * scale**2)
        tables |= {name: tables[name] * scale for name in ("interval", "residual_m") if name in tables}
        bodies = {body: {name: at * scale for name, at in own.items()} for body, own in self.bodies.items()}
        cameras = scaled(self.cameras, scale)
        return replace(self, unit=unit, points=points, tables=tables, cameras=cameras, bodies=bodies)


def camera_files(path: Path, recording: FileContents) -> list[Path]:
    """The files of a format that holds one camera: ``NAME_CAMERA.end`` of several; of positions the one of the name."""
    cameras = recording.camera_names
    if recording.points is not None or len(cameras) < 2:
        return [path]
    name, dot, end = path.name.partition(".")
    return [path.with_name(f"{name}_{camera}{dot}{end}") for camera in file_names(cameras)]


def pixel_recording(
    path: Path,
    format: str,
    *,
    names: Sequence[str],
    cameras: Sequence[str],
    uv_px: Array,
    frames: NDArray[np.int64] | None = None,
    first: int = 1,
    fps: float | None = None,
    calibration: tuple[Camera, ...] = (),
    **parts: Any,
) -> FileContents:
    """A recording of pixel tracks.

    Args:
        path: The file, as ``format`` and ``**parts`` a field of the recording.
        format: See above.
        names: The M markers.
        cameras: The C cameras.
        uv_px: (C, T, M, 2) pixels.
        frames: (T,) frame numbers; None: from ``first`` on.
        first: Number of the frame at time 0.
        fps: Frames a second.
        calibration: Of the cameras, if the file holds it.
        **parts: See above.

    Raises:
        FormatError: a name appears twice, or frame numbers do not increase.
    """
    frames = first + np.arange(uv_px.shape[1]) if frames is None else frames
    parts["findings"] = (*parts.get("findings", ()), *half_seen(np.moveaxis(uv_px, 0, 1), names, frames))
    with _as_format_error(path):
        t_s, names, cameras = (frames - first) / (fps or 1.0), tuple(names), tuple(cameras)
        parts["pixels"] = PixelTracks(names=names, cameras=cameras, t_s=t_s, uv_px=uv_px)
    parts |= {"names": names, "camera_names": cameras, "cameras": calibration, "frames": frames, "fps": fps}
    return FileContents(format=format, paths=(path,), **parts)


def point_recording(
    path: Path,
    format: str,
    *,
    names: Sequence[str],
    xyz: Array,
    unit: str | None,
    frames: NDArray[np.int64] | None = None,
    first: int = 1,
    fps: float | None = None,
    t_s: Array | None = None,
    status: NDArray | None = None,
    **parts: Any,
) -> FileContents:
    """A recording of positions; other arguments as of ``pixel_recording``.

    Args:
        path: The file.
        format: Its format.
        names: The M markers.
        xyz: (T, M, 3) positions in ``unit``, or (T, 3 M) columns x, y, z of each marker; NaN where there is none.
        unit: As the file states it; None: it does not.
        frames: (T,) frame numbers; None: from ``first`` on.
        first: Number of the frame at time 0.
        fps: Frames a second.
        t_s: (T,) times; None: from the frame numbers.
        status: (T, M) Status codes; None: measured where there is a position.
        **parts: Other fields of the recording.

    Raises:
        FormatError: a name appears twice, frame numbers do not increase, or the unit is not known.
    """
    frames = first + np.arange(len(xyz)) if frames is None else frames
    xyz = xyz.reshape(len(xyz), -1, 3) if xyz.ndim == 2 else xyz
    xyz = xyz * metres(path, unit) if unit is not None else np.array(xyz, dtype=np.float64)
    parts["findings"] = (*parts.get("findings", ()), *half_seen(xyz, names, frames))
    xyz[np.isnan(xyz).any(axis=-1)] = np.nan
    times = (frames - first) / (fps or 1.0) if t_s is None else t_s
    with _as_format_error(path):
        parts["points"] = marker_tracks(names, times, xyz, status=status)
    parts |= {"names": tuple(names), "frames": frames, "fps": fps, "unit": unit}
    return FileContents(format=format, paths=(path,), **parts)


def half_seen(values: Array, names: Sequence[str], frames: NDArray[np.int64]) -> tuple[str, ...]:
    """A sentence on samples of which some coordinates are there and others are not, if there are any.

    Args:
        values: (T, ..., M, d) coordinates as the file has them; NaN where a cell is empty.
        names: The M markers.
        frames: (T,) frame numbers.
    """
    if not len(names) or not len(values):
        return ()
    empty = np.isnan(values).reshape(len(values), -1, *values.shape[-2:])
    half = np.logical_and(empty.any(axis=-1), ~np.logical_and.reduce(empty, axis=-1)).sum(axis=1)
    if not half.any():
        return ()
    listed = [
        f"{count} of {names[m]!r} (from frame {frames[half[:, m].argmax()]} on)"
        for m, count in enumerate(half.sum(axis=0))
        if count
    ]
    more = f", and of {number_of(len(listed) - 8, 'more marker')}" if len(listed) > 8 else ""
    rest = "coordinates and not the others, and"
    count = number_of(int(half.sum()), f"sample has some of its {rest} is", f"samples have some of their {rest} are")
    return (f"{count} read as missing: {', '.join(listed[:8])}{more}: look for empty cells",)


@contextmanager
def _as_format_error(path: Path) -> Iterator[None]:
    """Tracks that contradict themselves are a file to be corrected."""
    try:
        yield
    except ValueError as error:
        raise FormatError(f"{path.name}: {error}; correct it and export again") from None


def table_recording(path: Path, format: str, *, tables: Mapping[str, Array], **parts: Any) -> FileContents:
    """Tables alone, of T rows each, one for each frame; frames are counted from 1 where ``parts`` states none."""
    rows = len(next(iter(tables.values())))
    parts["frames"] = 1 + np.arange(rows) if parts.get("frames") is None else parts["frames"]
    return FileContents(format=format, paths=(path,), tables=tables, **parts)


def calibration_recording(path: Path, format: str, cameras: tuple[Camera, ...], **parts: Any) -> FileContents:
    """Cameras alone; other parts as fields of the recording are."""
    names = tuple(camera.name for camera in cameras)
    return FileContents(format=format, paths=(path,), camera_names=names, cameras=cameras, **parts)


def of_animals(animals: Sequence[str], parts: Sequence[str]) -> tuple[list[str], tuple[tuple[str, str], ...]]:
    """Names of the markers of several animals with the same body parts, and each marker's (individual, part)."""
    pairs = tuple((animal, part) for animal in animals for part in parts)
    return [part if len(animals) == 1 else f"{animal}_{part}" for animal, part in pairs], pairs


def views_of(path: Path, recording: FileContents) -> tuple[list[str], str, Array, Array]:
    """Of what is to be written: names of its C views, their axes, (T,) times and (C, T, M, axes) coordinates.

    Of positions in space, where there are any, one view without a name, in the unit of the recording.

    Raises:
        FormatError: it holds no tracks.
    """
    if recording.points is not None:
        return [""], "xyz", recording.points.t_s, recording.points.xyz_m[None] / recording.length_m(path)
    if recording.pixels is not None:
        return list(recording.pixels.cameras), "xy", recording.pixels.t_s, recording.pixels.uv_px
    raise FormatError(f"{path.name}: needs tracks, but {recording.paths[0].name} contains none")


def points_of(path: Path, recording: FileContents) -> MarkerTracks:
    """The positions of a recording that is to be written.

    Raises:
        FormatError: it holds none.
    """
    if recording.points is None:
        contents = (
            "pixels: triangulate them first (mocap triangulate)" if recording.pixels is not None else "no positions"
        )
        raise FormatError(f"{path.name}: needs positions, but {recording.paths[0].name} contains {contents}")
    return recording.points


def summary(recording: FileContents) -> dict[str, Any]:
    """Figures of a recording, ready for JSON.

    ``points`` and ``cameras`` are numbers, ``missing`` the share of samples (marker x frame x camera) without a value,
    of the frames and markers that have any at all, None where the file holds no samples; ``undigitised`` are the frames
    (their number) and markers without any; ``gaps`` are runs of missing frames between two sightings.
    """
    seen = recording.seen
    tracks = seen if seen.ndim == 3 else seen[None]
    sampled = seen.size > 0 and (recording.pixels is not None or recording.points is not None or bool(recording.tables))
    in_frames, of_markers = np.any(tracks, axis=(0, 2)), np.any(tracks, axis=(0, 1))
    lost = [name for name, any_seen in zip(recording.names, of_markers, strict=True) if sampled and not any_seen]
    px = recording.pixels is not None or (recording.lenses and not recording.cameras)
    plane = recording.plane_mm is not None
    px = px and not plane
    there = {
        "pixels": recording.pixels is not None and not plane,
        "plane": plane,
        "points": recording.points is not None,
        "cameras": bool(recording.cameras),
        "lenses": bool(recording.lenses),
        "score": recording.score is not None,
        **{name: True for name, table in recording.tables.items() if np.isfinite(table).any()},
    }
    found: dict[str, Any] = {
        "format": recording.format,
        "points": len(recording.names),
        "cameras": len(recording.camera_names),
        "frames": len(recording.frames),
        "fps": recording.fps,
        "units": "px" if px or set(recording.tables) == {"residual_px"} else recording.unit,
        "missing": _missing(tracks) if sampled else None,
        "findings": list(recording.remarks),
        "names": list(recording.names),
        "camera_names": list(recording.camera_names),
        "first_frame": int(recording.frames[0]) if len(recording.frames) else None,
        "undigitised": {"frames": int((~in_frames).sum()) if sampled else 0, "markers": lost},
        "gaps": gaps(tracks) if sampled else None,
        "pixel_origin": recording.pixel_origin,
        "holds": [name for name, has in there.items() if has],
    }
    if recording.pixels is not None and recording.points is not None:
        found["missing_points"] = _missing(recording.points.seen[None])
    if recording.points is not None:
        codes, counts = np.unique(recording.points.status, return_counts=True)
        found["samples"] = {Status(code).name.lower(): int(n) for code, n in zip(codes, counts, strict=True)}
    animals = list(dict.fromkeys(animal for animal, _ in recording.animals))
    return found | ({"individuals": animals} if animals else {})


def _missing(tracks: NDArray[np.bool_]) -> float:
    """Share of (K, T, M) samples without a value, of the frames and the markers that have any."""
    kept = tracks[:, np.any(tracks, axis=(0, 2))][:, :, np.any(tracks, axis=(0, 1))]
    return round(float(1 - kept.mean()), 6) if kept.size else 1.0


def gaps(seen: NDArray[np.bool_]) -> dict[str, int | float]:
    """Runs of missing frames between two sightings in (K, T, M) samples of each view, frame and marker.

    Their number, and the median and largest length in frames.
    """
    lengths = []
    for track in np.moveaxis(seen, 1, -1).reshape(-1, seen.shape[1]):
        at = np.flatnonzero(track)
        steps = np.diff(at) - 1
        lengths.append(steps[steps > 0])
    runs = np.concatenate(lengths) if lengths else np.zeros(0)
    return {
        "count": len(runs),
        "median_frames": float(np.median(runs)) if len(runs) else 0,
        "longest_frames": int(runs.max(initial=0)),
    }
