"""Videos in which a person clicks and the program finds and names the rest; a click is stored before its answer."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, stacked, undistorted
from mocap.desk.pictures import drawn, ellipses, epipolar_lines, listed, moving_box, snapped
from mocap.desk.places import Place
from mocap.digitising.clicks import Click, read_clicks, read_unseen, write_clicks, write_unseen
from mocap.digitising.digitised import Digitised, cameras_of, check_clicks, digitise, open_with_crops
from mocap.digitising.videos import Videos
from mocap.errors import MocapError
from mocap.io.output import result_folder
from mocap.skeleton import Skeleton, read_skeleton

SAVED = "saved_clicks_xypts.csv"
"""The clicks, after each of them; DLTdv reads it, and ``start`` takes it."""
UNSEEN = "saved_not_seen.csv"
"""Where markers are not to be seen, beside it."""
WHAT_TO_DO = "click each marker in two cameras of a frame, then find and name the rest (Enter)"


@dataclass(eq=False, kw_only=True)
class Session:
    """What the desk's room of videos works on where ``mocap digitise`` opened it.

    Attributes:
        videos: Opened videos.
        cameras: Their cameras.
        skeleton: The animal.
        fps: Frames a second.
        track: Digitises with the clicks that there are.
        folder: Where clicks are saved.
        command: That does the same with the clicks that are saved.
        clicks: All clicks so far.
        steps: How many clicks each step of this session made, which ``undo`` takes back together.
        pending: What was not named yet: clicks, and the frames that are meant (False: those about them, too), or how
            many were taken back.
        found: What was digitised; None: nothing yet.
        changes: How often the clicks were changed since this was opened.
    """

    videos: Videos
    cameras: Sequence[Camera]
    skeleton: Skeleton
    fps: float
    track: Callable[[list[Click]], Digitised]
    folder: Path
    command: str = ""
    clicks: list[Click] = field(default_factory=list)
    steps: list[int] = field(default_factory=list)
    pending: list[Callable[[], Any]] = field(default_factory=list)
    found: Digitised | None = None
    changes: int = 0

    @property
    def name(self) -> str:
        """What pages call it."""
        return self.folder.name

    def info(self) -> dict[str, Any]:
        """What does not change."""
        first, n = self.clicks[0].frame if self.clicks else 0, self.videos.n_frames
        others = [(first + n // 3) % n, (first + 2 * n // 3) % n]
        return {
            "trial": self.name,
            "names": list(self.skeleton.markers),
            "cameras": [camera.name for camera in self.cameras],
            "sizes": [list(movie.size_px) for movie in self.videos.movies],
            "films": True,
            "n_frames": self.videos.n_frames,
            "frame": first,
            "moves": [moving_box([self.picture(c, at) for at in (first, *others)]) for c in range(len(self.cameras))],
            "digitise": True,
            "commands": {"proof": self.command},
        }

    def _keep(self, clicks: list[Click]) -> str:
        """Write all clicks in DLTdv's format, and then go on with them.

        The earlier file or the new one is there, whatever happens; what cannot be written is not gone on with.
        """
        with result_folder(self.folder, "clicks", replace=True, beside=True) as draft:
            write_clicks(
                draft / SAVED,
                clicks,
                names=self.skeleton.markers,
                cameras=[camera.name for camera in self.cameras],
                n_frames=self.videos.n_frames,
                fps=self.fps,
            )
            write_unseen(draft / UNSEEN, clicks)
        self.clicks[:] = clicks
        self.changes += 1
        return f"{len(clicks)} click{'s' * (len(clicks) != 1)}"

    def click(self, *clicks: Click, within: bool = False) -> str:
        """Take clicks; they are on the disk when this returns. ``settle`` names again what they change."""
        if not clicks:
            return "there is nothing to change"
        said = self._keep([*self.clicks, *clicks])
        self.steps.append(len(clicks))
        if self.found is not None:
            found = self.found
            self.pending.append(lambda: found.click(clicks, within=within))
        return said

    def place(self, *, snap: bool = False, **where: Any) -> str:
        """One click, on request where the image shows a dot beside it."""
        click = Click(**where)
        if not snap or click.uv_px is None or (image := self.picture(click.camera, click.frame)) is None:
            return self.click(click)
        return self.click(replace(click, uv_px=snapped(image, click.uv_px)))

    def exchange(self, marker: int, other: int, first: int, last: int) -> str:
        """Exchange the names of two markers in a range of frames."""
        names = self.skeleton.markers
        return self.click(*self._tracked().swapped(names[marker], names[other], first, last), within=True)

    def delete(self, marker: int, first: int, last: int) -> str:
        """A marker is not to be seen in a range of frames."""
        return self.click(*self._tracked().deleted(self.skeleton.markers[marker], first, last), within=True)

    def _tracked(self) -> Digitised:
        if self.found is None:
            raise MocapError("nothing is named yet: find and name first (Enter)")
        self.settle()
        return self.found

    def undo(self) -> str:
        """Take the last step back."""
        if not self.clicks:
            return "there is no click to take back"
        count = self.steps[-1] if self.steps else 1
        said = self._keep(self.clicks[:-count])
        del self.steps[-1:]
        found = self.found
        if found is not None and (self.pending or found.engine.clicks):
            self.pending.append(lambda: found.undo(count) and None)
        return said

    def settle(self) -> str:
        """Name again what the clicks change that were made or taken back since this was called last."""
        message = "nothing to name again" if self.found else WHAT_TO_DO
        while self.pending:
            span = self.pending.pop(0)()
            message = f"frames {span[0] + 1} to {span[1] + 1} were named again" if span else "named as before"
        return message

    def run(self) -> str:
        """Digitise with the clicks that there are."""
        self.found = self.track(list(self.clicks))
        self.pending.clear()
        share = float((self.found.sd_px <= self.found.error_px).mean())
        return f"{100 * share:.1f} % of all positions are known to {self.found.error_px:g} px"

    def scene(self) -> bytes:
        """The positions that were found, as a recording of rerun."""
        from mocap.rerun.record import write_points

        with TemporaryDirectory() as place:
            path = Path(place) / "points.rrd"
            write_points(self._tracked().points, self.cameras, self.skeleton, path)
            return path.read_bytes()

    def frame(self, frame: int, marker: int) -> dict[str, Any]:
        """What is drawn over the images of a frame, and what is known of the marker there."""
        shape, matrices = (len(self.cameras), len(self.skeleton.markers)), stacked(self.cameras)
        clicked, dots, shapes = np.full((*shape, 2), np.nan), np.full((*shape, 2), np.nan), np.full((*shape, 5), np.nan)
        for click in self.clicks:
            if click.frame == frame:
                clicked[click.camera, click.marker] = np.nan if click.uv_px is None else click.uv_px
        sd_mm = None
        if self.found is not None:
            tracks = self.found.engine.tracks
            chosen, all_dots = tracks.dot[:, frame], tracks.dots[frame]
            if all_dots.shape[1]:
                picked = all_dots[np.arange(shape[0])[:, None], np.maximum(chosen, 0), :2]
                dots = np.where((chosen >= 0)[..., None], picked, np.nan)
            shapes = ellipses(matrices, tracks.xyz_m[frame], tracks.cov_m2[frame], self._as_filmed)
            sd_mm = listed(1e3 * np.sqrt(np.trace(tracks.cov_m2[frame, [marker]], axis1=1, axis2=2) / 3))
        ideal = undistorted(self.cameras, clicked[:, [marker]])[:, 0]
        lines = epipolar_lines(matrices, ideal, [movie.size_px for movie in self.videos.movies], self._as_filmed)
        n_clicks, n_dots = (int(np.isfinite(places[:, marker, 0]).sum()) for places in (clicked, dots))
        return {
            "status": f"clicked in {n_clicks}, found in {n_dots} of {len(self.cameras)}",
            "sd_mm": sd_mm,
            "cameras": drawn({"click": clicked, "dot": dots, "ellipse": shapes}, lines),
        }

    def _as_filmed(self, camera: int, uv_px: Array) -> Array:
        lens = self.cameras[camera].lens
        return uv_px if lens is None else lens.distort(uv_px)

    def picture(self, camera: int, frame: int) -> Any:
        """A camera's image in a frame; None: there is none."""
        return self.videos.picture(camera, frame)

    def places(self) -> list[Place]:
        """Clicks that are asked for, the most useful first."""
        if self.found is None:
            return []
        cov_m2 = self.found.engine.tracks.cov_m2
        return [
            Place(
                frame=question.frame,
                marker=question.marker,
                first=question.frame,
                last=question.frame,
                worth_m2=float(np.trace(cov_m2[question.frame, question.marker])),
                why=f"click it in {self.cameras[question.camera].name}",
                camera=question.camera,
            )
            for question in self.found.questions()
        ]


