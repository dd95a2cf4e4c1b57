"""A recording that is watched while it is filtered."""

import os
import sys
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import rerun as rr

from mocap.filters.live import live, looks
from mocap.filters.motion.base import MotionModel
from mocap.pipeline.recording import Recording
from mocap.pipeline.tracking import Part
from mocap.rerun.live import LiveView, live_blueprint
from mocap.rerun.record import APPLICATION
from mocap.rerun.scene import Scene, make_scene
from mocap.rerun.viewer import Viewer, has_display, open_viewer

LIVE = "mocap-live"
LAG, EVERY = 8, 8
"""Frames of hindsight that a frame is shown with, and so many come at once: two smoothing steps a frame."""


@dataclass(frozen=True, eq=False)
class Session:
    """A viewer that shows a recording while it is tracked.

    Attributes:
        sink: Address that it listens on.
        tell: Told what was shown, and what was not.
    """

    sink: str
    tell: Callable[[str], None]

    def watch(self, prepared: Recording, part: Part, model: MotionModel) -> None:
        """Filter a recording for the viewer."""
        scene = scene_of(prepared)
        rec = rr.RecordingStream(LIVE, recording_id=f"{prepared.name}, live", send_properties=False)
        rec.set_log_time_enabled(False)
        rec.connect_grpc(self.sink, default_blueprint=live_blueprint(scene))
        names = [prepared.names[int(m)] for m in part.markers]
        observations = prepared.observations(part.frames, part.markers)
        with LiveView(rec, scene, names=names, skeleton=prepared.skeleton, first=part.frames.start) as view:
            for estimate in live(model, looks(observations, prepared.t_s[part.frames]), lag=LAG, every=EVERY):
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
def session(tell: Callable[[str], None]) -> Iterator[tuple[Session, Viewer]]:
    """A viewer for a session: a window, or where there is no screen a page for the browser. Closed at the end."""
    viewer = open_viewer(None, web=not has_display(os.environ, sys.platform))
    try:
        if viewer.url:
            tell(viewer.url)
            webbrowser.open(viewer.url)
        yield Session(viewer.sink, tell), viewer
    finally:
        viewer.close()


def scene_of(prepared: Recording) -> Scene:
    """The scene of a recording that is not tracked yet."""
    y_up = prepared.rows is not None and prepared.rows.coefficients == "lower-left"
    uv = prepared.ideal_px if prepared.cameras else None
    return make_scene(prepared.cameras, xyz_m=prepared.xyz_m, uv_px=uv, y_up=y_up)
