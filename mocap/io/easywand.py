"""easyWand's results (``*easyWandData.mat``) and the undistortion of one camera that it writes (``*Tforms.mat``).

Both are MATLAB files (Theriault et al. 2014, "A protocol and calibration method for accurate multi-camera field
videography").
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, dlt_camera
from mocap.cameras.lens import BrownLens
from mocap.errors import FormatError
from mocap.io.apart import variables
from mocap.io.contents import FileContents, pixel_recording
from mocap.io.format import Hints, file_format


@dataclass(frozen=True, eq=False, kw_only=True)
class EasyWand:
    """A calibration by a wand of known length.

    Attributes:
        cameras: The C cameras with their lenses and sizes, in the unit of the wand's length; empty before calibration.
        lenses: Their lenses, which are there also before the calibration.
        sizes_px: Their image widths and heights.
        wand_px: (C, T, 2, 2) recorded pixels of the wand's two ends; NaN where not seen.
        wand_ideal_px: (C, K, 2, 2) undistorted pixels of the frames that easyWand used; empty where not stored.
        background_px: (C, N, B, 2) recorded pixels of B background points.
        wand_length: Length of the wand.
        wand_score: 100 x standard deviation / mean of the reconstructed wand length; NaN where not stored.
    """

    cameras: tuple[Camera, ...]
    lenses: tuple[BrownLens, ...]
    sizes_px: tuple[tuple[int, int], ...]
    wand_px: Array
    wand_ideal_px: Array
    background_px: Array
    wand_length: float
    wand_score: float


def read_easywand(path: Path) -> EasyWand:
    """Read ``easyWandData``.

    Raises:
        FormatError: the file is no such file, or its parts contradict each other.
    """
    table = variables(path).get("easyWandData")
    if not isinstance(table, dict):
        raise FormatError(f"{path.name}: no struct easyWandData; expected what easyWand 5 saves")
    count = int(_numbers(path, table, "nCams", 1)[0])
    if not 1 <= count <= 100:
        raise FormatError(f"{path.name}: nCams is {count}; expected the number of cameras: save it again in easyWand")
    focal = _numbers(path, table, "focalLengths", count)
    centres = _numbers(path, table, "ppts", 2 * count).reshape(count, 2)
    nlin = _numbers(path, table, "nlin", 5 * count).reshape(count, 5)
    sizes = np.stack([_numbers(path, table, f"image{side}", count) for side in ("Width", "Height")], axis=1)
    lenses = tuple(
        BrownLens.of((f, f), tuple(centre), tuple(k)) for f, centre, k in zip(focal, centres, nlin, strict=True)
    )
    sizes_px = tuple((int(w), int(h)) for w, h in sizes)
    return EasyWand(
        cameras=_cameras(path, table, lenses, sizes_px),
        lenses=lenses,
        sizes_px=sizes_px,
        wand_px=_pixels(path, table, "wandPts", count, 2),
        wand_ideal_px=_pixels(path, table, "ptMatu", count, 2),
        background_px=_pixels(path, table, "backgroundPts", count, None),
        wand_length=float(_numbers(path, table, "wandLen", 1)[0]),
        wand_score=float(_numbers(path, {"wandScore": np.nan, **table}, "wandScore", 1, finite=False)[0]),
    )


def _numbers(path: Path, table: dict[str, Any], name: str, count: int, *, finite: bool = True) -> Array:
    try:
        values = np.ravel(np.asarray(table[name], dtype=np.float64))
    except (KeyError, TypeError, ValueError):
        values = np.zeros(0)
    if len(values) != count or (finite and not np.isfinite(values).all()):
        raise FormatError(
            f"{path.name}: easyWandData.{name} has {len(values)} numbers, expected {count} finite ones: calibrate and "
            "save it again in easyWand"
        )
    return values


def _pixels(path: Path, table: dict[str, Any], name: str, cameras: int, points: int | None) -> Array:
    """(C, T, B, 2) pixels from columns point-major, then camera, then x, y; no frames where the field is absent."""
    try:
        values = np.asarray(table.get(name, []), dtype=np.float64)
    except (TypeError, ValueError):
        raise FormatError(f"{path.name}: easyWandData.{name} contains no numbers: save it again in easyWand") from None
    if values.size == 0:
        return np.full((cameras, 0, points or 1, 2), np.nan)
    values = np.atleast_2d(values)
    width = 2 * cameras * (points or 1)
    if values.ndim != 2 or values.shape[1] % width or (points and values.shape[1] != width):
        raise FormatError(
            f"{path.name}: easyWandData.{name} has shape {values.shape}; expected x, y of {cameras} cameras for each "
            "point: save it again in easyWand"
        )
    return np.transpose(values.reshape(len(values), -1, cameras, 2), (2, 0, 1, 3))


def _cameras(
    path: Path, table: dict[str, Any], lenses: tuple[BrownLens, ...], sizes: tuple[tuple[int, int], ...]
) -> tuple[Camera, ...]:
    if np.size(table.get("coefs", ())) == 0:
        return ()
    coefs = _numbers(path, table, "coefs", 11 * len(lenses)).reshape(11, len(lenses))
    cameras = []
    for c, (lens, size) in enumerate(zip(lenses, sizes, strict=True)):
        cameras.append(replace(dlt_camera(f"cam{c + 1}", coefs[:, c], lens=lens.if_bent), size_px=size))
    return tuple(cameras)


@file_format(
    "easywand",
    "easyWand calibration (easyWandData.mat)",
    lambda head: "easyWandData" in head.mat,
    signs="mat easyWandData coefs wandPts",
)
def _easywand(path: Path, _hints: Hints) -> FileContents:
    wand = read_easywand(path)
    findings = [
        f"wand of length {wand.wand_length:g}, in the unit of the coefficients, which the file does not state; "
        f"wand score {wand.wand_score:.4g}; {wand.background_px.shape[1]} frames of "
        f"{wand.background_px.shape[2]} background points"
    ]
    if not wand.cameras:
        findings.append("the file contains no DLT coefficients: the calibration was not computed")
    names, uv = ("wand1", "wand2"), wand.wand_px
    if np.isnan(uv).all() and np.isfinite(wand.background_px).any():
        findings.append("the file contains no wand points: its background points are read as its pixels")
        uv = wand.background_px
        names = tuple(f"background{k + 1}" for k in range(uv.shape[2]))
    return pixel_recording(
        path,
        "easywand",
        names=names,
        cameras=[f"cam{c + 1}" for c in range(len(wand.lenses))],
        uv_px=uv,
        calibration=wand.cameras,
        lenses=tuple(zip(wand.lenses, wand.sizes_px, strict=True)),
        pixel_origin="upper-left",  # its lenses are described in the pixels' own rows, whichever way these run
        findings=tuple(findings),
    )


def read_tform(path: Path) -> tuple[BrownLens, int]:
    """The lens of a ``Tforms.mat``, and the iterations of its undistortion.

    Raises:
        FormatError: the file holds no such numbers.
    """
    struct = variables(path).get("camud")
    try:
        tdata = np.ravel(np.asarray(struct["tdata"], dtype=np.float64))  # type: ignore[index]
    except (KeyError, TypeError, ValueError, IndexError):
        tdata = np.zeros(0)
    if not is_tdata(tdata):
        raise FormatError(
            f"{path.name}: no camud.tdata of ten numbers (fx fy cx cy k1 k2 p1 p2 k3 iterations): save it again in "
            "easyWand"
        )
    return lens_of(tdata), int(tdata[9])


def is_tdata(values: Array) -> bool:
    """Whether numbers are those of a lens and its undistortion: fx fy cx cy k1 k2 p1 p2 k3 iterations."""
    return values.shape == (10,) and bool(np.isfinite(values).all() and (values[:2] > 0).all() and values[9] >= 1)


def lens_of(tdata: Array) -> BrownLens:
    """The lens of such numbers."""
    return BrownLens.of(tuple(tdata[:2]), tuple(tdata[2:4]), tuple(tdata[4:9]))


@file_format(
    "easywand-tforms",
    "undistortion of one camera (Tforms.mat)",
    lambda head: "camud" in head.mat,
    signs="mat camud tdata",
)
def _tform(path: Path, _hints: Hints) -> FileContents:
    lens, iterations = read_tform(path)
    return FileContents(
        format="easywand-tforms",
        paths=(path,),
        camera_names=("cam1",),
        lenses=((lens, None),),
        findings=(f"DLTdv undistorts with f = {np.mean(lens.f_px):g} px and {iterations} iterations",),
    )
