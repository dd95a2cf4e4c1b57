"""Known points of a scene, and where they were clicked in the image of each camera."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.lines import MISSING_WORDS, cells_of

_NAMES = frozenset({"name", "point", "marker", "label", "id"})
_CAMERAS = frozenset({"camera", "cam", "view"})
_XYZ = re.compile(r"([xyz])(?:[ _]*[\[(]?(mm|cm|m)[\])]?)?", re.IGNORECASE)
_UV = re.compile(r"(?:(.+?)[ _.:-]+)?([xyuv])(?:[ _]*[\[(]?(?:px|pix|pixels?)[\])]?)?", re.IGNORECASE)
UNITS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


def read_scene(path: Path, unit: str | None) -> tuple[list[str], Array]:
    """Names (P) and places (P, 3) in metres of ``[name,]x,y,z``, as ``unit`` or the titles (``x_mm``) say.

    Raises:
        FormatError: other columns, a cell that is no number, or another unit in the titles.
    """
    titles, rows = _cells(path)
    axes = {m[1].lower(): (i, (m[2] or "").lower()) for i, t in enumerate(titles) if (m := _XYZ.fullmatch(t))}
    if sorted(axes) != list("xyz"):
        raise FormatError(f"{path.name}: columns {', '.join(titles[:8])}; expected name,x,y,z: a row for each point")
    units = {u for _, u in axes.values() if u}
    if len(units) > 1 or (unit and units and units != {unit}):
        raise FormatError(f"{path.name}: its titles state {', '.join(sorted(units))}: give `unit` as they do")
    scale = UNITS_M[unit or next(iter(units), "m")]
    xyz = np.array([[_number(path, row[axes[a][0]], i) for a in "xyz"] for i, row in enumerate(rows)])
    names = _column(titles, _NAMES)
    labels = [row[names] for row in rows] if names is not None else [str(i + 1) for i in range(len(rows))]
    if len(set(labels)) != len(labels):
        raise FormatError(f"{path.name}: point {max(labels, key=labels.count)!r} is listed twice: rename one")
    return labels, scale * xyz


def read_clicks(path: Path, cameras: Sequence[str], points: Sequence[str]) -> Array | None:
    """Pixels (C, P, 2) of points in cameras; NaN where not clicked.

    Two tables are known: ``camera,point,x,y``, one row for each; and one row per point, ``[point,]left_x,left_y,...``
    with the names of the cameras or their numbers (``cam1_x``).

    Returns:
        The pixels; None where the table is neither (as a tracker's, with a row a frame).

    Raises:
        FormatError: a camera or point that is not known, rows that are not those of the points, or no number.
    """
    titles, rows = _cells(path)
    where, named = _column(titles, _CAMERAS), _column(titles, _NAMES)
    out = np.full((len(cameras), len(points), 2), np.nan)
    found = [(i, m) for i, t in enumerate(titles) if i not in (where, named) and (m := _UV.fullmatch(t))]
    if where is not None:
        axes = {"xyuv".index(m[2].lower()) % 2: i for i, m in found if not m[1]}
        if len(axes) != 2 or named is None:
            raise FormatError(
                f"{path.name}: columns {', '.join(titles[:8])}; expected camera,point,x,y: one row for each"
            )
        for i, row in enumerate(rows):
            c = _index(path, "camera", row[where], cameras, i)
            p = _index(path, "point", row[named], points, i)
            if np.isfinite(out[c, p]).any():
                raise FormatError(
                    f"{path.name}: row {i + 1} clicks {row[named]} in {row[where]} again: keep one of the clicks"
                )
            out[c, p] = [_number(path, row[axes[a]], i) for a in (0, 1)]
        return out
    owners = list(dict.fromkeys(m[1] for _, m in found))
    if len(cameras) == 1 and owners == [None]:
        order: dict[str | None, int] = {None: 0}
    elif set(owners) <= set(cameras):
        order = {o: cameras.index(o) for o in owners}
    elif all(o and re.fullmatch(r"(?:camera|cam|view|c)[ _.#-]*\d+", o, re.IGNORECASE) for o in owners):
        order = {o: int(re.findall(r"\d+", o)[-1]) - 1 for o in owners}
        if not all(0 <= c < len(cameras) for c in order.values()):
            raise FormatError(
                f"{path.name}: clicks of {', '.join(owners)}, but the lenses are of {', '.join(cameras)}: name the "
                "columns as the lenses, as in " + f"{cameras[0]}_x"
            )
    else:
        return None
    if len(found) != 2 * len(owners) or (named is None and len(rows) != len(points)):
        raise FormatError(
            f"{path.name}: {len(rows)} rows and columns {', '.join(titles[:8])}; expected a row for each of the "
            f"{len(points)} points, with x and y of each camera"
        )
    for i, row in enumerate(rows):
        p = i if named is None else _index(path, "point", row[named], points, i)
        for column, m in found:
            out[order[m[1]], p, "xyuv".index(m[2].lower()) % 2] = _number(path, row[column], i)
    return out


def _cells(path: Path) -> tuple[list[str], list[list[str]]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: cannot be read as a table: {error}") from None
    rows = [[c.strip() for c in row] for row in cells_of(path, text.splitlines()) if any(c.strip() for c in row)]
    if len(rows) < 2:
        raise FormatError(f"{path.name}: contains no rows below its titles; expected a table with titles")
    wrong = next((i for i, row in enumerate(rows) if len(row) != len(rows[0])), None)
    if wrong is not None:
        raise FormatError(f"{path.name}: line {wrong + 1} has {len(rows[wrong])} cells, expected {len(rows[0])}")
    return rows[0], rows[1:]


def _column(titles: Sequence[str], words: frozenset[str]) -> int | None:
    return next((i for i, t in enumerate(titles) if t.lower() in words), None)


def _number(path: Path, cell: str, row: int) -> float:
    if cell in MISSING_WORDS:
        return np.nan
    try:
        return float(cell)
    except ValueError:
        text = f"{path.name}: row {row + 1}: {cell!r:.80} is not a number; correct it or write NaN"
        raise FormatError(text) from None


def _index(path: Path, what: str, name: str, names: Sequence[str], row: int) -> int:
    if name not in names:
        raise FormatError(
            f"{path.name}: row {row + 1}: there is no {what} {name!r}; known: {', '.join(names[:20])}: correct the name"
        )
    return names.index(name)
