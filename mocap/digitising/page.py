"""The page to click in: films side by side, on 127.0.0.1 only; every click is saved before it is answered."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
from starlette.applications import Starlette

from eal.arrays import Array
from mocap.cameras.camera import Camera, stacked, undistorted
from mocap.digitising.clicks import Click, read_clicks, read_unseen, write_clicks, write_unseen
from mocap.digitising.digitised import Digitised, cameras_of, check_clicks, digitise, open_with_crops
from mocap.digitising.films import Films
from mocap.digitising.overlays import (
    ClickAt,
    ExchangeOf,
    RangeOf,
    ShownAt,
    ellipses,
    epipolar_lines,
    listed,
    picture_route,
    scene_routes,
    shell,
)
from mocap.errors import MocapError
from mocap.io.output import result_folder
from mocap.skeleton import Skeleton, read_skeleton
from mocap.web import Nothing, Query, below, changes, page, reads

SAVED = "saved_clicks_xypts.csv"
"""The clicks, after each of them; DLTdv reads it, and ``start`` takes it."""
UNSEEN = "saved_not_seen.csv"
"""Where markers are not to be seen, beside it."""


@dataclass(eq=False)
class Session:
    """What the page works on.

    Attributes:
        films: Opened films.
        cameras: Their cameras.
        skeleton: The animal.
        fps: Frames a second.
        track: Digitises with the clicks that there are.
        folder: Where clicks are saved.
        clicks: All clicks so far.
        steps: How many clicks each step of this session made, which ``undo`` takes back together.
        found: What was digitised; None: nothing yet.
    """

    films: Films
    cameras: Sequence[Camera]
    skeleton: Skeleton
    fps: float
    track: Callable[[list[Click]], Digitised]
    folder: Path
    clicks: list[Click] = field(default_factory=list)
    steps: list[int] = field(default_factory=list)
    found: Digitised | None = None

    def info(self) -> dict[str, Any]:
        """What does not change."""
        return {
            "names": list(self.skeleton.markers),
            "cameras": [camera.name for camera in self.cameras],
            "sizes": [list(movie.size_px) for movie in self.films.movies],
            "n_frames": self.films.n_frames,
            "frame": self.clicks[0].frame if self.clicks else 0,
        }

    def save(self) -> None:
        """Write all clicks in DLTdv's format; the earlier file or the new one is there, whatever happens."""
        with result_folder(self.folder, "clicks", replace=True, beside=True) as draft:
            write_clicks(
                draft / SAVED,
                self.clicks,
                names=self.skeleton.markers,
                cameras=[camera.name for camera in self.cameras],
                n_frames=self.films.n_frames,
                fps=self.fps,
            )
            write_unseen(draft / UNSEEN, self.clicks)

    def click(self, *clicks: Click, within: bool = False) -> str:
        """Take clicks; they are on the disk before anything is named again."""
        if not clicks:
            return "there is nothing to change"
        self.clicks += clicks
        self.steps.append(len(clicks))
        self.save()
        if self.found is None:
            return f"{len(self.clicks)} clicks"
        first, last = self.found.click(clicks, within=within) or (clicks[0].frame, clicks[-1].frame)
        return f"{len(self.clicks)} clicks; frames {first + 1} to {last + 1} were named again"

    def swap(self, a: int, b: int, first: int, last: int) -> str:
        """Exchange the names of two markers in a range of frames."""
        names = self.skeleton.markers
        return self.click(*self._tracked().swapped(names[a], names[b], first, last), within=True)

    def delete(self, marker: int, first: int, last: int) -> str:
        """A marker is not to be seen in a range of frames."""
        return self.click(*self._tracked().deleted(self.skeleton.markers[marker], first, last), within=True)

    def _tracked(self) -> Digitised:
        if self.found is None:
            raise MocapError("nothing is named yet: find and name first (Enter)")
        return self.found

    def undo(self) -> str:
        """Take the last step back."""
        if not self.clicks:
            return "there is no click to take back"
        count = self.steps.pop() if self.steps else 1
        del self.clicks[-count:]
        self.save()
        if self.found is not None and self.found.engine.clicks:
            self.found.undo(count)
        return f"{len(self.clicks)} clicks"

    def run(self) -> str:
        """Digitise with the clicks that there are."""
        self.found = self.track(list(self.clicks))
        share = float((self.found.sd_px <= self.found.error_px).mean())
        return f"{100 * share:.1f} % of all positions are known to {self.found.error_px:g} px"

    def scene(self) -> bytes:
        """The positions that were found, as a recording of rerun."""
        from mocap.rerun.points import write_points

        with TemporaryDirectory() as place:
            path = Path(place) / "points.rrd"
            write_points(self._tracked().points, self.cameras, self.skeleton, path)
            return path.read_bytes()

    def frame(self, frame: int, marker: int) -> dict[str, Any]:
        """What is drawn over the pictures of a frame."""
        n_cameras, n_markers = len(self.cameras), len(self.skeleton.markers)
        clicked = np.full((n_cameras, n_markers, 2), np.nan)
        for click in self.clicks:
            if click.frame == frame:
                clicked[click.camera, click.marker] = np.nan if click.uv_px is None else click.uv_px
        dots, shapes = np.full_like(clicked, np.nan), np.full((n_cameras, n_markers, 5), np.nan)
        if self.found is not None:
            tracks = self.found.engine.tracks
            chosen, all_dots = tracks.dot[:, frame], tracks.dots[frame]
            if all_dots.shape[1]:
                picked = all_dots[np.arange(n_cameras)[:, None], np.maximum(chosen, 0), :2]
                dots = np.where((chosen >= 0)[..., None], picked, np.nan)
            around = tracks.xyz_m[frame], tracks.cov_m2[frame]
            shapes = ellipses(stacked(self.cameras), *around, self._as_filmed)
        lines = self._lines(clicked[:, marker])
        return {
            "cameras": [
                {
                    "markers": [
                        {
                            "click": listed(clicked[c, m]),
                            "dot": listed(dots[c, m]),
                            "ellipse": listed(shapes[c, m]),
                        }
                        for m in range(n_markers)
                    ],
                    "lines": lines[c],
                }
                for c in range(n_cameras)
            ]
        }

    def _as_filmed(self, camera: int, uv_px: Array) -> Array:
        lens = self.cameras[camera].lens
        return uv_px if lens is None else lens.distort(uv_px)

    def _lines(self, clicked: Array) -> list[list[list[list[float]]]]:
        """For each camera the epipolar lines of a marker's clicks in the others."""
        ideal = undistorted(self.cameras, clicked[:, None])[:, 0]
        sizes = [movie.size_px for movie in self.films.movies]
        return epipolar_lines(stacked(self.cameras), ideal, sizes, self._as_filmed)

    def question(self, after: int) -> dict[str, Any]:
        """The next click that is asked for."""
        asked = [] if self.found is None else self.found.questions(after + 1)
        if not asked:
            return {}
        q = asked[min(after, len(asked) - 1)]
        return {"camera": q.camera, "frame": q.frame, "marker": q.marker, "uv_px": list(q.uv_px)}


