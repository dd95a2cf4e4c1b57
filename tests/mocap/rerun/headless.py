"""A viewer without a screen, which says what a person would see."""

import io
import os
import subprocess
import time
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from PIL import Image
from rerun.experimental import ViewerClient

from mocap.rerun import guardian
from mocap.rerun.columns import FRAME
from mocap.rerun.record import APPLICATION
from mocap.rerun.viewer import HOST, free_ports, quiet_environment, viewer_program

LONGEST_S = 240.0
"""Nothing here takes longer, on a busy machine either."""


class Headless:
    """A viewer process and its remote control; a context manager."""

    def __init__(self, *, size: tuple[int, int] = (900, 650), display: str | None = None) -> None:
        """Start it.

        Args:
            size: Of its window, in pixels.
            display: An X display on which it opens a real window, which a pointer can hover over; None: no window.
        """
        (port,) = free_ports(1)
        command = [viewer_program(), "--bind", HOST, "--port", str(port), "--hide-welcome-screen"]
        command += [] if display else ["--headless"]
        command += ["--window-size", f"{size[0]}x{size[1]}"]
        environment = quiet_environment(os.environ)
        environment |= {"DISPLAY": display, "WAYLAND_DISPLAY": ""} if display else {}
        self.process = guardian.started(command, environment=environment, output=subprocess.DEVNULL)
        self.client = self._connect(f"rerun+http://{HOST}:{port}/proxy")
        self.stream: rr.RecordingStream | None = None
        self.recording_id = ""
        self.throwaway = 12

    def __enter__(self) -> "Headless":
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process, after the connection to it."""
        if self.stream is not None:
            self.stream.disconnect()
        guardian.end(self.process)

    def load(self, rrd: Path, recording_id: str, *, application: str = APPLICATION) -> None:
        """Load a file, given what it calls itself and the program that wrote it."""
        if self.stream is not None:
            self.stream.disconnect()
        self.recording_id = recording_id
        self.stream = rr.RecordingStream(application, recording_id=recording_id, send_properties=False)
        self.stream.connect_grpc(self.client.url)
        self.stream.log_file_from_path(str(rrd))
        self.stream.flush(timeout_sec=300)

    def picture(self, view: rrb.View, *, frame: int) -> NDArray[np.uint8]:
        """(H, W, 3) one view alone at one frame (from 0); fails if the viewer has anything to report about it."""
        return self._shown(rrb.Blueprint(view, *_BARE), frame, str(view.id))

    def show(self, blueprint: rrb.Blueprint, *, frame: int) -> NDArray[np.uint8]:
        """(H, W, 3) the whole window with a blueprint at one frame; fails likewise."""
        return self._shown(blueprint, frame, None)

    def _shown(self, blueprint: rrb.Blueprint, frame: int, view_id: str | None) -> NDArray[np.uint8]:
        if self.stream is None:
            raise RuntimeError("nothing is loaded: call load first")
        self.stream.send_blueprint(blueprint)
        self.stream.flush(timeout_sec=300)
        self._set_frame(frame)
        picture = self._still(view_id)
        reports = [(view.name, r.summary) for view in self.client.get_state().views for r in view.reports]
        if reports:
            raise RuntimeError(f"the viewer complains: {reports}")
        return picture

    def _set_frame(self, frame: int) -> None:
        """Move the cursor as soon as the file has arrived; again where a blueprint that came later took it back."""
        end = time.monotonic() + LONGEST_S
        while time.monotonic() < end:
            state = self.client.get_state()
            wanted = [r for r in state.recordings if r.store_id.endswith(f":{self.recording_id}")]
            if wanted and wanted[0].current_time == frame + 1:
                return
            if not state.loading and wanted and any(t.name == FRAME for t in wanted[0].timelines):
                self.client.set_time(FRAME, sequence=frame + 1, play_state="paused")
            time.sleep(0.05)
        raise RuntimeError(f"frame {frame} of {self.recording_id} was not shown within {LONGEST_S:.0f} s: {state}")

    def _still(self, view_id: str | None) -> NDArray[np.uint8]:
        """A picture that stays the same, after the messages of the start have faded and the view is there."""
        for _ in range(self.throwaway):
            self.client.take_screenshot(max_size=32)
        self.throwaway = 1
        same, last = 0, b""
        for _ in range(100):
            png = self.client.take_screenshot(view_id)
            same = same + 1 if png == last else 0
            last = png
            if same == 2:
                break
        return np.asarray(Image.open(io.BytesIO(last)).convert("RGB"))

    def _connect(self, url: str) -> ViewerClient:
        end = time.monotonic() + LONGEST_S
        while True:
            try:
                client = ViewerClient.connect(url)
                client.take_screenshot(max_size=32)
                return client
            except Exception as error:  # it is still starting
                if self.process.poll() is not None or time.monotonic() > end:
                    raise RuntimeError("no headless viewer: apt-get install mesa-vulkan-drivers") from error
                time.sleep(0.1)


_BARE = (
    rrb.TimePanel(state=rrb.PanelState.Hidden, timeline="frame", play_state=rrb.components.PlayState.Paused),
    rrb.TopPanel(state=rrb.PanelState.Hidden),
    rrb.SelectionPanel(state=rrb.PanelState.Hidden),
    rrb.BlueprintPanel(state=rrb.PanelState.Hidden),
)
