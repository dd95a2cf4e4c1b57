"""What the cameras filmed, under what was measured in it: as AV1, which every viewer plays without help."""

import os
from collections.abc import Iterator
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

from eal.arrays import Array
from mocap.cameras.camera import Camera
from mocap.io.movies import FIRST_PIXEL, Movie, pyav, straightened, straightening
from mocap.pipeline.recording import Footage
from mocap.rerun import paths
from mocap.rerun.columns import log_over_time
from mocap.rerun.scene import ViewCamera

if TYPE_CHECKING:
    import av

_CODER = {"preset": "11", "crf": "34", "svtav1-params": "pred-struct=1:lp=1:rtc=1"}


def log_video(rec: rr.RecordingStream, view: ViewCamera, camera: Camera, footage: Footage, t_s: Array) -> None:
    """The film of one camera, a picture a frame; black where there is none.

    An AV1 film that needs no change is taken as it is; any other is decoded frame by frame, straightened if it is bent
    by the lens, and coded.

    Args:
        rec: Where to.
        view: The camera as it is drawn.
        camera: The camera with its lens.
        footage: Its movie.
        t_s: (T,) times of the recording.
    """
    path = f"{paths.image(view.name)}/video"
    as_is = footage.straight and view.pixel_signs[0] > 0 and _is_plain_av1(footage.movie, len(t_s))
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
    """Pictures coded as AV1 in the order in which they are shown, one packet a picture."""
    os.environ.setdefault("SVT_LOG", "1")  # the coder says nothing but errors
    coder: Any = pyav().CodecContext.create("libsvtav1", "w")
    coder.width, coder.height = size_px
    coder.pix_fmt = "yuv420p"
    coder.time_base, coder.framerate = Fraction(1, 30), Fraction(30, 1)
    coder.gop_size, coder.max_b_frames, coder.options = 30, 0, _CODER
    for number, picture in enumerate(pictures):
        picture.pts, picture.time_base = number, coder.time_base
        picture.pict_type = 0  # the coder chooses
        yield from coder.encode(picture)
    yield from coder.encode(None)


def _pictures(
    footage: Footage, camera: Camera, size_px: tuple[int, int], *, mirrored: bool
) -> "Iterator[av.VideoFrame]":
    """The pictures to code, one a frame of the recording."""
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


def _is_plain_av1(movie: Movie, n_frames: int) -> bool:
    """Whether a viewer can play the file itself, and it holds little that is not shown."""
    return movie.codec in ("libdav1d", "av1") and movie.path.suffix == ".mp4" and movie.n_frames <= 2 * n_frames
