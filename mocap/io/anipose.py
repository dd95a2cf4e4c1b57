"""Anipose (Karashchuk et al. 2021): ``calibration.toml``, which sleap-anipose shares, and its 3D CSV."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, KnownLens, decompose, pinhole_camera, pinhole_lens
from mocap.cameras.lens import BrownLens, FisheyeLens, Lens, RationalLens
from mocap.documents import read_toml
from mocap.errors import FormatError
from mocap.io.contents import FileContents, calibration_recording, point_recording
from mocap.io.csv_table import read_table
from mocap.io.format import Format, Head, Hints, file_format
from mocap.io.lines import frame_numbers
from mocap.records import Status
from mocap.schema import LARGEST, Entry, checked
from mocap.text import number_of

_FIELDS = ("x", "y", "z", "error", "ncams", "score")
_FRAME = [*(f"M_{i}{j}" for i in range(3) for j in range(3)), *(f"center_{i}" for i in range(3))]
_KEYS = {"matrix", "distortions", "rotation", "translation"}
PLACEHOLDER = 10.0
"""``_error`` of points that Anipose's filter in 3D put in."""


def read_calibration(path: Path) -> tuple[Camera, ...]:
    """Read the cameras, in the order of their sections ``cam_<i>``, in the unit of the calibration board.

    Caliscope's files have sections ``cameras.<i>`` and rotation matrices in place of vectors, FreeMoCap's sections are
    named by their cameras. Distortions are OpenCV's: 4 (fisheye) or 5 (Brown) or 8 (rational) coefficients.

    Raises:
        FormatError: the file is no such TOML; the message names the camera and the key.
    """
    cameras = tuple(_camera(path, key, section) for key, section in camera_sections(path))
    names = [camera.name for camera in cameras]
    if len(set(names)) != len(names):
        raise FormatError(f"{path.name}: two cameras are called {max(names, key=names.count)!r}: rename one")
    return cameras


def camera_sections(path: Path) -> list[tuple[str, Any]]:
    """The cameras' sections with their names, in order.

    Raises:
        FormatError: there are none, or the file is no TOML.
    """
    table = read_toml(path)
    numbered = {match[1]: (key, table[key]) for key in table if (match := re.fullmatch(r"cam_(\d{1,9})", key))}
    array = table.get("cameras")
    if not numbered and isinstance(array, dict):
        numbered = {key: (f"cam_{key}", part) for key, part in array.items() if re.fullmatch(r"\d{1,9}", key)}
    # a camera that Caliscope was told to ignore, of which it then knows no place
    ignored = {k for k, (_, one) in numbered.items() if isinstance(one, dict) and one.get("ignore") is True}
    ignored -= {k for k in ignored if numbered[k][1].keys() >= {"rotation", "translation"}}
    found = [numbered[key] for key in sorted(numbered.keys() - ignored, key=int)]
    found = found or [(key, part) for key, part in table.items() if isinstance(part, dict) and part.keys() >= _KEYS]
    if not found:
        raise FormatError(f"{path.name}: no sections [cam_0], [cam_1], ...; expected a calibration of Anipose")
    return found


def _camera(path: Path, key: str, section: Any) -> Camera:
    from scipy.spatial.transform import Rotation

    if not isinstance(section, dict):
        raise FormatError(f"{path.name}: {key} is not a section: expected [{key}] with name, size, matrix, ...")
    if not section.keys() & {"rotation", "translation"}:
        raise FormatError(
            f"{path.name}: {key} states a lens, but not where the camera is: calibrate all cameras together"
        )
    matrix, size = _array(path, key, section, "matrix", (3, 3)), _array(path, key, section, "size", (2,))
    rotation = _array(path, key, section, "rotation", None)
    if rotation.shape == (3,):
        rotation = Rotation.from_rotvec(rotation).as_matrix()
    if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3):
        raise FormatError(f"{path.name}: {key}.rotation is not a rotation vector or matrix: calibrate again")
    shift = _array(path, key, section, "translation", (3,))
    distortions = np.ravel(_array(path, key, section, "distortions", None))
    f_px, centre = (float(matrix[0, 0]), float(matrix[1, 1])), (float(matrix[0, 2]), float(matrix[1, 2]))
    models: dict[int, type[Lens]] = {4: FisheyeLens} if section.get("fisheye") else {5: BrownLens, 8: RationalLens}
    if len(distortions) == 4 and 4 not in models:
        distortions = np.append(distortions, 0.0)
    if len(distortions) not in models or min(f_px) <= 0 or min(size) < 1:
        raise FormatError(
            f"{path.name}: {key} has {len(distortions)} distortions, focal lengths {f_px}, size {size}; expected "
            f"{' or '.join(map(str, models))} distortions{', as fisheye is set,' if 4 in models else ''} and positive "
            "lengths: calibrate again"
        )
    lens = models[len(distortions)].of(f_px, centre, distortions)
    name = section.get("name", key)
    entry = {"name": str(name) if type(name) is int else name}  # caliscope numbers its cameras
    checked_entry = checked(f"{path.name}: {key}", entry, {"name": Entry(kind="s")}, again="name each camera")
    return pinhole_camera(
        checked_entry["name"][()],
        intrinsic=matrix,
        rotation=rotation,
        translation_m=shift,
        lens=lens.if_bent,
        size_px=(int(size[0]), int(size[1])),
    )


