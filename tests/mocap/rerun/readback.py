"""Read a recording back, exactly."""

import hashlib
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from rerun.chunk import RrdReader


def column(path: Path, entity: str, component: str, *, index: str = "frame") -> tuple[NDArray, NDArray, NDArray]:
    """Times (one 0 for what is static), list lengths, and all values of a component, in the order of time."""
    parts = []
    for chunk in RrdReader(str(path)).store().stream().filter(content=entity, components=component):
        if chunk.entity_path != entity:
            continue
        batch = chunk.to_record_batch()
        if component not in batch.schema.names:
            continue
        lists = batch.column(component)
        if chunk.is_static:
            times = np.zeros(len(lists), dtype=np.int64)
        else:
            times = np.asarray(batch.column(index).cast(pa.int64())) - (index == "frame")  # frames count from 1
        parts.append((times, np.diff(np.asarray(lists.offsets)), _flat(lists.flatten())))
    if not parts:
        raise KeyError((entity, component))
    parts.sort(key=lambda part: part[0][0])
    times, lengths, values = zip(*parts, strict=True)
    return np.concatenate(times), np.concatenate(lengths), np.concatenate(values)


def digest(path: Path) -> str:
    """Of all data of a recording: the same whatever the order and size of its chunks."""
    sums = []
    for chunk in RrdReader(str(path)).store().stream():
        batch = chunk.to_record_batch()
        indexes = [] if chunk.is_static else [n for n in batch.schema.names if n in chunk.timeline_names]
        for name in batch.schema.names:
            if name in indexes or pa.types.is_fixed_size_binary(batch.column(name).type):
                continue
            for row in range(batch.num_rows):
                at = [str(batch.column(i).cast(pa.int64())[row]) for i in indexes]
                value = batch.column(name)[row].as_py()
                sums.append(f"{chunk.entity_path} {name} {at} {value!r}")
    return hashlib.sha256("\n".join(sorted(sums)).encode()).hexdigest()


def entities(path: Path) -> set[str]:
    """Paths of all entities that hold data."""
    return {chunk.entity_path for chunk in RrdReader(str(path)).store().stream()}


def _flat(values: pa.Array) -> NDArray:
    if pa.types.is_fixed_size_list(values.type):
        return np.asarray(values.flatten()).reshape(-1, values.type.list_size)
    if pa.types.is_list(values.type):
        return _flat(values.flatten())
    return np.asarray(values)
