"""Videos of all cameras, decoded once, in step and in bounded memory; refused where they do not fit the calibration."""

from collections import deque
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras import triangulate
from mocap.cameras.camera import Camera, cropped_camera, stacked, undistorted
from mocap.digitising.dots import Grey
from mocap.errors import CalibrationError, MocapError
from mocap.io.crop import matched
from mocap.io.movies import Movie, listed, open_movie

AHEAD = 4
"""So many frames of each video are decoded before they are asked for: of speed and memory alone."""
_MISFIT_PX = 6.0  # twice what careless clicks miss by; chosen, not measured


@dataclass(frozen=True, eq=False, kw_only=True)
class Videos:
    """Videos of C cameras, in the order of the cameras.

    Attributes:
        movies: One a camera.
        offset_frames: (C,) frame of the video minus frame of the tracks.
        n_frames: Frames that at least two videos show, or the only one.
    """

    movies: tuple[Movie, ...]
    offset_frames: tuple[int, ...]
    n_frames: int

    def pictures(self, frames: NDArray[np.int64] | None = None) -> "Iterator[list[Grey | None]]":
        """The images of all cameras, frame after frame; each video is decoded by a thread of its own.

        Args:
            frames: Frames to show, increasing; None: all.

        Yields:
            One image a camera, (h, w) grey levels of 8 or 16 bits; None where a video does not show the frame.
        """
        wanted = np.arange(self.n_frames) if frames is None else np.asarray(frames)
        videos = [_ahead(movie, wanted + o) for movie, o in zip(self.movies, self.offset_frames, strict=True)]
        try:
            yield from map(list, zip(*videos, strict=True))
        finally:
            for video in videos:
                video.close()

    def picture(self, camera: int, frame: int) -> Grey | None:
        """One image of one camera."""
        found = next(self.movies[camera].frames(np.array([frame + self.offset_frames[camera]])))
        return None if found is None else grey_levels(found)


def _ahead(movie: Movie, wanted: NDArray[np.int64]) -> "Generator[Grey | None]":
    """The images of a video, decoded by a thread that is ``AHEAD`` frames before what is asked for."""
    source = movie.frames(wanted, threads=False)

    def decoded() -> "Grey | None":
        frame = next(source)
        return None if frame is None else grey_levels(frame)

    thread = ThreadPoolExecutor(1)
    try:
        waiting = deque(thread.submit(decoded) for _ in wanted[:AHEAD])
        for i in range(len(wanted)):
            picture = waiting.popleft().result()
            if i + AHEAD < len(wanted):
                waiting.append(thread.submit(decoded))
            yield picture
    finally:
        thread.shutdown(cancel_futures=True)


