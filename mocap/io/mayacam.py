"""Cameras of XMALab: its MayaCam 2 files, one for each camera, and its project (``.xma``), which holds all.

Both state what OpenCV calibrated: pixels from the upper left, the centre of the first at (0, 0), eight coefficients of
its rational lens, lengths in the unit of the calibration object, which they do not name (XMALab's ``Camera.cpp`` and
``ProjectFileIO.cpp``). X-ray images have a grid of their own in place of the lens, which undoes what the intensifier
bends: then pixels have to be exported undistorted.
"""

import re
import zipfile
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera
from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.contents import FileContents, calibration_recording
from mocap.io.format import Head, Hints, file_format
from mocap.io.lines import number, read_lines
from mocap.io.other_rigs import rig_camera, xml_root

_MOST_BYTES = 20_000_000
"""Of one file of a project: those that are read hold nine numbers, or some thousand tags."""
_SECTIONS = {"image size": 2, "camera matrix": 9, "rotation": 9, "translation": 3, "undistortion": 8}
"""Titles of MayaCam 2 and the numbers below each; the last is there only where the lens bends."""
_AGAIN = "export the cameras again from XMALab (File, Export, MayaCams 2.0)"


def _is_mayacam(head: Head) -> bool:
    return head.first.strip().lower() == "image size" and any(
        line.strip().lower() == "camera matrix" for line in head.lines[:8]
    )


@file_format(
    "mayacam",
    "camera of XMALab (MayaCam 2.0, one file for each)",
    _is_mayacam,
    signs="text image size camera matrix rotation translation undistortion",
)
def _mayacam(path: Path, _hints: Hints) -> FileContents:
    found: dict[str, list[float]] = {}
    section = ""
    for n, line in enumerate(read_lines(path), start=1):
        text = line.strip().strip(",").strip()
        if text.lower() in _SECTIONS:
            section = text.lower()
            found[section] = []
        elif text:
            cells = [number(cell) for cell in text.split(",")]
            if not section or not np.isfinite(cells).all():
                raise FormatError(f"{path.name}: line {n}: {text[:60]!r}, expected numbers: {_AGAIN}")
            found[section] += cells
    for title, count in _SECTIONS.items():
        have = len(found.get(title, ()))
        if have != count and not (title == "undistortion" and title not in found):
            raise FormatError(f"{path.name}: {have} numbers below {title!r}, expected {count}: {_AGAIN}")
    matrix, rotation = (np.reshape(found[title], (3, 3)) for title in ("camera matrix", "rotation"))
    bend = np.array(found.get("undistortion", [0.0]))
    size, shift = np.array(found["image size"]), np.array(found["translation"])
    camera = rig_camera(path, _name(path), matrix, rotation, shift, bend, size)
    return calibration_recording(path, "mayacam", (camera,), findings=(_pixels_note([camera], None),))


def _name(path: Path) -> str:
    """``cam2`` of files that are named so, as columns of pixels are; else the name of the file."""
    numbered = re.findall(r"cam(?:era)?[ _-]*0*(\d+)", re.sub("mayacam2?", "", path.stem, flags=re.IGNORECASE), re.I)
    return f"cam{numbered[-1]}" if numbered else path.stem


def _pixels_note(cameras: Sequence[Camera], grids: bool | None) -> str:
    """Which pixels the cameras are for.

    Args:
        cameras: As read.
        grids: Whether images are undistorted by a grid; None: the file does not say.
    """
    if grids:
        return "images are undistorted by a grid, which is not read: give 2D points that XMALab exported undistorted"
    if any(camera.lens is not None for camera in cameras):
        return "the cameras have lenses: give 2D points that XMALab exported distorted, counted from 0"
    unknown = "" if grids is False else " (where the project has an undistortion grid, undistorted)"
    return f"the cameras have no lens: give 2D points that XMALab exported counted from 0{unknown}"


@file_format(
    "mayacam-1",
    "camera of Maya (MayaCam 1.0)",
    lambda head: (
        "mayacam" in head.name and len(head.lines) <= 7 and [len(x.split(",")) for x in head.lines[:5]] == [3] * 5
    ),
)
def _first_version(path: Path, _hints: Hints) -> FileContents:
    raise FormatError(
        f"{path.name}: a camera for Maya (MayaCam 1.0), which has one focal length and Maya's angles, is not read: "
        f"{_AGAIN}"
    )


def _is_project(head: Head) -> bool:
    if not head.start.startswith(b"PK\3\4"):
        return False
    try:
        with zipfile.ZipFile(head.path) as archive:
            return "project.xml" in archive.namelist() and b"<Project " in _entry(head.path, archive, "project.xml")
    except (OSError, zipfile.BadZipFile, FormatError):
        return False


