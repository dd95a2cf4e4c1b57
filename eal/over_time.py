"""Records of arrays over time: a field says which axis is time, so that any record can be cut, spread and joined."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

R = TypeVar("R")
T = TypeVar("T")


@dataclass(frozen=True)
class Time:
    """Annotates a field of a dataclass: an array, or a mapping of arrays, whose axis of this number is time."""

    axis: int = 0


OverTime = Annotated[T, Time()]
"""The type of such a field whose first axis is time; None may stand in its place."""


def at_frames(record: R, frames: slice | NDArray[np.int64]) -> R:
    """A record at some of its frames: all arrays over time in it, and in the records that it holds.

    Args:
        record: A dataclass with fields over time.
        frames: Which frames; -1 in an index: one of which nothing is known (numbers there are NaN).
    """

    def part(values: list[Any], axis: int) -> Any:
        (array,) = values
        out = array[(slice(None),) * (axis % array.ndim) + (frames,)]
        if not isinstance(frames, slice) and (frames < 0).any():
            out[(slice(None),) * (axis % array.ndim) + (frames < 0,)] = np.nan
        return out

    return _of([record], part)


def _of(records: Sequence[Any], part: Any) -> Any:
    """One record of several: timed arrays as ``part`` makes them of those of all, all else as in the first."""
    first = records[0]
    if not is_dataclass(first) or isinstance(first, type):
        if isinstance(first, Mapping):
            made = {key: _of([one[key] for one in records], part) for key in first}
            return made if any(made[key] is not first[key] for key in first) else first
        if isinstance(first, tuple):
            made = tuple(_of(list(each), part) for each in zip(*records, strict=True))
            return made if any(a is not b for a, b in zip(made, first, strict=True)) else first
        return first
    changes = {}
    for one in fields(first):
        values = [getattr(record, one.name) for record in records]
        axis = next((mark.axis for mark in getattr(one.type, "__metadata__", ()) if isinstance(mark, Time)), None)
        if axis is None:
            made = _of(values, part)
        elif isinstance(values[0], Mapping):
            made = {key: part([value[key] for value in values], axis) for key in values[0]}
        else:
            made = None if values[0] is None else part(values, axis)
        if made is not values[0]:
            changes[one.name] = made
    return replace(first, **changes) if changes else first
