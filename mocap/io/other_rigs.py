"""Calibrations of Qualisys (``.qca.txt``), Vicon (``.xcp``), EasyMocap (``intri.yml``, ``extri.yml``) and OpenCap.

FreeMoCap's calibration is Anipose's TOML (``mocap.io.anipose``). OptiTrack's ``.cal`` is binary and its layout is not
published; it is named, with what to do. Conventions as Pose2Sim's ``calibration.py`` reads them (Pagnon et al. 2022,
JOSS 7, 4362), but for distortions: QTM's are without unit and are not divided by its 64 subpixels, and Vicon's
map recorded pixels to ideal ones.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, pinhole_camera
from mocap.cameras.lens import BrownLens, RationalLens
from mocap.documents import damaged, decoded
from mocap.errors import FormatError
from mocap.io.apart import plain_pickle
from mocap.io.contents import FileContents, calibration_recording
from mocap.io.format import Head, Hints, file_format

_MOST_BYTES = 20_000_000  # files of rigs are far smaller


def _numbers(path: Path, where: str, text: Mapping[str, str | None], names: str) -> list[float]:
    out = []
    for name in names.split():
        try:
            out.append(float(text[name] or ""))
        except (KeyError, ValueError, TypeError):
            out.append(np.nan)
        if not np.isfinite(out[-1]):
            raise FormatError(
                f"{path.name}: {where}: {name} is {text.get(name)!r}, expected a number: export the calibration again"
            )
    return out


def xml_root(path: Path, data: bytes | None = None) -> ElementTree.Element:
    """The XML of a file, or of what is in it; none that is long or defines entities."""
    data = path.read_bytes() if data is None else data
    text = decoded(path, data[:_MOST_BYTES])[0]
    if len(data) > _MOST_BYTES or re.search(r"<!ENTITY|<!DOCTYPE[^>]*\[", text):
        raise FormatError(f"{path.name}: not the XML of a calibration: it is too long, or defines entities")
    try:
        return ElementTree.fromstring(re.sub(r"^\s*<\?xml[^>]*\?>", "", text).strip())  # it is decoded already
    except ElementTree.ParseError as error:
        raise FormatError(f"{path.name}: not readable as XML: {error}: export the calibration again") from None


def rig_camera(
    path: Path, name: str, matrix: Array, rotation: Array, translation_m: Array, bend: Array, size: Array | None
) -> Camera:
    """A camera with a lens of coefficients ``bend`` in OpenCV's order; those that are not there are 0.

    Args:
        path: The file, for messages.
        name: Of the camera.
        matrix: (3, 3) camera matrix.
        rotation: (3, 3) from world to camera axes.
        translation_m: (3,) after it, in metres, or in the file's unit where that is not known.
        bend: (n,) at most eight distortion coefficients.
        size: Width and height of the image; None: the file does not state it.

    Raises:
        FormatError: the numbers are not those of a camera.
    """
    numbers = np.concatenate([np.ravel(part) for part in (matrix, rotation, translation_m, bend)])
    turned = np.isfinite(numbers).all() and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-2)
    if not turned or np.linalg.det(rotation) < 0 or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise FormatError(f"{path.name}: camera {name}: no rotation, or no focal length: calibrate again")
    lens = opencv_lens(matrix, bend).if_bent
    if lens is not None and abs(matrix[0, 1]) > 1e-6 * matrix[0, 0]:
        raise FormatError(
            f"{path.name}: camera {name}: its axes are not square (skew {matrix[0, 1]:g} px) and its lens bends: "
            "lenses with both are not read: calibrate again without skew"
        )
    return pinhole_camera(
        name,
        intrinsic=matrix,
        rotation=rotation,
        translation_m=translation_m,
        lens=lens,
        size_px=None if size is None else (round(float(size[0])), round(float(size[1]))),
    )


def opencv_lens(matrix: Array, bend: Array) -> BrownLens | RationalLens:
    """Brown's lens of at most five coefficients in OpenCV's order, the rational one where three more are not 0."""
    bend = np.pad(np.ravel(bend)[:8], (0, max(0, 8 - np.size(bend))))
    f, centre = (matrix[0, 0], matrix[1, 1]), (matrix[0, 2], matrix[1, 2])
    return RationalLens.of(f, centre, bend) if bend[5:].any() else BrownLens.of(f, centre, bend[:5])


def _matrix(fu: float, fv: float, cu: float, cv: float) -> Array:
    return np.array([[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]])


@file_format(
    "qualisys-calibration",
    "calibration of Qualisys (.qca.txt)",
    lambda head: "<calibration" in _text(head)[:2000] and "focalLengthU" in _text(head),
    signs="xml calibration camera intrinsic focalLengthU transform",
)
def _qualisys(path: Path, _hints: Hints) -> FileContents:
    """QTM: camera axes x right, y up, z to the rear (turned by pi about x here), millimetres."""
    root, cameras, turned = xml_root(path), [], []
    for section in root.iter("camera"):
        name = section.get("serial") or f"cam{len(cameras) + 1}"
        intrinsic, transform = section.find("intrinsic"), section.find("transform")
        if intrinsic is None or transform is None or section.get("calibrated", "true") == "false":
            continue
        fu, fv, cu, cv, umin, umax, vmin, vmax = _numbers(
            path,
            f"camera {name}",
            intrinsic.attrib,
            "focalLengthU focalLengthV centerPointU centerPointV sensorMinU sensorMaxU sensorMinV sensorMaxV",
        )
        unit = 64 if umax - umin > 20_000 else 1  # QTM counts sensors in 64ths of a pixel
        size = np.array([umax - umin + (unit > 1), vmax - vmin + (unit > 1)]) / unit
        start = np.zeros(2)
        if (film := section.find("fov_video")) is not None:
            left, top, right, bottom = _numbers(path, f"camera {name}", film.attrib, "left top right bottom")
            start, size = np.array([left, top]), np.array([right - left + 1, bottom - top + 1])
        k1, k2, p1, p2 = _numbers(
            path,
            f"camera {name}",
            intrinsic.attrib,
            "radialDistortion1 radialDistortion2 tangentalDistortion1 tangentalDistortion2",
        )
        k3 = float(intrinsic.get("radialDistortion3") or 0.0)
        matrix = _matrix(fu / unit, fv / unit, cu / unit - start[0], cv / unit - start[1])
        rows = "r11 r12 r13 r21 r22 r23 r31 r32 r33"
        axes = np.array(_numbers(path, f"camera {name}", transform.attrib, rows)).reshape(3, 3)
        place = np.array(_numbers(path, f"camera {name}", transform.attrib, "x y z")) / 1000
        rotation = np.diag([1.0, -1.0, -1.0]) @ axes
        bend = np.array([k1, k2, p1, p2, k3])
        cameras.append(rig_camera(path, name, matrix, rotation, -rotation @ place, bend, size))
        if section.get("viewrotation", "0") != "0":
            turned.append(f"{name} by {section.get('viewrotation')} degrees")
    if not cameras:
        raise FormatError(f"{path.name}: no calibrated camera in this calibration of QTM: export it after calibrating")
    note = f"videos are shown rotated ({', '.join(turned)}): pixels must be those of the video as it was recorded"
    findings = (note,) if turned else ()
    return calibration_recording(path, "qualisys-calibration", tuple(cameras), unit="mm", findings=findings)


@file_format(
    "vicon-calibration",
    "calibration of Vicon (.xcp)",
    lambda head: "<Cameras" in _text(head)[:2000] and "SENSOR_SIZE" in _text(head),
    signs="xml Cameras Camera SENSOR_SIZE KeyFrame ORIENTATION",
)
def _vicon(path: Path, _hints: Hints) -> FileContents:
    """Vicon: the quaternion x, y, z, w turns world into camera axes (x right, y down, z forward); millimetres."""
    from scipy.spatial.transform import Rotation

    cameras = []
    sections = list(xml_root(path).iter("Camera"))
    films = [s for s in sections if "video" in f"{s.get('TYPE', '')} {s.get('DISPLAY_TYPE', '')}".lower()]
    for section in films or sections:
        name = section.get("LABEL") or section.get("DEVICEID") or f"cam{len(cameras) + 1}"
        frame = next(section.iter("KeyFrame"), None)
        if frame is None:
            continue
        where = f"camera {name}"

        def several(text: str | None, count: int, what: str, where: str = where) -> Array:
            try:
                values = np.array([float(x) for x in (text or "").split()])
            except ValueError:
                values = np.zeros(0)
            if len(values) != count or not np.isfinite(values).all():
                raise FormatError(f"{path.name}: {where}: {what} is {text!r}, expected {count} numbers")
            return values

        size = several(section.get("SENSOR_SIZE"), 2, "SENSOR_SIZE")
        centre = several(frame.get("PRINCIPAL_POINT"), 2, "PRINCIPAL_POINT")
        (focal,) = _numbers(path, where, frame.attrib, "FOCAL_LENGTH")
        aspect = float(section.get("PIXEL_ASPECT_RATIO") or 1.0) or 1.0
        quaternion = several(frame.get("ORIENTATION"), 4, "ORIENTATION")
        place = several(frame.get("POSITION"), 3, "POSITION") / 1000
        if np.linalg.norm(quaternion) < 0.5:
            raise FormatError(f"{path.name}: {where}: ORIENTATION is no rotation: calibrate again")
        rotation = Rotation.from_quat(quaternion).as_matrix()
        matrix = _matrix(focal, focal / aspect, centre[0], centre[1])
        radial = (frame.get("VICON_RADIAL2") or "").split()[3:] or (frame.get("VICON_RADIAL") or "").split()
        radial = [*several(" ".join(radial[:3]), len(radial[:3]), "VICON_RADIAL"), 0.0, 0.0, 0.0][:3]
        bend = _nearest_brown(matrix, size, np.array(radial))
        cameras.append(rig_camera(path, name, matrix, rotation, -rotation @ place, bend, size))
    if not cameras:
        raise FormatError(f"{path.name}: no camera with a KeyFrame: calibrate in Vicon and save the .xcp again")
    notes = () if films else ("no camera is called a video camera: all cameras are read",)
    return calibration_recording(path, "vicon-calibration", tuple(cameras), unit="mm", findings=notes)


def _nearest_brown(matrix: Array, size: Array, radial: Array) -> Array:
    """k1, k2, 0, 0, k3 of Brown's lens nearest to Vicon's, by least squares over radii that the image has.

    Vicon's multiplies offsets from the centre by 1 + a r^2 + b r^4 + c r^6, r in pixels of the recorded image.
    """
    f, centre = matrix[0, 0], matrix[:2, 2]
    corner = float(np.linalg.norm(np.maximum(centre, size - centre)))
    recorded = np.linspace(0.02, 1.0, 60) * corner
    ideal = recorded * (1 + radial[0] * recorded**2 + radial[1] * recorded**4 + radial[2] * recorded**6) / f
    powers = np.stack([ideal**3, ideal**5, ideal**7], axis=1)
    k = np.linalg.lstsq(powers, recorded / f - ideal, rcond=None)[0] if radial.any() else np.zeros(3)
    return np.array([k[0], k[1], 0.0, 0.0, k[2]])


def _matrices(path: Path) -> dict[str, Array]:
    text = path.read_text(encoding="utf-8", errors="replace")
    found = {}
    pattern = r"(?ms)^\s*(\w+): *!!opencv-matrix\s+rows: *(\d+)\s+cols: *(\d+)\s+dt: *\w+\s+data: *\[([^\]]*)\]"
    for name, rows, columns, data in re.findall(pattern, text):
        try:
            values = np.array([float(x) for x in data.replace("\n", " ").split(",")])
            found[name] = values.reshape(int(rows), int(columns))
        except ValueError:
            raise FormatError(f"{path.name}: {name} is not {rows} x {columns} numbers: calibrate again") from None
    return found


@file_format(
    "easymocap",
    "calibration of EasyMocap (intri.yml, extri.yml)",
    lambda head: (
        head.first.startswith("%YAML") and re.search(r"(?m)^\s*(K|R|Rot)_\w+: *!!opencv", _text(head)) is not None
    ),
    signs="yaml opencv-matrix K_ dist_ Rot_",
    beside=True,
)
def _easymocap(path: Path, _hints: Hints) -> FileContents:
    """EasyMocap: ``intri.yml`` holds K and dist, ``extri.yml`` R (or Rot) and T; metres. The other lies beside it."""
    from scipy.spatial.transform import Rotation

    own = _matrices(path)
    other = path.with_name(path.name.replace("extri", "intri") if "extri" in path.name else "extri.yml")
    beside = _matrices(other) if other != path and other.is_file() else {}
    found = {**beside, **own}
    names = [name[2:] for name in found if name.startswith("K_")]
    if not names:
        raise FormatError(f"{path.name}: no matrices K_<camera>: EasyMocap writes them to intri.yml: put it beside")
    cameras, lenses = [], []
    for name in names:
        matrix = found[f"K_{name}"]
        bend = found.get(f"dist_{name}", np.zeros(5))
        if matrix.shape != (3, 3):
            raise FormatError(f"{path.name}: K_{name} is {matrix.shape}, expected 3 x 3: calibrate again")
        lenses.append((opencv_lens(matrix, bend), None))
        shift = found.get(f"T_{name}")
        rotation = found.get(f"Rot_{name}", found.get(f"R_{name}"))
        if shift is None or rotation is None:
            continue
        rotation = Rotation.from_rotvec(np.ravel(rotation)).as_matrix() if rotation.size == 3 else rotation
        cameras.append(rig_camera(path, name, matrix, rotation, np.ravel(shift), bend, 2 * matrix[:2, 2]))
    if len(cameras) == len(names):
        note = "image sizes are not in the file: twice the principal point is taken"
        return calibration_recording(path, "easymocap", tuple(cameras), unit="m", findings=(note,))
    return FileContents(
        format="easymocap",
        paths=(path,),
        camera_names=tuple(names),
        lenses=tuple(lenses),
        findings=("lenses alone: where the cameras stand is in extri.yml, which is not beside this file",),
    )


@file_format(
    "opencap",
    "camera of OpenCap (cameraIntrinsicsExtrinsics.pickle)",
    lambda head: head.start[:1] == b"\x80" and b"intrinsicMat" in head.start,
    signs="pickle intrinsicMat distortion",
    beside=True,
)
def _opencap(path: Path, _hints: Hints) -> FileContents:
    """OpenCap: a pickle a camera (``cameraIntrinsicsExtrinsics.pickle``), its name that of the folder; millimetres."""
    advice = "expected intrinsicMat, distortion, imageSize, rotation and translation"
    with damaged(f"{path.name}: not a camera of OpenCap", advice):
        table = plain_pickle(path.read_bytes())
        matrix = np.array(table["intrinsicMat"], dtype=float).reshape(3, 3)
        bend = np.array(table["distortion"], dtype=float)
        size = np.ravel(np.array(table["imageSize"], dtype=float))[::-1]
        rotation = np.array(table["rotation"], dtype=float).reshape(3, 3)
        shift = np.ravel(np.array(table["translation"], dtype=float)) / 1000
    camera = rig_camera(path, path.absolute().parent.name, matrix, rotation, shift, bend, size)
    note = "the world is that of OpenCap's board, which stands upright: y or z of the board may point down"
    return calibration_recording(path, "opencap", (camera,), unit="mm", findings=(note,))


@file_format(
    "optitrack-calibration",
    "calibration of OptiTrack (.cal, .mcal)",
    lambda head: head.name.endswith(".mcal") or (not head.lines and head.name.endswith(".cal")),
)
def _optitrack(path: Path, _hints: Hints) -> FileContents:
    raise FormatError(
        f"{path.name}: calibrations of OptiTrack (.cal, .mcal) are not read: calibrate the cameras (mocap calibrate), "
        "or write the values that Motive shows (focal length, principal point, position, orientation) as a .toml"
    )


def _text(head: Head) -> str:
    return "\n".join(head.lines)