def _entry(path: Path, archive: zipfile.ZipFile, name: str) -> bytes:
    """What a file in a project holds, whose name may be written with slashes of either kind."""
    trouble = damaged(f"{path.name}: {name} in it cannot be read", "save the project again in XMALab")
    with trouble, archive.open(name.replace("\\", "/")) as stream:
        data = stream.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise FormatError(f"{path.name}: {name} in it is larger than {_MOST_BYTES} bytes: it is none of XMALab's")
    return data


def _values(path: Path, archive: zipfile.ZipFile, name: str | None, count: int) -> Array:
    """So many numbers of a file in a project."""
    if not name:
        raise FormatError(f"{path.name}: a calibrated camera lacks its numbers: calibrate again in XMALab")
    cells = re.split(r"[,\s]+", _entry(path, archive, name).decode("utf-8", "replace").strip())
    values = np.array([number(cell) for cell in cells])
    if len(values) != count or not np.isfinite(values).all():
        raise FormatError(f"{path.name}: {name} in it: expected {count} numbers: calibrate again in XMALab")
    return values


@file_format("xmalab-project", "cameras of a project of XMALab (.xma)", _is_project)
def _project(path: Path, _hints: Hints) -> FileContents:
    """Cameras, where they stood in the image that the trials refer to; tracks are not read, and counted."""
    cameras, grids = [], []
    with zipfile.ZipFile(path) as archive:
        root = xml_root(path, _entry(path, archive, "project.xml"))
        sections, trials = root.findall("Camera"), root.findall("Trial")
        reference, notes = _reference(path, sections, trials)
        for section in sections:
            if section.get("isCalibrated") != "1":
                raise FormatError(
                    f"{path.name}: camera {section.get('Name')} is not calibrated: calibrate it in XMALab, and save"
                )
            cameras.append(_project_camera(path, archive, section, reference))
            grid = section.find("UndistortionGrid")
            grids.append(grid is not None and grid.get("isComputed") == "1")
    if not cameras:
        raise FormatError(f"{path.name}: a project of XMALab without cameras")
    return calibration_recording(
        path, "xmalab-project", tuple(cameras), findings=(_pixels_note(cameras, any(grids)), *notes)
    )


def _reference(
    path: Path, cameras: Sequence[ElementTree.Element], trials: Sequence[ElementTree.Element]
) -> tuple[int, list[str]]:
    """The image of the calibration that places the cameras; which trials there are."""
    chosen = {trial.get("referenceCalibration", "") for trial in trials} - {"-1", ""}
    if len(chosen) > 1:
        raise FormatError(
            f"{path.name}: its trials refer to {len(chosen)} images of the calibration ({', '.join(sorted(chosen))}), "
            f"and the cameras stand otherwise in each: {_AGAIN}, for the trial alone"
        )
    shared = [_placed(camera).keys() for camera in cameras]
    common = sorted(set.intersection(*map(set, shared))) if shared else []
    reference = int(chosen.pop()) if chosen else next(iter(common), 0)
    rates = {trial.get("recordingSpeed") for trial in trials} - {None, "", "-1"}
    rate = f" at {rates.pop()} frames a second" if len(rates) == 1 else ""
    names = ", ".join(trial.get("Name", "?") for trial in trials[:8])
    if not trials:
        return reference, []
    return reference, [
        f"{len(trials)} trials{rate} ({names}) are in the project and not read: export their 2D points (CSV)"
    ]


def _placed(camera: ElementTree.Element) -> dict[int, ElementTree.Element]:
    """Images of the calibration in which a camera has its place, by their numbers."""
    images = camera.findall("CalibrationImage")
    return {
        int(image.get("Frame", i)): image
        for i, image in enumerate(images)
        if image.find("RotationMatrix") is not None and image.find("TranslationVector") is not None
    }


def _project_camera(path: Path, archive: zipfile.ZipFile, section: ElementTree.Element, reference: int) -> Camera:
    name, placed = section.get("Name") or "cam", _placed(section)
    if reference not in placed:
        raise FormatError(
            f"{path.name}: camera {name} has no place in image {reference} of the calibration, which the trials refer "
            "to: calibrate that image in XMALab, and save"
        )
    at = {tag: placed[reference].find(tag) for tag in ("RotationMatrix", "TranslationVector")}
    files = {tag: None if element is None else element.get("Filename") for tag, element in at.items()}
    bend = np.zeros(1)
    if section.get("UndistortionParameter"):
        bend = _values(path, archive, section.get("UndistortionParameter"), 8)
    sized = [e for e in (section.find("CalibrationSequence"), placed[reference]) if e is not None and e.get("Width")]
    size = np.array([number(sized[0].get(side) or "") for side in ("Width", "Height")]) if sized else None
    matrix = _values(path, archive, section.get("CameraMatrix"), 9).reshape(3, 3)
    rotation = _values(path, archive, files["RotationMatrix"], 9).reshape(3, 3)
    shift = _values(path, archive, files["TranslationVector"], 3)
    return rig_camera(path, name, matrix, rotation, shift, bend, size)
