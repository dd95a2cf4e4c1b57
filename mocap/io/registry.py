"""All formats: recognising, reading and writing files, what a format cannot store, and which one comes nearest."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import TypeVar

import numpy as np

from mocap.cameras.camera import flipped
from mocap.errors import FormatError
from mocap.io import keypoints_json, plain
from mocap.io.contents import FILLED, FileContents
from mocap.io.crop import has_crops
from mocap.io.elsewhere import formats_elsewhere
from mocap.io.format import Format, Head, Hints, head
from mocap.io.number_spelling import Undecided
from mocap.io.plausible import plausible
from mocap.io.transcribe import transcribed
from mocap.records import Status
from mocap.text import number_of

_SUFFIXES = {
    **{end: f"{end} table" for end in ("csv", "tsv")},
    **{end: end for end in ("mat", "toml", "xml", "json")},
    **dict.fromkeys(("yml", "yaml"), "yaml"),
    **dict.fromkeys(("pickle", "pkl"), "pickle"),
    **dict.fromkeys(("h5", "hdf5"), "hdf5"),
    "nc": "hdf5 netcdf",
    "txt": "text",
    "xcp": "xml cameras",
    "c3d": "c3d binary",
    "trc": "trc tsv",
    "parquet": "parquet binary",
}
KIND = 3.0
"""What a word for the kind of file counts, beside 1 or 2 for another word. Chosen; not measured."""
_MAGIC = (
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"\x89PNG", "a PNG image"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive (or an Office document)"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"RIFF", "an AVI video or a WAV sound"),
    (b"SQLite format", "an SQLite database"),
    (b"\x80", "a Python pickle"),
)


def looks_like(head: Head) -> str:
    """What a file is by its beginning, in words: its kind, and how it begins."""
    if head.is_hdf5:
        return "an HDF5 file with " + ", ".join(sorted(head.hdf5)[:6])
    if head.is_classic_netcdf:
        return "a NetCDF file with " + ", ".join(sorted(head.netcdf)[:6])
    if head.mat:
        return f"a MATLAB file with {', '.join(sorted(head.mat)[:6])}"
    if head.start[4:8] == b"ftyp":
        return "an MP4 or MOV video"
    magic = next((name for start, name in _MAGIC if head.start.startswith(start)), None)
    if magic is not None:
        return magic
    if not head.lines:
        return "a binary file"
    text = head.first.strip()
    begins = f"that begins {head.first[:60]!r}"
    if text[:1] in ("{", "[") and not re.match(r"\[[\w.]+\]\s*$", text):
        keys = re.findall(r'"([A-Za-z_]\w*)"\s*:', "\n".join(head.lines)[:20_000])
        named = ", ".join(dict.fromkeys(keys))[:120]
        return f"JSON with {named}" if named else f"JSON {begins}"
    if text.startswith("<"):
        tags = re.findall(r"<([A-Za-z_][\w:]*)", "\n".join(head.lines)[:20_000])
        return "XML with " + ", ".join(dict.fromkeys(tags)) if tags else f"XML {begins}"
    if text.startswith("%YAML"):
        return f"YAML {begins}"
    if re.match(r"\[[\w.]+\]\s*$", text):
        return f"text in sections (TOML or INI), {begins}"
    rows = [line for line in head.lines[:40] if line.strip()]
    for name, separator in (("commas", ","), ("tabs", "\t"), ("semicolons", ";")):
        counts = [len(row.split(separator)) for row in rows]
        if len(rows) >= 2 and counts[-1] > 1 and counts.count(counts[-1]) > len(rows) / 2:
            titles = [row for row in rows if not _numbers(row, separator)]
            kind = f"{len(titles)} rows of titles first" if len(titles) < 6 else "text"
            kind = kind if titles else "rows of numbers"
            return f"a table of {counts[-1]} columns, separated by {name}, {kind}, {begins}"
    return f"text {begins}"


def _numbers(row: str, separator: str) -> bool:
    cells = [cell.strip() for cell in row.split(separator)]
    return sum(bool(re.fullmatch(r"[-+0-9.eE]+|nan|NaN|", cell)) for cell in cells) > len(cells) / 2


def nearest(head: Head) -> list[Format]:
    """The three formats that share most words with the beginning of a file, its kind and its name."""
    description = f"{looks_like(head)} {_SUFFIXES.get(head.path.suffix.lower().lstrip('.'), '')} {head.path.stem}"
    text = description + " " + " ".join(head.lines[:40])
    found = _words(text)

    def score(format: Format) -> float:
        signs = _words(format.signs or f"{format.name} {format.title}")
        kinds = {"csv", "tsv", *(word for words in _SUFFIXES.values() for word in words.split())}
        weights = (KIND if sign in kinds else 2.0 if len(sign) > 4 else 1.0 for sign in signs & found)
        return sum(weights) / (3 + len(signs)) ** 0.5

    return sorted((f for f in formats() if not f.is_set), key=lambda f: -score(f))[:3]


def _words(text: str) -> set[str]:
    """Words in lower case, with numbers in them made alike, and the parts of names with underscores."""
    words = {re.sub(r"\d+", "1", word.lower()) for word in re.findall(r"[A-Za-z_][A-Za-z0-9_]*", text)}
    return words | {part for word in words for part in word.split("_") if len(part) > 1}


ELSEWHERE = "formats of other packages"
PLACES = (
    *("dvproject", "dltdv", "dltdv_sparse", "easywand", "profile", "deeplabcut", "sleap", "movement", "nwb", "anipose"),
    *("other_rigs", "mayacam", "bouguet", "not_read", "keypoints_json", "matlab_points", "video_tables", "qualisys"),
    *("optical_csv", "trc", "c3d", "tables_long", "tables", "tidy", "plain:typed-pixels", "xmalab", "argus"),
    *(ELSEWHERE, "plain:csv"),
)
"""Files of this folder, or a format of one, in the order in which they are asked: where two know a file, the first is
right. A file is loaded when its turn comes."""


@cache
def _of(place: str) -> tuple[Format, ...]:
    """The formats of a place, in the order in which its file defines them."""
    if place == ELSEWHERE:
        return formats_elsewhere()
    file, _, name = place.partition(":")
    found = (one for one in vars(import_module(f"mocap.io.{file}")).values() if isinstance(one, Format))
    return tuple(one for one in found if name in ("", one.name))


def formats() -> Iterator[Format]:
    """All formats, in the order in which they are asked."""
    return (format for place in PLACES for format in _of(place))


NANOMETRE = 1e-9  # the last digit that is written
Result = TypeVar("Result")


def by_name(name: str) -> Format:
    """A format by its name.

    Raises:
        FormatError: there is none of that name.
    """
    found = next((format for format in formats() if format.name == name), None)
    if found is None:
        raise FormatError(f"no format {name!r}; there are {', '.join(sorted(format.name for format in formats()))}")
    return found


def identify(path: Path, hints: Hints | None = None) -> Format:
    """The format of a file: the one that the user states, else by its content.

    Raises:
        FormatError: it cannot be read, or begins like no format; the message says what was looked for.
    """
    hints = hints or Hints()
    if path.is_dir() and any(path.glob("*.json")) | any(path.glob("*/*.json")):
        return by_name("pose-json")
    return _of_either(path, hints, None, lambda file, _: _identify(file, hints))


def _of_either(
    path: Path, hints: Hints, format: Format | None, result: Callable[[Path, Sequence[str]], Result]
) -> Result:
    """What comes of a file or, where it is refused, of the table in it laid out anew (``mocap.io.title_rows``).

    Args:
        path: What the user named.
        hints: What the user states.
        format: What the file is, if that is known.
        result: What is wanted, of the file to read and of sentences on how its text was read.
    """

    def fits(beginning: Head) -> bool:
        return (_is_known if format is None else format.knows)(beginning)

    stands = False
    try:
        with transcribed(path, knows=_is_known, named=_is_named, sheet=hints.sheet) as (file, notes):
            stands = format is not None and format.name != "csv" and fits(head(file))
            return result(file, notes)
    except Undecided:
        raise
    except FormatError as error:
        if format is not None and format.of_words:
            raise
        with transcribed(path, knows=_is_known, sheet=hints.sheet, anew=True) as (file, notes):
            if file == path or not (hints.format or fits(head(file)) or plain.is_mapped(head(file), hints)):
                raise error from None
            try:
                return result(file, notes)
            except FormatError as again:
                raise error if stands else FormatError("; ".join([str(again), *notes])) from None


def _is_known(beginning: Head) -> bool:
    return any(format.knows(beginning) for format in formats())


def _is_named(beginning: Head) -> bool:
    """Whether a format of columns with names of its own knows a text; others take any names."""
    return any(f.knows(beginning) for f in formats() if not f.any_names)


def _identify(path: Path, hints: Hints) -> Format:
    beginning = head(path)
    if hints.format is not None:
        return by_name(hints.format)
    if beginning.lines and plain.is_mapped(beginning, hints):
        return by_name("csv")
    for format in formats():
        if format.knows(beginning):
            return format
    if looks_like(beginning) == "an MP4 or MOV video" or path.suffix.lower() in (
        ".avi",
        ".mkv",
        ".cine",
        ".mp4",
        ".mov",
    ):
        raise FormatError(f"{path.name}: is a video, in which nothing is digitised yet: mocap digitise does that")
    if has_crops(path):
        raise FormatError(f"{path.name}: crop offsets of a cropped video: give them as `crop`, with the video's pixels")
    near = "; ".join(f"{format.title} (`format` {format.name})" for format in nearest(beginning))
    raise FormatError(
        f"{path.name}: {looks_like(beginning)}: not a known format. Nearest are {near}. If it is a table, state what "
        "its columns hold with `columns`"
    )


def read(path: Path, hints: Hints | None = None) -> FileContents:
    """Read a file of any format.

    Raises:
        FormatError: it is of none, or not what its format promises.
    """
    hints = hints or Hints()
    return read_as(by_name("pose-json") if path.is_dir() else identify(path, hints), path, hints)


def read_as(format: Format, path: Path, hints: Hints) -> FileContents:
    """Read a file of a known format.

    Raises:
        FormatError: it is not what the format promises.
    """
    if path.is_dir():
        return plausible(keypoints_json.read_folder(path), hints.zero)
    if format.beside:
        return plausible(format.read(path, hints), hints.zero)

    def of_file(file: Path, notes: Sequence[str]) -> FileContents:
        """As of the file that the user named, its findings beginning with how its text was read."""
        _ = head(file).netcdf  # a damaged file is refused here, in whatever format it is asked for
        found = plausible(format.read(file, hints), hints.zero)
        return replace(found, paths=(path,), findings=(*notes, *found.findings), assumed=(*notes, *found.assumed))

    return _of_either(path, hints, format, of_file)


as_table = partial(transcribed, knows=_is_known)
"""For readers of one kind of table that the user names as such: camera profiles, coefficients, known points."""


def writer(path: Path, name: str | None) -> Format:
    """The format to write: the one named, else the one that the end of the file's name means.

    Raises:
        FormatError: there is none, or it is only read.
    """
    if name is not None:
        format = by_name(name)
    else:
        ends = [(len(end), f) for f in formats() for end in f.suffixes if path.name.lower().endswith(end.lower())]
        if not ends:
            endings = ", ".join(dict.fromkeys(end for f in formats() for end in f.suffixes))
            raise FormatError(
                f"{path.name}: no format is written to files with this ending (known: {endings}): give `to`"
            )
        format = max(ends, key=lambda pair: pair[0])[1]
    if format.write is None:
        names = ", ".join(f.name for f in formats() if f.write is not None)
        raise FormatError(f"{path.name}: {format.title} can only be read; formats that can be written are {names}")
    return format


def parts(recording: FileContents) -> dict[str, str]:
    """What a recording holds, and how to call it."""
    found = {}
    if recording.pixels is not None:
        plane = recording.plane_mm is not None
        found["pixels"] = "positions in a plane" if plane else f"pixels of {len(recording.camera_names)} cameras"
        if recording.pixel_origin is not None:
            found["pixel_origin"] = f"the corner that pixel rows are counted from ({recording.pixel_origin})"
    if recording.points is not None:
        found["points"] = "positions"
        if np.isfinite(recording.points.sd_m).any():
            found["sd"] = "standard deviations"
        filled = int(np.isin(recording.points.status, FILLED).sum())
        if filled:
            found["origin"] = f"which samples are filled instead of measured ({filled})"
    if recording.cameras:
        found["cameras"] = f"the calibration of {len(recording.cameras)} cameras"
    elif recording.lenses:
        found["lenses"] = f"{len(recording.lenses)} lenses"
    if recording.score is not None:
        found["score"] = "scores (confidence) of samples"
    if len({animal for animal, _ in recording.animals}) > 1:
        found["animals"] = "which animal a marker belongs to (only in the marker's name)"
    if recording.fps is not None:
        found["fps"] = f"the frame rate, {recording.fps:g}"
    if len(recording.frames) and recording.frames[0] > 1:
        found["first_frame"] = f"the number of the first frame, {recording.frames[0]}"
    jumps = int((np.diff(recording.frames) != 1).sum())
    if jumps:
        found["frame_numbers"] = f"{jumps} jumps of the frame numbers"
    if recording.unit is not None and (recording.points is not None or recording.cameras):
        found["unit"] = f"the unit of lengths, {recording.unit}"
    for name, table in recording.tables.items():
        if np.isfinite(table).any() and (name != "offset_frames" or table.any()):
            found[name] = f"the table {name}"
    return found


def _from_the_top(path: Path, format: Format, recording: FileContents) -> FileContents:
    """The recording with pixel rows counted from the upper left."""
    sizes = [camera.size_px for camera in recording.cameras] or [size for _, size in recording.lenses]
    if recording.pixels is None or None in sizes or not sizes or (recording.cameras and "cameras" in format.holds):
        raise FormatError(
            f"{path.name}: {format.title} counts pixel rows from the upper left, {recording.paths[0].name} from the "
            "lower left: convert it with the camera profile alone, which states the heights of the images"
        )
    uv = [flipped(own, float(size[1])) for own, size in zip(recording.pixels.uv_px, sizes, strict=True) if size]
    return replace(recording, pixels=replace(recording.pixels, uv_px=np.stack(uv)), pixel_origin="upper-left")


def write(recording: FileContents, path: Path, name: str | None = None, *, filled: bool = False) -> list[str]:
    """Write a recording to a file, in place of what is there, as the end of its name says or ``name`` does.

    Filled samples go to formats that can say that they are filled; to others only where ``filled`` asks for them.

    Returns:
        A sentence for each thing that the file does not hold, or holds otherwise.

    Raises:
        FormatError: the format cannot hold any of the tracks (or cameras), or needs what the recording does not have.
    """
    format = writer(path, name)
    contents = parts(recording)
    if not format.holds & contents.keys() & {"pixels", "points", "cameras", "lenses", "transforms", "quantities"}:
        there = ", ".join(contents.values()) or "nothing"
        advice = ": triangulate first: mocap triangulate" if "pixels" in contents and "points" in format.holds else ""
        if recording.plane_mm is not None:
            advice = ": they are a table already, and mocap track writes them in metres"
        raise FormatError(
            f"{path.name}: {format.title} cannot store what {recording.paths[0].name} contains ({there})" + advice
        )
    for need in sorted(format.needs - contents.keys() - ({"unit"} if "quantities" in contents else set())):
        option = {"fps": "the frame rate (give `fps`)", "unit": "the unit of lengths (give `unit`)"}[need]
        raise FormatError(
            f"{path.name}: {format.title} needs {option}, because {recording.paths[0].name} does not state it"
        )
    kept = format.holds - {"pixels"} if {"points", "pixels"} <= contents.keys() and not format.both else format.holds
    losses = [f"not written: {text}" for part, text in contents.items() if part not in kept]
    if "pixels" in contents.keys() & kept and "pixel_origin" in format.holds:
        if recording.pixel_origin == "lower-left":
            recording = _from_the_top(path, format, recording)
            losses.append("pixel rows, counted from the lower left, are written as counted from the upper left")
        elif recording.pixel_origin is None:
            losses.append("pixel rows are written as they are, and will be read as counted from the upper left")
    points = recording.points
    if points is not None and "points" in format.holds:
        if "origin" in contents and "origin" not in format.holds:
            mask = np.isin(points.status, FILLED) & points.seen
            count = int(mask.sum())
            if filled:
                losses.append(
                    f"{number_of(count, 'filled sample is', 'filled samples are')} written like measured ones"
                )
            elif mask.any():
                xyz = np.where(mask[..., None], np.nan, points.xyz_m)
                points = replace(points, xyz_m=xyz, status=np.where(mask, Status.MISSING, points.status))
                left = number_of(count, "filled sample is left as a gap", "filled samples are left as gaps")
                losses.append(f"{left}; `filled` writes {'it' if count == 1 else 'them'}")
        zero = np.all(np.abs(points.xyz_m) < 0.5 * NANOMETRE, axis=-1)  # they would be rounded to it
        if format.zero_is_missing and zero.any():
            points = replace(points, xyz_m=np.where(zero[..., None], NANOMETRE, points.xyz_m))
            at = "at (0, 0, 0), to the digits written,"
            losses.append(
                f"{number_of(int(zero.sum()), f'sample {at} is', f'samples {at} are')} set 1 nm away, because 0 means "
                "missing in this format"
            )
        recording = replace(recording, points=points)
    return losses + ((format.write(path, recording) if format.write else None) or [])
