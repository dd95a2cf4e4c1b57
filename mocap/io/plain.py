"""Plain CSV tables of numbers: by a map of columns that the user states, or by titles ``<name>_x, _y, _z``."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.argus import ARGUS_PIXEL
from mocap.io.contents import FileContents, pixel_recording, point_recording
from mocap.io.csv_table import Key, has_titles, laid_out, read_table
from mocap.io.dltdv import PIXEL, names_of
from mocap.io.format import Format, Head, Hints, file_format
from mocap.io.lines import FRAMES, even_times, frame_numbers, time_unit_s
from mocap.text import number_of

_UNITS = "mm|cm|dm|um|m|in|ft"
_UNIT = re.compile(rf"(?P<title>.+?)\s*(?:[\[(]\s*(?P<a>{_UNITS})\s*[\])]|(?<=[xyzXYZ])[ _](?P<b>mm|cm|m))", re.DOTALL)
_TITLES = (
    re.compile(r"(?P<name>.*?)[ _.:/-]?\s*[\[(]?(?P<axis>[xyzXYZ])[\])]?"),
    re.compile(r"(?P<axis>[xyzXYZ])(?:[ _.:/-](?P<name>.+)|(?P<number>\d+))"),
)
"""``nose_x``, ``nose.X``, ``nose (x)``; or ``x_nose``, ``x1``: those of a table are all of one kind."""
LIKELY = re.compile(r"(?P<name>.*?)[ _.:-]?(?P<axis>likelihood|confidence|conf|score|prob(ability)?)", re.IGNORECASE)
"""Titles of likelihoods: as a marker's third column they make the first two pixels."""
_TIMES = re.compile(
    r"(?P<what>((elapsed|video|relative|frame)[ _]?)?(time[ _]?stamps?|time|zeit|temps|tiempo|tempo|t)|elapsed|)"
    r"[ _]?\s*[\[(,/]?\s*(?P<unit>[a-zµμ]*?)\s*[\])]?",
    re.IGNORECASE,
)
"""Titles of times, in the languages that spreadsheets are often written in."""
_FRAMES = re.compile(FRAMES, re.IGNORECASE)


def parse_columns(text: str) -> dict[str, tuple[str, ...]]:
    """``"tip=x1,y1,z1;root=4,5,6;time=t"`` to marker and columns: titles, or numbers from 1.

    Raises:
        FormatError: it is not of that form.
    """
    found: dict[str, tuple[str, ...]] = {}
    for part in filter(None, (part.strip() for part in text.split(";"))):
        name, equals, columns = part.partition("=")
        cells = tuple(cell.strip() for cell in columns.split(","))
        if not equals or not name.strip() or not all(cells) or name.strip() in found:
            raise FormatError(f"`columns` {part!r}: expected marker=column,column,column, each marker once")
        found[name.strip()] = cells
    return found


def _read(path: Path, hints: Hints) -> FileContents:
    """Three columns a marker are positions, two are pixels of one camera, also with a likelihood as the third.

    Raises:
        FormatError: no map is stated and titles give none; a column is not there; the table is broken.
    """
    header, values = read_table(path, header=has_titles(path))
    header = header or [str(c + 1) for c in range(values.shape[1])]
    plain, unit = without_unit(header)
    columns = dict(hints.columns)
    rest: list[str] = []
    if not columns:
        columns, rest = _places(_by_titles(plain) or _counted(plain, values)) or _among_others(plain)
        header = plain if columns else header
    if not columns:
        if twice := [title for title in dict.fromkeys(header) if title and header.count(title) > 1]:
            raise FormatError(f"{path.name}: the column {twice[0]!r} stands twice: rename one, so that markers differ")
        shown = ", ".join(header[:8]) + (", ..." if len(header) > 8 else "")
        raise FormatError(
            f"{path.name}: a plain table of {len(header)} columns ({shown}) in no known format (DLTdv, Argus, "
            "XMALab, Anipose, DeepLabCut, Vicon, TRC, mocap's own): state what the columns are with "
            '`columns` "tip=x1,y1,z1;root=x2,y2,z2;time=t" (titles, or numbers from 1)'
        )
    counted = columns.get("frame", (None,))[0]
    if counted in header and "time" not in columns:
        steps = np.diff(values[:, header.index(counted)])
        if (steps % 1 != 0).any() and 0 < np.median(steps) < 1:  # a timestamp in seconds
            columns = {"time" if name == "frame" else name: cells for name, cells in columns.items()}
    found = _mapped(path, header, values, columns, unit=None if hints.columns else unit, fps=hints.fps)
    if not rest:
        return found
    note = f"{number_of(len(rest), 'column is', 'columns are')} of no marker, left out: {', '.join(rest[:8])}"
    note += ", ..." if len(rest) > 8 else ""
    return replace(found, findings=(note, *found.findings), assumed=(note, *found.assumed))


