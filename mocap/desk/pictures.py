"""Images of a recording's cameras, and what is drawn over them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import flipped
from mocap.digitising.dots import dot_at
from mocap.digitising.naming import seen_from
from mocap.digitising.videos import Videos, open_videos
from mocap.errors import MocapError
from mocap.io.movies import FILMS, FIRST_PIXEL
from mocap.reading.decided import decided
from mocap.recording import Recording


@dataclass(eq=False, kw_only=True)
class Pictures:
    """Images of a recording.

    Attributes:
        raw: The recording as it was read, without edits, and with what was decided of the pixels.
        videos: Its videos, if there are any.
    """

    raw: Recording
    videos: Videos | None = None

    @cached_property
    def sizes_px(self) -> list[tuple[float, float]]:
        """Width and height of each camera's image: of its video, of the calibration, or of what it shows."""
        if self.videos is not None:
            return [(float(width), float(height)) for width, height in (m.size_px for m in self.videos.movies)]
        if "pixels" not in self.raw.data:
            return []
        most = np.nanmax(self.raw.data["pixels"].values, axis=(1, 2), initial=1.0)
        cameras = self.raw.cameras or (None,) * len(most)
        sizes = [None if camera is None else camera.size_px for camera in cameras]
        whole = [np.ceil(1.05 * own) if size is None else size for size, own in zip(sizes, most, strict=True)]
        return [(float(width), float(height)) for width, height in whole]

    @cached_property
    def height_px(self) -> float | None:
        """By which rows counted from below are shown from above; None: they are counted from above."""
        rows = decided(self.raw).rows
        if rows is None or "lower-left" not in (rows.pixels, rows.coefficients):
            return None
        return rows.height_px or float(self.sizes_px[0][1])

    def shown(self, camera: int, uv_px: Array) -> Array:
        """Ideal pixels as the image shows them."""
        how, cam = decided(self.raw), self.raw.cameras[camera]
        rows = how.rows
        if how.lens is not None:
            bent = np.broadcast_to(uv_px, (len(self.raw.cameras), *uv_px.shape)).copy()
            for _ in range(4):  # the inverse of ``straight``, whose steps shrink by the lens' slope, 0.1 or less
                bent += uv_px - how.lens.straight(bent)
            uv_px = bent[camera]
        uv = flipped(uv_px, self.height_px) if rows is not None and rows.coefficients == "lower-left" else uv_px
        return uv if cam.lens is None else cam.lens.distort(uv)

    def upright(self, uv_px: Array) -> Array:
        """Pixels of the file as images show them, or the reverse."""
        rows = decided(self.raw).rows
        return flipped(uv_px, self.height_px) if rows is not None and rows.pixels == "lower-left" else uv_px

    def picture(self, camera: int, frame: int) -> Any:
        """A camera's image in a frame; None: there is none."""
        return None if self.videos is None else self.videos.picture(camera, frame)


def pictures_of(recording: Recording) -> Pictures:
    """Images of a recording, with its videos where they lie beside its file."""
    filmed = recording.cameras and "pixels" in recording.data
    return Pictures(raw=recording, videos=films_beside(recording) if filmed else None)


def films_beside(recording: Recording) -> Videos | None:
    """Videos of a recording: in its folder, else in a folder there of which each video or folder is a camera's."""
    if recording.file is None:
        return None
    place = recording.file.parent
    inside = sorted(path for path in place.iterdir() if not path.name.startswith("."))
    own = [path for path in inside if path.suffix.lower() in FILMS]
    mine = [path for path in own if path.stem.startswith(recording.name)]
    tries: list[Sequence[Path]] = [mine, own, *([path] for path in inside if path.is_dir())]
    for given in tries:
        try:
            if given:
                return open_videos(given, recording.cameras)
        except (MocapError, OSError):  # others' images, or results
            continue
    return None


_REACH = float(np.sqrt(-2 * np.log(0.05)))  # root of the chi-square of two degrees of freedom that 95 % stay below

Shown = Callable[[int, Array], Array]
"""(N, 2) ideal pixels of a camera as its image shows them."""


