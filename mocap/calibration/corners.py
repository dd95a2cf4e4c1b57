"""Corners of a checkerboard to a fraction of a pixel, each in a window that its neighbours on the board span."""

import cv2
import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array

HALF_WINDOW = 0.35
"""Half the side of a window, in squares. The edges that meet in a corner reach one square from it, those of its
neighbours come as near as that; on renderings and two sets of real images 0.25 to 0.4 are alike, 0.45 is worse where
lenses bend the edges."""
LEAST_PX = 2.5
"""Half a window in pixels at least: edges are as wide as that in images that are a little out of focus."""
WIDEST = 0.45
"""Half a window in squares at most: two windows do not meet."""
ASTRAY = 0.4
"""Squares that a corner is off where the board's plane puts it, and five times as far as the median one: it was found
at another corner. OpenCV does so where squares are small (12 px)."""
STEPS = 40
STILL_PX = 1e-3


def refined(picture: NDArray[np.uint8], grid: Array) -> Array:
    """(rows, columns, 2) corners where the edges around each meet.

    At a pixel q on an edge the gradient g is perpendicular to the edge, which goes through the corner p:
    g . (q - p) = 0. The corner is the least-squares solution over its window, sum(w g g^T) p = sum(w g g^T q)
    (Foerstner & Guelch 1987), iterated, as OpenCV does it in windows square to the image. Here the window is a
    parallelogram along the rows and columns of the board at that corner, so that it is as large as the square it is
    in, however the board is turned, tilted or far.

    Args:
        picture: In shades of grey.
        grid: (rows, columns, 2) pixels of the corners, to some tenths of a square.
    """
    grid = _in_place(grid)
    along, across = np.gradient(grid, axis=1), np.gradient(grid, axis=0)
    axes = np.stack([along, across], axis=-2).reshape(-1, 2, 2)  # of each corner, a row each
    area = np.abs(np.linalg.det(axes))
    narrow = area / np.maximum(np.linalg.norm(axes, axis=-1).max(axis=-1), 1e-9)  # width of a square across its edges
    half = np.clip(LEAST_PX / np.maximum(narrow, 1e-9), HALF_WINDOW, WIDEST)
    count = int(np.clip(np.ceil(2 * (half * np.linalg.norm(axes, axis=-1).max(axis=-1)).max()), 8, 40))  # a pixel each
    unit = (np.arange(count) + 0.5) / count * 2 - 1
    window = np.stack(np.meshgrid(unit, unit), axis=-1).reshape(-1, 2)
    weight = np.exp(-np.sum(window**2, axis=-1) / 2 / 0.6**2)
    offsets = np.einsum("n,kj,njx->nkx", half, window, axes)
    smooth = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 0.7)
    slopes = [cv2.Scharr(smooth, cv2.CV_32F, *d, scale=1 / 32) for d in ((1, 0), (0, 1))]
    start = grid.reshape(-1, 2)
    at = start.copy()
    for _ in range(STEPS):
        place = (at[:, None] + offsets).astype(np.float32)
        u, v = np.ascontiguousarray(place[..., 0]), np.ascontiguousarray(place[..., 1])
        g = np.stack([cv2.remap(s, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for s in slopes], axis=-1)
        products = weight[:, None, None] * g[..., :, None] * g[..., None, :]
        normal = products.sum(axis=1)
        shift = np.einsum("nkij,nkj->ni", products, offsets)
        sharp = np.linalg.det(normal) > 1e-6 * np.maximum(np.trace(normal, axis1=1, axis2=2) ** 2, 1e-12)
        step = np.zeros_like(at)
        step[sharp] = np.linalg.solve(normal[sharp], shift[sharp][..., None])[..., 0]
        at = at + step
        if np.abs(step).max() < STILL_PX:
            break
    inside = np.linalg.norm(at - start, axis=-1) <= half * np.linalg.norm(axes, axis=-1).max(axis=-1)
    return np.where(inside[:, None], at, start).reshape(grid.shape)


def _in_place(grid: Array) -> Array:
    """(rows, columns, 2) corners, those that went astray where the board's plane puts them.

    The plane is a homography that half of the corners fit best (least median of squares): lenses bend the others by
    less than a square.
    """
    rows, columns = grid.shape[:2]
    x, y = np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float))
    board = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    plane, _ = cv2.findHomography(board, grid.reshape(-1, 1, 2), cv2.LMEDS)
    if plane is None:
        return grid
    placed = np.asarray(cv2.perspectiveTransform(board, plane), dtype=float).reshape(grid.shape)
    off = np.linalg.norm(grid - placed, axis=-1)
    square = np.linalg.norm(np.gradient(placed, axis=1), axis=-1)
    square = np.minimum(square, np.linalg.norm(np.gradient(placed, axis=0), axis=-1))
    astray = (off > ASTRAY * square) & (off > 5 * np.median(off))
    return np.where(astray[..., None], placed, grid)