def open_session(
    films: Sequence[Path],
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
) -> Session:
    """A session on films; it goes on with the clicks of ``start``, or else with those saved in ``folder``.

    Arguments as of ``mocap.digitise``.

    Raises:
        MocapError: the films do not fit the calibration, a file cannot be read, or clicks saved in ``folder`` would be
            replaced by those of ``start``.
    """
    opened, cameras = open_with_crops(films, cameras_of(calibration, profile), crop, offset_frames)
    known = read_skeleton(skeleton)
    saved = folder / SAVED
    if start is not None and saved.is_file() and not saved.samefile(start):
        raise MocapError(
            f"{saved} holds clicks that were made earlier, and clicks after those of {start.name} would replace them: "
            "leave `start` out to go on with them, or give another folder"
        )
    earlier = start or (saved if saved.is_file() else None)
    clicks = [] if earlier is None else read_clicks(earlier, known, n_cameras=len(cameras), n_frames=opened.n_frames)
    if earlier is not None and (unseen := earlier.parent / UNSEEN).is_file():
        clicks += read_unseen(unseen)
        check_clicks(clicks, (len(cameras), opened.n_frames, len(known.markers)), empty=True)
    rate = fps or opened.movies[0].fps
    if rate is None:
        raise MocapError("the frame rate is in no film: give `fps`")

    def track(given: list[Click]) -> Digitised:
        return digitise(
            list(films),
            calibration=calibration,
            skeleton=known,
            start=given,
            model=model,
            profile=profile,
            fps=rate,
            offset_frames=offset_frames,
            crop=crop,
            error_px=error_px,
        )

    return Session(
        films=opened, cameras=cameras, skeleton=known, fps=float(rate), track=track, folder=folder, clicks=clicks
    )


class _After(Query):
    after: Annotated[int, below("places")]


def digitise_page(session: Session) -> Starlette:
    """The page of a session, for ``mocap.web.served``."""
    shape = (len(session.cameras), session.films.n_frames, len(session.skeleton.markers))
    limits = {
        **dict(zip(("cameras", "frames", "markers"), shape, strict=True)),
        "places": prod(shape),
        "sizes": [movie.size_px for movie in session.films.movies],
    }

    return page(
        [
            shell("mocap.digitising", "page.html"),
            reads("/info", Nothing, lambda _: session.info()),
            reads("/frame", ShownAt, lambda at: session.frame(at.frame, at.marker)),
            reads("/question", _After, lambda given: session.question(given.after)),
            picture_route(session.films.picture),
            *scene_routes(session.scene),
            changes("/click", ClickAt, lambda given: session.click(Click(**dict(given)))),
            changes("/swap", ExchangeOf, lambda at: session.swap(at.marker, at.other, at.first, at.last)),
            changes("/delete", RangeOf, lambda at: session.delete(at.marker, at.first, at.last)),
            changes("/undo", Nothing, lambda _: session.undo()),
            changes("/track", Nothing, lambda _: session.run()),
        ],
        limits=limits,
    )