def seconds_of(title: str) -> float | None:
    """Seconds in the unit of a column of times: 1, or less where its title says milliseconds, ...; None: it is none.

    A bare time stamp may be a frame number.
    """
    match = _TIMES.fullmatch(title)
    if match is None or not (match["unit"] or (match["what"] and "stamp" not in match["what"].lower())):
        return None
    return time_unit_s(match["unit"]) if match["unit"] else 1.0


def without_unit(header: list[str]) -> tuple[list[str], str | None]:
    """Titles without the unit that coordinates have in theirs, ``tip X (mm)``, and that unit if all have one."""
    found = [_UNIT.fullmatch(title) for title in header]
    units = {match["a"] or match["b"] for match in found if match}
    bare = [t for m, t in zip(found, header, strict=True) if not m and not is_frame(t) and not seconds_of(t)]
    if len(units) != 1 or any(kind.fullmatch(title) for kind in _TITLES for title in bare):
        return header, None
    return [match["title"] if match else title for match, title in zip(found, header, strict=True)], units.pop()


def is_frame(title: str) -> bool:
    """Whether a title is that of a column of frame numbers; pandas leaves that of its index empty."""
    return not title or _FRAMES.fullmatch(title) is not None


def is_mapped(head: Head, hints: Hints) -> bool:
    """Whether the columns that the user states are those of a table."""
    titles = head.cells()
    mapped = [column for columns in hints.columns.values() for column in columns]
    return bool(mapped) and all(c in titles or (c.isdigit() and 1 <= int(c) <= len(titles)) for c in mapped)


def _counted(header: list[str], values: Array) -> dict[str, tuple[str, ...]]:
    """The map where all titles but one are of x, y, z of markers, and that column counts up: it is of the frames."""
    for column, title in enumerate(header):
        counts = values[:, column]
        if len(counts) > 1 and (counts == np.round(counts)).all() and (np.diff(counts) > 0).all():
            found = _by_titles(header[:column] + header[column + 1 :])
            if found and not found.keys() & {"frame", "time"} and all(len(cells) == 3 for cells in found.values()):
                return {"frame": (title,), **found}
    return {}


def _by_titles(header: list[str]) -> dict[str, tuple[str, ...]]:
    """The map that the titles suggest; empty where one fits no marker, frame or time."""
    return next((found for kind in _TITLES if (found := _by_kind(header, kind))), {})


_NO_MARKER = re.compile(
    r"[fmtva]|f\d+|(.*[ _.-])?(g?rf|cop|force|moment|torque|emg|vel(ocity)?|acc(eleration)?|gyr(o|oscope)?"
    r"|mag(netometer)?|ang(le)?|rot(ation)?|quat(ernion)?|euler|speed|power|omega)\d*([ _.-].*)?",
    re.IGNORECASE,
)
"""Names of forces, moments, speeds and angles, which have x, y and z, too, but are no places."""


def _places(columns: dict[str, tuple[str, ...]]) -> tuple[dict[str, tuple[str, ...]], list[str]] | None:
    """The map without what is no place (forces, speeds, ...), and its titles; None where there is nothing else.

    A name of one letter is that of a marker where all titles are written so: ``F_x`` beside ``nose_x``, ``Fx`` beside
    ``Ax``. Forces are ``Fx`` beside ``nose_x`` or ``hipx``, and ``F`` and ``M`` both beside longer names.
    """
    special = {name: columns[name] for name in ("time", "frame") if name in columns}
    markers = {name: cells for name, cells in columns.items() if name not in special}
    style = {name: (cells[0][:-1].replace(name, "", 1), cells[0][-1].isupper()) for name, cells in markers.items()}
    letters = {name for name in markers if re.fullmatch(r"[fmtva]|f\d+", name, re.IGNORECASE)}
    letters |= {name for name in markers if name[0] in "mM" and {"F" + name[1:], "f" + name[1:]} & letters}
    others = {name for name in markers if name not in letters and not _NO_MARKER.fullmatch(name)}
    forces = {name for name in letters if others and style[name] not in {style[one] for one in others}}
    if not others and all(name[0] in "FM" and not style[name][0] for name in letters):
        forces = letters  # Fx, Fy, Fz, Mx, ...: the columns of a plate
    if others and min(map(len, others)) > 1:
        forces |= {"F", "M"} if {"F", "M"} <= letters else {name for name in letters & {"F", "M"} if not style[name][0]}
    places = {name: cells for name, cells in markers.items() if name in others | letters - forces}
    rest = [title for name in markers if name not in places for title in markers[name]]
    return (special | places, rest) if places else None


