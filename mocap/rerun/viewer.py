"""Open a recording in the rerun viewer, which runs as a process of its own and listens on this computer only.

It ends with the process that opened it, whatever ends that (``mocap.rerun.guardian``).
"""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import IO
from urllib.error import URLError
from urllib.parse import quote

from mocap.errors import MocapError
from mocap.rerun import guardian

HOST = "127.0.0.1"
POLICY = "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:"
"""What a page may load: parts of its own."""
_START_S = 30.0  # for a viewer that starts; chosen


class ViewerError(MocapError):
    """The viewer cannot be opened here."""

    page = "looking"


@dataclass(frozen=True, eq=False, kw_only=True)
class Viewer:
    """A viewer that runs.

    Attributes:
        process: Its guardian, which ends with it.
        url: Address for a browser; None for a viewer with a window of its own.
        sink: Address to stream to.
        messages: What it said so far.
        page: Server of its page, where it is for a browser.
    """

    process: subprocess.Popen[bytes]
    url: str | None
    sink: str
    messages: IO[bytes]
    page: ThreadingHTTPServer | None = None

    def wait(self) -> None:
        """Wait until its window is closed, or for ever if it serves a browser.

        Raises:
            ViewerError: it ended with an error.
        """
        while (code := self.process.poll()) is None:
            time.sleep(0.2)  # a signal that another thread gets, as a busy machine gives it, wakes no longer wait
        if code > 0:
            raise _failed(self)

    def close(self) -> None:
        """End it."""
        if self.page is not None:
            self.page.shutdown()
            self.page.server_close()
        guardian.end(self.process)
        self.messages.close()


def open_viewer(rrd: Path | None, *, web: bool = False) -> Viewer:
    """Show a recording, or what will be streamed.

    Args:
        rrd: The recording; None: nothing yet.
        web: Serve it to a browser of this computer, at the ``url`` of the result, instead of opening a window.

    Returns:
        The viewer, started; wait for it, or close it.

    Raises:
        ViewerError: there is no such recording, or it is none, no viewer, or no screen, or the viewer did not start.
    """
    if rrd is not None and not rrd.is_file():
        raise ViewerError(f"{rrd}: there is no such recording; `mocap track` and `mocap demo` write recording.rrd")
    program = viewer_program()
    if not web and not has_display(os.environ, sys.platform):
        raise ViewerError(
            "no screen was found (neither DISPLAY nor WAYLAND_DISPLAY is set): look at it in a browser with --web, or "
            "copy the .rrd to a computer with a screen and open it there with `rerun`"
        )
    data_port, page_port = free_ports(2)
    command = [program, *([] if rrd is None or web else [str(rrd)]), "--bind", HOST, "--port", str(data_port)]
    url, sink, page = None, f"rerun+http://{HOST}:{data_port}/proxy", None
    if web:
        command += ["--serve-web", "--web-viewer-port", str(page_port)]
        page = _page(f"http://{HOST}:{page_port}", asks=f"http://{HOST}:{data_port}")
        url = f"http://{HOST}:{page.server_port}/?url={quote(sink, safe='')}&theme=dark"
    messages = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the viewer
    process = guardian.started(command, environment=quiet_environment(os.environ), output=messages)
    viewer = Viewer(process=process, url=url, sink=sink, messages=messages, page=page)
    for port in (data_port, page_port) if web else (data_port,):
        _wait_for(viewer, port)
    if web and rrd is not None:
        try:
            _send(rrd, sink)
        except Exception:
            viewer.close()
            raise
    return viewer


def _page(source: str, *, asks: str) -> ThreadingHTTPServer:
    """A server of the page at ``source`` with a policy by which a browser lets it ask ``asks`` alone.

    By itself the page sends statistics of use and loads fonts from other hosts.
    """

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            name = self.path.partition("?")[0]
            try:
                with urllib.request.urlopen(source + name, timeout=_START_S) as answer:
                    kind, content = answer.headers.get_content_type(), answer.read()
            except URLError:
                self.send_error(404)
                return
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Content-Security-Policy", f"{POLICY}; connect-src 'self' {asks}")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None: ...

    server = ThreadingHTTPServer((HOST, 0), Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


def _send(rrd: Path, sink: str) -> None:
    """Stream a recording to a server: one that is started with the file takes a core for as long as it serves."""
    import rerun as rr
    from rerun.chunk import RrdReader

    try:
        kept = RrdReader(str(rrd)).recordings()[0]
    except (IndexError, ValueError, OSError, RuntimeError) as error:
        raise ViewerError(f"{rrd}: not a recording for the viewer ({error}): run `mocap track` again") from None
    stream = rr.RecordingStream(kept.application_id, recording_id=kept.recording_id, send_properties=False)
    stream.connect_grpc(sink)
    stream.log_file_from_path(str(rrd))
    stream.flush()
    stream.disconnect()


def viewer_program() -> str:
    """Path of the viewer's own program, not of the script that would start it as a child.

    Raises:
        ViewerError: it is not installed.
    """
    try:
        import rerun_cli
    except ImportError:
        found = None
    else:
        name = "rerun.exe" if sys.platform == "win32" else "rerun"
        found = shutil.which(str(Path(str(rerun_cli.__file__)).parent / name))
    found = found or shutil.which("rerun")
    if found is None:
        raise ViewerError("the rerun viewer is not installed: run `pip install --force-reinstall eal-mocap`")
    return found


def has_display(environment: Mapping[str, str], platform: str) -> bool:
    """True where a window can be opened."""
    if platform in ("win32", "darwin"):
        return True
    return bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))


def quiet_environment(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment for a viewer: no statistics of use, no question for a newer version, errors alone."""
    quiet = {"CI": "1", "RUST_LOG": environment.get("RUST_LOG", "warn"), "NO_COLOR": "1"}
    return {**environment, **quiet, "HTTPS_PROXY": f"http://{HOST}:9"}


def free_ports(count: int) -> list[int]:
    """Ports of this computer on which nothing listens."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_STREAM) for _ in range(count)]
    try:
        for s in sockets:
            s.bind((HOST, 0))
        return [s.getsockname()[1] for s in sockets]
    finally:
        for s in sockets:
            s.close()


def _wait_for(viewer: Viewer, port: int) -> None:
    end = time.monotonic() + _START_S
    while viewer.process.poll() is None:
        try:
            socket.create_connection((HOST, port), timeout=1.0).close()
        except OSError:
            if time.monotonic() > end:
                viewer.close()
                raise ViewerError(f"the viewer did not start within {_START_S:g} s; try again") from None
            time.sleep(0.05)
        else:
            return
    raise _failed(viewer)


def _failed(viewer: Viewer) -> ViewerError:
    guardian.end(viewer.process)
    viewer.messages.seek(0)
    lines = viewer.messages.read().decode(errors="replace").strip().splitlines()
    viewer.close()
    reason = lines[-1].strip() if lines else "it said nothing"
    hint = "try --web" if viewer.url is None else "try again, or open the file with `rerun` elsewhere"
    return ViewerError(f"the viewer ended with code {viewer.process.returncode} ({reason}): {hint}")
