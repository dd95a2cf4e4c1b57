"""Our long tables, CSV and Parquet: a row a sample, sorted by frame, then marker, then camera.

Points: ``frame, t_s, marker, x_m, y_m, z_m, sd_m, score, origin`` (``x, y, z, sd`` where the unit is not known).
Pixels: ``frame, t_s, marker, camera, u_px, v_px, score, seen``. ``t_s``, ``sd`` and ``score`` only where there are any.
"""

import json
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.documents import damaged, from_json
from mocap.errors import FormatError, MocapError
from mocap.io.apart import check_bytes
from mocap.io.contents import FileContents, pixel_recording, point_recording, points_of
from mocap.io.csv_table import as_cell, from_cell
from mocap.io.format import Format, Hints
from mocap.io.lines import even_times, frame_numbers
from mocap.io.tables import EDITED, REPAIRED, WORDS, check_origins, codes, read_rows, titles, with_sd
from mocap.records import MarkerTracks
from mocap.schema import POSITIVE, Entry, checked

if TYPE_CHECKING:
    import pandas as pd

_META = b"eal-mocap"
_NAMES = ("marker", "camera")
_TEXT = (*_NAMES, "origin", "seen")
_AXES = {("u_px", "v_px"): "px", ("x_m", "y_m", "z_m"): "m", ("x", "y", "z"): None}


def _long(path: Path, recording: FileContents) -> "pd.DataFrame":
    """The rows of a recording: its points, or its pixels where it has no points."""
    import pandas as pd

    pixels = recording.pixels if recording.points is None else None
    tracks = pixels if pixels is not None else points_of(path, recording)
    cameras = [""] if pixels is None else list(pixels.cameras)
    size = len(tracks.names) * len(cameras)
    table: dict[str, Any] = {"frame": np.repeat(recording.frames, size)}
    table |= {"t_s": np.repeat(tracks.t_s, size)} if recording.fps else {}
    markers = np.repeat(np.array(tracks.names, dtype=object), len(cameras))
    table["marker"] = np.tile(markers, len(recording.frames))
    if pixels is not None:
        table["camera"] = np.tile(np.array(cameras, dtype=object), len(recording.frames) * len(tracks.names))
        table |= {end: np.transpose(pixels.uv_px[..., k], (1, 2, 0)).ravel() for k, end in enumerate(("u_px", "v_px"))}
        if recording.score is not None:
            table["score"] = np.transpose(recording.score, (1, 2, 0)).ravel()
        table["seen"] = np.where(np.isnan(table["u_px"]), "no", "yes")
        return pd.DataFrame(table)
    points, end = points_of(path, recording), "" if recording.unit is None else "_m"
    table |= {f"{axis}{end}": points.xyz_m[..., k].ravel() for k, axis in enumerate("xyz")}
    table |= {f"sd{end}": points.sd_m.ravel()} if np.isfinite(points.sd_m).any() else {}
    table |= {"score": recording.score.ravel()} if recording.score is not None else {}
    return pd.DataFrame(table | {"origin": WORDS[points.status].ravel()})


