"""Who may talk to a page of this computer, and how much: middleware that stands before every page of ours.

A server on 127.0.0.1 is reached by every user of the computer, and by every web page that its browser shows. So the
address holds a random token, as the first part of its path. It is neither a cookie nor a parameter: browsers send the
cookies of 127.0.0.1 to the servers of all its ports, those of other users too, whereas a path is carried on by relative
addresses in whatever a page loads (images, frames, scripts, WebSockets), to this server alone. It leaves the browser
with no request to another host (``Referrer-Policy``), and is written to no log.
"""

import asyncio
import secrets
from time import monotonic

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

HEAD_BYTES = 16_384
"""Of the address and headers of a request. A browser's have 1,000."""
BODY_BYTES = 65_536
"""Of the largest request. A click takes 60."""
REQUEST_S = 10.0
"""A request that has not come whole by then is given up; on one computer it takes milliseconds."""
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""Of every answer, unless the application gives its own."""


class Refusal(Exception):
    """A request that is not answered, with its status and why."""

    def __init__(self, status: int, reason: str) -> None:
        """As HTTP has it."""
        super().__init__(reason)
        self.status = status


class Guard:
    """ASGI middleware that lets through what comes from the page itself, whole and within limits.

    Attributes:
        app: What is guarded; it sees paths below the token.
        host: Name and port as the browser sends them: another name of this computer is DNS rebinding.
        token: First part of every path.
    """

    def __init__(self, app: ASGIApp, *, host: str, token: str) -> None:
        """Before an application that is served at ``http://host/token/``."""
        self.app, self.host, self.token = app, host, token
        self._answers, self._heard_s = 0, monotonic()

    def idle_s(self) -> float:
        """Seconds since the last request of the page itself was answered; 0 while one is."""
        return 0.0 if self._answers else monotonic() - self._heard_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or let the application do so."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        started = False

        async def answer(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                policy = headers["Content-Security-Policy"]
                if "frame-ancestors" not in policy:
                    headers["Content-Security-Policy"] = f"{policy}; frame-ancestors 'none'"
            await send(message)

        try:
            self._check(scope)
            self._answers += 1
            try:
                whole = await _received(receive) if scope["type"] == "http" else receive
                await self.app({**scope, "root_path": f"/{self.token}"}, whole, answer)
            finally:
                self._answers, self._heard_s = self._answers - 1, monotonic()
        except Refusal as refusal:
            # what may still come of the request is not read
            said = JSONResponse({"said": str(refusal)}, refusal.status, headers={"Connection": "close"})
            await (said if scope["type"] == "http" else WebSocketClose())(scope, receive, answer)
        except Exception:
            if not started:  # Starlette has answered with status 500, or the connection is gone
                raise

    def _check(self, scope: Scope) -> None:
        headers = Headers(scope=scope)
        texts = [scope["path"], scope["query_string"], *(text for pair in headers.raw for text in pair)]
        if sum(len(text) for text in texts) > HEAD_BYTES:
            raise Refusal(431, f"address and headers have at most {HEAD_BYTES} bytes")
        if headers.getlist("host") != [self.host]:
            raise Refusal(403, f"this page is at http://{self.host}/, and nowhere else")
        root, first, *_ = [*scope["path"].split("/", 2), ""]
        # in constant time: how long it takes tells nothing of how much is right
        if root or not secrets.compare_digest(first.encode(), self.token.encode()):
            raise Refusal(403, "open the address that the command wrote, with all of its letters")
        reads = scope["type"] == "http" and scope["method"] in ("GET", "HEAD")
        if not reads and headers.getlist("origin") != [f"http://{self.host}"]:
            raise Refusal(403, f"changes are taken from the page at http://{self.host} alone (`Origin`)")


async def _received(receive: Receive) -> Receive:
    """The whole body, so that no thread waits for it."""
    body, more = bytearray(), True
    try:
        async with asyncio.timeout(REQUEST_S):
            while more and len(body) <= BODY_BYTES:
                message = await receive()
                if message["type"] == "http.disconnect":
                    raise Refusal(400, "the request ended before it was whole")
                body += message.get("body", b"")
                more = message.get("more_body", False)
    except TimeoutError:
        raise Refusal(408, f"the request did not come whole within {REQUEST_S:g} s") from None
    if len(body) > BODY_BYTES:
        raise Refusal(413, f"a request has at most {BODY_BYTES} bytes")
    messages = iter([{"type": "http.request", "body": bytes(body), "more_body": False}])

    async def whole() -> Message:
        return next(messages, None) or await receive()

    return whole