def ellipses(matrices: Array, xyz_m: Array, cov_m2: Array, shown: Shown, *, y_up: bool = False) -> Array:
    """(C, M, 5) centre, half axes and angle of the 95 % ellipses of where images show markers.

    Args:
        matrices: (C, 3, 4) projections.
        xyz_m: (M, 3) positions.
        cov_m2: (M, 3, 3) their covariances.
        shown: Ideal pixels as images show them.
        y_up: Whether ideal pixels are counted from the lower left.
    """
    uv, jacobian = seen_from(matrices, xyz_m)
    jacobian = jacobian * np.array([1.0, -1.0 if y_up else 1.0])[:, None]
    s = jacobian @ cov_m2 @ np.swapaxes(jacobian, -1, -2)
    out = np.full((*uv.shape[:2], 5), np.nan)
    finite = np.isfinite(s).all(axis=(-1, -2))
    values, vectors = np.linalg.eigh(s[finite])
    turn = np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])
    out[finite, 2:] = np.c_[_REACH * np.sqrt(np.maximum(values[:, ::-1], 0)), turn]
    for c in range(len(matrices)):
        out[c, :, :2] = shown(c, uv[c])
    return out


def epipolar_lines(
    matrices: Array, ideal_px: Array, sizes_px: Sequence[Sequence[float]], shown: Shown
) -> list[list[list[list[float]]]]:
    """For each camera the lines on which a marker lies by its place in each of the others, as images bend them.

    Args:
        matrices: (C, 3, 4) projections.
        ideal_px: (C, 2) ideal pixels of the marker; NaN where it was not digitised.
        sizes_px: Width and height of each image.
        shown: Ideal pixels as images show them.
    """
    out: list[list[list[list[float]]]] = [[] for _ in matrices]
    for a in np.flatnonzero(np.isfinite(ideal_px[:, 0])).tolist():
        inverse = np.linalg.inv(matrices[a, :, :3])
        eye, along = -inverse @ matrices[a, :, 3], inverse @ np.append(ideal_px[a], 1.0)
        # depths of one camera's ray from near to far
        reach = max(float(np.linalg.norm(eye)), 1e-3)
        points = eye + np.geomspace(0.05, 20, 200)[:, None] * reach * along / np.linalg.norm(along)
        uv, _ = seen_from(matrices, points)
        for b, (width, height) in enumerate(sizes_px):
            near = (np.abs(uv[b] - (width / 2, height / 2)) < (width, height)).all(axis=1)
            line = shown(b, uv[b][near])
            if b != a and len(line) > 1:
                out[b].append(np.round(line, 2).tolist())
    return out


def listed(values: Array) -> Any:
    """Numbers for a script; None: there are none."""
    return np.round(values, 3).tolist() if np.isfinite(values).all() else None


def drawn(marks: Mapping[str, Array], lines: Sequence[Any]) -> list[dict[str, Any]]:
    """What the page draws over the image of each of C cameras.

    Args:
        marks: (C, M, ...) of each marker by what it is: ``click``, ``dot``, ``ellipse``, ``edited``.
        lines: Of each camera those of one marker.
    """
    each = [
        [{name: listed(values[c, m]) for name, values in marks.items()} for m in range(len(marks["click"][c]))]
        for c in range(len(lines))
    ]
    return [{"markers": own, "lines": line} for own, line in zip(each, lines, strict=True)]


def moving_box(images: Sequence[Any]) -> list[float] | None:
    """Left, top, right and bottom of what an image shows elsewhere than two others of its camera do, in their pixels.

    It is what differs from the median of the three by more than six standard deviations of what differs in most of
    the image, but for 2 % of it at each edge, with a margin of a quarter on each side.

    Args:
        images: Three images; the first is the one that is shown.

    Returns:
        None: nothing moves there, or most of it does.
    """
    if len(images) < 3 or any(image is None or image.shape != images[0].shape for image in images):
        return None
    levels = [cv2.blur(image.astype(np.float32), (5, 5)) for image in images]
    apart = np.abs(levels[0] - np.median(levels, axis=0))
    usual = max(1.4826 * float(np.median(np.abs(levels[1] - levels[2]))), 0.5)
    rows, columns = np.nonzero(apart > 6 * usual)
    if not 8 <= len(rows) <= apart.size / 2:
        return None
    low, high = np.quantile(np.c_[columns, rows], (0.02, 0.98), axis=0)
    low, high = low - 0.25 * (high - low) - 5, high + 0.25 * (high - low) + 5
    edge = np.array(apart.shape[::-1], dtype=float)
    return [*np.clip(low, 0, edge).round(1).tolist(), *np.clip(high, 0, edge).round(1).tolist()]


def snapped(image: Any, uv_px: tuple[float, float]) -> tuple[float, float]:
    """A click (the centre of the first pixel is at (1, 1)) where the image shows a dot beside it, else as it is."""
    found = dot_at(image, np.array(uv_px) - FIRST_PIXEL)
    if found is None:
        return uv_px
    u, v = (found + FIRST_PIXEL).round(3).tolist()
    return u, v
