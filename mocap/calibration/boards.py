"""Calibration boards: where their corners are, and finding them in the images of all cameras."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, frozen
from mocap.calibration.corners import refined
from mocap.errors import CalibrationError


@dataclass(frozen=True, eq=False, kw_only=True)
class Corners:
    """The corners of a board that one image shows.

    Attributes:
        ids: (n,) numbers of the corners on their board.
        local_m: (n, 3) their places on it; z = 0.
        uv_px: (n, 2) pixels, origin upper-left, the centre of the first pixel at (0, 0).
    """

    ids: NDArray[np.int64]
    local_m: Array
    uv_px: Array

    def __post_init__(self) -> None:
        """Copy, freeze and check."""
        n = len(self.ids)
        object.__setattr__(self, "ids", frozen("ids", self.ids, (n,), dtype=np.int64))
        object.__setattr__(self, "local_m", frozen("local_m", self.local_m, (n, 3)))
        object.__setattr__(self, "uv_px", frozen("uv_px", self.uv_px, (n, 2)))


@dataclass(frozen=True, kw_only=True)
class Checkerboard:
    """A checkerboard, found whole or not at all.

    Attributes:
        columns: Inner corners along x.
        rows: Inner corners along y.
        square_m: Side of a square.
    """

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        """Check the size."""
        if min(self.columns, self.rows) < 3 or not self.square_m > 0:
            raise CalibrationError(
                "a checkerboard needs at least 3 x 3 inner corners and a square size above 0, but this has "
                f"{self.columns}x{self.rows} and {self.square_m * 1e3:g} mm: count the corners between the squares, "
                "not the squares"
            )

    @property
    def turnable(self) -> bool:
        """Whether it looks the same when turned by 180 degrees."""
        return (self.columns + self.rows) % 2 == 0

    def points(self) -> Array:
        """(columns x rows, 3) places of the corners, row by row."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return self.square_m * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)

    def find(self, picture: NDArray[np.uint8]) -> Corners | None:
        """Its corners in a grey image; None where the whole board is not found."""
        size = (self.columns, self.rows)
        options = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, uv = cv2.findChessboardCorners(picture, size, flags=options)
        if not found:
            found, uv = cv2.findChessboardCornersSB(picture, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not found:
            return None
        grid = refined(picture, np.reshape(np.asarray(uv, dtype=float), (self.rows, self.columns, 2)))
        if not self.turnable and self._starts_light(picture, grid):
            grid = grid[::-1, ::-1]
        return Corners(ids=np.arange(self.columns * self.rows), local_m=self.points(), uv_px=grid.reshape(-1, 2))

    def _starts_light(self, picture: NDArray[np.uint8], grid: Array) -> bool:
        """Whether the inner square at the first corner is lighter than its neighbour: then the board is upside down."""

        def shade(column: int, row: int) -> float:
            u, v = grid[row : row + 2, column : column + 2].reshape(4, 2).mean(axis=0)
            return float(picture[int(np.clip(v, 0, picture.shape[0] - 1)), int(np.clip(u, 0, picture.shape[1] - 1))])

        columns, rows = 2 * ((self.columns - 1) // 2), 2 * ((self.rows - 1) // 2)  # as many dark as light ones
        return sum((-1) ** (c + r) * shade(c, r) for r in range(rows) for c in range(columns)) > 0


@dataclass(frozen=True, kw_only=True)
class Charuco:
    """A ChArUco board, whose corners have numbers, so that any part of it will do.

    Attributes:
        columns: Squares along x.
        rows: Squares along y.
        square_m: Side of a square.
        marker_m: Side of a marker.
        dictionary: OpenCV's name of the markers, such as ``DICT_4X4_50``.
        legacy: Whether boards of even rows start with a white square, as OpenCV printed them before 4.6.
        inverted: Whether the print is a negative.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str
    legacy: bool = False
    inverted: bool = False

    def __post_init__(self) -> None:
        """Check sizes and the dictionary."""
        if not 0 < self.marker_m < self.square_m:
            raise CalibrationError(
                f"markers of {self.marker_m * 1e3:g} mm do not fit into squares of {self.square_m * 1e3:g} mm: "
                "give `square_mm` and `marker_mm` as printed"
            )
        if not self.dictionary.startswith("DICT_") or not hasattr(cv2.aruco, self.dictionary):
            names = ", ".join(sorted(n for n in dir(cv2.aruco) if n.startswith("DICT_4X4")))
            raise CalibrationError(f"there is no marker dictionary {self.dictionary!r}: give one of {names}, ...")
        if min(self.columns, self.rows) < 3:
            raise CalibrationError(f"a ChArUco board has at least 3 x 3 squares, not {self.columns}x{self.rows}")

    @property
    def turnable(self) -> bool:
        """Never: its corners have numbers."""
        return False

    def board(self) -> cv2.aruco.CharucoBoard:
        """As OpenCV has it."""
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, markers)
        board.setLegacyPattern(self.legacy)
        return board

    def points(self) -> Array:
        """((columns - 1) (rows - 1), 3) places of the inner corners by their numbers; z = 0."""
        return np.asarray(self.board().getChessboardCorners(), dtype=float)

    def find(self, picture: NDArray[np.uint8]) -> Corners | None:
        """Its corners in a grey image; None where fewer than 6 are found, or all on one line."""
        options = cv2.aruco.DetectorParameters()
        options.detectInvertedMarker = self.inverted
        detector = cv2.aruco.CharucoDetector(self.board(), cv2.aruco.CharucoParameters(), options)
        uv, ids, _, _ = detector.detectBoard(picture)
        if ids is None or len(ids) < 6:
            return None
        numbers = np.ravel(np.asarray(ids, dtype=np.int64))
        local = self.points()[numbers]
        if np.linalg.matrix_rank(local[:, :2] - local[0, :2], tol=0.1 * self.square_m) < 2:
            return None
        pixels = np.reshape(np.asarray(uv, dtype=float), (-1, 2))
        return Corners(ids=numbers, local_m=local, uv_px=pixels)

    def fitted(self, pictures: list[NDArray[np.uint8]]) -> "Charuco":
        """The same board in the print (legacy or not, negative or not) that shows most corners in some images."""
        prints = [replace(self, legacy=a, inverted=b) for b in (False, True) for a in (False, True)]
        counts = [sum(len(c.ids) for p in pictures if (c := b.find(p)) is not None) for b in prints]
        return prints[int(np.argmax(counts))]


Board = Checkerboard | Charuco


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
class CameraImages:
    """Images of one camera, read when they are asked for.

    Attributes:
        labels: Their names.
        read: Increasing numbers of images to these, in shades of grey.
    """

    labels: tuple[str, ...]
    read: Callable[[Sequence[int]], Iterable[NDArray[np.uint8]]]


def of_files(files: Mapping[str, Path]) -> CameraImages:
    """Images that are files, by label."""
    paths = list(files.values())
    return CameraImages(labels=tuple(files), read=lambda wanted: (read_grey(paths[i]) for i in wanted))


def detect(
    pictures: Mapping[str, Mapping[str, Path] | CameraImages],
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
    sources = {c: p if isinstance(p, CameraImages) else of_files(p) for c, p in pictures.items()}
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