def _recording(path: Path, format: str, table: "pd.DataFrame", fps: float | None, stated: float | None) -> FileContents:
    """A recording from rows, which must be the whole grid of frames, markers and cameras, sorted.

    ``fps`` is the rate that the file holds, ``stated`` that of the user.
    """
    axes = next((axes for axes in _AXES if set(axes) <= set(table.columns)), ("x", "y", "z"))
    filmed = _AXES[axes] == "px"
    lacking = [
        c for c in ("frame", "marker", *axes, *(("camera", "seen") if filmed else ("origin",))) if c not in table
    ]
    if lacking:
        raise FormatError(f"{path.name}: no column {lacking[0]}; expected one row for each sample: frame, marker, ...")
    words = {c: table[c].astype(object).fillna("").astype(str).to_numpy() for c in _TEXT if c in table}
    names = list(dict.fromkeys(words["marker"]))
    cameras = list(dict.fromkeys(words["camera"])) if filmed else [""]
    size, frames = len(names) * len(cameras), frame_numbers(path, table["frame"])
    if len(table) % size == 0:
        grid = frames.reshape(-1, size)
        sorted_ = (grid == grid[:, :1]).all() and (np.diff(grid[:, 0]) > 0).all()
        sorted_ &= (words["marker"].reshape(-1, size) == np.repeat(np.array(names, dtype=object), len(cameras))).all()
        sorted_ &= not filmed or (words["camera"].reshape(-1, len(cameras)) == np.array(cameras, dtype=object)).all()
    if len(table) % size or not sorted_:
        raise FormatError(
            f"{path.name}: {len(table)} rows are not all frames x {len(names)} markers x {len(cameras)} cameras, "
            "sorted so: sort them, and leave no row out"
        )
    values = table[list(axes)].to_numpy(dtype=np.float64).reshape(-1, len(names), len(cameras), len(axes))
    if np.isinf(values).any():
        raise FormatError(f"{path.name}: a number is infinite; expected a number or NaN")
    times, findings = None, []
    if "t_s" in table:
        times = table["t_s"].to_numpy(dtype=np.float64)[::size]
        times, rate, findings = even_times(path, times, frames=frames[::size], header=fps, stated=stated)
        fps = fps or rate
    score = None if "score" not in table else table["score"].to_numpy(dtype=np.float64).reshape(values.shape[:3])
    if filmed:
        if (words["seen"] != np.where(np.isnan(values).any(axis=-1).ravel(), "no", "yes")).any():
            raise FormatError(f"{path.name}: pixels contradict the column seen: correct it")
        return pixel_recording(
            path,
            format,
            names=names,
            cameras=cameras,
            uv_px=np.transpose(values, (2, 0, 1, 3)),
            frames=frames[::size],
            first=int(frames[0]),
            fps=fps,
            score=None if score is None else np.transpose(score, (2, 0, 1)),
            findings=tuple(findings),
        )
    origin = codes(path, words["origin"]).reshape(-1, len(names))
    check_origins(path, values[:, :, 0], origin)
    recording = point_recording(
        path,
        format,
        names=names,
        xyz=values[:, :, 0],
        unit=_AXES[axes],
        frames=frames[::size],
        first=int(frames[0]),
        fps=fps,
        t_s=times,
        status=origin,
        score=None if score is None else score[..., 0],
        findings=tuple(findings),
    )
    sd = next((c for c in ("sd_m", "sd") if c in table), None)
    if sd is None:
        return recording
    return with_sd(recording, table[sd].to_numpy(dtype=np.float64).reshape(-1, len(names)))


def _read_csv(path: Path, hints: Hints) -> FileContents:
    kinds = {title: str if title in _TEXT else float for title in titles(path)}
    table = read_rows(path, kinds)
    for column in table.columns.intersection(_NAMES):
        table[column] = table[column].map(from_cell, na_action="ignore")
    return _recording(path, "csv-long", table, None, hints.fps)


def _write_csv(path: Path, recording: FileContents) -> None:
    table = _long(path, recording)
    for column in table.columns.intersection(_NAMES):
        table[column] = table[column].map(as_cell)
    table.to_csv(path, index=False, na_rep="NaN", lineterminator="\n")


def _readable(path: Path) -> AbstractContextManager[None]:
    return damaged(f"{path}: cannot be read as Parquet", "copy or export it again")


def _read_parquet(path: Path, hints: Hints) -> FileContents:
    import pyarrow.parquet as parquet

    with _readable(path):
        with path.open("rb") as stream:
            file = parquet.ParquetFile(stream)
            meta = file.metadata
            unpacked = sum(meta.row_group(i).total_byte_size for i in range(meta.num_row_groups))
            check_bytes(path, max(unpacked, 8 * meta.num_rows * meta.num_columns), "its table")
            table = file.read()
        metadata = from_json((table.schema.metadata or {}).get(_META, b"{}"), path.name)
        found = checked(path.name, metadata, {"fps": Entry(least=POSITIVE, needed=False)}, again="export it again")
        fps = float(found["fps"]) if "fps" in found else None
        rows = table.to_pandas()
    if rows.empty:
        raise FormatError(f"{path.name}: contains no rows: export it again")
    with damaged(f"{path.name}: a column has the wrong type", "export it again"):  # they are arrow's until looked at
        return _recording(path, "parquet", rows, fps, hints.fps)


def _write_parquet(path: Path, recording: FileContents) -> None:
    import pyarrow
    import pyarrow.parquet as parquet

    table = pyarrow.Table.from_pandas(_long(path, recording), preserve_index=False)
    meta = {**(table.schema.metadata or {}), _META: json.dumps({"fps": recording.fps, "read_as": recording.format})}
    with path.open("wb") as stream:
        parquet.write_table(table.replace_schema_metadata(meta), stream)


