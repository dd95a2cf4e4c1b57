"""Calibration boards: where their corners are, and finding them in images."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, frozen
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
        grid = np.reshape(np.asarray(uv, dtype=float), (self.rows, self.columns, 2))
        spacing = min(np.linalg.norm(np.diff(grid, axis=a), axis=-1).min() for a in (0, 1))
        near = int(np.clip(0.45 * spacing, 2, 15))
        stop = (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, 50, 1e-3)
        uv = cv2.cornerSubPix(picture, np.asarray(uv, np.float32), (near, near), (-1, -1), stop)
        grid = np.reshape(np.asarray(uv, dtype=float), (self.rows, self.columns, 2))
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
