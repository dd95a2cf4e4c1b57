"""Tables of pixels whose titles were typed: marker, camera and axis in other words than DLTdv's ``tip_cam1_X``.

They have spaces or other separators, another word for the camera, or lower and upper case mixed.
"""

import re
from pathlib import Path

from mocap.errors import FormatError
from mocap.io.argus import PIXEL as ARGUS
from mocap.io.columns import Key, laid_out
from mocap.io.contents import FileContents, pixel_recording
from mocap.io.csv_table import read_table
from mocap.io.dltdv_files import PIXEL, names_of
from mocap.io.format import Format, Hints
from mocap.io.head import Head
from mocap.io.lines import frame_numbers
from mocap.io.optical import rate_of_times
from mocap.io.plain import is_frame, seconds_of

_CAMERA = r"(?:camera|cam|view|kamera|c|v)[ _.#-]*(?P<camera>\d+)"
_TITLES = (
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
            match = next(filter(None, (pattern.fullmatch(plain) for pattern in _TITLES)), None)
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
    return bool(columns_of(head.cells())) and not (names_of(head, PIXEL) or names_of(head, ARGUS))


def _read(path: Path, _hints: Hints) -> FileContents:
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
    fps, told = (None, []) if time is None else rate_of_times(path, time)
    first = next(iter(where))
    title = header[where[first]]
    said = f"titles were typed: {title!r} is read as marker {first[1]!r}, camera {first[0]}, {'xy'[first[2]]}"
    return pixel_recording(
        path,
        "typed-pixels",
        names=list(dict.fromkeys(name for _, name, _ in where)),
        cameras=[f"cam{camera}" for camera in sorted({camera for camera, _, _ in where})],
        uv_px=laid_out(values, where, 2),
        frames=frames,
        first=1 if frames is None else int(frames[0]),
        fps=fps,
        findings=(said, *told, "the file does not record the corner that pixel rows are counted from"),
        assumed=(said,),
    )


FORMATS = (
    Format(
        name="typed-pixels",
        title="a table of pixels, titles of marker, camera and axis (tip cam1 X)",
        knows=_is_typed,
        read=_read,
    ),
)