_HELD = frozenset({"points", "first_frame", "frame_numbers", "pixels", "fps", "unit", "origin", "sd", "score"})
CSV_LONG = Format(
    name="csv-long",
    title="mocap's CSV, one row for each sample (frame, marker, ...)",
    knows=lambda head: (
        head.cells()[:1] == ("frame",)
        and "marker" in head.cells()
        and bool({"origin", "seen", "x_m"} & {*head.cells()})
    ),
    read=_read_csv,
    write=_write_csv,
    holds=_HELD,
    suffixes=("long.csv",),
    signs="csv frame marker name x y z long table",
)
PARQUET = Format(
    name="parquet",
    title="mocap's Parquet, one row for each sample",
    knows=lambda head: head.start.startswith(b"PAR1"),
    read=_read_parquet,
    write=_write_parquet,
    holds=_HELD,
    suffixes=(".parquet",),
    signs="binary parquet PAR1",
)


COVARIANCES = (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2))
"""Columns ``cov_<name>_m2`` of a covariance, and where they are in it."""


@dataclass(frozen=True)
class LongTable:
    """Positions in metres in mocap's long table, of which any frames can be read.

    Attributes:
        path: The Parquet file; sorted by frame, then marker, every marker in every frame.
    """

    path: Path

    @cached_property
    def _head(self) -> tuple[int, int]:
        """Number of rows, and of the first frame."""
        import pyarrow.parquet as parquet

        with _readable(self.path):
            file = parquet.ParquetFile(self.path)
            first = next(file.iter_batches(batch_size=1, columns=["frame"]), None)
        lacking = [
            c for c in ("frame", "t_s", "marker", "x_m", "y_m", "z_m", "origin") if c not in file.schema_arrow.names
        ]
        if lacking or first is None:
            what = f"no column {lacking[0]}" if lacking else "no rows"
            raise FormatError(f"{self.path.name}: {what}; expected positions, one row per frame and marker")
        return file.metadata.num_rows, first["frame"][0].as_py()

    def _rows(self, rows: list[tuple[str, str, Any]], columns: list[str] | None = None) -> "pd.DataFrame":
        """Rows of which all that is true; row groups without any are not read."""
        import pyarrow.parquet as parquet

        with _readable(self.path):
            return parquet.read_table(self.path, columns=columns, filters=rows).to_pandas()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The M markers."""
        return tuple(self._rows([("frame", "==", self._head[1])], ["marker"])["marker"])

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return self._head[0] // len(self.names)

    @cached_property
    def t_s(self) -> Array:
        """(T,) times.

        Raises:
            FormatError: frames are not sorted, do not follow each other, or lack markers.
        """
        found = self._rows([("marker", "==", self.names[0])], ["frame", "t_s"])
        if len(found) * len(self.names) != self._head[0] or (np.diff(found["frame"]) != 1).any():
            raise FormatError(
                f"{self.path.name}: rows are not all frames, one after the other, x {len(self.names)} markers: read it "
                "at once, or export it again"
            )
        return found["t_s"].to_numpy(dtype=np.float64)

    def read(self, frames: slice) -> tuple[MarkerTracks, NDArray[np.int8]]:
        """Some frames, from 0; and (n, M) which bore another marker's name in the file (1), or were corrected (2).

        Raises:
            MocapError: there are no such frames.
            FormatError: rows are not all of them.
        """
        start, stop = frames.start or 0, self.n_frames if frames.stop is None else frames.stop
        if not 0 <= start < stop <= self.n_frames:
            raise MocapError(f"{self.path}: has the frames 1 to {self.n_frames}, not {start + 1} to {stop}")
        first = self._head[1]
        rows = self._rows([("frame", ">=", first + start), ("frame", "<", first + stop)])
        points = points_of(self.path, _recording(self.path, "parquet", rows, None, None))
        if f"cov_{COVARIANCES[0][0]}_m2" in rows:
            cov = np.empty((*points.xyz_m.shape, 3))
            for name, i, j in COVARIANCES:
                cov[..., i, j] = cov[..., j, i] = rows[f"cov_{name}_m2"].to_numpy().reshape(cov.shape[:2])
            points = replace(points, cov_m2=cov)
        words = rows["origin"].astype(str).to_numpy().reshape(points.xyz_m.shape[:2])
        return points, ((words == REPAIRED) + 2 * (words == EDITED)).astype(np.int8)
