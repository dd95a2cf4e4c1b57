"""The server of a page: uvicorn on 127.0.0.1, in a thread that ends with its command, and what ends that."""

import asyncio
import os
import secrets
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import uvicorn
from starlette.responses import JSONResponse
from starlette.routing import Match, Route
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from mocap.errors import MocapError
from mocap.web.guard import HEAD_BYTES, REQUEST_S, Guard

HOST = "127.0.0.1"
CONNECTIONS = 256
"""At once, at most: a browser opens six, and Linux lets a process open 1024 files, videos among them."""
ANSWER_S = 60.0
"""An answer that is not read by then is given up: rerun's viewer, 40 MB, at 0.7 MB/s."""
_BUSY = b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"


class Connection(H11Protocol):
    """A connection that waits for nothing without end; uvicorn itself limits only the time between two requests."""

    _late: asyncio.TimerHandle | None = None
    _unread: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Refuse one too many."""
        super().connection_made(transport)
        if len(self.connections) > CONNECTIONS:
            transport.write(_BUSY)
            transport.close()
        self._limit_head()

    def data_received(self, data: bytes) -> None:
        """A part of a request; the guard limits how long its body takes."""
        super().data_received(data)
        self._limit_head()

    def _limit_head(self) -> None:
        works = self.cycle is not None and not self.cycle.response_complete
        if works and self._late is not None:
            self._late.cancel()
            self._late = None
        elif not works and self._late is None:
            self._late = self.loop.call_later(REQUEST_S, self.transport.abort)

    def pause_writing(self) -> None:
        """The answer is not being read."""
        super().pause_writing()
        self._unread = self.loop.call_later(ANSWER_S, self.transport.abort)

    def resume_writing(self) -> None:
        """It is again."""
        super().resume_writing()
        if self._unread is not None:
            self._unread.cancel()

    def timeout_keep_alive_handler(self) -> None:
        """No other request came: close, also where the last bytes of the answer are never read."""
        super().timeout_keep_alive_handler()
        self.loop.call_later(ANSWER_S, self.transport.abort)


ENDS = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals that end a page: Ctrl-C, ``kill``, a terminal that is closed. Those that are ignored (``nohup``) do not."""


class _Ended(BaseException):
    """Raised by a signal that comes before the page waits; no handler of errors takes it for one."""


@dataclass(frozen=True, eq=False)
class Served:
    """A page that is served.

    Attributes:
        address: With its token: who has it may do all that the page can.
        thread: Of the server.
        guard: Before it.
    """

    address: str
    thread: threading.Thread
    guard: Guard
    _end: threading.Event = field(default_factory=threading.Event)
    _why: list[str] = field(default_factory=list)
    _waits: threading.Event = field(default_factory=threading.Event)

    def end(self, why: str) -> None:
        """End the page; of several reasons the first counts."""
        self._why.append(why)
        self._end.set()

    @property
    def why(self) -> str:
        """Why it ended."""
        return self._why[0]

    def signalled(self, name: str) -> None:
        """A signal ends the page; what is imported and opened before ``wait`` is given up, and the context ends."""
        self.end(name)
        if not self._waits.is_set():
            self._waits.set()
            raise _Ended

    def wait(self, *, idle_s: float | None = None, works: Callable[[], bool] = lambda: False) -> str:
        """Until its button, a signal, or the end of the server; the end of the process that started this one is none.

        Args:
            idle_s: Also until so many seconds without a request; None: never.
            works: Whether something goes on that no request waits for: it is not idle then.

        Returns:
            Why it ended.
        """
        self._waits.set()
        # a signal that another thread gets, as a busy machine gives it, wakes no longer wait
        while not self._end.wait(timeout=0.2):
            if not self.thread.is_alive():
                self.end("its server has ended")
            elif idle_s is not None and self.guard.idle_s() > idle_s and not works():
                self.end(f"no request came for {idle_s:g} s")
        return self.why