def _array(path: Path, key: str, section: dict[str, Any], name: str, shape: tuple[int, ...] | None) -> Array:
    try:
        values = np.array(section[name], dtype=np.float64)
    except (KeyError, TypeError, ValueError, OverflowError):
        values = np.full(0, np.nan)
    if (shape is not None and values.shape != shape) or not values.size or not (np.abs(values) <= LARGEST).all():
        expected = "a list" if shape is None else " x ".join(map(str, shape))
        raise FormatError(f"{path.name}: {key}.{name} is {section.get(name)!r}; expected {expected} of finite numbers")
    return values


def write_calibration(path: Path, cameras: Sequence[Camera]) -> None:
    """Write cameras as Anipose does; 17 digits, so that they come back to the last bit or the next.

    Raises:
        FormatError: a camera has no size, or is a mirror, which no rotation describes.
    """
    from scipy.spatial.transform import Rotation

    lines = []
    for number, camera in enumerate(cameras):
        pinhole = decompose(camera)
        if pinhole.mirrored or camera.size_px is None:
            trouble = "has a mirrored (left-handed) calibration" if pinhole.mirrored else "has no image size"
            raise FormatError(f"{path.name}: camera {camera.name!r} {trouble}, which calibration.toml cannot state")
        lens = camera.lens
        values = {
            "size": list(camera.size_px),
            "matrix": pinhole.intrinsic.tolist(),
            "distortions": [0.0] * 5 if lens is None else lens.coefficients.tolist(),
            "rotation": Rotation.from_matrix(np.array(pinhole.rotation)).as_rotvec().tolist(),
            "translation": pinhole.translation_m.tolist(),
        }
        name = camera.name.replace("\\", "\\\\").replace('"', '\\"')
        lines += [f"[cam_{number}]", f'name = "{name}"', *(f"{key} = {value}" for key, value in values.items())]
        lines += ["fisheye = true"] * isinstance(lens, FisheyeLens) + [""]
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write("\n".join([*lines, "[metadata]", ""]))


@file_format(
    "anipose-3d",
    "points of Anipose (CSV)",
    lambda head: {"_error", "_ncams", "_score"} <= {cell[cell.rfind("_") :] for cell in head.cells()},
    signs="csv _error _ncams _score fnum M_00 table",
)
def _points(path: Path, _hints: Hints) -> FileContents:
    """Points in the frame of the cameras: (p + center) M, where the file holds a rotated frame."""
    header, values = read_table(path)
    where = {title: column for column, title in enumerate(header)}
    if len(where) != len(header):
        raise FormatError(f"{path.name}: {max(header, key=header.count)} appears twice: export it again")
    names = [title.removesuffix("_error") for title in header if title.endswith("_error")]
    lacking = [f"{name}_{f}" for name in names for f in _FIELDS if f"{name}_{f}" not in where]
    lacking += [] if not set(_FRAME) & set(where) else [title for title in _FRAME if title not in where]
    if lacking or not names:
        raise FormatError(f"{path.name}: no column {(lacking or ['<name>_error'])[0]}; expected Anipose's pose-3d")
    table = values[:, [where[f"{name}_{f}"] for name in names for f in _FIELDS]].reshape(len(values), -1, 6)
    xyz, findings = table[..., :3].copy(), list[str]()
    if _FRAME[0] in where:
        frame = values[:, [where[title] for title in _FRAME]]
        rotation, centre = frame[:, :9].reshape(-1, 3, 3), frame[:, 9:]
        if not np.allclose(rotation @ np.swapaxes(rotation, 1, 2), np.eye(3), atol=1e-3):
            raise FormatError(f"{path.name}: M_00 to M_22 are not a rotation matrix: export it again")
        moved = not (np.allclose(rotation, np.eye(3)) and not centre.any())
        xyz = (xyz + centre[:, None]) @ rotation
        findings += (
            ["points were rotated back into the coordinate system of the cameras: (p + center) M"] if moved else []
        )
    filled = table[..., 3] == PLACEHOLDER
    seen = np.isfinite(xyz).all(axis=-1)
    if filled.any():
        error = f"the error {PLACEHOLDER:g}:"
        count = number_of(int(filled.sum()), f"sample has {error} it was", f"samples have {error} they were")
        findings.append(f"{count} filled by Anipose's filter")
    frames = values[:, where["fnum"]] if "fnum" in where else np.arange(len(values), dtype=np.float64)
    return point_recording(
        path,
        "anipose-3d",
        names=names,
        xyz=xyz,
        unit=None,
        frames=frame_numbers(path, frames, first_line=2),
        first=0,
        status=np.where(seen, np.where(filled, Status.INTERPOLATED, Status.MEASURED), Status.MISSING),
        score=table[..., 5],
        tables={"residual_px": table[..., 3]},
        findings=tuple(findings),
    )


