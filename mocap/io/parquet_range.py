"""Frames of a long Parquet table, a row a frame and marker, read by range: only the row groups that hold them."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError, MocapError
from mocap.io.tables import EDITED, REPAIRED, codes
from mocap.records import MarkerTracks

if TYPE_CHECKING:
    import pyarrow as pa

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
