"""Movies that belong to a recording: which is of which camera, and which of their frames belong to which of its."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera
from mocap.errors import MocapError
from mocap.io.dvproject import read_project
from mocap.io.format import Hints
from mocap.io.movies import PICTURES, Movie, by_number, open_movie
from mocap.io.registry import by_name, read_as
from mocap.pipeline.recording import Footage, Recording


def open_movies(given: Sequence[Path]) -> tuple[Movie, ...]:
    """The movies of all cameras, in their order.

    Args:
        given: A movie or a folder of pictures a camera; or one folder that holds just these, sorted by their names,
            numbers by their value.

    Raises:
        MocapError: one of them is no movie.
    """
    if len(given) == 1 and given[0].is_dir():
        inside = sorted((p for p in given[0].iterdir() if not p.name.startswith(".")), key=by_number)
        movies = [p for p in inside if p.is_dir() or p.suffix.lower() not in PICTURES]
        given = movies or given
    return tuple(open_movie(path) for path in given)


def with_footage(
    run: Recording, movies: Sequence[Movie], *, offsets: tuple[Array, str], straight: bool = False
) -> Recording:
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
        Footage(movie=movie, frames=np.arange(n_frames) + shifts[:, c], straight=straight or camera.lens is None)
        for c, (camera, movie) in enumerate(zip(cameras, movies, strict=True))
    )
    sized = tuple(_with_size(camera, f.movie) for camera, f in zip(cameras, footage, strict=True))
    lines = [_sentence(camera, f, source) for camera, f in zip(cameras, footage, strict=True)]
    text = "\n".join([run.report_text.rstrip(), "", "## Video", "", *(f"- {line}" for line in lines), ""])
    return replace(run, cameras=sized, footage=footage, report={**run.report, "video": lines}, report_text=text)


def _with_size(camera: Camera, movie: Movie) -> Camera:
    """The camera with the size of its movie's pictures."""
    if camera.size_px is not None and tuple(camera.size_px) != movie.size_px:
        raise MocapError(
            f"`video`: {movie.path.name} is {movie.size_px[0]} x {movie.size_px[1]}, but camera {camera.name} is "
            f"{camera.size_px[0]} x {camera.size_px[1]}: give the movies in the order of the cameras, uncropped"
        )
    return replace(camera, size_px=movie.size_px)


def _sentence(camera: Camera, footage: Footage, source: str) -> str:
    """What the report says of one movie."""
    offsets = np.unique(footage.frames - np.arange(len(footage.frames)))
    how = f"{offsets[0]:+d}" if len(offsets) == 1 else f"{offsets[0]:+d} to {offsets[-1]:+d}"
    there = int(footage.there.sum())
    missing = "" if there == len(footage.frames) else f"; {len(footage.frames) - there} frames have no picture"
    lens = "" if camera.lens is None else " taken as free of distortion" if footage.straight else " straightened"
    return (
        f"{camera.name}: {footage.movie.path.name}{lens}, {footage.movie.n_frames} frames, frame of the movie = "
        f"frame of the tracks {how} ({source}){missing}"
    )


def offsets_of(tracks: Path | None, stated: Sequence[int] | None) -> tuple[Array, str]:
    """Frames of the movies minus frames of the tracks, and where that is known from.

    Args:
        tracks: xypts file or project; None: not known.
        stated: By the user; None: what the project says, or the file ``*offsets.csv`` beside an xypts file, or 0.

    Returns:
        (T or 1, C or 1) offsets.

    Raises:
        MocapError: that file cannot be read.
    """
    if stated:
        return np.array([stated], dtype=np.float64), "as stated"
    if tracks is None:
        return np.zeros((1, 1)), "not stated"
    if tracks.suffix.lower() == ".mat":
        return read_project(tracks, fps=1.0).offset_frames, "from the project"
    beside = tracks.with_name(tracks.name.replace("xypts", "offsets"))
    if beside != tracks and beside.is_file():
        return read_as(by_name("dltdv-offsets"), beside, Hints()).tables["offset_frames"], f"from {beside.name}"
    return np.zeros((1, 1)), "not stated"
