"""What a recording on disk holds, read back from the file itself."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import Chunk, RrdReader

from eal.arrays import Array
from mocap.errors import MocapError, beside
from mocap.io.manifest import current
from mocap.rerun import paths
from mocap.rerun.columns import FRAME, TIME

_UP, _DOWN = 1, 2  # codes of rerun's view coordinates


class StoredError(MocapError):
    """A file is no recording of this program."""

    page = "looking"


@dataclass(frozen=True, eq=False, kw_only=True)
class Stored:
    """One recording.

    Attributes:
        name: For people.
        chunks: All that it holds.
        names: The M markers.
        bones: Pairs of markers.
        first: Number of its first frame.
        t_s: (T,) times of the frames, which follow one another.
        xyz_m: (T, M, 3) the body in the scene; NaN where there is none.
        up: (3,) signed axis that points up in the scene.
    """

    name: str
    chunks: tuple[Chunk, ...]
    names: tuple[str, ...]
    bones: tuple[tuple[int, int], ...]
    first: int
    t_s: Array
    xyz_m: Array
    up: Array

    def static(self, entity: str, component: str) -> Any:
        """The value of a component that does not change, as Python has it; raises KeyError where there is none."""
        return _static(self.chunks, entity, component)

    def points2d(self, entity: str) -> Array:
        """(N, 2) all positions that an entity ever has."""
        component, parts = "Points2D:positions", [np.zeros((0, 2))]
        for chunk in self.chunks:
            if chunk.entity_path == entity and not chunk.is_static:
                flat = chunk.to_record_batch().column(component).flatten().flatten()
                parts.append(np.asarray(flat, dtype=np.float64).reshape(-1, 2))
        points = np.concatenate(parts)
        return points[np.isfinite(points).all(axis=1)]

    def below(self, parent: str) -> list[str]:
        """Names of the entities right below a path, in order."""
        starts = [c.entity_path[len(parent) + 1 :] for c in self.chunks if c.entity_path.startswith(f"{parent}/")]
        return sorted({start.split("/")[0] for start in starts})


def read_recording(path: Path, *, name: str) -> Stored:
    """Read a recording.

    Raises:
        StoredError: there is none, or another program wrote it.
    """
    file = recording_file(path)
    try:
        chunks = tuple(RrdReader(str(file)).store().stream())
        context = _static(chunks, "/", "AnnotationContext:context")
        axes = _static(chunks, paths.WORLD, "ViewCoordinates:xyz")[0]
        first, t_s, xyz = _body(chunks)
    except (KeyError, ValueError, OSError, RuntimeError) as error:
        raise StoredError(
            f"{file}: not a recording of mocap track or mocap demo ({error}): run the command again"
        ) from None
    body = context[0][0]["class_description"]
    up = np.array([{_UP: 1.0, _DOWN: -1.0}.get(code, 0.0) for code in axes])
    return Stored(
        name=name,
        chunks=chunks,
        names=tuple(point["label"] for point in body["keypoint_annotations"]),
        bones=tuple((pair["keypoint0"], pair["keypoint1"]) for pair in body["keypoint_connections"]),
        first=first,
        t_s=t_s,
        xyz_m=xyz,
        up=up,
    )


def recording_file(path: Path) -> Path:
    """The file of a recording, or of the run in a folder.

    Raises:
        StoredError: there is none.
    """
    file = current(path, "recording.rrd") if path.is_dir() else path
    if not file.is_file():
        trouble = "there is no recording" if path.exists() else f"there is no such file or folder{beside(path)}"
        raise StoredError(f"{path}: {trouble}: give a folder that mocap track or mocap demo wrote")
    return file


def _static(chunks: tuple[Chunk, ...], entity: str, component: str) -> Any:
    for chunk in chunks:
        if chunk.entity_path == entity and chunk.is_static:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                return batch.column(component)[0].as_py()
    raise KeyError(f"no {component} of {entity}")


def _body(chunks: tuple[Chunk, ...]) -> tuple[int, Array, Array]:
    """The number of the first frame; times and positions of all markers, frame by frame."""
    component, parts = "Points3D:positions", []
    for chunk in chunks:
        if chunk.entity_path == paths.SKELETON and not chunk.is_static:
            batch = chunk.to_record_batch()
            t_s = np.asarray(batch.column(TIME).cast(pa.int64())) / 1e9
            points = np.asarray(batch.column(component).flatten().flatten(), dtype=np.float64)
            parts.append((int(batch.column(FRAME)[0].as_py()), t_s, points.reshape(len(t_s), -1, 3)))
    if not parts:
        raise KeyError(f"no {component} of {paths.SKELETON}")
    parts.sort(key=lambda part: part[0])
    return parts[0][0], np.concatenate([t_s for _, t_s, _ in parts]), np.concatenate([points for *_, points in parts])
