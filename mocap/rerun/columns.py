"""A recording into a file, and whole columns of it: time axes, points that are not always there, line segments."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike, NDArray

from eal.arrays import Array
from mocap.errors import MocapError

Single = NDArray[np.float32]
"""Numbers as the viewer keeps them."""

FRAME = "frame"
TIME = "time"
ui = rr.components.Radius.ui_points
"""A radius in points of the screen."""
_NUMBERS: ContextVar[tuple[int, int]] = ContextVar("numbers", default=(1, 1))


class RecordingError(MocapError):
    """A recording could not be made."""


@contextmanager
def recording_into(
    path: Path, *, application: str, recording_id: str, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """A stream whose content is in the file afterwards; data that the viewer cannot take are an error meanwhile.

    rerun's own file sink says nothing of a write that fails, and may wait for ever.

    Yields:
        The stream.

    Raises:
        RecordingError: rerun is switched off, or does not take the data.
        OSError: the file cannot be written.
    """
    strict = rr.strict_mode()
    rr.set_strict_mode(True)
    try:
        rec = rr.RecordingStream(application, recording_id=recording_id, send_properties=False)
        rec.set_log_time_enabled(False)
        try:
            buffer = rec.binary_stream()
            rec.send_blueprint(blueprint, make_active=True, make_default=True)  # else a browser makes up views
            yield rec
            content = buffer.read(flush=True, flush_timeout_sec=600)
        except RuntimeError as error:
            raise RecordingError(
                f"{path.name}: the recording was not made ({error}): is the environment variable RERUN set to off?"
            ) from error
        finally:
            rec.disconnect()
    finally:
        rr.set_strict_mode(strict)
    if not content:
        raise RecordingError(f"{path.name}: rerun recorded nothing: is the environment variable RERUN set to off?")
    path.write_bytes(content)


@contextmanager
def numbered_from(first: int, *, every: int = 1) -> Iterator[None]:
    """Frames are numbered from ``first`` inside, in steps of ``every``: parts keep the numbers of the whole."""
    token = _NUMBERS.set((first, every))
    try:
        yield
    finally:
        _NUMBERS.reset(token)


def log_over_time(
    rec: rr.RecordingStream,
    path: str,
    t_s: Array,
    columns: rr.ComponentColumnList,
    look: rr.AsComponents | None = None,
    *,
    counts: ArrayLike | None = None,
    at: NDArray | None = None,
    rare: bool = False,
) -> None:
    """An entity over time, and how it looks.

    Args:
        rec: Where to.
        path: Entity.
        t_s: (T,) times.
        columns: What changes.
        look: What does not; None: that is logged elsewhere.
        counts: Of each frame, how many entries of the columns it has; None: they are divided already.
        at: The frames that have entries; None: all.
        rare: Whether most frames have nothing to show: only those with something are written, and those just after.
    """
    if look is not None:
        rec.log(path, look, static=True)
    if counts is not None:
        each = np.asarray(counts, dtype=int)
        if rare:
            at = np.flatnonzero((each > 0) | np.append(True, each[:-1] > 0))
            each = each[at]
        columns = columns.partition(each)
    # the two time axes: the number of the frame, from 1 as in the tables, and the time in whole nanoseconds
    frames = np.arange(len(t_s)) if at is None else at
    ns = np.round(t_s[frames] * 1e9).astype(np.int64)
    first, every = _NUMBERS.get()
    rec.send_columns(
        path,
        indexes=[
            rr.TimeColumn(FRAME, sequence=first + every * frames),
            rr.TimeColumn(TIME, duration=ns.astype("timedelta64[ns]")),
        ],
        columns=columns,
    )


def single(values: Array) -> Single:
    """Numbers as the viewer keeps them."""
    return np.ascontiguousarray(values, dtype=np.float32)


def segments(start: Array | Single, end: Array | Single) -> pa.Array:
    """Line strips of two points each, as an Arrow array, without a Python object a strip.

    Args:
        start: (N, D) first points; D is 2 or 3.
        end: (N, D) second points.
    """
    points = np.stack([start, end], axis=1).astype(np.float32, copy=False)
    dimension = points.shape[-1]
    batch = rr.components.LineStrip2DBatch if dimension == 2 else rr.components.LineStrip3DBatch
    kind = batch(np.zeros((1, 2, dimension), dtype=np.float32)).as_arrow_array().type
    vectors = pa.FixedSizeListArray.from_arrays(pa.array(points.ravel()), type=kind.value_type)
    offsets = pa.array(np.arange(0, 2 * len(points) + 1, 2, dtype=np.int32))
    return pa.ListArray.from_arrays(offsets, vectors, type=kind)
