"""SLEAP's analysis files (Pereira et al. 2022; one camera a file, rows from the top) and sleap-anipose's points."""

from pathlib import Path
from typing import Any

import numpy as np

from mocap.errors import FormatError
from mocap.io.contents import FileContents, pixel_recording, point_recording
from mocap.io.format import Format, Hints
from mocap.io.lines import one_line

_NO_RATE = "the file does not state the frame rate"


def _read(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Datasets of the root, as far as they are there.

    Raises:
        FormatError: HDF5 cannot read the file.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            table = {name: np.asarray(file[name][()]) for name in names if name in file}  # type: ignore[index]
    except (OSError, KeyError, RuntimeError, ValueError, TypeError, AttributeError, MemoryError) as error:
        raise FormatError(
            f"{path.name}: cannot be read as HDF5 ({type(error).__name__}: {one_line(error)}): it is cut or "
            "damaged; export it again"
        ) from None
    lacking = [name for name in ("tracks", "node_names") if name in names and name not in table]
    if lacking:
        raise FormatError(f"{path.name}: the dataset {lacking[0]} is damaged: copy or export the file again")
    return table


def _words(path: Path, table: dict[str, Any], name: str, count: int, plain: str) -> list[str]:
    """Names of nodes or tracks; ``<plain>1``, ... where there are none."""
    values = np.ravel(table.get(name, ()))
    if len(values) == 0:
        return [f"{plain}{i + 1}" for i in range(count)]
    try:
        words = [value.decode("utf-8") if isinstance(value, bytes) else str(value) for value in values]
    except UnicodeDecodeError:
        raise FormatError(f"{path.name}: {name} contains no text: export it again") from None
    if len(words) != count:
        raise FormatError(f"{path.name}: {len(words)} {name} for {count}: export it again")
    return words


def _analysis(path: Path, _hints: Hints) -> FileContents:
    table = _read(path, ("tracks", "node_names", "track_names", "point_scores"))
    tracks, nodes = table["tracks"], np.ravel(table["node_names"])
    if tracks.ndim != 4 or tracks.dtype.kind != "f" or not tracks.size:
        raise FormatError(f"{path.name}: tracks has shape {tracks.shape}; expected tracks x 2 x nodes x frames")
    # MATLAB's order (written since 1.0) is (tracks, 2, nodes, frames), the other (frames, nodes, 2, tracks)
    if tracks.shape[1] == 2 and tracks.shape[2] == len(nodes):
        xy = np.transpose(tracks, (3, 0, 2, 1))
    elif tracks.shape[2] == 2 and tracks.shape[1] == len(nodes):
        xy = np.transpose(tracks, (0, 3, 1, 2))
    else:
        raise FormatError(
            f"{path.name}: tracks has shape {tracks.shape}; expected tracks x 2 x {len(nodes)} nodes x frames"
        )
    frames, animals = xy.shape[:2]
    parts = _words(path, table, "node_names", xy.shape[2], "node")
    individuals = _words(path, table, "track_names", animals, "track")
    score = table.get("point_scores")
    if score is not None:
        if score.shape == (animals, len(parts), frames):
            score = np.transpose(score, (2, 0, 1))
        elif score.shape == (frames, len(parts), animals):
            score = np.transpose(score, (0, 2, 1))
        else:
            raise FormatError(f"{path.name}: point_scores has shape {score.shape}, unlike tracks: export it again")
        score = score.reshape(1, frames, -1).astype(np.float64)
    return pixel_recording(
        path,
        "sleap-analysis",
        names=[n if animals == 1 else f"{i}_{n}" for i in individuals for n in parts],
        cameras=[_camera_name(path)],
        uv_px=xy.reshape(1, frames, -1, 2).astype(np.float64),
        first=0,
        pixel_origin="upper-left",
        animals=tuple((i, n) for i in individuals for n in parts),
        score=score,
        findings=(_NO_RATE,),
    )


def _camera_name(path: Path) -> str:
    """sleap-anipose keeps the files of a camera in a folder of its name; else the file's name tells."""
    return path.absolute().parent.name if path.absolute().parent.name in path.name else path.name.split(".")[0]


def _points(path: Path, _hints: Hints) -> FileContents:
    tracks = _read(path, ("tracks",))["tracks"]
    if tracks.ndim != 4 or tracks.shape[3] != 3 or tracks.dtype.kind != "f" or not tracks.size:
        raise FormatError(
            f"{path.name}: tracks has shape {tracks.shape}; expected frames x tracks x nodes x 3 (sleap-anipose)"
        )
    frames, animals, nodes, _ = tracks.shape
    parts = [f"node{i + 1}" for i in range(nodes)]
    return point_recording(
        path,
        "sleap-anipose-3d",
        names=[n if animals == 1 else f"track{i + 1}_{n}" for i in range(animals) for n in parts],
        xyz=tracks.reshape(frames, -1, 3).astype(np.float64),
        unit=None,
        first=0,
        animals=tuple((f"track{i + 1}", n) for i in range(animals) for n in parts),
        findings=(
            _NO_RATE,
            "the unit of lengths is that of the calibration board, not in the file",
            "names of points are not in the file: they are numbered in the order of the SLEAP skeleton",
        ),
    )


FORMATS = (
    Format(
        name="sleap-analysis",
        title="pixel tracks of SLEAP (analysis HDF5)",
        knows=lambda head: {"tracks", "node_names"} <= head.hdf5,
        read=_analysis,
    ),
    Format(
        name="sleap-anipose-3d",
        title="points of sleap-anipose (HDF5)",
        knows=lambda head: "tracks" in head.hdf5 and "node_names" not in head.hdf5,
        read=_points,
    ),
)
