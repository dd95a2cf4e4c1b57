"""Digitise videos: from a few clicks to named pixels and positions with intervals."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, check_cameras
from mocap.digitising.asking import Question, pixel_sd, questions
from mocap.digitising.clicks import Click, places, read_clicks
from mocap.digitising.engine import Engine, Progress
from mocap.digitising.pose import PoseGaussian, fit_poses
from mocap.digitising.videos import Videos, check_order, open_videos, open_windows
from mocap.digitising.write import Report, named_pixels, report_of, write_digitised
from mocap.errors import FormatError, MocapError
from mocap.filters.model import LearnedModel
from mocap.io.crop import crops_of
from mocap.io.output import result_folder
from mocap.io.profile import with_profile
from mocap.io.registry import as_table, read
from mocap.records import MarkerTracks, PixelTracks, Status
from mocap.skeleton import Skeleton
from mocap.skeleton_files import read_skeleton
from mocap.tracking.learning import Model, load_model

PathText = str | PathLike[str]


@dataclass(eq=False)
class Digitised:
    """Videos that were digitised; ``click`` goes on.

    Attributes:
        engine: Dots, names, positions and clicks.
        fps: Frames a second.
        error_px: Standard deviation in pixels above which clicks are asked for.
    """

    engine: Engine
    fps: float
    error_px: float

    def __repr__(self) -> str:
        """One line."""
        seen = self.pixels.seen
        cameras, frames, markers = seen.shape
        return f"<Digitised {frames} frames, {cameras} cameras, {markers} markers: {seen.mean():.1%} clicked or named>"

    @property
    def pixels(self) -> PixelTracks:
        """What was clicked or found and named; NaN where the marker is not seen, or not surely."""
        return named_pixels(self.engine, self.fps)

    @property
    def points(self) -> MarkerTracks:
        """Positions of all markers with covariance; ``smoothed`` where fewer than two cameras show the marker."""
        tracks = self.engine.tracks
        finite = np.isfinite(tracks.xyz_m[..., 0])
        status = np.where(tracks.rays >= 2, Status.MEASURED, np.where(finite, Status.SMOOTHED, Status.MISSING))
        t_s = np.arange(len(finite)) / self.fps
        return MarkerTracks(names=self.engine.names, t_s=t_s, xyz_m=tracks.xyz_m, cov_m2=tracks.cov_m2, status=status)

    @property
    def report(self) -> Report:
        """What was found, as numbers."""
        return report_of(self.engine, self.error_px)

    @property
    def sd_px(self) -> Array:
        """(T, M) standard deviation of each marker in the image that knows it least."""
        return pixel_sd(self.engine)

    def questions(self, most: int = 40) -> list[Question]:
        """The next clicks to make, the most useful first."""
        return questions(self.engine, error_px=self.error_px, most=most)

    def click(self, clicks: Sequence[Click], *, within: bool = False) -> tuple[int, int] | None:
        """Take clicks, also corrections; only the frames about them are named again, and are returned (from 0).

        ``within``: only the frames of the clicks, from the first to the last; the names of others stay as they are.
        """
        if not clicks:
            return None
        return self.engine.rerun(clicks, within=within)

    def undo(self, count: int = 1) -> list[Click]:
        """Take the last clicks back."""
        return self.engine.undo(count)

    def swapped(self, a: str, b: str, first: int, last: int) -> list[Click]:
        """Clicks that exchange the names of two markers in all videos, from frame ``first`` to ``last`` (from 0).

        Give them to ``click(..., within=True)``: what was named ``a`` is ``b`` then, and the other way round, as if
        clicked by hand.

        Raises:
            MocapError: there are no such markers or frames.
        """
        pair = [self._marker(a), self._marker(b)]
        uv_px = self.pixels.uv_px
        return [
            Click(camera=camera, frame=frame, marker=marker, uv_px=None if np.isnan(u) else (float(u), float(v)))
            for frame in self._range(first, last)
            for camera in range(len(uv_px))
            for marker, (u, v) in zip(pair, uv_px[camera, frame, pair[::-1]], strict=True)
            if np.isfinite(uv_px[camera, frame, pair, 0]).any()
        ]

    def deleted(self, marker: str, first: int, last: int, *, camera: int | None = None) -> list[Click]:
        """Clicks that say of a range of frames that a marker is not to be seen; ``camera`` None: in no video.

        Raises:
            MocapError: there are no such marker or frames.
        """
        which = range(len(self.engine.cameras)) if camera is None else (camera,)
        m = self._marker(marker)
        return [Click(camera=c, frame=t, marker=m, uv_px=None) for t in self._range(first, last) for c in which]

    def _marker(self, name: str) -> int:
        if name not in self.engine.names:
            raise MocapError(f"there is no marker {name!r}: the skeleton has {', '.join(self.engine.names)}")
        return self.engine.names.index(name)

    def _range(self, first: int, last: int) -> range:
        n = self.engine.videos.n_frames
        if not 0 <= first <= last < n:
            raise MocapError(f"frames {first + 1} to {last + 1} are not a range of the videos' {n} frames")
        return range(first, last + 1)

    def ask(self, answer: Callable[[Question], tuple[float, float] | None], *, budget: int) -> int:
        """Ask for clicks until all is known well enough, or the budget is used up; how many were made.

        Args:
            answer: Place as recorded (the first pixel at (1, 1)), or None where the marker cannot be seen.
            budget: Greatest number of clicks.
        """
        for made in range(budget):
            todo = self.questions(1)
            if not todo:
                return made
            question = todo[0]
            place = answer(question)
            self.click([Click(camera=question.camera, frame=question.frame, marker=question.marker, uv_px=place)])
        return budget

    def save(self, folder: PathText, *, overwrite: bool = False) -> None:
        """Write tables in DLTdv's format, the calibration, the clicks, what is asked next, and a report.

        Raises:
            OutputError: it cannot be written there.
        """
        with result_folder(Path(folder), "digitise", replace=overwrite) as draft:
            self.write(draft)

    def write(self, folder: Path, *, most: int = 40) -> None:
        """Write the files of ``save`` into a folder that ``mocap.io.output.result_folder`` gives."""
        write_digitised(folder, self.engine, self.pixels, self.points, self.report, self.questions(most))


def digitise(
    videos: PathText | Sequence[PathText],
    *,
    calibration: PathText,
    skeleton: PathText | Skeleton,
    start: PathText | Sequence[Click],
    model: PathText | Model | None = None,
    profile: PathText | None = None,
    fps: float | None = None,
    offset_frames: Sequence[int] | None = None,
    crop: PathText | Sequence[PathText] | None = None,
    error_px: float = 1.0,
    progress: Progress = lambda _stage, _share: None,
) -> Digitised:
    """Find and name markers in the videos of calibrated cameras.

    In each frame a filter predicts where every marker is, with its covariance; dots are looked for in these windows of
    all images, and are named together: by the predicted covariance, by rays that meet, by the lengths of the bones,
    and by the pose. A second pass backward decides what a crossing left open. What is not sure is left unnamed, and the
    next click that removes most variance can be asked for (``questions``, ``ask``).

    Args:
        videos: A video or folder of images for each camera, in the order of the cameras; or a folder of them.
        calibration: Cameras, in any format that mocap knows; pixels count rows from the upper left corner.
        skeleton: Skeleton TOML, or a skeleton: markers, rigid bones, trunk.
        start: First clicks: a file of pixels (DLTdv's xypts, ...) or clicks; each marker in two cameras in one frame.
        model: A file of ``mocap learn``, or a model: poses of other recordings tell where hidden markers are.
        profile: Camera profile with the lenses.
        fps: Frames a second; None: as the first video says.
        offset_frames: Frame of each video minus frame of the tracks.
        crop: Crop offsets (files, or a folder of them) of videos that are windows of the calibrated images; clicks
            and results then count in the windows, and the calibration that is written is theirs.
        error_px: Clicks are asked for where a marker is known worse than that, in pixels.
        progress: Called with a stage and the share of it that is done.

    Raises:
        MocapError: the videos do not fit the calibration (number, size, order), or there are no clicks to begin with.
        FormatError: a file cannot be read.
        SkeletonError: the skeleton cannot be read.
    """
    cameras = cameras_of(Path(calibration), None if profile is None else Path(profile))
    given = [videos] if isinstance(videos, (str, PathLike)) else list(videos)
    opened, cameras = open_with_crops([Path(video) for video in given], cameras, crop, offset_frames)
    animal = skeleton if isinstance(skeleton, Skeleton) else read_skeleton(Path(skeleton))
    if isinstance(start, (str, PathLike)):
        clicks = read_clicks(Path(start), animal, n_cameras=len(cameras), n_frames=opened.n_frames)
    else:
        clicks = list(start)
    shape = (len(cameras), opened.n_frames, len(animal.markers))
    check_clicks(clicks, shape)
    frames = sorted({click.frame for click in clicks})
    table = places(clicks, shape)[:, frames]
    check_order(cameras, table.reshape(len(cameras), -1, 2), opened.movies)
    poses = None if model is None else poses_of_model(model, animal)
    engine = Engine(videos=opened, cameras=cameras, skeleton=animal, poses=poses, clicks=clicks)
    engine.decode(progress=progress)
    rate = fps or opened.movies[0].fps
    if rate is None:
        raise MocapError("the frame rate is in no video: give `fps`")
    return Digitised(engine, float(rate), error_px)


def open_with_crops(
    videos: Sequence[Path],
    cameras: Sequence[Camera],
    crop: PathText | Sequence[PathText] | None,
    offset_frames: Sequence[int] | None,
) -> tuple[Videos, tuple[Camera, ...]]:
    """Videos, and the cameras of their images: those given, or of windows of their images. As ``digitise``."""
    if not crop:
        return open_videos(videos, cameras, offset_frames=offset_frames), tuple(cameras)
    files = [crop] if isinstance(crop, (str, PathLike)) else crop
    return open_windows(videos, cameras, crops_of([Path(file) for file in files]), offset_frames=offset_frames)


def check_clicks(clicks: Sequence[Click], shape: tuple[int, int, int], *, empty: bool = False) -> None:
    """Refuse clicks outside of cameras, frames and markers; ``empty``: there may be none.

    Raises:
        MocapError: one is, or there are none.
    """
    if not clicks and not empty:
        raise MocapError("`start`: there are no clicks: click each marker in two or more videos of one frame")
    for click in clicks:
        place = (click.camera, click.frame, click.marker)
        if not all(0 <= i < n for i, n in zip(place, shape, strict=True)):
            raise MocapError(
                f"`start`: a click in camera {click.camera + 1}, frame {click.frame + 1}, marker {click.marker + 1}, "
                f"but there are {shape[0]} cameras, {shape[1]} frames and {shape[2]} markers"
            )


def cameras_of(calibration: Path, profile: Path | None) -> tuple[Camera, ...]:
    """Cameras of a calibration in any format.

    Raises:
        FormatError: it holds none.
        CalibrationError: they are impossible.
    """
    contents = read(calibration)
    if not contents.cameras:
        raise FormatError(f"{calibration.name}: contains no cameras ({contents.format}): give a calibration")
    cameras = contents.cameras
    check_cameras(cameras, calibration.name)
    if profile is not None:
        with as_table(profile) as (table, _):
            cameras = with_profile(cameras, table)
    return tuple(cameras)


def poses_of_model(model: PathText | Model, skeleton: Skeleton) -> PoseGaussian | None:
    """The poses of the trials of a learned model, for the markers of a skeleton.

    Raises:
        MocapError: the model lacks a marker.
    """
    learned: LearnedModel = (model if isinstance(model, Model) else load_model(model)).learned
    missing = [name for name in skeleton.markers if name not in learned.names]
    if missing:
        raise MocapError(
            f"`model`: it does not know {', '.join(missing[:6])}: name markers alike in model and skeleton, or leave "
            "the model out"
        )
    index = [learned.names.index(name) for name in skeleton.markers]
    xyz = np.concatenate([trial.xyz_m[:, index] for trial in learned.trials])
    trunk = [skeleton.markers.index(name) for name in (skeleton.trunk or learned.trunk) if name in skeleton.markers]
    return fit_poses(xyz, trunk)
