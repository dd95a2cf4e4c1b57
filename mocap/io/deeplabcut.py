"""DeepLabCut's predictions and labels (Mathis et al. 2018): CSV and HDF5, one individual or several; one camera a file.

Pixels are counted from the upper left. Lightning Pose writes the same CSV. HDF5 is written by pandas with PyTables, as
DeepLabCut does, and read without.
"""

import importlib
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from eal.needs import installing
from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.apart import plain_pickle
from mocap.io.contents import FileContents, camera_files, pixel_recording, point_recording, views_of
from mocap.io.format import Format
from mocap.io.lines import cells_of, frame_numbers, image_numbers, number, numbers, read_lines
from mocap.records import LEAST_LIKELIHOOD
from mocap.text import number_of

if TYPE_CHECKING:
    import pandas as pd

_KEY = "df_with_missing"
"""Of DeepLabCut's tables in HDF5; labels of napari-deeplabcut, tracklets and others have theirs."""
_LEVELS = (("scorer", "bodyparts", "coords"), ("scorer", "individuals", "bodyparts", "coords"))
Index = Array | list[str]
"""Of the rows: their frame numbers, or the images that they label."""


def _read_csv(path: Path) -> tuple[list[tuple[str, ...]], Array, Index]:
    """Columns as (individual, body part, coordinate), (T, columns) values and the index of the T rows."""
    lines = read_lines(path)
    lines = [line for line in lines if line.strip()]
    rows = [next(cells_of(path, [line], first_line=n), []) for n, line in enumerate(lines[:4], start=1)]
    depth = next((i + 1 for i, row in enumerate(rows) if row and row[0] == "coords"), 0)
    if depth == 0 or tuple(row[0] for row in rows[:depth]) not in _LEVELS:
        raise FormatError(
            f"{path.name}: the first lines are not DeepLabCut's scorer, (individuals,) bodyparts, coords: export it "
            "again"
        )
    width = len(rows[0])
    if any(len(row) != width for row in rows[:depth]) or width < 2:
        raise FormatError(f"{path.name}: the {depth} header lines have different lengths: export it again")
    # labels by hand have the folder and the file of each image in place of a frame number
    index = next((i for i in range(1, width) if any(row[i] for row in rows[:depth])), 1)
    body = lines[depth:]
    if not body:
        raise FormatError(f"{path.name}: no frames after the header: export it again")
    cells = [
        next(cells_of(path, [line], first_line=n)) if '"' in line else line.split(",")
        for n, line in enumerate(body, start=depth + 1)
    ]
    frames: Index = ["/".join(row[:index]) for row in cells]
    if index == 1 and any(np.isfinite(number(cell)) for cell in frames):
        frames = frame_numbers(path, [number(cell) for cell in frames], first_line=depth + 1).astype(np.float64)
    table = [",".join(row[index:]) for row in cells]
    values = numbers(path, table, separator=",", columns=width - index, first_line=depth + 1)
    parts = [row[index:] for row in rows[1:depth]]
    columns = list(zip(*(parts if len(parts) == 3 else [[""] * (width - index), *parts]), strict=True))
    return columns, values, frames


def _in_order(values: Array, index: Index) -> tuple[Array, NDArray[np.int64], list[str]]:
    """Rows in the order of their frames, the frames' numbers, and a finding where the index does not tell them."""
    if not isinstance(index, list):
        return values, index.astype(np.int64), []
    images = [PurePosixPath(image.replace("\\", "/")) for image in index]
    films = {image.parent for image in images}
    numbers = image_numbers([image.name for image in images]) if len(films) == 1 else None
    if numbers is None:
        reason = f"the rows are images of {len(films)} videos" if len(films) > 1 else "the rows have no frame numbers"
        return values, np.arange(len(values)), [f"{reason}: they are counted in their order"]
    order = np.argsort(numbers)
    return values[order], np.array(numbers)[order], []


