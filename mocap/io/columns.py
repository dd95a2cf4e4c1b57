"""Columns whose titles say of which marker, camera and axis they are, in any order."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError

Key = tuple[int, str, int]
"""Camera (0 where columns are of none), marker and axis of a column."""


def by_title(
    path: Path,
    table: tuple[Sequence[str], Array],
    pattern: re.Pattern[str],
    axes: Sequence[str],
    *,
    expected: str,
    spare: int = 0,
) -> tuple[tuple[str, ...], list[int], Array]:
    """Names, numbers of the C cameras, and (C, T, M, A) values of a table's columns.

    Args:
        path: Of the file, for messages.
        table: Titles, and (T, columns) numbers.
        pattern: Of a title, with the groups ``name``, ``axis`` and, of pixels, ``camera``.
        axes: How each of the A axes is spelt, as the group ``axis`` matches it; other spellings follow a blank.
        expected: What titles look like, for messages.
        spare: So many axes, the last, a marker may lack: NaN.

    Raises:
        FormatError: a title is none, one appears twice, or a marker lacks an axis.
    """
    header, values = table
    axis_of = {word: axis for axis, words in enumerate(axes) for word in words.split(" ")}
    where: dict[Key, int] = {}
    for column, title in enumerate(header):
        match = pattern.fullmatch(title)
        if match is None:
            raise FormatError(f"{path.name}: column {column + 1} is {title!r}; expected {expected}")
        key = (int(match.groupdict().get("camera", 0)), match["name"], axis_of[match["axis"]])
        if key in where:
            raise FormatError(f"{path.name}: marker name {match['name']!r} appears twice (column {title}): rename one")
        where[key] = column
    needed = [words.split(" ")[0] for words in axes[: len(axes) - spare]]
    names, cameras = _grid(where)
    lacking = next((k[:2] for k in _order(names, cameras, len(needed)) if k not in where), None)
    if lacking is not None and "camera" in pattern.groupindex:
        raise FormatError(
            f"{path.name}: marker {lacking[1]!r} has no {' and '.join(word.strip('_') for word in needed)} columns for "
            f"cam{lacking[0]}: {len(header)} columns do not make {len(names)} markers x {len(cameras)} cameras x "
            f"{len(needed)}: add them, empty where nothing was seen"
        )
    if lacking is not None:
        columns = [lacking[1] + word for word in needed]
        told = " and ".join([", ".join(columns[:-1]), columns[-1]])
        raise FormatError(f"{path.name}: marker {lacking[1]!r} needs the columns {told}")
    return names, cameras, laid_out(values, where, len(axes))


def laid_out(values: Array, where: Mapping[Key, int], axes: int) -> Array:
    """(C, T, M, axes) values of (T, columns), by the place of each; NaN where there is no column."""
    names, cameras = _grid(where)
    columns = np.array([where.get(key, -1) for key in _order(names, cameras, axes)], dtype=int)
    picked = values[:, columns]  # and nothing but that: the table may be large
    picked[:, columns < 0] = np.nan
    return np.moveaxis(picked.reshape(len(values), len(cameras), len(names), axes), 1, 0)


def _grid(where: Mapping[Key, int]) -> tuple[tuple[str, ...], list[int]]:
    return tuple(dict.fromkeys(name for _, name, _ in where)), sorted({camera for camera, _, _ in where})


def _order(names: Sequence[str], cameras: Sequence[int], axes: int) -> list[Key]:
    return [(camera, name, axis) for camera in cameras for name in names for axis in range(axes)]
