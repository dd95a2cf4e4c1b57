"""What the cameras filmed, under what was measured in it: which videos these are, and how every viewer plays them."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

from eal.arrays import Array
from mocap.cameras.camera import Camera
from mocap.errors import MocapError
from mocap.io.dvproject import read_project
from mocap.io.format import Hints
from mocap.io.movies import FIRST_PIXEL, Movie, pyav, straightened, straightening
from mocap.io.registry import by_name, read_as
from mocap.rerun import paths
from mocap.rerun.columns import log_over_time
from mocap.rerun.footage import CameraFootage, Footage
from mocap.rerun.scene import ViewCamera
from mocap.text import number_of
from mocap.tracking.report_part import Report
from mocap.tracking.result import Result

if TYPE_CHECKING:
    import av


def with_footage(run: Result, movies: Sequence[Movie], *, offsets: tuple[Array, str], straight: bool = False) -> Result:
    """The run with its movies; what they show and where they are from is added to its report.

    Args:
        run: The run.
        movies: One a camera, in the order of the cameras.
        offsets: Frames of the movies minus frames of the recording, and where they are from; see ``offsets_of``.
        straight: Whether the movies are free of distortion already.

    Raises:
        MocapError: not one movie a camera, or of other sizes than the cameras have.
    """
    cameras, n_frames = run.cameras, len(run.t_s)
    if len(movies) != len(cameras):
        raise MocapError(
            f"`video`: {len(movies)} movies ({', '.join(m.path.name for m in movies)}) for {len(cameras)} cameras: "
            "give one for each camera, in the order of the cameras, or a folder that contains one for each"
        )
    offset_frames, source = offsets
    rows, columns = offset_frames.shape
    if columns not in (1, len(cameras)) or rows not in (1, n_frames):
        raise MocapError(
            f"offsets of movies {source}: {rows} rows of {columns} for {n_frames} frames of {len(cameras)} cameras: "
            "give `video_offset` once for all cameras, or once for each"
        )
    late: Any = run.report.get("late_frames")  # of the cameras' own clocks; the tracks were put in step
    if late is not None:
        offset_frames, source = offset_frames - np.array(late), f"{source}, less the lag that was corrected"
    whole = np.round(np.nan_to_num(offset_frames)).astype(np.int64)
    shifts = np.broadcast_to(whole, (n_frames, len(cameras)))
    footage = tuple(
        CameraFootage(movie=movie, frames=np.arange(n_frames) + shifts[:, c], straight=straight or camera.lens is None)
        for c, (camera, movie) in enumerate(zip(cameras, movies, strict=True))
    )
    sized = tuple(_with_size(camera, f.movie) for camera, f in zip(cameras, footage, strict=True))
    lines = [_sentence(camera, f, source) for camera, f in zip(cameras, footage, strict=True)]
    text = "\n".join([run.report_text.rstrip(), "", "## Video", "", *(f"- {line}" for line in lines), ""])
    report = Report(numbers={**run.report, "video": lines}, text=text)
    return replace(run, cameras=sized).with_part(Footage(cameras=footage), report)


def _with_size(camera: Camera, movie: Movie) -> Camera:
    if camera.size_px is not None and tuple(camera.size_px) != movie.size_px:
        raise MocapError(
            f"`video`: {movie.path.name} is {movie.size_px[0]} x {movie.size_px[1]}, but camera {camera.name} is "
            f"{camera.size_px[0]} x {camera.size_px[1]}: give the movies in the order of the cameras, uncropped"
        )
    return replace(camera, size_px=movie.size_px)


def _sentence(camera: Camera, footage: CameraFootage, source: str) -> str:
    offsets = np.unique(footage.frames - np.arange(len(footage.frames)))
    how = f"{offsets[0]:+d}" if len(offsets) == 1 else f"{offsets[0]:+d} to {offsets[-1]:+d}"
    there = int(footage.there.sum())
    lacking = number_of(len(footage.frames) - there, "frame has", "frames have")
    missing = "" if there == len(footage.frames) else f"; {lacking} no image"
    lens = "" if camera.lens is None else " taken as free of distortion" if footage.straight else " straightened"
    return (
        f"{camera.name}: {footage.movie.path.name}{lens}, {footage.movie.n_frames} frames, frame of the movie = "
        f"frame of the tracks {how} ({source}){missing}"
    )


def offsets_of(tracks: Path | None, offsets: Sequence[int] | None) -> tuple[Array, str]:
    """Frames of the movies minus frames of the tracks, and where that is known from.

    Args:
        tracks: xypts file or project; None: not known.
        offsets: By the user; None: what the project says, or the file ``*offsets.csv`` beside an xypts file, or 0.

    Returns:
        (T or 1, C or 1) offsets.

    Raises:
        MocapError: that file cannot be read.
    """
    if offsets:
        return np.array([offsets], dtype=np.float64), "as stated"
    if tracks is None or not (tracks.is_absolute() or tracks.is_file()):  # a loaded result knows its name alone
        return np.zeros((1, 1)), "not stated"
    if tracks.suffix.lower() == ".mat":
        return read_project(tracks).tables["offset_frames"], "from the project"
    beside = tracks.with_name(tracks.name.replace("xypts", "offsets"))
    if beside != tracks and beside.is_file():
        return read_as(by_name("dltdv-offsets"), beside, Hints()).tables["offset_frames"], f"from {beside.name}"
    return np.zeros((1, 1)), "not stated"


_CODER = {"preset": "11", "crf": "34", "svtav1-params": "pred-struct=1:lp=1:rtc=1"}


def log_video(rec: rr.RecordingStream, view: ViewCamera, camera: Camera, footage: CameraFootage, t_s: Array) -> None:
    """The video of one camera, an image a frame; black where there is none.

    An AV1 video that needs no change is taken as it is; any other is decoded frame by frame, straightened if it is bent
    by the lens, and coded.

    Args:
        rec: Where to.
        view: The camera as it is drawn.
        camera: The camera with its lens.
        footage: Its movie.
        t_s: (T,) times of the recording.
    """
    path = f"{paths.image(view.name)}/video"
    # a viewer plays the file itself, if that holds little that is not shown
    plain = footage.movie.codec in ("libdav1d", "av1") and footage.movie.path.suffix == ".mp4"
    plain &= footage.movie.n_frames <= 2 * len(t_s)
    as_is = plain and footage.straight and view.pixel_signs[0] > 0
    shown_px = footage.movie.size_px if as_is else coded_size(footage.movie.size_px)
    corner = np.where(view.pixel_signs > 0, FIRST_PIXEL - 0.5, 0.5 - FIRST_PIXEL)
    scale = np.array(footage.movie.size_px) / shown_px
    rec.log(path, rr.Transform3D(translation=(*corner, 0.0), scale=(*scale, 1.0)), static=True)
    if as_is:
        asset = rr.AssetVideo(path=footage.movie.path)
        stamps = np.asarray(asset.read_frame_timestamps_nanos())
        rec.log(path, asset, static=True)
        there = footage.there & (footage.frames < len(stamps))
        columns = rr.VideoFrameReference.columns(timestamp=stamps[footage.frames[there]])
        log_over_time(rec, path, t_s, columns, rr.VideoFrameReference.from_fields(draw_order=-20.0), counts=there)
        return
    pictures = _pictures(footage, camera, shown_px, mirrored=bool(view.pixel_signs[0] < 0))
    samples = [bytes(packet) for packet in av1(pictures, shown_px)]
    look = rr.VideoStream.from_fields(codec=rr.VideoCodec.AV1, draw_order=-20.0)
    log_over_time(rec, path, t_s, rr.VideoStream.columns(sample=samples), look)


def coded_size(size_px: tuple[int, int]) -> tuple[int, int]:
    """Width and height, even and at most 1280, in which a movie is coded."""
    shrink = min(1.0, 1280 / max(size_px))
    width, height = (max(2 * round(shrink * n / 2), 64) for n in size_px)
    return width, height


def av1(pictures: "Iterator[av.VideoFrame]", size_px: tuple[int, int]) -> "Iterator[av.Packet]":
    """Images coded as AV1 in the order in which they are shown, one packet an image."""
    os.environ.setdefault("SVT_LOG", "1")  # the coder says nothing but errors
    coder: Any = pyav().CodecContext.create("libsvtav1", "w")
    coder.width, coder.height = size_px
    coder.pix_fmt = "yuv420p"
    coder.time_base, coder.framerate = Fraction(1, 30), Fraction(30, 1)
    coder.gop_size, coder.max_b_frames, coder.options = 30, 0, _CODER
    with not_in_real_time():
        coder.open()
    for number, picture in enumerate(pictures):
        picture.pts, picture.time_base = number, coder.time_base
        picture.pict_type = 0  # the coder chooses
        yield from coder.encode(picture)
    yield from coder.encode(None)


@contextmanager
def not_in_real_time() -> Iterator[None]:
    """Threads keep the scheduling of this one: run by root, SVT-AV1 gives itself and its caller real-time priority.

    Whatever the caller starts later inherits that, and leaves the computer to nobody else while it works.
    """
    tasks = Path("/proc/self/task")
    if not hasattr(os, "sched_getscheduler") or not tasks.is_dir():  # Linux alone schedules so
        yield
        return
    before, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    yield
    for task in tasks.iterdir():
        with suppress(ProcessLookupError, PermissionError):
            if os.sched_getscheduler(int(task.name)) != before:
                os.sched_setscheduler(int(task.name), before, priority)


def _pictures(
    footage: CameraFootage, camera: Camera, size_px: tuple[int, int], *, mirrored: bool
) -> "Iterator[av.VideoFrame]":
    library = pyav()
    width, height = size_px
    where = None
    if not footage.straight and camera.lens is not None:
        where = straightening(camera.lens.distort, footage.movie.size_px, size_px)
    black = library.VideoFrame.from_ndarray(np.zeros((height, width, 3), dtype=np.uint8), format="rgb24")
    for frame in footage.movie.frames(footage.frames):
        picture = black if frame is None else frame
        if frame is not None and (where is not None or mirrored):
            rgb = frame.to_ndarray(format="rgb24").astype(np.uint8, copy=False)
            rgb = rgb if where is None else straightened(rgb, where)
            picture = library.VideoFrame.from_ndarray(
                np.ascontiguousarray(rgb[:, ::-1] if mirrored else rgb), format="rgb24"
            )
        yield picture.reformat(width, height, "yuv420p")
