"""Which pictures of a folder belong to which camera and which time."""

import re
from collections import defaultdict
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mocap.errors import CalibrationError

KINDS = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm"})


def pictures_of(folder: Path, *, instants: bool = True) -> dict[str, dict[str, Path]]:
    """Pictures by camera and by instant.

    Two layouts are known: a folder a camera, pictures anywhere below it, and one folder with all pictures named by
    camera and number (``left07.jpg``). Pictures of one instant have one name, but for the name of the camera in front.

    Args:
        folder: Where they are.
        instants: Whether names state instants; else every picture counts by itself, and is named by its path.

    Raises:
        CalibrationError: there are no pictures, or their names do not tell the cameras apart.
    """
    files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in KINDS and p.is_file())
    if not files:
        raise CalibrationError(f"{folder}: no pictures here; expected <camera>/<frame>.png or <camera><frame>.png")
    found: dict[str, dict[str, Path]] = defaultdict(dict)
    for path in files:
        inside = path.relative_to(folder)
        if len(inside.parts) > 1:
            camera, stem = inside.parts[0], path.stem.removeprefix(inside.parts[0]).lstrip("-_ ")
        else:
            parts = re.fullmatch(r"(.*?)[-_ ]?(\d+)", path.stem)
            if parts is None or not parts[1]:
                raise CalibrationError(
                    f"{path.name}: the name does not state camera and frame; expected <camera><number>, as in "
                    "left07.png, or one folder for each camera"
                )
            camera, stem = parts[1], parts[2]
        if not instants:
            stem = Path(*inside.parts[len(inside.parts) > 1 :]).as_posix()
        if stem in found[camera]:
            raise CalibrationError(f"{path}: camera {camera!r} has two pictures of frame {stem!r}: remove one")
        found[camera][stem] = path
    return _numbered(dict(found)) if instants else dict(found)


def _numbered(found: dict[str, dict[str, Path]]) -> dict[str, dict[str, Path]]:
    """Instants by the number that ends their names, where that alone pairs more pictures (clocks in names differ)."""
    numbers = {
        camera: {m[0]: path for stem, path in files.items() if (m := re.search(r"\d+$", stem))}
        for camera, files in found.items()
    }
    if any(len(numbers[camera]) < len(files) for camera, files in found.items()):
        return found
    return numbers if len(set().union(*numbers.values())) < len(set().union(*found.values())) else found


def read_grey(path: Path) -> NDArray[np.uint8]:
    """A picture in shades of grey.

    Raises:
        CalibrationError: it cannot be read.
    """
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise CalibrationError(f"{path}: not a picture that can be read: remove it or save it again")
    return np.asarray(picture, dtype=np.uint8)
