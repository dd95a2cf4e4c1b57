"""A recording that is watched while it is filtered: the filter never waits for the viewer."""

import os
import queue
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mocap.filters.live import LiveEstimate, live
from mocap.filters.motion.base import MotionModel
from mocap.recording import Recording
from mocap.rerun import palette, paths
from mocap.rerun.blueprint import screen, series_view
from mocap.rerun.columns import FRAME, TIME, Single, segments, single
from mocap.rerun.log_markers import ellipsoids, log_looks, log_world
from mocap.rerun.record import APPLICATION
from mocap.rerun.scene import Scene, make_scene
from mocap.rerun.scene_views import eye, world_view
from mocap.rerun.viewer import Viewer, has_display, open_viewer
from mocap.sides import side_of
from mocap.skeleton import Skeleton
from mocap.tracking.tracking import observations

LIVE = "mocap-live"
WAITING = 256
"""Frames that wait for the viewer at most; what comes while so many wait is dropped."""
_PATIENCE_S = 5.0  # for a viewer that is busy; chosen


class LiveView:
    """A stream of frames; a context manager that ends it.

    Frames are put into a queue. A thread of its own takes all that wait, some twenty times a second, and sends them as
    columns: a frame costs the filter a tenth of a millisecond.

    Attributes:
        shown: Frames that were sent.
        dropped: Frames that came while the queue was full.
        trouble: What ended the stream before its time; empty if nothing did.
    """

    def __init__(
        self, rec: rr.RecordingStream, scene: Scene, *, names: Sequence[str], skeleton: Skeleton, first: int = 0
    ) -> None:
        """Log what does not move.

        Args:
            rec: Where to; disconnected at the end.
            scene: The scene.
            names: The M markers of the frames to come.
            skeleton: Its bones are drawn.
            first: Number, from 0, of the recording's frame that comes first.
        """
        self.shown, self.dropped, self.trouble = 0, 0, ""
        self._rec, self._scene, self._first = rec, scene, first
        self._before: Single | None = None
        log_world(rec, scene, names=tuple(names), skeleton=skeleton)
        log_looks(rec, len(names))
        sides = [palette.TRAIL[side_of(name)] for name in names]
        rec.log(paths.TRAILS, rr.LineStrips3D.from_fields(colors=sides), static=True)
        for path, name, color in (
            (paths.NIS, "NIS (expected 1)", palette.SKY_BLUE),
            (paths.LOG_LIKELIHOOD, "log-likelihood", palette.GREEN),
        ):
            rec.log(path, rr.SeriesLines(names=name, colors=color, widths=1.5), static=True)
        self._frames: queue.Queue[LiveEstimate | None] = queue.Queue(maxsize=WAITING)
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def __enter__(self) -> "LiveView":
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Send what waits; a viewer that does not answer is left alone after some seconds."""
        try:
            self._frames.put(None, timeout=_PATIENCE_S)
            self._thread.join(timeout=_PATIENCE_S)
        except queue.Full:
            pass
        if self._thread.is_alive():
            self.trouble = self.trouble or "the viewer does not answer"

    def show(self, estimate: LiveEstimate) -> None:
        """Send a frame; at once, whatever the viewer does."""
        try:
            self._frames.put_nowait(estimate)
        except queue.Full:
            self.dropped += 1

    def _work(self) -> None:
        last = False
        while not last:
            waiting = [self._frames.get()]
            while not self._frames.empty():
                waiting.append(self._frames.get())
            last = waiting[-1] is None
            frames = [frame for frame in waiting if frame is not None]
            try:
                if frames and not self.trouble:
                    self._send(frames)
                    self.shown += len(frames)
                if last:
                    self._rec.flush(timeout_sec=_PATIENCE_S)
            except (RuntimeError, ValueError, OSError) as error:
                self.trouble = str(error)
            if not last:
                time.sleep(0.05)
        self._rec.disconnect()

    def _send(self, frames: list[LiveEstimate]) -> None:
        rec, scene, n = self._rec, self._scene, len(frames)
        ns = np.round(np.array([f.t_s for f in frames]) * 1e9).astype("timedelta64[ns]")
        numbers = np.array([f.frame for f in frames]) + self._first + 1
        index = [rr.TimeColumn(FRAME, sequence=numbers), rr.TimeColumn(TIME, duration=ns)]
        xyz = single(scene.points(np.stack([f.xyz_m for f in frames])))
        rec.send_columns(paths.SKELETON, indexes=index, columns=rr.Points3D.columns(positions=xyz))
        seen = np.zeros(xyz.shape[:2], dtype=bool)
        for k, frame in enumerate(frames):
            seen[k, frame.observed.where[frame.observed.weight > 0, 1]] = True
        for name, mask in (("measured", seen), ("filled", ~seen)):
            columns = rr.Points3D.columns(positions=xyz[mask], keypoint_ids=np.nonzero(mask)[1])
            rec.send_columns(
                paths.child(paths.MARKERS, name), indexes=index, columns=columns.partition(mask.sum(axis=1))
            )
        cov = np.stack([f.cov_m2 for f in frames])
        # a larger ellipsoid would hide all else
        known = ~seen & (np.trace(cov, axis1=-2, axis2=-1) < (0.2 * scene.radius_m) ** 2)
        half_sizes, quaternions = ellipsoids(cov[known] * np.outer(scene.signs, scene.signs))
        columns = rr.Ellipsoids3D.columns(
            centers=xyz[known], half_sizes=single(half_sizes), quaternions=single(quaternions)
        )
        rec.send_columns(
            paths.child(paths.UNCERTAINTY, "filled"), indexes=index, columns=columns.partition(known.sum(axis=1))
        )
        start = np.concatenate([xyz[:1] if self._before is None else self._before, xyz[:-1]])
        self._before = xyz[-1:]
        steps = rr.LineStrips3D.columns(strips=segments(start.reshape(-1, 3), xyz.reshape(-1, 3)))
        rec.send_columns(paths.TRAILS, indexes=index, columns=steps.partition([xyz.shape[1]] * n))
        with np.errstate(divide="ignore", invalid="ignore"):
            nis = np.array([f.observed.nis / f.observed.n_rows for f in frames])
        likely = np.array([f.observed.log_likelihood for f in frames])
        for path, values in ((paths.NIS, nis), (paths.LOG_LIKELIHOOD, likely)):
            rec.send_columns(path, indexes=index, columns=rr.Scalars.columns(scalars=values))


def live_blueprint(scene: Scene) -> rrb.Blueprint:
    """The scene, and how surprised the filter is; the newest frame is shown."""
    look = eye(scene.centre_m, 1.75 * scene.radius_m, scene.up)
    view = world_view(
        paths.WORLD,
        "Scene (m), as it is filtered",
        contents=["$origin/**"],
        ground=(scene.up, scene.ground_m, scene.radius_m),
        look=look,
        trail=(paths.TRAILS, 40),
    )
    lines = [
        series_view(paths.NIS, "Squared prediction error over its expected value (NIS, expected 1)", legend=False),
        series_view(paths.LOG_LIKELIHOOD, "Log-likelihood of each frame (nat)", legend=False),
    ]
    content = rrb.Horizontal(view, rrb.Vertical(*lines), column_shares=[3, 2])
    return screen(content, play_state=rrb.components.PlayState.Following)


@dataclass(frozen=True, eq=False)
class LiveSession:
    """A viewer that shows a recording while it is tracked.

    Attributes:
        sink: Address that it listens on.
        tell: Told what was shown, and what was not.
    """

    sink: str
    tell: Callable[[str], None]

    def watch(self, prepared: Recording, part: Recording, model: MotionModel) -> None:
        """Filter a recording for the viewer."""
        scene = scene_of(prepared)
        rec = rr.RecordingStream(LIVE, recording_id=f"{prepared.name}, live", send_properties=False)
        rec.set_log_time_enabled(False)
        rec.connect_grpc(self.sink, default_blueprint=live_blueprint(scene))
        first = prepared.place(part)[0].start
        with LiveView(rec, scene, names=part.names, skeleton=prepared.skeleton, first=first) as view:
            # eight frames of hindsight, eight at once: two smoothing steps a frame
            for estimate in live(model, observations(part), part.t_s, lag=8, every=8):
                view.show(estimate)
        dropped = f", {view.dropped} dropped because the viewer was slower" if view.dropped else ""
        trouble = f"; the stream ended early: {view.trouble}" if view.trouble else ""
        self.tell(f"live: {view.shown} frames shown{dropped}{trouble}")

    def show(self, rrd: Path, recording_id: str) -> None:
        """Show a whole recording in place of the stream, unless the viewer has been closed."""
        rec = rr.RecordingStream(APPLICATION, recording_id=recording_id, send_properties=False)
        rec.connect_grpc(self.sink)
        rec.log_file_from_path(str(rrd))
        try:
            rec.flush(timeout_sec=30)
        except RuntimeError as error:
            self.tell(f"live: the whole recording is not shown: the viewer does not answer ({error})")
        rec.disconnect()


@contextmanager
def session(tell: Callable[[str], None]) -> Iterator[tuple[LiveSession, Viewer]]:
    """A viewer for a session: a window, or where there is no screen a page for the browser. Closed at the end."""
    viewer = open_viewer(None, web=not has_display(os.environ, sys.platform))
    try:
        if viewer.url:
            tell(viewer.url)
            webbrowser.open(viewer.url)
        yield LiveSession(viewer.sink, tell), viewer
    finally:
        viewer.close()


def scene_of(prepared: Recording) -> Scene:
    """The scene of a recording that is not tracked yet."""
    y_up = prepared.y_up
    uv = prepared.ideal_px if prepared.cameras else None
    return make_scene(prepared.cameras, xyz_m=prepared.xyz_m, uv_px=uv, y_up=y_up)
