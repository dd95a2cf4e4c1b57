"""Whole columns of a recording: time axes, points that are not always there, line segments."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from eal.arrays import Array

Single = NDArray[np.float32]
"""Numbers as the viewer keeps them."""

FRAME = "frame"
TIME = "time"


_NUMBERS: ContextVar[tuple[int, int]] = ContextVar("numbers", default=(1, 1))


@contextmanager
def numbered_from(first: int, *, every: int = 1) -> Iterator[None]:
    """Frames are numbered from ``first`` inside, in steps of ``every``: parts keep the numbers of the whole."""
    token = _NUMBERS.set((first, every))
    try:
        yield
    finally:
        _NUMBERS.reset(token)


def time_columns(t_s: Array, *, at: NDArray | None = None) -> list[rr.TimeColumn]:
    """The two time axes: the number of the frame, from 1 as in the tables, and the time in whole nanoseconds.

    See ``numbered_from`` for recordings of a part.

    Args:
        t_s: (T,) times in seconds.
        at: Indices of the frames to take, from 0; None: all.
    """
    frames = np.arange(len(t_s)) if at is None else at
    ns = np.round(t_s[frames] * 1e9).astype(np.int64)
    first, every = _NUMBERS.get()
    return [
        rr.TimeColumn(FRAME, sequence=first + every * frames),
        rr.TimeColumn(TIME, duration=ns.astype("timedelta64[ns]")),
    ]


def changing(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Frames that need an entry where most frames have nothing to show: those with something, and those just after."""
    some = counts > 0
    return np.flatnonzero(some | np.append(True, some[:-1]))


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


def names_of(labels: Sequence[str]) -> list[rr.AnnotationInfo]:
    """Keypoints named in order."""
    return [rr.AnnotationInfo(id=i, label=label) for i, label in enumerate(labels)]
