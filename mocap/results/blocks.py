"""Results of long recordings, written block by block as Parquet, and read back by range."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pyarrow as pa

from eal.over_time import at_frames
from mocap.io.tables import origin_words
from mocap.io.tables_long import COVARIANCES, LongTable
from mocap.kinematics.cycles import Cycle
from mocap.kinematics.records import WORDS as REST_WORDS
from mocap.kinematics.records import Kinematics
from mocap.records import MarkerTracks, Status
from mocap.results.stored import read_recording
from mocap.results.tables import cycle_tables, write_table
from mocap.tracking.result import Result
from mocap.tracking.tracking import of_tracks

if TYPE_CHECKING:
    import pyarrow.parquet as parquet

MARKERS, KINEMATICS, BLOCKS = "markers.parquet", "kinematics.parquet", "blocks.csv"


class BlockWriter:
    """Tables of a long recording, a row group a block.

    ``markers.parquet`` is mocap's long table (a row a frame and marker: ``frame, t_s, marker, x_m, y_m, z_m, sd_m,
    origin``) with ``cov_xx_m2``, ... in single precision; ``kinematics.parquet`` has a row a frame and for each
    quantity its value, ``_sd`` and ``_status``; ``cycles.csv`` and ``angles.csv`` a row a cycle, ``peaks.csv`` several;
    ``blocks.csv`` a row a block. Positions are float64, standard deviations and covariances float32.
    """

    def __init__(self, folder: Path, *, fps: float) -> None:
        """Into an empty folder, as ``mocap.io.output.result_folder`` gives it."""
        self._folder = folder
        self._meta = {b"eal-mocap": json.dumps({"fps": fps, "read_as": "parquet"}).encode()}
        self._open: dict[str, parquet.ParquetWriter] = {}
        self._quantities: list[str] = []
        self._cycles: dict[str, list[pd.DataFrame]] = {}
        self._numbers: Counter[tuple[str, str]] = Counter()
        self._blocks: list[dict[str, float]] = []

    def __enter__(self) -> "BlockWriter":
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close all files; write the tables of cycles, of which a block may have columns that the first had not."""
        for file in self._open.values():
            file.close()
        if kind is None:
            order = [f.name for f in fields(Cycle)]
            for name, tables in self._cycles.items():
                whole = pd.concat([table for table in tables if len(table)] or tables[:1], ignore_index=True)
                if name == "cycles.csv":
                    whole = whole.reindex(columns=sorted(whole.columns, key=order.index))
                write_table(whole, self._folder / name)
            write_table(pd.DataFrame(self._blocks), self._folder / BLOCKS)

    def add(self, core: range, run: Result, whole: Kinematics, own: slice, cycles: Sequence[Cycle]) -> None:
        """One block's own frames: its markers, what follows of them, and the cycles that begin in it.

        Args:
            core: The frames.
            run: These frames.
            whole: What follows of them, also in the frames on either side.
            own: The frames in that.
            cycles: Those that begin in them, and may end after them.
        """
        frames, markers = np.arange(core.start + 1, core.stop + 1), run.tracks
        self._write(MARKERS, _marker_table(frames, markers, run.repaired))
        self._write(KINEMATICS, self._kinematics_table(frames, at_frames(whole, own)))
        numbered = []
        for row in cycles:
            self._numbers[row.kind, row.of] += 1
            numbered.append(replace(row, number=self._numbers[row.kind, row.of]))
        for name, table in cycle_tables(whole, numbered).items():
            self._cycles.setdefault(name, []).append(table)
        sd = markers.sd_m[markers.status == Status.MEASURED]
        self._blocks.append(
            {"first_frame": core.start + 1, "last_frame": core.stop}
            | {o.name.lower(): float(np.mean(markers.status == o)) for o in Status}
            | {"median_sd_mm": 1e3 * float(np.median(sd)) if len(sd) else np.nan, "cycles": len(cycles)}
        )

    def _write(self, name: str, table: pa.Table) -> None:
        import pyarrow.parquet as parquet  # 0.1 s, for long recordings alone

        if name not in self._open:
            schema = table.schema.with_metadata(self._meta)
            self._open[name] = parquet.ParquetWriter(self._folder / name, schema, compression="zstd")
        self._open[name].write_table(table.cast(self._open[name].schema), row_group_size=len(table))

    def _kinematics_table(self, frames: np.ndarray, found: Kinematics) -> pa.Table:
        self._quantities = self._quantities or list(found)
        columns: dict[str, Any] = {"frame": frames, "t_s": found.t_s}
        words, of_name = pa.array(REST_WORDS), {one.name: one for one in found.quantities}
        for name in self._quantities:
            one = of_name.get(name)
            empty = np.full(len(frames), np.nan)
            columns[name] = empty if one is None else one.value
            columns[f"{name}_sd"] = (empty if one is None else one.sd).astype(np.float32)
            rests = np.zeros(len(frames), dtype=np.int8) if one is None else one.rests
            columns[f"{name}_status"] = pa.DictionaryArray.from_arrays(pa.array(rests), words)
        return pa.table(columns)


def _marker_table(frames: np.ndarray, markers: MarkerTracks, repaired: np.ndarray) -> pa.Table:
    n_frames, n_markers = markers.status.shape
    names = np.tile(np.arange(n_markers, dtype=np.int32), n_frames)
    words = origin_words(markers.status, repaired).ravel()
    columns: dict[str, Any] = {
        "frame": np.repeat(frames, n_markers),
        "t_s": np.repeat(markers.t_s, n_markers),
        "marker": pa.DictionaryArray.from_arrays(pa.array(names), pa.array(list(markers.names))),
        **{f"{axis}_m": markers.xyz_m[..., k].ravel() for k, axis in enumerate("xyz")},
        "sd_m": markers.sd_m.ravel().astype(np.float32),
        "origin": pa.array(words).dictionary_encode(),
    }
    columns |= {f"cov_{name}_m2": markers.cov_m2[..., i, j].ravel().astype(np.float32) for name, i, j in COVARIANCES}
    return pa.table(columns)


def is_long(folder: Path) -> bool:
    """Whether a folder holds the result of a recording that was tracked in blocks."""
    return (folder / MARKERS).is_file() and (folder / BLOCKS).is_file()


def load_range(folder: Path, frames: range) -> Result:
    """All frames of a range, from 0, of a result that was written in blocks; without pixels and velocities.

    Only the row groups that hold them are read; covariances are in single precision.

    Raises:
        MocapError: there are no such frames.
        FormatError: the files cannot be read.
    """
    markers, repaired = LongTable(folder / MARKERS).read(slice(frames.start, frames.stop))
    whole = read_recording(folder)
    found = of_tracks(markers, whole.skeleton, name=whole.name, model=whole.model).having(repaired=repaired)
    return replace(found, source=whole.source, parts=whole.parts)
