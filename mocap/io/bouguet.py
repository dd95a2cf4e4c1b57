"""Bouguet's Camera Calibration Toolbox for MATLAB: ``Calib_Results.mat`` of one camera, ``Calib_Results_stereo.mat``.

Its model is OpenCV's, which was made after it: the centre of the first pixel is (0, 0), ``kc`` is k1 k2 p1 p2 k3.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.apart import variables
from mocap.io.contents import FileContents, calibration_recording
from mocap.io.format import Hints, file_format
from mocap.io.other_rigs import opencv_lens, rig_camera

_SKEW_PX = 0.05
"""How far skew may move a pixel before it matters: corners of boards are found no better."""


def _vector(path: Path, table: dict[str, Any], name: str, *counts: int) -> Array:
    try:
        values = np.ravel(np.asarray(table[name], dtype=np.float64))
    except (KeyError, TypeError, ValueError):
        values = np.zeros(0)
    if len(values) not in counts or not np.isfinite(values).all():
        expected = " or ".join(map(str, counts))
        raise FormatError(f"{path.name}: {name} is not {expected} numbers: save the calibration again in the toolbox")
    return values


def _intrinsics(path: Path, table: dict[str, Any], side: str) -> tuple[Array, Array, Array | None]:
    """Camera matrix, distortion coefficients and image size of one camera."""
    f, centre = _vector(path, table, f"fc{side}", 2), _vector(path, table, f"cc{side}", 2)
    bend = _vector(path, table, f"kc{side}", 4, 5)  # before 2001 there was no k3
    size = np.array([_vector(path, table, n, 1)[0] for n in ("nx", "ny")]) if "nx" in table and "ny" in table else None
    skew = _vector(path, table, f"alpha_c{side}", 1)[0] if f"alpha_c{side}" in table else 0.0
    moves = abs(skew) * f[0] * 0.5 * (2 * centre[1] if size is None else size[1]) / f[1]
    if moves > _SKEW_PX:
        raise FormatError(
            f"{path.name}: alpha_c{side} is {skew:g}: skew moves pixels by up to {moves:.2g} px, and lenses with skew "
            "are not read: calibrate with est_alpha = 0"
        )
    return np.array([[f[0], 0.0, centre[0]], [0.0, f[1], centre[1]], [0.0, 0.0, 1.0]]), bend, size


@file_format(
    "bouguet",
    "lens of one camera of Bouguet's toolbox (Calib_Results.mat)",
    lambda head: {"fc", "cc", "kc", "omc_1"} <= head.mat or {"fc", "cc", "kc", "alpha_c", "nx"} <= head.mat,
    signs="mat fc cc kc alpha_c omc_1 Tc_1 KK",
)
def _single(path: Path, _hints: Hints) -> FileContents:
    table = variables(path)
    matrix, bend, size = _intrinsics(path, table, "")
    named = re.fullmatch(r"calib_results[ _-]*(.+)", path.stem, re.IGNORECASE)
    return FileContents(
        format="bouguet",
        paths=(path,),
        camera_names=(named[1] if named else "cam1",),
        lenses=((opencv_lens(matrix, bend), None if size is None else (round(size[0]), round(size[1]))),),
        findings=("a lens alone: where two cameras stand is in Calib_Results_stereo.mat",),
    )


@file_format(
    "bouguet-stereo",
    "two cameras of Bouguet's toolbox (Calib_Results_stereo.mat)",
    lambda head: {"fc_left", "cc_left", "kc_left", "fc_right", "R", "T"} <= head.mat,
    signs="mat fc_left cc_left kc_left fc_right R T om KK_left",
)
def _stereo(path: Path, _hints: Hints) -> FileContents:
    """The world is the left camera's axes; a point of the right one's is R x + T, in the unit of the squares."""
    table = variables(path)
    places = {
        "left": (np.eye(3), np.zeros(3)),
        "right": (_vector(path, table, "R", 9).reshape(3, 3), _vector(path, table, "T", 3)),
    }
    cameras = []
    for side, (rotation, shift) in places.items():
        matrix, bend, size = _intrinsics(path, table, f"_{side}")
        cameras.append(rig_camera(path, side, matrix, rotation, shift, bend, size))
    note = "lengths are in the unit in which the toolbox was told the squares (dX), usually mm"
    return calibration_recording(path, "bouguet-stereo", tuple(cameras), findings=(note,))
