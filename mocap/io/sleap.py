"""SLEAP's own and analysis files (Pereira et al. 2022; rows from the top) and sleap-anipose's points."""

import importlib
import io
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from eal.needs import installing
from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.apart import check_bytes
from mocap.io.contents import FileContents, camera_files, of_animals, pixel_recording, point_recording, points_of
from mocap.io.format import Format, Head, Hints, file_format
from mocap.io.lines import frame_numbers


def _read(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    import h5py

    with damaged(f"{path.name}: cannot be read as HDF5", "copy or export it again"), h5py.File(path, "r") as file:
        table = {name: np.asarray(file[name][()]) for name in names if name in file}  # type: ignore[index]
        axes = {name: _dims(file[name]) for name in table if table[name].ndim > 2}
    table |= {f"{name}.dims": stated for name, stated in axes.items()}
    lacking = [name for name in ("tracks", "node_names") if name in names and name not in table]
    if lacking:
        raise FormatError(f"{path.name}: the dataset {lacking[0]} is not in it: copy or export it again")
    return table


def _dims(dataset: Any) -> tuple[str, ...]:
    """The names of its axes that a dataset states (sleap-io, as JSON); none where it does not."""
    stated = dataset.attrs.get("dims", ())
    try:
        words = json.loads(stated) if isinstance(stated, str | bytes) else list(stated)
    except ValueError:
        return ()
    names = tuple(word.decode() if isinstance(word, bytes) else str(word) for word in words)
    return names if len(names) == dataset.ndim and set(names) <= set(_CANONICAL) else ()


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


_CANONICAL = ("frame", "track", "node", "xy")
"""Axes of tracks, and of scores without the last, as they are here."""


def _analysis(path: Path, _hints: Hints) -> FileContents:
    """Pixels and scores; the attribute ``dims`` says the order of their axes, else their shape does."""
    table = _read(path, ("tracks", "node_names", "track_names", "point_scores"))
    tracks, nodes = table["tracks"], np.ravel(table["node_names"])
    if tracks.ndim != 4 or tracks.dtype.kind != "f" or not tracks.size:
        raise FormatError(f"{path.name}: tracks has shape {tracks.shape}; expected tracks x 2 x nodes x frames")
    dims = table["tracks.dims"]
    # without dims MATLAB's order (written since 1.0) is (tracks, 2, nodes, frames), else (frames, nodes, 2, tracks)
    if dims:
        xy = np.transpose(tracks, [dims.index(axis) for axis in _CANONICAL])
        if xy.shape[2:] != (len(nodes), 2):
            raise FormatError(
                f"{path.name}: tracks has shape {tracks.shape} for {', '.join(dims)} and {len(nodes)} node_names: "
                "export it again"
            )
    elif tracks.shape[1] == 2 and tracks.shape[2] == len(nodes):
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
        order = table.get("point_scores.dims") or tuple(axis for axis in dims if axis != "xy")
        if order and score.ndim == 3:
            score = np.transpose(score, [order.index(axis) for axis in _CANONICAL[:3]])
            if score.shape != xy.shape[:3]:
                raise FormatError(f"{path.name}: point_scores has shape {score.shape}, unlike tracks: export it again")
        elif score.shape == (animals, len(parts), frames):
            score = np.transpose(score, (2, 0, 1))
        elif score.shape == (frames, len(parts), animals):
            score = np.transpose(score, (0, 2, 1))
        else:
            raise FormatError(f"{path.name}: point_scores has shape {score.shape}, unlike tracks: export it again")
        score = score.reshape(1, frames, -1).astype(np.float64)
    names, pairs = of_animals(individuals, parts)
    folder = path.absolute().parent.name  # sleap-anipose calls it after the camera
    return pixel_recording(
        path,
        "sleap-analysis",
        names=names,
        cameras=[folder if folder in path.name else path.name.split(".")[0]],
        uv_px=xy.reshape(1, frames, -1, 2).astype(np.float64),
        first=0,
        pixel_origin="upper-left",
        animals=pairs,
        score=score,
    )


def _points(path: Path, _hints: Hints) -> FileContents:
    tracks = _read(path, ("tracks",))["tracks"]
    if tracks.ndim != 4 or tracks.shape[3] != 3 or tracks.dtype.kind != "f" or not tracks.size:
        raise FormatError(
            f"{path.name}: tracks has shape {tracks.shape}; expected frames x tracks x nodes x 3 (sleap-anipose)"
        )
    frames, animals, nodes, _ = tracks.shape
    names, pairs = of_animals([f"track{i + 1}" for i in range(animals)], [f"node{i + 1}" for i in range(nodes)])
    return point_recording(
        path,
        "sleap-anipose-3d",
        names=names,
        xyz=tracks.reshape(frames, -1, 3).astype(np.float64),
        unit=None,
        first=0,
        animals=pairs,
        findings=("names of points are not in the file: they are numbered in the order of the SLEAP skeleton",),
    )


@file_format(
    "sleap-labels",
    "labels and predictions of SLEAP (.slp)",
    lambda head: {"metadata", "frames", "instances"} <= head.hdf5,
)
def _labels(path: Path, _hints: Hints) -> FileContents:
    """Pixels of SLEAP's own project or prediction file, through sleap-io; a camera for each video.

    Raises:
        FormatError: sleap-io is not installed or cannot read it, or it holds no instances.
    """
    try:
        sleap_io: Any = importlib.import_module("sleap_io")
    except ImportError:
        raise FormatError(
            f"{path.name}: reading a file of SLEAP (.slp) needs sleap_io, not installed here: run {installing('sleap')}"
        ) from None
    with damaged(f"{path.name}: sleap-io cannot read it", "export it again"):
        labels = sleap_io.load_slp(str(path), open_videos=False)
        parts = [node.name for node in labels.skeleton.nodes]
        seen = [(labels.videos.index(one.video), int(one.frame_idx), one) for one in labels.labeled_frames]
    samples, unnamed = {}, False
    for camera, frame, one in seen:
        # what a person corrected stands beside the prediction that it was made from
        corrected = [id(own.from_predicted) for own in one.user_instances if own.from_predicted is not None]
        own = [*one.user_instances, *(found for found in one.predicted_instances if id(found) not in corrected)]
        for place, instance in enumerate(own):
            track = None if instance.track is None else instance.track.name
            unnamed = unnamed or (track is None and len(own) > 1)
            samples.setdefault((camera, frame, track or f"animal{place + 1}"), instance)
    if not samples:
        raise FormatError(f"{path.name}: contains no instances: label or predict frames in SLEAP first")
    first, last = (end(frame for _, frame, _ in samples) for end in (min, max))
    check_bytes(path, 24 * (last - first + 1) * len(labels.videos), "all frames up to its last")
    animals = list(dict.fromkeys(animal for *_, animal in samples))
    xy = np.full((len(labels.videos), last - first + 1, len(animals), len(parts), 2), np.nan)
    score = np.full(xy.shape[:-1], np.nan)
    for (camera, frame, animal), instance in samples.items():
        at = (camera, frame - first, animals.index(animal))
        xy[at] = instance.numpy()
        if isinstance(instance, sleap_io.PredictedInstance):
            score[at] = instance.numpy(scores=True)[:, 2]
    stems = [Path(str(video.filename)).stem for video in labels.videos]
    notes = [_NO_ORDER] if unnamed else []
    names, pairs = of_animals(animals, parts)
    return pixel_recording(
        path,
        "sleap-labels",
        names=names,
        cameras=stems if len(set(stems)) == len(stems) else [f"cam{c + 1}" for c in range(len(stems))],
        uv_px=xy.reshape(*xy.shape[:2], -1, 2),
        first=first,
        pixel_origin="upper-left",
        animals=pairs,
        score=None if np.isnan(score).all() else score.reshape(*score.shape[:2], -1),
        findings=tuple(notes),
    )


_NO_ORDER = "instances without a track are in no order: one animal may be another in the next frame"
_INSTANCES = ("track", "frame_idx")


def _is_instances(head: Head) -> bool:
    """Titles ``track, frame_idx, instance.score, <node>.x, <node>.y, <node>.score, ...``, of nodes in any order."""
    cells = head.cells()
    nodes = {cell.removesuffix(".x") for cell in cells if cell.endswith(".x")}
    return set(_INSTANCES) <= set(cells) and bool(nodes) and all(f"{node}.y" in cells for node in nodes)


@file_format(
    "sleap-csv",
    "pixel tracks of SLEAP (analysis CSV, one row for each instance)",
    _is_instances,
    signs="csv track frame_idx instance score x y table",
    of_words=True,
)
def _instances(path: Path, _hints: Hints) -> FileContents:
    """Pixels and scores of one camera; frames without an instance have no row, and show nothing.

    Raises:
        FormatError: a cell is no number, or a track has two instances in one frame.
    """
    import pandas as pd

    with damaged(f"{path.name}: cannot be read as a table", "export it again"):
        table = pd.read_csv(path, dtype={"track": str}, encoding="utf-8-sig", skipinitialspace=True)
    table = table.rename(columns=str.strip)
    nodes = list(dict.fromkeys(title[:-2] for title in table.columns if title.endswith(".x")))
    columns = [f"{node}.{part}" for node in nodes for part in ("x", "y", "score")]
    numbers = table.reindex(columns=["frame_idx", *columns]).apply(pd.to_numeric, errors="coerce")
    there = table.reindex(columns=numbers.columns)
    wrong = np.argwhere(np.asarray(numbers.isna() & there.notna()))
    if len(wrong):
        row, column = wrong[0]
        cell = there.iloc[row, column]
        raise FormatError(
            f"{path.name}: line {row + 2}, {numbers.columns[column]}: {cell!r} is not a number: correct it"
        )
    index = _frames_of_rows(path, numbers["frame_idx"])
    values = np.asarray(numbers[columns], dtype=np.float64).reshape(len(table), len(nodes), 3)
    tracks = table["track"].fillna("").str.strip()
    place = np.zeros(len(table), dtype=int)
    seen = Counter[tuple[int, str]]()
    for row, key in enumerate(zip(index.tolist(), tracks, strict=True)):
        place[row] = seen[key]
        seen[key] += 1
    unnamed = bool((place[np.asarray(tracks == "")] > 0).any())
    twice = np.flatnonzero((place > 0) & np.asarray(tracks != ""))
    if len(twice):
        raise FormatError(
            f"{path.name}: line {twice[0] + 2}: track {tracks.iloc[twice[0]]!r} has a second instance in frame "
            f"{index[twice[0]]}: export it again"
        )
    animal_of = [track or f"animal{k + 1}" for track, k in zip(tracks, place, strict=True)]
    animals = list(dict.fromkeys(animal_of))
    first, last = int(index.min()), int(index.max())
    check_bytes(path, 24 * (last - first + 1), "all frames up to its last")
    out = np.full((last - first + 1, len(animals), len(nodes), 3), np.nan)
    out[index - first, [animals.index(animal) for animal in animal_of]] = values
    out[..., :2][np.isnan(out[..., :2]).any(axis=-1)] = np.nan
    score = out[..., 2].reshape(1, len(out), -1)
    names, pairs = of_animals(animals, nodes)
    return pixel_recording(
        path,
        "sleap-csv",
        names=names,
        cameras=[path.name.split(".")[0]],
        uv_px=out[..., :2].reshape(1, len(out), -1, 2),
        frames=np.arange(first, last + 1),
        first=first,
        pixel_origin="upper-left",
        animals=pairs,
        score=None if np.isnan(score).all() else score,
        findings=(_NO_ORDER,) if unnamed else (),
    )


def _frames_of_rows(path: Path, column: Any) -> NDArray[np.int64]:
    """Whole frame numbers of rows, in any order.

    Raises:
        FormatError: one is none.
    """
    values = np.asarray(column, dtype=np.float64)
    if np.isnan(values).any():
        raise FormatError(f"{path.name}: line {int(np.argmax(np.isnan(values))) + 2} has no frame_idx: correct it")
    order = np.unique(values)
    return frame_numbers(path, order)[np.searchsorted(order, values)]


def _spread(recording: FileContents, values: Array) -> Array:
    """(frames, animals, parts, ...) of (T, M, ...), with a row for every frame from 0; NaN where there is nothing."""
    animals, parts, at = recording.grid()
    rows = recording.frames_from_0()
    out = np.full((rows[-1] + 1, len(animals) * len(parts), *values.shape[2:]), np.nan)
    out[np.ix_(rows, np.array(at))] = values
    return out.reshape(len(out), len(animals), len(parts), *values.shape[2:])


def _write_analysis(path: Path, recording: FileContents) -> None:
    """An analysis file of each camera, axes in MATLAB's order, as SLEAP writes them."""
    if recording.pixels is None:
        raise FormatError(f"{path.name}: needs pixels, but {recording.paths[0].name} contains none")
    animals, parts, _ = recording.grid()
    scores = recording.pixels.seen.astype(float) if recording.score is None else recording.score
    for file, uv, one in zip(camera_files(path, recording), recording.pixels.uv_px, scores, strict=True):
        xy, score = _spread(recording, uv), _spread(recording, one)
        seen = np.isfinite(xy[..., 0])
        with np.errstate(invalid="ignore"):
            mean = np.nan_to_num(score).sum(axis=2) / seen.sum(axis=2)
        table = {
            "tracks": np.transpose(xy, (1, 3, 2, 0)),
            "track_occupancy": seen.any(axis=2).astype(np.uint8),
            "point_scores": np.transpose(score, (1, 2, 0)),
            "instance_scores": mean.T,
            "tracking_scores": np.full(mean.T.shape, np.nan),
            "track_names": np.array([name.encode() for name in animals]),
            "node_names": np.array([name.encode() for name in parts]),
        }
        file.write_bytes(_as_hdf5(table))


def _write_points(path: Path, recording: FileContents) -> list[str]:
    xyz = points_of(path, recording).xyz_m / recording.length_m(path)
    _, parts, _ = recording.grid()
    path.write_bytes(_as_hdf5({"tracks": _spread(recording, xyz)}))
    return [f"the format has no names; its nodes are in this order: {', '.join(parts)}"]


def _as_hdf5(table: dict[str, Array]) -> bytes:
    """An HDF5 file, made in memory: a full disk ends the library with a segmentation fault."""
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        for name, values in table.items():
            file[name] = values
    return buffer.getvalue()


SLEAP_ANALYSIS = Format(
    name="sleap-analysis",
    title="pixel tracks of SLEAP (analysis HDF5)",
    knows=lambda head: {"tracks", "node_names"} <= head.hdf5,
    read=_analysis,
    write=_write_analysis,
    holds=frozenset({"pixels", "pixel_origin", "score", "animals"}),
    suffixes=("analysis.h5",),
    files=camera_files,
    signs="hdf5 tracks node_names track_names track_occupancy",
)
SLEAP_ANIPOSE_3D = Format(
    name="sleap-anipose-3d",
    title="points of sleap-anipose (HDF5)",
    knows=lambda head: "tracks" in head.hdf5 and "node_names" not in head.hdf5,
    read=_points,
    write=_write_points,
    holds=frozenset({"points"}),
    suffixes=("points3d.h5",),
)