def _is_calibration(head: Head) -> bool:
    keys = {line.partition("=")[0].strip() for line in head.lines if "=" in line}
    if head.name.endswith(".toml") and keys >= _KEYS:
        return True
    return any(re.fullmatch(r"\s*\[\s*(cam_|cameras\.)\d+\s*\]\s*", line) for line in head.lines)


ANIPOSE_CALIBRATION = Format(
    name="anipose-calibration",
    title="calibration of Anipose, sleap-anipose, FreeMoCap or caliscope (TOML)",
    knows=_is_calibration,
    read=lambda path, _: calibration_recording(path, "anipose-calibration", read_calibration(path)),
    write=lambda path, recording: write_calibration(path, recording.cameras),
    holds=frozenset({"cameras"}),
    suffixes=(".toml",),
    signs="toml matrix distortions rotation translation size",
)


NAME = "lenses.toml"


def write_lenses(path: Path, lenses: Sequence[KnownLens]) -> None:
    """Write lenses.

    Raises:
        FormatError: one has no image size.
    """
    place = {"rotation": np.eye(3), "translation_m": np.zeros(3)}
    write_calibration(
        path,
        [
            pinhole_camera(one.name, intrinsic=one.lens.intrinsic, lens=one.lens, size_px=one.size_px, **place)
            for one in lenses
        ],
    )
    text = path.read_text(encoding="utf-8")
    for i, lens in enumerate(lenses):
        more = f"free = {list(lens.free)}\ncovariance = {lens.cov.tolist()}\n"
        text = text.replace(f"[cam_{i}]\n", f"[cam_{i}]\n{more}")
    path.write_text(text, encoding="utf-8", newline="")


def read_lenses(path: Path) -> tuple[KnownLens, ...]:
    """Lenses of ``lenses.toml``, of any ``calibration.toml``, or of a folder that holds one of them.

    Raises:
        FormatError: there is none, or its covariance does not belong to it.
    """
    if path.is_dir():
        inside = [path / n for n in (NAME, "calibration.toml") if (path / n).is_file()]
        if not inside:
            raise FormatError(f"{path}: contains no {NAME} and no calibration.toml: give the lenses' file")
        path = inside[0]
    cameras = read_calibration(path)
    out = []
    for camera, (_, section) in zip(cameras, camera_sections(path), strict=True):
        lens = pinhole_lens(camera) if camera.lens is None else camera.lens
        again = f"its covariance is not that of its {lens.model} lens: calibrate the lenses again"
        schema = {
            "free": Entry(kind="i", shape=("free",), least=0, most=3 + lens.n_coefficients, rising=True, needed=False),
            "covariance": Entry(shape=("free", "free"), covariance=True, needed=False),
        }
        found = checked(f"{path.name}: camera {camera.name!r}", section, schema, again=again)
        free = tuple(found["free"].tolist()) if "free" in found else ()
        cov = found.get("covariance", np.zeros((0, 0)))
        if len(cov) != len(free):
            raise FormatError(f"{path.name}: camera {camera.name!r}: {again}")
        out.append(KnownLens(name=camera.name, lens=lens, size_px=camera.size_px, free=free, cov=cov))
    return tuple(out)
