"""Finding a board in all pictures of all cameras."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocap.calibration.boards import Board, Charuco, Corners
from mocap.calibration.pictures import read_grey
from mocap.errors import CalibrationError


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardViews:
    """What one camera saw of a board.

    Attributes:
        size_px: Width and height of its pictures.
        corners: By instant, where the board was found.
        missed: Instants of pictures in which it was not.
    """

    size_px: tuple[int, int]
    corners: Mapping[str, Corners]
    missed: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Pictures:
    """Pictures of one camera, read when they are asked for.

    Attributes:
        labels: Their names.
        read: Increasing numbers of pictures to these, in shades of grey.
    """

    labels: tuple[str, ...]
    read: Callable[[Sequence[int]], Iterable[NDArray[np.uint8]]]


def of_files(files: Mapping[str, Path]) -> Pictures:
    """Pictures that are files, by label."""
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
        pictures: Files by camera and instant, or pictures that are read otherwise.
        board: The board; of a ChArUco board, the print (legacy, negative) is found out from some pictures.
        progress: Told of each camera.

    Returns:
        The board as printed, and the views of each camera.

    Raises:
        CalibrationError: a camera's pictures have several sizes, or the board is in none of any camera.
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
                f"camera {camera!r}: picture {first!r} is {a[0]}x{a[1]}, {other!r} is {b[0]}x{b[1]}: calibrate with "
                "pictures of one size, uncropped"
            )
        views[camera] = BoardViews(size_px=next(iter(sizes)), corners=corners, missed=tuple(missed))
        progress(f"{camera}: board found in {len(corners)} of {len(source.labels)} pictures")
    if not any(v.corners for v in views.values()):
        raise CalibrationError(
            f"no picture shows {_describe(board)}: check the numbers (inner corners of a checkerboard, squares of a "
            "ChArUco board) and the dictionary"
        )
    return board, views


def _some(count: int, n: int = 2) -> list[int]:
    return [round((i + 0.5) * count / n - 0.5) for i in range(min(n, count))]


def _describe(board: Board) -> str:
    if isinstance(board, Charuco):
        return f"a ChArUco board of {board.columns}x{board.rows} squares with markers of {board.dictionary}"
    return f"a checkerboard of {board.columns}x{board.rows} inner corners"