def _recording(path: Path, format: str, columns: list[tuple[str, ...]], values: Array, index: Index) -> FileContents:
    """Pixels of one camera, or positions, from columns (individual, body part, x | y | z | likelihood)."""
    values, numbered, findings = _in_order(values, index)
    where: dict[tuple[str, ...], int] = {}
    for column, key in enumerate(columns):
        if key in where or key[2] not in ("x", "y", "z", "likelihood"):
            trouble = "appears twice" if key in where else "is not x, y, z or likelihood"
            raise FormatError(f"{path.name}: column {column + 2}, {' '.join(key)}, {trouble}: export it again")
        where[key] = column
    animals = list(dict.fromkeys(key[:2] for key in columns))
    axes = "xyz" if any(key[2] == "z" for key in columns) else "xy"
    lacking = next((a for a in animals for axis in axes if (*a, axis) not in where), None)
    if lacking is not None:
        raise FormatError(f"{path.name}: {' '.join(lacking)} has no {' and '.join(axes)}: export it again")
    places = values[:, [where[(*a, axis)] for a in animals for axis in axes]].reshape(len(values), len(animals), -1)
    score = np.full((1, *places.shape[:2]), np.nan)
    for m, animal in enumerate(animals):
        if (*animal, "likelihood") in where:
            score[0, :, m] = values[:, where[(*animal, "likelihood")]]
    single = len({individual for individual, _ in animals}) == 1
    names = [part if single else f"{individual}_{part}" for individual, part in animals]
    low = np.isfinite(score) & (score < LEAST_LIKELIHOOD)
    count = number_of(int(low.sum()), "sample has", "samples have")
    findings += [f"{count} a likelihood below {LEAST_LIKELIHOOD}"] if low.any() else []
    scored = not np.isnan(score).all()
    whose = tuple(animals) if animals[0][0] else ()
    if axes == "xyz":
        return point_recording(
            path, format, names=names, xyz=places, unit=None,
            frames=numbered, first=0, animals=whose, score=score[0] if scored else None, findings=tuple(findings),
        )  # fmt: skip
    return pixel_recording(
        path, format, names=names, cameras=[path.stem], uv_px=places[None], frames=numbered, first=0,
        pixel_origin="upper-left", animals=whose, score=score if scored else None, findings=tuple(findings),
    )  # fmt: skip


def _read_hdf5(path: Path) -> tuple[list[tuple[str, ...]], Array, Index]:
    """The same from the table that pandas writes with PyTables (fixed or table layout)."""
    import h5py

    with damaged(f"{path.name}: not a readable table of DeepLabCut", "export it again"), h5py.File(path, "r") as file:
        tables = [str(key) for key in file if "pandas_type" in file[key].attrs]
        if _KEY not in file and len(tables) != 1:
            raise FormatError(
                f"{path.name}: has the tables {', '.join(tables)}; expected one, or {_KEY}: save one alone"
            )
        group: Any = file[_KEY if _KEY in file else tables[0]]
        columns, stored, values, index = (_table_layout if "table" in group else _fixed_layout)(path, group)
        at = {key: i for i, key in enumerate(stored)}
        if not columns or {len(column) for column in columns} - {3, 4}:
            raise FormatError(
                f"{path.name}: the columns lack DeepLabCut's levels scorer, (individuals,) bodyparts, "
                "coords: export it again"
            )
        whose = [(("" if len(column) == 3 else column[1]), *column[-2:]) for column in columns]
        return whose, values[:, [at[key] for key in columns]], index


def _fixed_layout(path: Path, group: Any) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]], Array, Index]:
    """Columns in their order, columns as they are stored, a block for each kind of number, their values, the index."""
    depth, blocks = int(group.attrs["axis0_nlevels"]), range(int(group.attrs["nblocks"]))
    columns = _multi(group, "axis0", depth)
    stored = [key for i in blocks for key in _multi(group, f"block{i}_items", depth)]
    values = _side_by_side(path, [group[f"block{i}_values"][()] for i in blocks])
    if "axis1" in group:
        return columns, stored, values, _index(path, group["axis1"][()])
    return columns, stored, values, ["/".join(row) for row in _multi(group, "axis1", int(group.attrs["axis1_nlevels"]))]


def _multi(group: Any, name: str, depth: int) -> list[tuple[str, ...]]:
    """The words of an index of so many levels, which stores each of them once."""
    words = [[_word(w) for w in group[f"{name}_level{i}"][()]] for i in range(depth)]
    parts = [[words[i][int(j)] for j in group[f"{name}_label{i}"][()]] for i in range(depth)]
    return list(zip(*parts, strict=True))


def _table_layout(path: Path, group: Any) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]], Array, Index]:
    table = group["table"]
    blocks = [name for name in table.dtype.names if name.startswith("values_block_")]
    stored = [key for name in blocks for key in _names_only(path, bytes(table.attrs[f"{name}_kind"]))]
    rows = table[()]
    values = _side_by_side(path, [rows[name].reshape(len(rows), -1) for name in blocks])
    if len(stored) != values.shape[1]:
        raise FormatError(f"{path.name}: {len(stored)} column names for {values.shape[1]} columns: export it again")
    columns = stored if len(blocks) == 1 else _names_only(path, bytes(group.attrs["non_index_axes"]))
    return columns, stored, values, _index(path, rows["index"])