def _among_others(header: list[str]) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    """The map of markers with x, y and z among columns of other things, and these; of a table mostly of markers."""
    for kind in _TITLES:
        found: dict[str, dict[str, str]] = {}
        special: dict[str, tuple[str, ...]] = {}
        for title in header:
            match = kind.fullmatch(title)
            named = match.groupdict() if match else {}
            if title and (seconds_of(title) or is_frame(title)):
                special.setdefault("time" if seconds_of(title) else "frame", (title,))
            elif (name := named.get("name")) and header.count(title) == 1:
                found.setdefault(name, {}).setdefault(named["axis"].lower(), title)
        forces = {name[1:] for name in found if re.fullmatch(r"f\d+", name, re.IGNORECASE)}  # of plate 1: F1, M1
        markers = {
            name: tuple(axes[a] for a in "xyz")
            for name, axes in found.items()
            if set(axes) == set("xyz")
            and not _NO_MARKER.fullmatch(name)
            and not (name[0] in "mMtT" and name[1:] in forces)
        }
        used = {title for cells in (*special.values(), *markers.values()) for title in cells}
        rest = [title for title in header if title not in used]
        if 3 * len(markers) > len(rest) > 0:
            return special | markers, rest
    return {}, []


def _by_kind(header: list[str], kind: re.Pattern[str]) -> dict[str, tuple[str, ...]]:
    found: dict[str, dict[str, str]] = {}
    special: dict[str, tuple[str, ...]] = {}
    for title in header:
        likely = LIKELY.fullmatch(title)
        if likely is not None:
            found.setdefault(likely["name"] or "point", {})["likelihood"] = title
            continue
        match = kind.fullmatch(title)
        named = match.groupdict() if match else {}
        name = named.get("name") or "point" + (named.get("number") or "")
        if seconds_of(title):
            special["time"] = (title,)
        elif is_frame(title):
            special["frame"] = (title,)
        elif match is None or match["axis"].lower() in found.setdefault(name, {}):
            return {}
        else:
            found[name][match["axis"].lower()] = title
    if list(found).count("point") and len(found) > 1 and set(found["point"]) == {"likelihood"}:
        every = found.pop("point")["likelihood"]  # one likelihood for all markers of a frame
        found = {name: {**axes, "likelihood": every} for name, axes in found.items()}
    sets = {"".join(sorted(axes.keys() - {"likelihood"})) for axes in found.values()}
    likely = any("likelihood" in axes for axes in found.values())
    if sets not in ({"xyz"}, {"xy"}) or (sets == {"xyz"} and likely) or header.count("") > 1:
        return {}
    order = ("x", "y", "z", "likelihood")
    return special | {name: tuple(axes[a] for a in order if a in axes) for name, axes in found.items()}


def _mapped(
    path: Path,
    header: list[str],
    values: Array,
    columns: Mapping[str, tuple[str, ...]],
    *,
    unit: str | None = None,
    fps: float | None = None,
) -> FileContents:
    def column(title: str) -> Array:
        if title in header:
            return values[:, header.index(title)]
        if title.isdigit() and 1 <= int(title) <= len(header):
            return values[:, int(title) - 1]
        raise FormatError(f"{path.name}: no column {title!r}; there are {', '.join(header[:20])}")

    markers = {name: cells for name, cells in columns.items() if name not in ("time", "frame", "likelihood")}
    scores = {name: cells[2] for name, cells in markers.items() if len(cells) == 3 and LIKELY.fullmatch(cells[2])}
    if "likelihood" in columns:
        scores = dict.fromkeys(markers, columns["likelihood"][0]) | scores
    markers = {name: cells[:2] if name in scores else cells for name, cells in markers.items()}
    sizes = {len(cells) for cells in markers.values()}
    if len(sizes) != 1 or not sizes <= {2, 3}:
        raise FormatError(f"{path.name}: markers have {sorted(sizes)} columns; expected 3 each (x, y, z) or 2 (pixels)")
    table = np.stack([np.stack([column(c) for c in cells], axis=-1) for cells in markers.values()], axis=1)
    frames, times = None, None
    if "frame" in columns:
        frames = frame_numbers(path, column(columns["frame"][0]), first_line=2)
    rate, findings = None, ["read as a plain table: " + ", ".join(f"{n} = {' '.join(c)}" for n, c in columns.items())]
    if "time" in columns:
        times = column(columns["time"][0]) * (seconds_of(columns["time"][0]) or 1.0)
        if not np.isfinite(times).all():
            raise FormatError(f"{path.name}: a time is missing in the column {columns['time'][0]!r}")
        times, rate, notes = even_times(path, times, frames=frames, stated=fps)
        findings += notes
    first = 1 if frames is None else int(frames[0])
    if sizes == {2}:
        uv = np.where(np.isnan(table).any(axis=-1, keepdims=True), np.nan, table)[None]
        score = None
        if scores:
            blank = np.full(len(values), np.nan)
            score = np.stack([column(scores[n]) if n in scores else blank for n in markers], axis=1)[None]
        found = pixel_recording(
            path, "csv", names=list(markers), cameras=["cam1"], uv_px=uv, frames=frames, first=first, fps=rate,
            findings=tuple(findings), assumed=(findings[0],), score=score,
        )  # fmt: skip
        return found if unit is None else found.with_unit(unit)
    return point_recording(
        path, "csv", names=list(markers), xyz=table, unit=unit, frames=frames, first=first, fps=rate, t_s=times,
        findings=tuple(findings), assumed=(findings[0],),
    )  # fmt: skip