@contextmanager
def _signals(end: Callable[[str], None]) -> Iterator[None]:
    """A signal ends the page; a second one does what it did before."""
    before: dict[int, Any] = {}

    def again() -> None:
        while before:
            signal.signal(*before.popitem())

    def signalled(number: int, _frame: object) -> None:
        again()
        end(signal.Signals(number).name)

    if threading.current_thread() is threading.main_thread():
        for number in (getattr(signal, name) for name in ENDS if hasattr(signal, name)):
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, signalled)
    try:
        yield
    finally:
        again()


class _Button:
    """Answers ``end``, by which the page itself is ended; what else is asked for the application answers."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self.pressed: Callable[[], None] = lambda: None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope.get("method") == "POST" and scope["path"] == f"{scope['root_path']}/end":
            await JSONResponse({"said": "ended"})(scope, receive, send)
            self.pressed()
        else:
            await self.app(scope, receive, send)


class Behind:
    """A page that is there before what answers it: of what takes long to import, or to open.

    Until ``becomes``, the application ``first`` answers what it has a route for, and everything else waits.
    """

    def __init__(self, first: Route) -> None:
        """With what is shown at once."""
        self._first = first
        self._app: Future[ASGIApp] = Future()

    def becomes(self, app: ASGIApp) -> None:
        """From now on this one answers, also what was asked for before."""
        self._app.set_result(app)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or wait."""
        if not self._app.done() and self._first.matches(scope)[0] is Match.FULL:
            await self._first.handle(scope, receive, send)
        else:
            await (await asyncio.wrap_future(self._app))(scope, receive, send)


@contextmanager
def forwarded(address: str) -> Iterator[str]:
    """The address of a file that forwards to another: a browser gets it as an argument, which all users can read.

    The file can be read by this user alone, and is there while the context lasts.
    """
    with TemporaryDirectory(prefix="mocap-") as folder:
        path = Path(folder) / "open.html"
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
            file.write(
                '<!doctype html><meta charset="ascii"><meta name="referrer" content="no-referrer">'
                f'<meta http-equiv="refresh" content="0; url={address}"><a href="{address}">mocap</a>\n'
            )
        yield path.as_uri()


@contextmanager
def served(app: ASGIApp, *, port: int = 0) -> Iterator[Served]:
    """Serve an application behind a ``Guard`` on 127.0.0.1 while the context lasts.

    Raises:
        MocapError: the port is taken.
    """
    token, button = secrets.token_urlsafe(32), _Button(app)
    with _listening(port) as listener:
        number = listener.getsockname()[1]
        host = HOST if number == 80 else f"{HOST}:{number}"  # as browsers write it
        guard = Guard(button, host=host, token=token)
        config = uvicorn.Config(
            guard,
            http=Connection,
            ws="none",
            loop="asyncio",
            lifespan="off",
            access_log=False,  # it would hold the token
            log_config=None,
            log_level="critical",
            proxy_headers=False,
            server_header=False,
            h11_max_incomplete_event_size=HEAD_BYTES,
            timeout_graceful_shutdown=1,
        )
        server = uvicorn.Server(config)
        # threads of a daemon are daemons: work that goes on does not hold up the end of the process
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()
        try:
            while thread.is_alive() and not server.started:
                time.sleep(0.01)
            site = Served(f"http://{host}/{token}/", thread, guard)
            button.pressed = lambda: site.end("its button End")
            with _signals(site.signalled), suppress(_Ended):
                yield site
        finally:
            server.should_exit = True
            thread.join(timeout=3.0)  # what still works ends with the process


@contextmanager
def _listening(port: int) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
        if os.name == "posix":  # the port of a page that has just ended; on Windows also one in use
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((HOST, port))
        except OSError as error:
            raise MocapError(
                f"`port`: {port} cannot be used ({error.strerror}): give another, or 0 for any that is free"
            ) from None
        yield listener
