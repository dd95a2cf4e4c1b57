"""Movies of a camera, read frame by frame: movie files of any kind that FFmpeg knows, or folders of images."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from eal.needs import installing
from mocap.errors import FormatError, MocapError

if TYPE_CHECKING:
    import av

PICTURES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".webp"}
"""Endings of the files that make a folder a movie."""
FILMS = {".mp4", ".avi", ".mov", ".mkv", ".m4v", ".mpg", ".mpeg", ".mts", ".webm", ".wmv", ".cine"}
"""Endings of videos that are looked for in a folder."""
FIRST_PIXEL = 1.0
"""Coordinates of the centre of the first pixel, as DLTdv counts them."""

Picture = NDArray[np.uint8]


@dataclass(frozen=True, eq=False, kw_only=True)
class Movie:
    """A movie that can be read; nothing of its images is kept.

    Attributes:
        path: File, or folder of images.
        pictures: The images of a folder, in the order of the numbers in their names; empty for a file.
        pts: (N,) time stamps of the frames of a file in its own units, increasing; empty for a folder.
        size_px: Width and height.
        codec: What FFmpeg calls its coding.
        fps: Frames a second that a file states, which high-speed cameras often do not mean; None: a folder.
    """

    path: Path
    pictures: tuple[Path, ...]
    pts: NDArray[np.int64]
    size_px: tuple[int, int]
    codec: str
    fps: float | None = None

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.pictures) or len(self.pts)

    def frames(self, wanted: NDArray[np.int64], *, threads: bool = True) -> "Iterator[av.VideoFrame | None]":
        """Frames one after the other, decoded when they are asked for; whoever stops early decodes no more.

        Args:
            wanted: (T,) numbers of frames from 0, not decreasing where they are in the movie; others give None.
            threads: Whether several threads decode: sooner, but more work: not for several movies at once.

        Raises:
            FormatError: a frame cannot be decoded.
        """
        inside = (wanted >= 0) & (wanted < self.n_frames)
        source = self._pictures(wanted[inside]) if self.pictures else self._decoded(wanted[inside], threads)
        for there in inside:
            yield next(source) if there else None

    def _pictures(self, wanted: NDArray[np.int64]) -> "Iterator[av.VideoFrame]":
        for number in wanted:
            path = self.pictures[int(number)]
            with _opened(path) as container:
                frame = next(container.decode(video=0))
            if (frame.width, frame.height) != self.size_px:
                raise FormatError(
                    f"{path}: is {frame.width} x {frame.height}, the first image of the folder {self.size_px[0]} x "
                    f"{self.size_px[1]}: give a folder of images of one camera"
                )
            yield frame

    def _decoded(self, wanted: NDArray[np.int64], threads: bool) -> "Iterator[av.VideoFrame]":
        if not len(wanted):
            return
        with _opened(self.path) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO" if threads else "NONE"
            if wanted[0] > 0:
                container.seek(int(self.pts[wanted[0]]), stream=stream)
            number, last = -1, None
            decoded: Iterator[Any] = container.decode(stream)
            for target in wanted:
                while last is None or number < target:
                    last = next(decoded, None)
                    if last is None:
                        raise FormatError(
                            f"{self.path}: frame {target + 1} of {self.n_frames} cannot be decoded: repair the movie, "
                            "or convert it to images"
                        )
                    stamp = last.pts if last.pts is not None else last.dts
                    number = int(np.searchsorted(self.pts, stamp)) if stamp is not None else number + 1
                yield last


def open_movie(path: Path) -> Movie:
    """Look at a movie: its frames are counted, not decoded.

    Raises:
        FormatError: there is none, with what was expected.
    """
    if path.is_dir():
        files = (p for p in path.iterdir() if p.suffix.lower() in PICTURES and p.is_file())
        pictures = tuple(sorted(files, key=by_number))
        if not pictures:
            raise FormatError(
                f"{path}: contains no images ({', '.join(sorted(PICTURES))}): give a movie, or a folder of images"
            )
        with _opened(pictures[0]) as container:
            stream = container.streams.video[0]
            size, codec = (stream.width, stream.height), stream.codec_context.name
        return Movie(path=path, pictures=pictures, pts=np.zeros(0, dtype=np.int64), size_px=size, codec=codec)
    if not path.is_file():
        raise FormatError(f"{path}: there is no such movie or folder")
    with _opened(path) as container:
        stream = container.streams.video[0]
        size, codec = (stream.width, stream.height), stream.codec_context.name
        rate = stream.average_rate
        packets = [p for p in container.demux(stream) if p.size]
    stamps = [p.pts if p.pts is not None else p.dts for p in packets]
    if not stamps or any(s is None for s in stamps):
        raise FormatError(f"{path}: its frames have no times: convert it (ffmpeg -i {path.name} movie.mp4)")
    pts = np.unique(np.array(stamps, dtype=np.int64))
    fps = float(rate) if rate else None
    return Movie(path=path, pictures=(), pts=pts, size_px=size, codec=codec, fps=fps)


def open_movies(given: Sequence[Path]) -> tuple[Movie, ...]:
    """The movies of all cameras, in their order: of files or folders of images, or of one folder of these.

    Raises:
        MocapError: one of them is no movie.
    """
    return tuple(open_movie(path) for path in listed(given))


def listed(given: Sequence[Path]) -> list[Path]:
    """Movies, or those of one folder among other files, sorted by their names, numbers by their value.

    Folders of pictures are movies, too; beside files of movies those whose pictures are all numbered, as frames are.
    """
    if len(given) == 1 and given[0].is_dir():
        inside = sorted((p for p in given[0].iterdir() if not p.name.startswith(".")), key=by_number)
        films = any(p.suffix.lower() in FILMS for p in inside)
        movies = [p for p in inside if p.suffix.lower() in FILMS or (p.is_dir() and _has_pictures(p, numbered=films))]
        given = movies or given
    return list(given)


def _has_pictures(folder: Path, *, numbered: bool) -> bool:
    names = [path.stem for path in folder.iterdir() if path.suffix.lower() in PICTURES]
    return bool(names) and (not numbered or all(name[-1:].isdigit() for name in names))


def by_number(path: Path) -> list[tuple[int, int | str]]:
    """Sorts frame2 before frame10."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [(0, int(p)) if p.isdigit() else (1, p) for p in parts if p]