def _side_by_side(path: Path, blocks: list[Any]) -> Array:
    other = next((block.dtype for block in blocks if block.dtype.kind not in "fiu"), None)
    if other is not None:
        raise FormatError(f"{path.name}: columns are of the kind {other}; expected numbers only")
    return np.concatenate([np.asarray(block, dtype=np.float64) for block in blocks], axis=1)


def _names_only(path: Path, data: bytes) -> list[tuple[str, ...]]:
    """The column names that pandas keeps, pickled, in an attribute."""
    with damaged(f"{path.name}: the names of the columns cannot be read", "export it again"):
        names = plain_pickle(data)
        names = names[0][1] if len(names) == 1 and isinstance(names[0][1], list) else names  # of an axis
        return [tuple(str(word) for word in name) for name in names]


def _word(value: Any) -> str:
    return value.decode("utf-8") if isinstance(value, bytes) else str(value)


def _index(path: Path, index: Any) -> Index:
    """The index of a table: numbers, or names of images."""
    if index.dtype.kind in "iuf":
        return frame_numbers(path, index).astype(np.float64)
    return [_word(image) for image in index]


def _tables(path: Path, recording: FileContents) -> list[tuple[Path, "pd.DataFrame"]]:
    """The table of each file: x, y and likelihood of a camera (1 where nothing states it), or x, y, z."""
    import pandas as pd

    animals = list(recording.animals) or [("", name) for name in recording.names]
    several = len({animal for animal, _ in animals}) > 1
    keys = [("eal-mocap", *((animal or "single",) if several else ()), part) for animal, part in animals]
    _, axes, _, views = views_of(path, recording)
    if recording.points is None:
        score = recording.score
        score = np.isfinite(views).all(axis=-1).astype(float) if score is None else np.nan_to_num(score)
        views, axes = np.concatenate([views, score[..., None]], axis=-1), ("x", "y", "likelihood")
    levels = ["scorer", *(["individuals"] if several else []), "bodyparts", "coords"]
    columns = pd.MultiIndex.from_tuples([(*key, axis) for key in keys for axis in axes], names=levels)
    files = camera_files(path, recording)
    rows = recording.frames_from_0()
    return [(f, pd.DataFrame(v.reshape(len(v), -1), rows, columns)) for f, v in zip(files, views, strict=True)]


def _write_csv(path: Path, recording: FileContents) -> None:
    for file, table in _tables(path, recording):
        table.to_csv(file, lineterminator="\n")


def _write_hdf5(path: Path, recording: FileContents) -> None:
    try:
        importlib.import_module("tables")
    except ImportError:
        raise FormatError(
            f"{path.name}: writing DeepLabCut's HDF5 needs PyTables, not installed here: run "
            f"{installing('deeplabcut')}, or write its CSV (--to deeplabcut-csv)"
        ) from None
    for file, table in _tables(path, recording):
        with TemporaryDirectory() as folder:  # PyTables tells files apart by the ends of their names
            table.to_hdf(Path(folder) / "a.h5", key=_KEY, format="table", mode="w")
            file.write_bytes((Path(folder) / "a.h5").read_bytes())


_WRITTEN = frozenset({"pixels", "pixel_origin", "points", "score", "animals", "frame_numbers"})
DEEPLABCUT_CSV = Format(
    name="deeplabcut-csv",
    title="pixel tracks or 3D points of DeepLabCut, pixel tracks of Lightning Pose (CSV)",
    knows=lambda head: head.first.startswith("scorer,") and any(x.startswith("coords,") for x in head.lines[2:4]),
    read=lambda path, _: _recording(path, "deeplabcut-csv", *_read_csv(path)),
    write=_write_csv,
    holds=_WRITTEN,
    suffixes=("dlc.csv",),
    files=camera_files,
    signs="csv scorer bodyparts coords likelihood table",
)
DEEPLABCUT_H5 = Format(
    name="deeplabcut-h5",
    title="pixel tracks or 3D points of DeepLabCut (HDF5)",
    knows=lambda head: _KEY in head.hdf5 or any(name.endswith("/pandas_type") for name in head.hdf5),
    read=lambda path, _: _recording(path, "deeplabcut-h5", *_read_hdf5(path)),
    write=_write_hdf5,
    holds=_WRITTEN,
    suffixes=("dlc.h5",),
    files=camera_files,
    signs="hdf5 df_with_missing",
)