def _is_table(head: Head) -> bool:
    """Text whose first two lines have as many commas, at least one, and a number in the second."""
    first, second = [re.sub(r'"[^"]*"', "", line) for line in [*head.lines, "", ""][:2]]
    return 0 < first.count(",") == second.count(",") and re.search(r"(^|,)\s*[-+.]?\d", head.lines[1]) is not None


CSV = Format(
    name="csv",
    title="a plain CSV table, with --columns",
    knows=_is_table,
    read=_read,
    signs="csv table numbers time x y",
    any_names=True,
)


_CAMERA = r"(?:camera|cam|view|kamera|c|v)[ _.#-]*(?P<camera>\d+)"
_TYPED = (
    re.compile(rf"(?P<name>.+?)[ _.:/-]+{_CAMERA}[ _.:/-]*(?P<axis>[xyuv])", re.IGNORECASE | re.ASCII),
    re.compile(rf"{_CAMERA}[ _.:/-]+(?P<name>.+?)[ _.:/-]+(?P<axis>[xyuv])", re.IGNORECASE | re.ASCII),
)
_PIXELS = re.compile(r"\s*[\[(](px|pix|pixels?)[\])]", re.IGNORECASE)
_SPACES = re.compile(r"\s+")


def columns_of(titles: tuple[str, ...]) -> dict[Key, int]:
    """Where each coordinate is; empty where a title is none, or a marker lacks one in some camera.

    Names that differ in case or in how many spaces they have are one where they complete each other, else two.
    """
    for alike in (str, str.casefold):
        found: dict[Key, int] = {}
        spelt: dict[str, str] = {}
        for place, title in enumerate(titles):
            if is_frame(title) or seconds_of(title):
                continue
            plain = _SPACES.sub(" ", _PIXELS.sub("", title)).strip()
            match = next(filter(None, (pattern.fullmatch(plain) for pattern in _TYPED)), None)
            if match is None:
                return {}
            name = spelt.setdefault(alike(match["name"]), match["name"])
            key = (int(match["camera"]), name, "xyuv".index(match["axis"].lower()) % 2)
            if key in found:
                return {}
            found[key] = place
        cameras, names = {camera for camera, _, _ in found}, set(spelt.values())
        if found and len(found) == 2 * len(cameras) * len(names):
            return found
    return {}


def _is_typed(head: Head) -> bool:
    return bool(columns_of(head.cells())) and not (names_of(head, PIXEL) or names_of(head, ARGUS_PIXEL))


@file_format(
    "typed-pixels", "a table of pixels, titles of marker, camera and axis (tip cam1 X)", _is_typed, any_names=True
)
def typed_pixels(path: Path, hints: Hints) -> FileContents:
    """Pixels by the marker, the camera and the axis that each title names."""
    header, values = read_table(path)
    where = columns_of(tuple(header))
    if not where:
        raise FormatError(
            f"{path.name}: titles {', '.join(header[:4])}, ...; expected marker, camera and axis: tip cam1 X"
        )
    plain = [title.lower() for title in header]
    frame = next((values[:, c] for c, title in enumerate(plain) if is_frame(title)), None)
    time = next((values[:, c] * s for c, title in enumerate(plain) if (s := seconds_of(title))), None)
    frames = None if frame is None else frame_numbers(path, frame, first_line=2)
    fps, rate_notes = (None, []) if time is None else even_times(path, time, frames=frames, stated=hints.fps)[1:]
    first = next(iter(where))
    title = header[where[first]]
    note = f"titles were typed: {title!r} is read as marker {first[1]!r}, camera {first[0]}, {'xy'[first[2]]}"
    return pixel_recording(
        path,
        "typed-pixels",
        names=list(dict.fromkeys(name for _, name, _ in where)),
        cameras=[f"cam{camera}" for camera in sorted({camera for camera, _, _ in where})],
        uv_px=laid_out(values, where, 2),
        frames=frames,
        first=1 if frames is None else int(frames[0]),
        fps=fps,
        findings=(note, *rate_notes, "the file does not record the corner that pixel rows are counted from"),
        assumed=(note,),
    )
