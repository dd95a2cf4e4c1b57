"""Frames as they are filtered: all of them arrive, and a viewer that does not answer holds nobody up."""

import io
import threading

import numpy as np
import pytest
import rerun as rr
from flapping import make_run
from mocap.filters.live import LiveEstimate
from mocap.filters.observations import WHOLE
from mocap.filters.observe import Observed
from PIL import Image
from readback import column
from test_view_pictures import amount
from vulkan import need_vulkan

from mocap.records import Status
from mocap.rerun import palette, paths
from mocap.rerun.live import LIVE, WAITING, LiveSession, LiveView, live_blueprint, session
from mocap.rerun.record import run_scene
from tests.mocap.rerun.headless import Headless


def estimates(run):
    """A run's frames as a filter that is still under way would hand them over."""
    markers = run.tracks
    for k in range(len(markers.t_s)):
        marker = np.flatnonzero(markers.status[k] == Status.MEASURED)
        n = len(marker)
        observed = Observed(
            where=np.column_stack([np.full(n, WHOLE), marker]),
            innovation=np.zeros((n, 3)),
            weight=np.ones(n),
            nis=run.nis[k],
            n_rows=int(run.n_rows[k]),
            log_likelihood=run.log_likelihood[k],
        )
        yield LiveEstimate(
            frame=k,
            t_s=markers.t_s[k],
            ahead=0,
            xyz_m=markers.xyz_m[k],
            cov_m2=markers.cov_m2[k],
            observed=observed,
        )


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A busy machine is no viewer that does not answer."""
    monkeypatch.setattr("mocap.rerun.live._PATIENCE_S", 600.0)


@pytest.fixture(scope="module")
def run():
    return make_run(n_frames=90, n_cameras=2, n_joints=0)


def test_every_frame_arrives_as_it_was(run, tmp_path):
    """Positions, classes, NIS and likelihood of all frames, at their numbers in the recording, and steps in between."""
    rec = rr.RecordingStream(LIVE, recording_id="live", send_properties=False)
    rec.set_log_time_enabled(False)
    rec.save(tmp_path / "live.rrd")
    markers = run.tracks
    with LiveView(rec, run_scene(run), names=markers.names, skeleton=run.skeleton, first=100) as view:
        for estimate in estimates(run):
            view.show(estimate)
    assert (view.shown, view.dropped, view.trouble) == (90, 0, "")
    path = tmp_path / "live.rrd"
    frames, _, xyz = column(path, paths.SKELETON, "Points3D:positions")
    np.testing.assert_array_equal(frames, 100 + np.arange(90))
    np.testing.assert_array_equal(xyz.reshape(90, -1, 3), markers.xyz_m.astype(np.float32))
    measured = column(path, paths.child(paths.MARKERS, "measured"), "Points3D:positions")[2]
    np.testing.assert_array_equal(measured, markers.xyz_m[markers.status == Status.MEASURED].astype(np.float32))
    np.testing.assert_array_equal(column(path, paths.NIS, "Scalars:scalars")[2], run.nis / run.n_rows)
    likelihood = column(path, paths.LOG_LIKELIHOOD, "Scalars:scalars")[2]
    np.testing.assert_array_equal(likelihood, run.log_likelihood)
    strips = column(path, paths.TRAILS, "LineStrips3D:strips")[2].reshape(90, -1, 2, 3)
    np.testing.assert_array_equal(strips[1:, :, 0], markers.xyz_m[:-1].astype(np.float32))
    np.testing.assert_array_equal(strips[:, :, 1], markers.xyz_m.astype(np.float32))


def test_a_stalled_viewer_holds_nobody_up(run):
    """While the stream is stuck, frames are taken at once: as many as wait are kept, the others counted."""
    stuck, go = threading.Event(), threading.Event()

    class Stalled:
        """A stream whose viewer is busy."""

        def log(self, *_: object, **__: object) -> None: ...

        def send_columns(self, *_: object, **__: object) -> None:
            stuck.set()
            go.wait()

        def flush(self, **_: object) -> None: ...

        def disconnect(self) -> None: ...

    frame = next(estimates(run))
    scene, markers = run_scene(run), run.tracks
    with LiveView(Stalled(), scene, names=markers.names, skeleton=run.skeleton) as view:  # type: ignore[arg-type]
        view.show(frame)
        stuck.wait()
        for _ in range(WAITING + 50):  # one that waited would wait for ever
            view.show(frame)
        assert view.dropped == 50
        go.set()
    assert view.shown == WAITING + 1
    assert view.trouble == ""


def test_a_stream_that_breaks_is_no_error_of_the_run(run):
    """What went wrong is noted, and the filter goes on."""

    class Broken:
        def log(self, *_: object, **__: object) -> None: ...

        def send_columns(self, *_: object, **__: object) -> None:
            raise RuntimeError("the viewer is gone")

        def flush(self, **_: object) -> None: ...

        def disconnect(self) -> None: ...

    scene, markers = run_scene(run), run.tracks
    with LiveView(Broken(), scene, names=markers.names, skeleton=run.skeleton) as view:  # type: ignore[arg-type]
        for estimate in estimates(run):
            view.show(estimate)
    assert view.shown == 0
    assert view.trouble == "the viewer is gone"


def test_the_viewer_shows_the_newest_frame(run):
    """Streamed to a viewer: markers, filled ones and trails are there."""
    need_vulkan()
    scene, markers = run_scene(run), run.tracks
    with Headless() as viewer:
        for _ in range(12):  # the messages of the start fade while pictures are taken
            viewer.client.take_screenshot(max_size=32)
        blank = np.asarray(Image.open(io.BytesIO(viewer.client.take_screenshot())).convert("RGB"))
        rec = rr.RecordingStream(LIVE, recording_id="live", send_properties=False)
        rec.set_log_time_enabled(False)
        rec.connect_grpc(viewer.client.url, default_blueprint=live_blueprint(scene))
        with LiveView(rec, scene, names=markers.names, skeleton=run.skeleton) as view:
            for estimate in estimates(run):
                view.show(estimate)
        assert view.trouble == ""
        while [r.current_time for r in viewer.client.get_state().recordings] != [90]:
            viewer.client.take_screenshot(max_size=32)
        picture = np.asarray(Image.open(io.BytesIO(viewer.client.take_screenshot())).convert("RGB"))
    assert amount(picture[100:], palette.SKY_BLUE) > 40
    assert amount(blank[100:], palette.SKY_BLUE) == 0
    assert amount(picture[100:], palette.YELLOW) > 10


def test_a_viewer_that_was_closed_is_no_error_of_the_run(tmp_path, monkeypatch):
    """The whole recording cannot be shown: told, as the result is written."""

    class Closed:
        def __init__(self, *_: object, **__: object) -> None: ...

        def connect_grpc(self, *_: object) -> None: ...

        def log_file_from_path(self, _: str) -> None: ...

        def flush(self, **_: object) -> None:
            raise RuntimeError("gone")

        def disconnect(self) -> None: ...

    monkeypatch.setattr("mocap.rerun.live.rr.RecordingStream", Closed)
    told = []
    LiveSession("", told.append).show(tmp_path / "recording.rrd", "a")
    assert told == ["live: the whole recording is not shown: the viewer does not answer (gone)"]


def test_a_session_without_a_screen_is_served_and_ends(monkeypatch):
    """On a computer without a screen a page is served, its address told; at the end nothing runs on."""
    monkeypatch.setattr("mocap.rerun.live.has_display", lambda *_: False)
    monkeypatch.setattr("webbrowser.open", lambda _: True)
    told = []
    with session(told.append) as (_, viewer):
        assert viewer.process.poll() is None
        assert told == [viewer.url]
    assert viewer.process.poll() is not None
