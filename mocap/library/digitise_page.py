"""The page to click in: films side by side, on 127.0.0.1 only; every click is saved before it is answered."""

import json
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, stacked, undistorted
from mocap.digitising.clicks import Click, read_clicks, read_unseen, write_clicks, write_unseen
from mocap.digitising.films import Films
from mocap.digitising.naming import seen_from
from mocap.errors import MocapError
from mocap.io.output import result_folder
from mocap.library.digitised import Digitised, cameras_of, check_clicks, digitise, open_with_crops
from mocap.skeleton import Skeleton, read_skeleton

SAVED = "saved_clicks_xypts.csv"
"""The clicks, after each of them; DLTdv reads it, and ``start`` takes it."""
UNSEEN = "saved_not_seen.csv"
"""Where markers are not to be seen, beside it."""
_POLICY = "default-src 'self' data: 'unsafe-inline'"
_VIEWER_POLICY = "default-src 'self' data: blob: 'unsafe-inline' 'unsafe-eval'"
_KINDS = {"": "text/html; charset=utf-8", "js": "text/javascript", "wasm": "application/wasm"}
_REACH = 2.4477  # root of the chi-square of two degrees of freedom that 95 % stay below


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
    lock: Any = field(default_factory=threading.RLock)

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
        return self.click(*self._tracked().swapped(self._name(a), self._name(b), first, last), within=True)

    def delete(self, marker: int, first: int, last: int) -> str:
        """A marker is not to be seen in a range of frames."""
        return self.click(*self._tracked().deleted(self._name(marker), first, last), within=True)

    def _name(self, marker: int) -> str:
        if marker < 0:
            raise IndexError(marker)
        return self.skeleton.markers[marker]

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
        dots, ellipses = np.full_like(clicked, np.nan), np.full((n_cameras, n_markers, 5), np.nan)
        if self.found is not None:
            tracks = self.found.engine.tracks
            chosen, all_dots = tracks.dot[:, frame], tracks.dots[frame]
            if all_dots.shape[1]:
                picked = all_dots[np.arange(n_cameras)[:, None], np.maximum(chosen, 0), :2]
                dots = np.where((chosen >= 0)[..., None], picked, np.nan)
            ellipses = self._ellipses(tracks.xyz_m[frame], tracks.cov_m2[frame])
        lines = self._lines(clicked[:, marker])
        return {
            "cameras": [
                {
                    "markers": [
                        {
                            "click": _listed(clicked[c, m]),
                            "dot": _listed(dots[c, m]),
                            "ellipse": _listed(ellipses[c, m]),
                        }
                        for m in range(n_markers)
                    ],
                    "lines": lines[c],
                }
                for c in range(n_cameras)
            ]
        }

    def _ellipses(self, xyz_m: Array, cov_m2: Array) -> Array:
        """(C, M, 5) centre, half axes and angle of the predicted places' 95 % ellipses."""
        uv, jacobian = seen_from(stacked(self.cameras), xyz_m)
        s = jacobian @ cov_m2 @ np.swapaxes(jacobian, -1, -2)
        out = np.full((*uv.shape[:2], 5), np.nan)
        for c, m in np.argwhere(np.isfinite(s).all(axis=(-1, -2))):
            values, vectors = np.linalg.eigh(s[c, m])
            axes = _REACH * np.sqrt(np.maximum(values[::-1], 0))
            out[c, m, 2:] = *axes, np.arctan2(vectors[1, 1], vectors[0, 1])
        for c, camera in enumerate(self.cameras):
            out[c, :, :2] = uv[c] if camera.lens is None else camera.lens.distort(uv[c])
        return out

    def _lines(self, clicked: Array) -> list[list[list[list[float]]]]:
        """For each camera the epipolar lines of a marker's clicks in the others, bent as its lens bends them."""
        out: list[list[list[list[float]]]] = [[] for _ in self.cameras]
        ideal = undistorted(self.cameras, clicked[:, None])[:, 0]
        matrices = stacked(self.cameras)
        for a in np.flatnonzero(np.isfinite(ideal[:, 0])).tolist():
            inverse = np.linalg.inv(matrices[a, :, :3])
            eye, along = -inverse @ matrices[a, :, 3], inverse @ np.append(ideal[a], 1.0)
            # depths of one camera's ray from near to far
            reach = max(float(np.linalg.norm(eye)), 1e-3)
            points = eye + np.geomspace(0.05, 20, 200)[:, None] * reach * along / np.linalg.norm(along)
            uv, _ = seen_from(matrices, points)
            for b, camera in enumerate(self.cameras):
                if b == a:
                    continue
                width, height = self.films.movies[b].size_px
                near = (np.abs(uv[b] - (width / 2, height / 2)) < (width, height)).all(axis=1)
                line = uv[b][near]
                line = line if camera.lens is None else camera.lens.distort(line)
                if len(line) > 1:
                    out[b].append(np.round(line, 2).tolist())
        return out

    def question(self, after: int) -> dict[str, Any]:
        """The next click that is asked for."""
        asked = [] if self.found is None else self.found.questions(after + 1)
        if not asked:
            return {}
        q = asked[min(after, len(asked) - 1)]
        return {"camera": q.camera, "frame": q.frame, "marker": q.marker, "uv_px": list(q.uv_px)}

    def picture(self, camera: int, frame: int) -> bytes | None:
        """A picture as PNG of 8 bits."""
        found = self.films.picture(camera, frame)
        if found is None:
            return None
        if found.dtype == np.uint16:
            found = np.asarray(cv2.normalize(found, np.empty(0), 0, 255, cv2.NORM_MINMAX, cv2.CV_8U), dtype=np.uint8)
        return cv2.imencode(".png", found, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()


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


def _listed(values: Array) -> list[float] | None:
    return None if np.isnan(values).any() else np.round(values, 3).tolist()


@contextmanager
def served(session: Session, *, port: int = 0) -> Iterator[str]:
    """Serve the page on 127.0.0.1 while the context lasts; yields its address."""
    server = ThreadingHTTPServer(("127.0.0.1", port), _handler(session))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def _handler(session: Session) -> type[BaseHTTPRequestHandler]:
    page = files("mocap.digitising").joinpath("page.html").read_bytes()

    class Handler(BaseHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None: ...

        def do_GET(self) -> None:
            url = urlsplit(self.path)
            given = {key: int(values[0]) for key, values in parse_qs(url.query).items() if values[0].isdigit()}
            if not self._from_here():
                return
            try:
                with session.lock:
                    if url.path == "/":
                        self._send(page, "text/html; charset=utf-8")
                    elif url.path == "/info":
                        self._json(session.info())
                    elif url.path == "/frame":
                        self._json(session.frame(given["frame"], given["marker"]))
                    elif url.path == "/question":
                        self._json(session.question(given["after"]))
                    elif url.path == "/scene/points.rrd":
                        self._send(session.scene(), "application/octet-stream")
                    elif url.path.startswith("/scene/"):
                        self._viewer(url.path.removeprefix("/scene/"))
                    elif url.path == "/picture":
                        png = session.picture(given["camera"], given["frame"])
                        if png is None:
                            self.send_error(HTTPStatus.NOT_FOUND)
                        else:
                            self._send(png, "image/png")
                    else:
                        self.send_error(HTTPStatus.NOT_FOUND)
            except MocapError as error:
                self._send(str(error).encode(), "text/plain; charset=utf-8", status=HTTPStatus.CONFLICT)
            except (KeyError, IndexError):
                self.send_error(HTTPStatus.BAD_REQUEST)

        def do_POST(self) -> None:
            if not self._from_here():
                return
            try:
                given = json.loads(self.rfile.read(int(self.headers.get("Content-Length", 0))) or b"{}")
                with session.lock:
                    if self.path == "/click":
                        said = session.click(_click(given, session))
                    elif self.path == "/swap":
                        said = session.swap(*(int(given[key]) for key in ("marker", "other", "first", "last")))
                    elif self.path == "/delete":
                        said = session.delete(*(int(given[key]) for key in ("marker", "first", "last")))
                    elif self.path == "/undo":
                        said = session.undo()
                    elif self.path == "/track":
                        said = session.run()
                    else:
                        self.send_error(HTTPStatus.NOT_FOUND)
                        return
                self._json({"said": said})
            except MocapError as error:
                self._json({"said": str(error), "error": True})
            except (KeyError, ValueError, TypeError, IndexError):
                self.send_error(HTTPStatus.BAD_REQUEST)

        def _from_here(self) -> bool:
            """Refuse requests that a page of another host makes the browser send."""
            host = self.headers.get("Host", "").split(":")[0]
            origin = self.headers.get("Origin")
            if host in ("127.0.0.1", "localhost") and (origin is None or urlsplit(origin).hostname == host):
                return True
            self.send_error(HTTPStatus.FORBIDDEN)
            return False

        def _viewer(self, name: str) -> None:
            """A file of rerun's web viewer; its page may ask this server alone."""
            from mocap.rerun.points import viewer_files

            found = viewer_files("/scene/points.rrd").get(name)
            if found is None:
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            self._send(found, _KINDS[name.rpartition(".")[2]], policy=_VIEWER_POLICY)

        def _json(self, data: Any) -> None:
            self._send(json.dumps(data).encode(), "application/json")

        def _send(self, body: bytes, kind: str, *, policy: str = _POLICY, status: HTTPStatus = HTTPStatus.OK) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", policy)
            self.end_headers()
            with suppress(ConnectionError):  # the page was closed meanwhile
                self.wfile.write(body)

    return Handler


def _click(given: dict[str, Any], session: Session) -> Click:
    uv = given["uv_px"]
    click = Click(
        camera=int(given["camera"]),
        frame=int(given["frame"]),
        marker=int(given["marker"]),
        uv_px=None if uv is None else (float(uv[0]), float(uv[1])),
    )
    limits = (len(session.cameras), session.films.n_frames, len(session.skeleton.markers))
    if not all(0 <= i < n for i, n in zip((click.camera, click.frame, click.marker), limits, strict=True)):
        raise ValueError("a click outside of the films")
    return click
