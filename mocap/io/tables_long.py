"""Our long tables, CSV and Parquet: a row a sample, sorted by frame, then marker, then camera.

Points: ``frame, t_s, marker, x_m, y_m, z_m, sd_m, score, origin`` (``x, y, z, sd`` where the unit is not known).
Pixels: ``frame, t_s, marker, camera, u_px, v_px, score, seen``. ``t_s``, ``sd`` and ``score`` only where there are any.
"""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.documents import from_json
from mocap.errors import FormatError, MocapError
from mocap.io.bounds import check_bytes
from mocap.io.contents import FileContents, pixel_recording, point_recording, points_of
from mocap.io.csv_table import as_cell, from_cell
from mocap.io.format import Format, Hints
from mocap.io.lines import frame_numbers
from mocap.io.optical import rate_of_times
from mocap.io.tables import EDITED, REPAIRED, WORDS, check_origins, codes, read_rows, titles, with_sd
from mocap.records import MarkerTracks
from mocap.schema import POSITIVE, Entry, checked

if TYPE_CHECKING:
    import pandas as pd
if TYPE_CHECKING:
    import pyarrow as pa

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


def _recording(path: Path, format: str, table: "pd.DataFrame", fps: float | None) -> FileContents:
    """A recording from rows, which must be the whole grid of frames, markers and cameras, sorted."""
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
        told, findings = rate_of_times(path, times)
        fps = fps or told
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


def _read_csv(path: Path, _hints: Hints) -> FileContents:
    kinds = {title: str if title in _TEXT else float for title in titles(path)}
    table = read_rows(path, kinds)
    for column in table.columns.intersection(_NAMES):
        table[column] = table[column].map(from_cell, na_action="ignore")
    return _recording(path, "csv-long", table, None)


def _write_csv(path: Path, recording: FileContents) -> None:
    table = _long(path, recording)
    for column in table.columns.intersection(_NAMES):
        table[column] = table[column].map(as_cell)
    table.to_csv(path, index=False, na_rep="NaN", lineterminator="\n")


def _read_parquet(path: Path, _hints: Hints) -> FileContents:
    import pyarrow.parquet as parquet

    try:
        with path.open("rb") as stream:
            file = parquet.ParquetFile(stream)
            meta = file.metadata
            unpacked = sum(meta.row_group(i).total_byte_size for i in range(meta.num_row_groups))
            check_bytes(path, max(unpacked, 8 * meta.num_rows * meta.num_columns), "its table")
            table = file.read()
        told = from_json((table.schema.metadata or {}).get(_META, b"{}"), path.name)
        found = checked(path.name, told, {"fps": Entry(least=POSITIVE, needed=False)}, again="export it again")
        fps = float(found["fps"]) if "fps" in found else None
        rows = table.to_pandas()
    except FormatError:
        raise
    except Exception as error:  # pyarrow raises its own and whatever damaged metadata bring about
        raise FormatError(
            f"{path.name}: cannot be read as Parquet ({' '.join(str(error).split())[:160]}): copy or export it again"
        ) from None
    if rows.empty:
        raise FormatError(f"{path.name}: contains no rows: export it again")
    try:
        return _recording(path, "parquet", rows, fps)
    except FormatError:
        raise
    except Exception as error:  # as above: columns are arrow's until they are looked at
        raise FormatError(f"{path.name}: a column has the wrong type ({error}): export it again") from None


def _write_parquet(path: Path, recording: FileContents) -> None:
    import pyarrow
    import pyarrow.parquet as parquet

    table = pyarrow.Table.from_pandas(_long(path, recording), preserve_index=False)
    meta = {**(table.schema.metadata or {}), _META: json.dumps({"fps": recording.fps, "read_as": recording.format})}
    with path.open("wb") as stream:
        parquet.write_table(table.replace_schema_metadata(meta), stream)


_HELD = frozenset({"points", "first_frame", "frame_numbers", "pixels", "fps", "unit", "origin", "sd", "score"})
FORMATS = (
    Format(
        name="csv-long",
        title="mocap's CSV, one row for each sample (frame, marker, ...)",
        knows=lambda head: head.cells()[:1] == ("frame",) and "marker" in head.cells(),
        read=_read_csv,
        write=_write_csv,
        holds=_HELD,
        suffixes=("long.csv",),
    ),
    Format(
        name="parquet",
        title="mocap's Parquet, one row for each sample",
        knows=lambda head: head.start.startswith(b"PAR1"),
        read=_read_parquet,
        write=_write_parquet,
        holds=_HELD,
        suffixes=(".parquet",),
    ),
)


COVARIANCES = (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2))
"""Columns ``cov_<name>_m2`` of a covariance, and where they are in it."""


