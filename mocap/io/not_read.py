"""Files that are known and not read: what they are, and what to export in their place."""

import zipfile
from pathlib import Path

from mocap.errors import FormatError
from mocap.io.contents import FileContents
from mocap.io.format import Head, Hints, file_format

_TABLES = {"data2d_distorted", "kalman_estimates", "ML_estimates", "kalman_observations"}
"""Of Flydra; a recording has the first, or what was tracked in it."""
_COLUMNS = (("obj_id", "frame", "timestamp", "x", "y", "z"), ("camn", "frame", "timestamp"))
"""Of Braid's tables of positions and of detections in images."""
_PIVOT = (
    "read its table kalman_estimates (positions in metres) with pandas, and save it with one row per frame and columns "
    "frame, <obj_id>_x, <obj_id>_y, <obj_id>_z (pivot): such a CSV is read"
)


@file_format("jabs", "poses of JABS (..._pose_est_v*.h5)", lambda head: "poseest" in head.hdf5)
def _jabs(path: Path, _hints: Hints) -> FileContents:
    raise FormatError(
        f"{path.name}: poses of JABS (HDF5 with poseest), whose layout changes with its version, are not read: export "
        "them as NWB with JABS (jabs-cli convert-to-nwb), which is read"
    )


@file_format("flydra", "tracks of Flydra (HDF5)", lambda head: bool(_TABLES & head.hdf5))
def _flydra(path: Path, _hints: Hints) -> FileContents:
    raise FormatError(
        f"{path.name}: tracks of Flydra (HDF5 with data2d_distorted or kalman_estimates), objects without names that "
        f"come and go, are not read: {_PIVOT}"
    )


def _is_braid(head: Head) -> bool:
    if not head.start.startswith(b"PK\3\4"):
        return any(head.cells()[: len(columns)] == columns for columns in _COLUMNS)
    try:
        with zipfile.ZipFile(head.path) as archive:
            return any(name.startswith("data2d_distorted.csv") for name in archive.namelist())
    except (OSError, zipfile.BadZipFile):
        return False


@file_format("braid", "recording of Braid, Flydra's successor (.braidz, or a table of it)", _is_braid)
def _braid(path: Path, _hints: Hints) -> FileContents:
    raise FormatError(
        f"{path.name}: a recording of Braid (a .braidz is a ZIP archive of its tables), objects without names that "
        f"come and go, is not read: {_PIVOT}"
    )
