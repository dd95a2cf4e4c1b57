"""C3D as a format of the registry, and its writer, through ezc3d."""

import errno
import os
from pathlib import Path

import numpy as np

from mocap.errors import FormatError
from mocap.io.c3d import read_c3d
from mocap.io.contents import FILLED, FileContents, points_of
from mocap.io.format import Format
from mocap.io.optical import metres
from mocap.records import MarkerTracks

MOST_FRAMES = 65535
"""The head of a C3D file counts frames with 16 bits, and ezc3d cuts off what is beyond."""
_RESIDUAL_M = 1e-5
"""One count of a residual, of which a byte holds 1 to 255."""
_GROUP = 255
"""Labels in one parameter; further ones go to LABELS2, LABELS3, ..."""


def write_c3d(path: Path, recording: FileContents) -> None:
    """Write positions as 32-bit numbers in the unit of the recording.

    The residual says where a sample comes from: -1 not seen (or rejected), 0 filled, above 0 measured: the residual
    that the recording holds, else the standard deviation, else the smallest that can be said, 0.01 mm.

    Raises:
        FormatError: there are too many frames, or a name is empty or longer than 120 bytes.
    """
    import ezc3d

    tracks, unit = points_of(path, recording), recording.unit or "m"
    if len(tracks.t_s) > MOST_FRAMES:
        raise FormatError(
            f"{path.name}: {len(tracks.t_s)} frames, but a C3D file can contain {MOST_FRAMES}: split the recording"
        )
    bad = next((name for name in tracks.names if not name.strip() or len(name.encode()) > 120), None)
    if bad is not None:
        raise FormatError(f"{path.name}: marker name {bad!r} is empty or longer than 120 bytes: rename it")
    scale = metres(path, unit)
    size = recording.tables.get("residual_m", tracks.sd_m)
    counts = np.clip(np.round(np.nan_to_num(size, nan=0.0) / _RESIDUAL_M), 1, 255)
    counts[np.isin(tracks.status, FILLED)] = 0
    residual = np.where(tracks.seen, counts * _RESIDUAL_M / scale, -1.0)
    data = np.ones((4, len(tracks.names), len(tracks.t_s)))
    data[:3] = np.transpose(tracks.xyz_m / scale, (2, 1, 0))
    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["RATE"]["value"] = [float(recording.fps or 1.0)]
    point["UNITS"]["value"] = [unit]
    names = list(tracks.names)
    point["LABELS"]["value"] = names[:_GROUP]
    for part, start in enumerate(range(_GROUP, len(names), _GROUP), start=2):
        file.add_parameter("POINT", f"LABELS{part}", names[start : start + _GROUP])
    file.add_parameter("POINT", "SCALE", [-_RESIDUAL_M / scale])
    first = int(recording.frames[0]) - 1 if len(recording.frames) else 0
    if first >= 0 and first + len(tracks.t_s) <= MOST_FRAMES:
        file["header"]["points"]["first_frame"] = first
    file["data"]["points"] = data
    masks = np.zeros((7, *residual.T.shape), dtype=bool)
    file["data"]["meta_points"] = {"residuals": residual.T[None], "camera_masks": masks}
    file.write(str(path))
    if not _holds(path, tracks):  # ezc3d does not say that a disk is full
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _holds(path: Path, tracks: MarkerTracks) -> bool:
    """Whether our own reader finds in a file what was to be written, to the seven digits of its numbers."""
    try:
        found = read_c3d(path).points
    except FormatError:
        return False
    if found is None or found.xyz_m.shape != tracks.xyz_m.shape:
        return False
    return np.allclose(found.xyz_m, np.where(tracks.seen[..., None], tracks.xyz_m, np.nan), rtol=1e-6, equal_nan=True)


FORMATS = (
    Format(
        name="c3d",
        title="C3D",
        knows=lambda head: len(head.start) > 512 and head.start[1] == 0x50 and 2 <= head.start[0] <= 0x7F,
        read=lambda path, _: read_c3d(path),
        write=write_c3d,
        holds=frozenset({"points", "first_frame", "fps", "unit", "origin", "residual_m", "sd"}),
        needs=frozenset({"fps", "unit"}),
        zero_is_missing=True,
        suffixes=(".c3d",),
    ),
)
