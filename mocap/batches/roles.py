"""What a file is to a batch: tracks, a view, a calibration, a camera profile, a skeleton, or none of these."""

import re
from functools import lru_cache
from pathlib import Path
from typing import Literal

from mocap.errors import MocapError
from mocap.io.crop import has_crops
from mocap.io.format import Hints
from mocap.io.registry import identify, read
from mocap.skeleton import read_skeleton

Role = Literal["tracks", "view", "calibration", "profile", "skeleton", "none", "unknown"]
"""A view is pixels of one camera; ``none`` is known but no trial; ``unknown`` looks like data and is not known."""

CALIBRATIONS = (
    "dltdv-coefficients",
    "anipose-calibration",
    "easywand",
    "argus-sba-profile",
    "qualisys-calibration",
    "vicon-calibration",
    "optitrack-calibration",
)
"""Formats that hold all cameras of a rig; of several of one rig the first is taken."""
VIEWS = ("deeplabcut-csv", "deeplabcut-h5", "sleap-analysis")
PIXELS = ("dltdv-xypts", "argus-xypts", "typed-pixels", "xmalab-2d")
TRACKS = (
    *PIXELS,
    "dltdv-project",
    "dltdv-sparse",
    "argus-sparse",
    "movement",
    "c3d",
    "trc",
    "qualisys-tsv",
    "qualisys-mat",
    "mocaptoolbox",
    "vicon-csv",
    "optitrack-csv",
    "parquet",
    "csv-long",
    "csv-wide",
    "sleap-anipose-3d",
    "anipose-3d",
    "dltdv-xyzpts",
    "argus-xyzpts",
    "xmalab-3d",
    "csv",
)
"""Formats of trials; of several files of one trial the first is tracked, as the rawest; others go before all."""
SPARSE = ("dltdv-sparse", "argus-sparse")
DATA = (".csv", ".tsv", ".txt", ".c3d", ".trc", ".mat", ".h5", ".hdf5", ".nc", ".parquet", ".xlsx", ".toml", ".xcp")
DATA += (".cal", ".slp", ".nwb")
"""Ends of the names of files that are looked into."""
_WORDS = (
    "xypts|xyzpts|xyzres|xyzci|offsets|dltcoefs|dvproject|camera_?profiles?|profile|calibration|easywanddata|skeleton"
    "|pointnames|extrinsics?|analysis|proofread"
)
_ENDING = re.compile(rf"[-_. ]*({_WORDS})$", re.IGNORECASE)
_TRIAL = re.compile(r"(xypts|xyzpts)\.[ct]sv$|dvproject\.mat$|\.c3d$|\.trc$", re.IGNORECASE)
"""Names that only tracks have."""


def role(path: Path, hints: Hints) -> tuple[Role, str]:
    """What a file is, and the name of its format (of ``unknown``: what is wrong with it)."""
    if path.suffix.lower() not in DATA:
        return "none", ""
    try:
        name = identify(path, hints).name
    except MocapError as error:
        if path.suffix.lower() == ".toml":
            return ("skeleton", "") if _is_skeleton(path) else ("none", "")
        if _TRIAL.search(path.name):
            return "tracks", str(error)  # and its error is told when it is tracked
        return ("none", "") if path.suffix.lower() == ".txt" or has_crops(path) else ("unknown", str(error))
    if name in CALIBRATIONS:
        return "calibration", name
    if name in VIEWS:
        return "view", name
    if name == "csv":
        return _by_content(path, name, hints)
    if name == "camera-profile":
        return "profile", name
    if name in SPARSE and not re.search(r"xyz?pts\.tsv$", path.name, re.IGNORECASE):
        return "none", name
    return ("tracks", name) if name in TRACKS else _by_content(path, name, hints)


def _by_content(path: Path, name: str, hints: Hints) -> tuple[Role, str]:
    """A file is to a batch what ``mocap track`` reads it as; a table whose columns are stated is a trial."""
    try:
        found = read(path, hints)
    except MocapError as error:
        plain = name == "csv"
        return ("tracks", name) if hints.columns and plain else ("unknown" if plain else "none", str(error))
    if found.pixels is not None:
        return ("view" if len(found.camera_names) == 1 else "tracks"), name
    return ("tracks" if found.points is not None else "none"), name


def are_pixels(path: Path, format: str, hints: Hints) -> bool:
    """Whether tracks are pixels that need a calibration beside them."""
    if format in TRACKS or not format:
        return format in PIXELS or (format in SPARSE and "xypts" in path.name.lower())
    try:
        found = read(path, hints)
    except MocapError:
        return False
    return found.pixels is not None and not found.cameras


def _is_skeleton(path: Path) -> bool:
    try:
        read_skeleton(path)
    except MocapError:
        return False
    return True


def base(path: Path) -> str:
    """The name of a file without what says which part of a trial it is: ``bat_`` of ``bat_xypts.csv`` goes."""
    stem = path.stem
    while (shorter := _ENDING.sub("", stem)) != stem:
        stem = shorter
    return stem.rstrip("-_. ")


@lru_cache(maxsize=64)
def camera_names(calibration: Path) -> tuple[str, ...]:
    """Names of the cameras of a calibration; none where it cannot be read."""
    try:
        return read(calibration).camera_names
    except MocapError:
        return ()
