"""The server of a page: uvicorn on 127.0.0.1, in a thread that ends with its command."""

import asyncio
import os
import secrets
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import uvicorn
from starlette.types import ASGIApp
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


@dataclass(frozen=True)
class Served:
    """A page that is served.

    Attributes:
        address: With its token: who has it may do all that the page can.
        thread: Of the server.
        parent: Process that started this one.
    """

    address: str
    thread: threading.Thread
    parent: int

    def wait(self) -> None:
        """Until Ctrl-C, the end of the parent process, or of the server."""
        with suppress(KeyboardInterrupt):
            while self.thread.is_alive() and os.getppid() == self.parent:
                time.sleep(0.2)  # a signal during join() has Python 3.11 take the thread for ended


@contextmanager
def served(app: ASGIApp, *, port: int = 0) -> Iterator[Served]:
    """Serve an application behind a ``Guard`` on 127.0.0.1 while the context lasts.

    Raises:
        MocapError: the port is taken.
    """
    parent, token = os.getppid(), secrets.token_urlsafe(32)
    with _listening(port) as listener:
        number = listener.getsockname()[1]
        host = HOST if number == 80 else f"{HOST}:{number}"  # as browsers write it
        config = uvicorn.Config(
            Guard(app, host=host, token=token),
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
            yield Served(f"http://{host}/{token}/", thread, parent)
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