def open_session(
    videos: Sequence[Path],
    *,
    calibration: Path,
    skeleton: Path,
    folder: Path,
    start: Path | None = None,
    model: Path | None = None,
    profile: Path | None = None,
    fps: float | None = None,
    offset_frames: Sequence[int] | None = None,
    crop: Sequence[Path] | None = None,
    error_px: float = 1.0,
    command: str = "",
) -> Session:
    """A session on videos; it goes on with the clicks of ``start``, or else with those saved in ``folder``.

    Arguments as of ``mocap.digitise``; ``command`` as of ``Session``.

    Raises:
        MocapError: the videos do not fit the calibration, a file cannot be read, or clicks saved in ``folder`` would be
            replaced by those of ``start``.
    """
    opened, cameras = open_with_crops(videos, cameras_of(calibration, profile), crop, offset_frames)
    animal = read_skeleton(skeleton)
    saved = folder / SAVED
    if start is not None and saved.is_file() and not saved.samefile(start):
        raise MocapError(
            f"{saved} holds clicks that were made earlier, and clicks after those of {start.name} would replace them: "
            "leave `start` out to go on with them, or give another folder"
        )
    earlier = start or (saved if saved.is_file() else None)
    clicks = [] if earlier is None else read_clicks(earlier, animal, n_cameras=len(cameras), n_frames=opened.n_frames)
    if earlier is not None and (unseen := earlier.parent / UNSEEN).is_file():
        clicks += read_unseen(unseen)
        check_clicks(clicks, (len(cameras), opened.n_frames, len(animal.markers)), empty=True)
    rate = fps or opened.movies[0].fps
    if rate is None:
        raise MocapError("the frame rate is in no video: give `fps`")

    def track(given: list[Click]) -> Digitised:
        return digitise(
            list(videos),
            calibration=calibration,
            skeleton=animal,
            start=given,
            model=model,
            profile=profile,
            fps=rate,
            offset_frames=offset_frames,
            crop=crop,
            error_px=error_px,
        )

    return Session(
        videos=opened,
        cameras=cameras,
        skeleton=animal,
        fps=float(rate),
        track=track,
        folder=folder,
        command=command,
        clicks=clicks,
    )