@dataclass(frozen=True)
class ParquetPoints:
    """Positions in metres in mocap's long table: ``frame, t_s, marker, x_m, y_m, z_m[, sd_m][, cov_..._m2], origin``.

    Attributes:
        path: The file; sorted by frame, then marker, every marker in every frame.
    """

    path: Path

    @cached_property
    def _columns(self) -> tuple[str, ...]:
        found = self._opened().schema_arrow.names
        lacking = [name for name in ("frame", "t_s", "marker", "x_m", "y_m", "z_m", "origin") if name not in found]
        if lacking:
            raise FormatError(f"{self.path.name}: no column {lacking[0]}; expected positions, a row a frame and marker")
        return tuple(found)

    def _opened(self):
        import pyarrow as pa
        import pyarrow.parquet as parquet

        try:
            return parquet.ParquetFile(self.path)
        except (OSError, pa.ArrowException) as error:
            raise FormatError(f"{self.path}: cannot be read as Parquet ({error}): copy or export it again") from None

    @cached_property
    def _rows(self) -> NDArray[np.int64]:
        """(G + 1,) row that each row group begins with, and their number."""
        meta = self._opened().metadata
        return np.concatenate([[0], np.cumsum([meta.row_group(i).num_rows for i in range(meta.num_row_groups)])])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The M markers."""
        _ = self._columns
        for batch in self._opened().iter_batches(batch_size=1 << 16, columns=["frame", "marker"]):
            frame = batch.column("frame").to_numpy()
            first = int(np.searchsorted(frame, frame[0], side="right"))
            if first < len(frame) or len(frame) == self._rows[-1]:
                return tuple(batch.column("marker").slice(0, first).to_pylist())
            break
        raise FormatError(f"{self.path.name}: contains no frames of markers, sorted by frame: export it again")

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return int(self._rows[-1]) // len(self.names)

    @cached_property
    def t_s(self) -> Array:
        """(T,) times.

        Raises:
            FormatError: frames are not sorted, do not follow each other, or lack markers.
        """
        m, file = len(self.names), self._opened()
        out, frames, done = np.empty(self.n_frames), np.empty(self.n_frames, dtype=np.int64), 0
        for batch in file.iter_batches(batch_size=m * max(1, (1 << 18) // m), columns=["frame", "t_s"]):
            some = slice(-done % m, None, m)
            at = slice((done + m - 1) // m, (done + len(batch) + m - 1) // m)
            out[at], frames[at] = batch.column("t_s").to_numpy()[some], batch.column("frame").to_numpy()[some]
            done += len(batch)
        if done % m or (np.diff(frames) != 1).any():
            raise FormatError(
                f"{self.path.name}: rows are not all frames, one after the other, x {m} markers: read it at once, or "
                "export it again"
            )
        return out

    def read(self, frames: slice) -> tuple[MarkerTracks, NDArray[np.int8]]:
        """Some frames, from 0; and (n, M) which bore another marker's name in the file.

        Raises:
            MocapError: there are no such frames.
        """
        m = len(self.names)
        start, stop = frames.start or 0, self.n_frames if frames.stop is None else frames.stop
        if not 0 <= start <= stop <= self.n_frames:
            raise MocapError(f"{self.path}: has the frames 1 to {self.n_frames}, not {start + 1} to {stop}")
        first = min(int(np.searchsorted(self._rows, start * m, side="right")) - 1, len(self._rows) - 2)
        last = max(first + 1, int(np.searchsorted(self._rows, stop * m, side="left")))
        wanted = [name for name in self._columns if name not in ("frame", "marker")]
        table = self._opened().read_row_groups(list(range(first, min(last, len(self._rows) - 1))), columns=wanted)
        table = table.slice(start * m - int(self._rows[first]), (stop - start) * m)
        return self._tracks(table, (stop - start, m))

    def _tracks(self, table: "pa.Table", shape: tuple[int, int]) -> tuple[MarkerTracks, NDArray[np.int8]]:
        import pyarrow as pa

        def column(name: str) -> Array:
            return np.asarray(table.column(name).to_numpy(), dtype=np.float64).reshape(shape)

        xyz = np.stack([column(f"{axis}_m") for axis in "xyz"], axis=-1)
        cov = np.full((*shape, 3, 3), np.nan)
        if f"cov_{COVARIANCES[0][0]}_m2" in self._columns:
            for name, i, j in COVARIANCES:
                cov[..., i, j] = cov[..., j, i] = column(f"cov_{name}_m2")
        elif "sd_m" in self._columns:
            cov = column("sd_m")[..., None, None] ** 2 * np.eye(3)
        origin = table.column("origin").cast(pa.string()).combine_chunks().dictionary_encode()
        words, index = origin.dictionary.to_pylist(), origin.indices.to_numpy().reshape(shape)
        status = codes(self.path, words)[index]
        repaired = np.array([{REPAIRED: 1, EDITED: 2}.get(word, 0) for word in words], dtype=np.int8)[index]
        t_s = column("t_s")[:, 0]
        return MarkerTracks(names=self.names, t_s=t_s, xyz_m=xyz, cov_m2=cov, status=status), repaired
