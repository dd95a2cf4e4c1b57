"""Finding a board in all images of all cameras."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mocap.calibration.boards import Board, Charuco, Corners
from mocap.errors import CalibrationError

KINDS = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm"})


def pictures_of(folder: Path, *, instants: bool = True) -> dict[str, dict[str, Path]]:
    """Images by camera and by instant.

    Two layouts are known: a folder a camera, images anywhere below it, and one folder with all images named by
    camera and number (``left07.jpg``). Images of one instant have one name, but for the name of the camera in front.

    Args:
        folder: Where they are.
        instants: Whether names state instants; else every image counts by itself, and is named by its path.

    Raises:
        CalibrationError: there are no images, or their names do not tell the cameras apart.
    """
    files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in KINDS and p.is_file())
    if not files:
        raise CalibrationError(f"{folder}: no images here; expected <camera>/<frame>.png or <camera><frame>.png")
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
            raise CalibrationError(f"{path}: camera {camera!r} has two images of frame {stem!r}: remove one")
        found[camera][stem] = path
    return _numbered(dict(found)) if instants else dict(found)


def _numbered(found: dict[str, dict[str, Path]]) -> dict[str, dict[str, Path]]:
    """Instants by the number that ends their names, where that alone pairs more images (clocks in names differ)."""
    numbers = {
        camera: {m[0]: path for stem, path in files.items() if (m := re.search(r"\d+$", stem))}
        for camera, files in found.items()
    }
    if any(len(numbers[camera]) < len(files) for camera, files in found.items()):
        return found
    return numbers if len(set().union(*numbers.values())) < len(set().union(*found.values())) else found


def read_grey(path: Path) -> NDArray[np.uint8]:
    """An image in shades of grey.

    Raises:
        CalibrationError: it cannot be read.
    """
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise CalibrationError(f"{path}: not an image that can be read: remove it or save it again")
    return np.asarray(picture, dtype=np.uint8)


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardViews:
    """What one camera saw of a board.

    Attributes:
        size_px: Width and height of its images.
        corners: By instant, where the board was found.
        missed: Instants of images in which it was not.
    """

    size_px: tuple[int, int]
    corners: Mapping[str, Corners]
    missed: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Pictures:
    """Images of one camera, read when they are asked for.

    Attributes:
        labels: Their names.
        read: Increasing numbers of images to these, in shades of grey.
    """

    labels: tuple[str, ...]
    read: Callable[[Sequence[int]], Iterable[NDArray[np.uint8]]]


def of_files(files: Mapping[str, Path]) -> Pictures:
    """Images that are files, by label."""
    paths = list(files.values())
    return Pictures(labels=tuple(files), read=lambda wanted: (read_grey(paths[i]) for i in wanted))


def detect(
    pictures: Mapping[str, Mapping[str, Path] | Pictures],
    board: Board,
    *,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Board, dict[str, BoardViews]]:
    """Find a board.

    Args:
        pictures: Files by camera and instant, or images that are read otherwise.
        board: The board; of a ChArUco board, the print (legacy, negative) is found out from some images.
        progress: Told of each camera.

    Returns:
        The board as printed, and the views of each camera.

    Raises:
        CalibrationError: a camera's images have several sizes, or the board is in none of any camera.
    """
    sources = {c: p if isinstance(p, Pictures) else of_files(p) for c, p in pictures.items()}
    if isinstance(board, Charuco):
        board = board.fitted([picture for s in sources.values() for picture in s.read(_some(len(s.labels)))])
    views = {}
    for camera, source in sources.items():
        corners, missed, sizes = {}, [], {}
        for stem, picture in zip(source.labels, source.read(range(len(source.labels))), strict=True):
            sizes.setdefault((picture.shape[1], picture.shape[0]), stem)
            found = board.find(picture)
            if found is None:
                missed.append(stem)
            else:
                corners[stem] = found
        if len(sizes) > 1:
            (a, first), (b, other) = list(sizes.items())[:2]
            raise CalibrationError(
                f"camera {camera!r}: image {first!r} is {a[0]}x{a[1]}, {other!r} is {b[0]}x{b[1]}: calibrate with "
                "images of one size, uncropped"
            )
        views[camera] = BoardViews(size_px=next(iter(sizes)), corners=corners, missed=tuple(missed))
        progress(f"{camera}: board found in {len(corners)} of {len(source.labels)} images")
    if not any(v.corners for v in views.values()):
        squares = f"{board.columns}x{board.rows}"
        what = f"a checkerboard of {squares} inner corners"
        if isinstance(board, Charuco):
            what = f"a ChArUco board of {squares} squares with markers of {board.dictionary}"
        raise CalibrationError(
            f"no image shows {what}: check the numbers (inner corners of a checkerboard, squares of a "
            "ChArUco board) and the dictionary"
        )
    return board, views


def _some(count: int, n: int = 2) -> list[int]:
    return [round((i + 0.5) * count / n - 0.5) for i in range(min(n, count))]