def grey_levels(frame: Any) -> Grey:
    """(h, w) grey levels of a decoded frame: 8 bits, or 16 where the video has more than 8."""
    kind = frame.format.name
    deep = frame.format.components[0].bits > 8
    if not deep and (kind.startswith(("yuv", "gray", "nv")) and "p" in kind + "p"):
        plane = frame.planes[0]
        if plane.line_size < 0:  # rows from the bottom, as in cine
            return np.asarray(frame.to_ndarray(format="gray"))
        rows = np.frombuffer(plane, dtype=np.uint8).reshape(-1, plane.line_size)
        return rows[: frame.height, : frame.width].copy()
    if kind.startswith("rgb") or kind.startswith("bgr") or kind.startswith("gbr"):
        return np.asarray(cv2.cvtColor(frame.to_ndarray(format="rgb24"), cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    return np.asarray(frame.to_ndarray(format="gray16le" if deep else "gray"))


def open_videos(
    given: Sequence[Path], cameras: Sequence[Camera], *, offset_frames: Sequence[int] | None = None
) -> Videos:
    """Open the videos of a rig and check that they fit its calibration.

    Args:
        given: A video or a folder of images a camera, in the order of the cameras; or one folder that holds just
            these. Files named as the cameras are put into their order.
        cameras: The C cameras.
        offset_frames: Frame of the video minus frame of the tracks, one for each camera; None: all 0.

    Raises:
        MocapError: not one video a camera, or videos of other sizes, with what fits.
    """
    paths = listed(given)
    if len(paths) != len(cameras):
        raise MocapError(
            f"`videos`: {len(paths)} videos ({', '.join(p.name for p in paths)}) for {len(cameras)} cameras "
            f"({', '.join(c.name for c in cameras)}): give one for each camera, in the order of the cameras"
        )
    by_name = {path.stem: path for path in paths}
    if {camera.name for camera in cameras} == set(by_name):
        paths = [by_name[camera.name] for camera in cameras]
    movies = tuple(open_movie(path) for path in paths)
    for camera, movie in zip(cameras, movies, strict=True):
        if camera.size_px is not None and tuple(camera.size_px) != movie.size_px:
            fits = [c.name for c in cameras if c.size_px is not None and tuple(c.size_px) == movie.size_px]
            fit = f"it fits {', '.join(fits)}" if fits else "it fits no camera of this calibration"
            raise MocapError(
                f"`videos`: {movie.path.name} is {movie.size_px[0]} x {movie.size_px[1]} px, but camera {camera.name} "
                f"was calibrated at {camera.size_px[0]} x {camera.size_px[1]}: {fit}; give the videos in the order of "
                "the cameras; where they are cropped give `crop`, or calibrate the cropped window"
            )
    offsets = tuple(offset_frames) if offset_frames else (0,) * len(movies)
    if len(offsets) == 1:
        offsets = offsets * len(movies)
    if len(offsets) != len(movies):
        raise MocapError(f"`offset_frames`: {len(offsets)} offsets for {len(movies)} videos: give one for each")
    ends = sorted((m.n_frames - o for m, o in zip(movies, offsets, strict=True)), reverse=True)
    return Videos(movies=movies, offset_frames=offsets, n_frames=max(ends[:2][-1], 0))


def open_windows(
    given: Sequence[Path],
    cameras: Sequence[Camera],
    crops: Mapping[str, Array],
    *,
    offset_frames: Sequence[int] | None = None,
) -> tuple[Videos, tuple[Camera, ...]]:
    """Open videos that are windows of the calibrated images.

    Args:
        given: As of ``open_videos``.
        cameras: The C cameras, of the whole images.
        crops: (1, 2) or (frames, 2) places of the windows' upper left corners, by the name of the camera or video.
        offset_frames: As of ``open_videos``.

    Returns:
        The videos, and the cameras of the windows.

    Raises:
        MocapError: a video has no offsets, its window moves or is not inside the image, or as ``open_videos``.
    """
    paths = listed(given)
    views = [[camera.name for camera in cameras], [path.stem for path in paths]]
    found = (matched(crops, [[name] for name in names]) for names in views if len(names) == len(cameras))
    offsets = next((each for each in found if each is not None), None)
    if offsets is None:
        raise MocapError(
            f"`crop`: offsets of {', '.join(crops)} for the cameras {', '.join(views[0])}: give one for each camera, "
            "named as camera or video"
        )
    for camera, offset in zip(cameras, offsets, strict=True):
        if np.ptp(offset, axis=0).max() > 0:
            raise MocapError(
                f"`crop`: the window of {camera.name} moves: videos are digitised in windows at rest; crop by one "
                "window, or digitise the whole image"
            )
    videos = open_videos(
        given,
        [cropped_camera(camera, offset[0]) for camera, offset in zip(cameras, offsets, strict=True)],
        offset_frames=offset_frames,
    )
    windows = []
    for camera, offset, movie in zip(cameras, offsets, videos.movies, strict=True):
        end = offset[0] + movie.size_px
        if camera.size_px is not None and ((offset[0] < 0) | (end > camera.size_px)).any():
            raise MocapError(
                f"`crop`: the window of {camera.name}, {movie.size_px[0]} x {movie.size_px[1]} px at "
                f"({offset[0, 0]:g}, {offset[0, 1]:g}), is not inside the calibrated image of "
                f"{camera.size_px[0]} x {camera.size_px[1]} px: check the offsets"
            )
        windows.append(replace(cropped_camera(camera, offset[0]), size_px=movie.size_px))
    return videos, tuple(windows)


def check_order(cameras: Sequence[Camera], uv_px: Array, movies: Sequence[Movie]) -> None:
    """Refuse videos whose clicks do not meet in space, with the order of the cameras in which they do.

    Args:
        cameras: The C cameras.
        uv_px: (C, N, 2) clicks as recorded; NaN where not clicked.
        movies: Videos of the cameras.

    Raises:
        CalibrationError: rays of the same marker pass each other by more than clicks can explain.
    """
    both = np.isfinite(uv_px[..., 0]).sum(axis=0) >= 2
    if not both.any():
        return
    found = _misfit(cameras, uv_px[:, both])
    if not found > _MISFIT_PX:
        return
    every = range(len(cameras))
    if len(every) <= 6:
        orders = list(permutations(every))
    else:
        orders = [tuple({i: j, j: i}.get(k, k) for k in every) for i, j in combinations(every, 2)]
    tried = [(_misfit([cameras[i] for i in order], uv_px[:, both]), order) for order in orders]
    best, order = min((misfit, order) for misfit, order in tried if np.isfinite(misfit))
    if best < min(_MISFIT_PX, 0.3 * found):
        pairs = ", ".join(f"{m.path.name}: {cameras[i].name}" for m, i in zip(movies, order, strict=True))
        raise CalibrationError(
            f"the videos are not in the order of the calibration: the clicks have a reprojection error of {found:.1f} "
            f"px; in the order {pairs} it is {best:.1f} px"
        )
    raise CalibrationError(
        f"the clicks do not fit the calibration: the median reprojection error is {found:.1f} px, and {best:.1f} px in "
        f"the best order of the cameras: check that it is the calibration of these videos, that they are in step "
        "(`offset_frames`), and that the clicks count rows from the upper left corner"
    )


def _misfit(cameras: Sequence[Camera], uv_px: Array) -> float:
    ideal, matrices = undistorted(cameras, uv_px), stacked(cameras)
    xyz_m = triangulate.linear(matrices, ideal)
    residual = triangulate.residual_px(matrices, ideal, xyz_m)
    return float(np.nanmedian(residual)) if np.isfinite(residual).any() else np.inf
