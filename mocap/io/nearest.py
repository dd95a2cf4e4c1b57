"""What an unknown file looks like, and which formats come nearest to it."""

import re
from collections.abc import Sequence

from mocap.io.format import Format
from mocap.io.head import Head

_SIGNS: dict[str, str] = {
    "dltdv-xypts": "csv pt1_cam1_X pt1_cam1_Y pt1_cam2_X table pixels",
    "dltdv-xyzpts": "csv pt1_X pt1_Y pt1_Z table",
    "dltdv-coefficients": "csv table numbers eleven-rows",
    "dltdv-sparse-pixels": "tsv sparse format camera coordinates file table",
    "dltdv-project": "hdf5 udExport data xypts dltpts",
    "easywand": "mat easyWandData coefs wandPts",
    "easywand-tforms": "mat camud tdata",
    "deeplabcut-csv": "csv scorer bodyparts coords likelihood table",
    "deeplabcut-h5": "hdf5 df_with_missing",
    "sleap-analysis": "hdf5 tracks node_names track_names track_occupancy",
    "anipose-3d": "csv _error _ncams _score fnum M_00 table",
    "anipose-calibration": "toml matrix distortions rotation translation size",
    "qualisys-tsv": "tsv NO_OF_FRAMES NO_OF_CAMERAS MARKER_NAMES FREQUENCY table",
    "qualisys-calibration": "xml calibration camera intrinsic focalLengthU transform",
    "optitrack-csv": "csv Format Version Take Name Frame Time (Seconds) table",
    "vicon-csv": "csv Trajectories Frame Sub table",
    "vicon-calibration": "xml Cameras Camera SENSOR_SIZE KeyFrame ORIENTATION",
    "trc": "tsv PathFileType DataRate NumMarkers table",
    "c3d": "binary c3d",
    "movement": "hdf5 netcdf position confidence time space keypoint",
    "csv-long": "csv frame marker name x y z long table",
    "csv-wide": "csv time x y z table",
    "xmalab-2d": "csv _cam1_X _cam1_Y table pixels",
    "argus-xypts": "csv cam_1_x cam_1_y table pixels",
    "easymocap": "yaml opencv-matrix K_ dist_ Rot_",
    "pose-json": "json people pose_keypoints_2d keypoints keypoint_scores",
    "parquet": "binary parquet PAR1",
    "csv": "csv table numbers time x y",
    "camera-profile": "text numbers space lenses cam f W H cx cy",
    "opencap": "pickle intrinsicMat distortion",
}
"""Words by which a format is known; formats without an entry are known by the words of their titles."""
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
_MAGIC = (
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"\x89PNG", "a PNG picture"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive (or an Office document)"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"RIFF", "an AVI film or a WAV sound"),
    (b"SQLite format", "an SQLite database"),
    (b"\x80", "a Python pickle"),
)


def looks_like(head: Head) -> str:
    """What a file is by its beginning, in words: its kind, and how it begins."""
    if head.is_hdf5:
        return "an HDF5 file with " + ", ".join(sorted(head.hdf5)[:6])
    if head.mat:
        return f"a MATLAB file with {', '.join(sorted(head.mat)[:6])}"
    if head.start[4:8] == b"ftyp":
        return "an MP4 or MOV film"
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


def nearest(head: Head, formats: Sequence[Format]) -> list[Format]:
    """The three of some formats that share most words with the beginning of a file, its kind and its name."""
    said = f"{looks_like(head)} {_SUFFIXES.get(head.path.suffix.lower().lstrip('.'), '')} {head.path.stem}"
    text = said + " " + " ".join(head.lines[:40])
    found = _words(text)

    def score(format: Format) -> float:
        signs = _words(_SIGNS.get(format.name, f"{format.name} {format.title}"))
        kinds = {"csv", "tsv", *(word for words in _SUFFIXES.values() for word in words.split())}
        weights = (3.0 if sign in kinds else 2.0 if len(sign) > 4 else 1.0 for sign in signs & found)
        return sum(weights) / (3 + len(signs)) ** 0.5

    return sorted((f for f in formats if f.name != "dltdv"), key=lambda f: -score(f))[:3]


def _words(text: str) -> set[str]:
    """Words in lower case, with numbers in them made alike, and the parts of names with underscores."""
    words = {re.sub(r"\d+", "1", word.lower()) for word in re.findall(r"[A-Za-z_][A-Za-z0-9_]*", text)}
    return words | {part for word in words for part in word.split("_") if len(part) > 1}