def straightening(
    distort: Callable[[Array], Array], size_px: tuple[int, int], out_px: tuple[int, int]
) -> NDArray[np.float32]:
    """(h, w, 2) where each pixel of a straight image of ``out_px`` lies in the recorded one of ``size_px``.

    The straight image shows the same part of the image plane; sizes are widths and heights. Both are counted as
    arrays are, from 0; ``distort`` takes (..., 2) ideal pixels to recorded ones, from ``FIRST_PIXEL``.
    """
    (width, height), (w, h) = size_px, out_px
    x = (np.arange(w) + 0.5) * width / w - 0.5
    y = (np.arange(h) + 0.5) * height / h - 0.5
    ideal = np.stack(np.meshgrid(x, y), axis=-1) + FIRST_PIXEL
    return (distort(ideal) - FIRST_PIXEL).astype(np.float32)


def straightened(picture: Picture, where: NDArray[np.float32]) -> Picture:
    """An (H, W, 3) image as a pinhole would have taken it, by the (h, w, 2) of ``straightening``; black beside it."""
    import cv2  # 0.1 s, for videos through a lens alone

    return np.asarray(cv2.remap(picture, where[..., 0], where[..., 1], cv2.INTER_LINEAR), dtype=np.uint8)


def _opened(path: Path) -> Any:
    library = pyav()
    try:
        container = library.open(str(path))
    except (library.error.FFmpegError, OSError) as error:
        raise FormatError(f"{path}: not a movie or image that can be read ({error}): convert it to mp4") from None
    if not container.streams.video:
        container.close()
        raise FormatError(
            f"{path}: contains no images, only {', '.join(s.type for s in container.streams) or 'nothing'}"
        )
    return container


class FilmError(MocapError):
    """Videos cannot be read or written here."""

    page = "installing"


def pyav() -> ModuleType:
    """The library, imported when a video is first asked for.

    Raises:
        FilmError: it is not installed.
    """
    try:
        import av
        import av.error
    except ImportError:
        raise FilmError(
            f"videos need PyAV, which is not installed: run {installing('film')}, or leave the videos out"
        ) from None
    return av
