"""What stands before every page: who may ask, how much, and what an answer forbids others to do with it."""

import asyncio
import json

import numpy as np
import pytest
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from mocap.web import guard as module
from mocap.web.guard import Guard
from mocap.web.tasks import Query, page, task

HOST, TOKEN = "127.0.0.1:8000", "t0-ken_" * 6
ORIGIN = {"Origin": f"http://{HOST}"}


class Number(Query):
    """A request."""

    number: float


def app():
    """What is done is counted in ``state.done``; ``/fault`` has an error of its own."""

    def work(given):
        made.state.done.append(given.number)
        return PlainTextResponse(f"{given.number:g}")

    def fault(_):
        raise ZeroDivisionError("of the application")

    async def socket(one):
        await one.accept()
        await one.send_text("open")
        await one.close()

    made = page(
        [
            task("/read", Number, work),
            task("/change", Number, work, changes=True),
            Route("/fault", fault),
            Route(
                "/framed", lambda _: PlainTextResponse("", headers={"Content-Security-Policy": "default-src 'self'"})
            ),
            WebSocketRoute("/socket", socket),
        ]
    )
    made.state.done = []
    return made


@pytest.fixture
def guarded():
    """The application, and a client before its guard."""
    made = app()
    return made, TestClient(Guard(made, host=HOST, token=TOKEN), base_url=f"http://{HOST}")


def test_the_page_itself_is_answered(guarded):
    """With the token in the path, the host and the origin, reading and changing work; HEAD is GET without a body."""
    made, client = guarded
    assert client.get(f"/{TOKEN}/read?number=1").text == "1"
    assert client.post(f"/{TOKEN}/change", json={"number": 2}, headers=ORIGIN).text == "2"
    assert client.head(f"/{TOKEN}/read?number=3").status_code == 200
    assert made.state.done == [1, 2, 3]


@pytest.mark.parametrize(
    "path",
    [
        "/read",
        "/",
        "",
        f"/{TOKEN}x/read",
        f"/{TOKEN[:-1]}/read",
        f"/{TOKEN.upper()}/read",
        f"//{TOKEN}/read",
        f"/read/{TOKEN}",
        f"/read?token={TOKEN}&number=1",
        f"/x%2F..%2F{TOKEN}/read",
        "/" + "%C2%B2" * 40 + "/read",
        f"/{TOKEN}%00/read",
    ],
)
def test_a_token_elsewhere_is_none(guarded, path):
    """Wrong, cut, in another place, as a header or a cookie: refused, whether there is such a path or not."""
    made, client = guarded
    client.cookies = {"token": TOKEN}
    headers = {**ORIGIN, "Authorization": f"Bearer {TOKEN}", "X-Token": TOKEN}
    for method in ("GET", "POST", "HEAD"):
        assert client.request(method, path, headers=headers).status_code == 403
    assert not made.state.done


@pytest.mark.parametrize(
    "host",
    [
        *("example.com", "example.com:8000", "localhost:8000", "127.0.0.1", "127.0.0.1:8001", "[::1]:8000", ""),
        *("127.0.0.1:8000.example.com", "127.1:8000", "0.0.0.0:8000"),
    ],
)
def test_another_name_is_refused(guarded, host):
    """DNS rebinding: the name of a foreign page that leads to this computer comes as ``Host``."""
    made, client = guarded
    for headers in ({"Host": host}, {"Host": host, "Origin": f"http://{host}"}):
        assert client.get(f"/{TOKEN}/read?number=1", headers=headers).status_code == 403
        assert client.post(f"/{TOKEN}/change", json={"number": 2}, headers=headers).status_code == 403
    assert not made.state.done


@pytest.mark.parametrize(
    "origin",
    [
        *(
            None,
            "null",
            "",
            "http://127.0.0.1",
            "http://127.0.0.1:9999",
            "https://127.0.0.1:8000",
            "http://localhost:8000",
        ),
        *(
            "http://127.0.0.1:8000.evil.com",
            "http://127.0.0.1:80000",
            "http://127.0.0.1:8000/",
            "HTTP://127.0.0.1:8000",
        ),
    ],
)
def test_changes_come_from_the_page(guarded, origin):
    """Another port, scheme or name is another page, also with the token; so is one that does not say which it is."""
    made, client = guarded
    headers = {} if origin is None else {"Origin": origin}
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "QUATSCH"):
        answer = client.request(method, f"/{TOKEN}/change", content=b'{"number": 2}', headers=headers)
        assert answer.status_code == 403, method
    with pytest.raises(WebSocketDisconnect), client.websocket_connect(f"/{TOKEN}/socket", headers=headers):
        pass
    both = [*ORIGIN.items(), ("Origin", origin or "null")]
    assert client.post(f"/{TOKEN}/change", json={"number": 2}, headers=both).status_code == 403
    assert not made.state.done


def test_other_methods_are_not_allowed(guarded):
    """Of the page itself, too."""
    made, client = guarded
    for method in ("PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "QUATSCH"):
        for path in ("read?number=1", "change"):
            answer = client.request(method, f"/{TOKEN}/{path}", content=b'{"number": 2}', headers=ORIGIN)
            assert answer.status_code == 405
    assert client.get(f"/{TOKEN}/change").status_code == 405
    assert client.post(f"/{TOKEN}/read", headers=ORIGIN).status_code == 405
    assert not made.state.done


def test_sockets_have_the_same_guard(guarded):
    """The next page may open one: with token and origin it does, without the token not."""
    _, client = guarded
    with client.websocket_connect(f"/{TOKEN}/socket", headers={**ORIGIN, "Host": HOST}) as socket:
        assert socket.receive_text() == "open"
    with pytest.raises(WebSocketDisconnect), client.websocket_connect("/socket", headers={**ORIGIN, "Host": HOST}):
        pass


def test_every_answer_forbids_the_same(guarded):
    """Refusals and errors, too: no frames, kinds, copies, no referrer; also with a policy of its own."""
    _, client = guarded
    client = TestClient(client.app, base_url=f"http://{HOST}", raise_server_exceptions=False)
    paths = ("read?number=1", "read", "nowhere", "fault", "framed", "../x")
    answers = [client.get(f"/{TOKEN}/{path}") for path in paths]
    answers.append(client.get("/"))
    assert {answer.status_code for answer in answers} == {200, 400, 403, 404, 500}
    for answer in answers:
        assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
        assert answer.headers["X-Frame-Options"] == "DENY"
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Cache-Control"] == "no-store"
        assert answer.headers["Referrer-Policy"] == "no-referrer"
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert TOKEN not in answer.text + str(answer.headers)
        if answer.status_code != 200:
            assert len(answer.json()["said"].splitlines()) == 1


def test_an_error_of_the_page_is_one_line(guarded):
    """Which, where, and that it is ours; the connection is not dropped."""
    _, client = guarded
    said = client.get(f"/{TOKEN}/fault").json()["said"]
    assert said.startswith("ZeroDivisionError at test_web_guard.py:")


@pytest.mark.parametrize("length", [None, "100", "-1", "x", "9" * 5000])
def test_a_large_body_is_not_read(length):
    """Whatever it says of its length, no more is taken than the limit and one message; the application sees nothing."""
    made, taken = app(), 0

    async def receive():
        nonlocal taken
        taken += 1
        return {"type": "http.request", "body": b" " * 10_000, "more_body": True}

    answers = asyncio.run(asked(made, receive, [] if length is None else [(b"content-length", length.encode())]))
    assert answers[0]["status"] == 413
    assert (b"connection", b"close") in answers[0]["headers"]
    assert taken == module.BODY_BYTES // 10_000 + 1
    assert not made.state.done


def test_a_body_that_does_not_come_is_given_up(monkeypatch):
    """One byte at a time, or none at all: the answer is that it came too late."""
    monkeypatch.setattr(module, "REQUEST_S", 0.2)

    async def slow():
        await asyncio.sleep(0.02)
        return {"type": "http.request", "body": b" ", "more_body": True}

    async def never():
        await asyncio.Event().wait()

    for receive in (slow, never):
        assert asyncio.run(asked(app(), receive, []))[0]["status"] == 408


def test_a_request_that_is_cut_is_none():
    """What came so far would be one by itself, but its end did not come: nothing is done."""
    made = app()
    messages = iter(
        [{"type": "http.request", "body": b'{"number": 1}', "more_body": True}, {"type": "http.disconnect"}]
    )

    async def receive():
        return next(messages)

    assert asyncio.run(asked(made, receive, []))[0]["status"] == 400
    assert not made.state.done


async def asked(made, receive, headers):
    """Messages that the guarded application sends when it is asked for a change."""
    sent = []

    async def send(message):
        sent.append(message)

    scope = {
        "type": "http",
        "method": "POST",
        "path": f"/{TOKEN}/change",
        "query_string": b"",
        "headers": [(b"host", HOST.encode()), (b"origin", f"http://{HOST}".encode()), *headers],
    }
    await Guard(made, host=HOST, token=TOKEN)(scope, receive, send)
    return sent


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            "{",
            "null",
            "[]",
            "3",
            '"x"',
            "[" * 50_000,
            '{"number":' * 5_000,
            '{"number": NaN}',
            '{"number": Infinity}',
        ),
        *('{"number": 1e400}', '{"number": -1e400}', '{"number": true}', '{"number": "1"}', '{"number": null}', "{}"),
        *(
            '{"number": 1, "more": 2}',
            '{"number": ' + "1" * 60_000 + "}",
            '{"number": [1]}',
            "\ufeff{}",
            '{"number": 1}x',
        ),
    ],
)
def test_what_has_another_shape_is_refused(guarded, text):
    """In one line that says where and what came, however deep or long it is."""
    made, client = guarded
    answer = client.post(f"/{TOKEN}/change", content=text.encode(), headers=ORIGIN)
    assert answer.status_code == 400
    said = answer.json()["said"]
    assert "\n" not in said
    assert len(said) < 400
    assert not made.state.done


@pytest.mark.parametrize(
    "query",
    [
        *("", "number=", "number=%C2%B2", "number=nan", "number=inf", "number=1e400", "more=1&number=1"),
        "number=" + "9" * 6000 + "x",
    ],
)
def test_parameters_have_the_same_schema(guarded, query):
    """Digits of other scripts, numbers that are none, parameters that nobody asked for."""
    made, client = guarded
    answer = client.get(f"/{TOKEN}/read?{query}")
    assert answer.status_code == 400
    assert len(answer.json()["said"]) < 400
    assert not made.state.done


@pytest.mark.parametrize(
    ("error", "status", "told"),
    [
        (SystemExit(3), 500, "SystemExit"),
        (np.linalg.LinAlgError("Singular matrix"), 409, "equations without a solution"),
        (MemoryError("Unable to allocate 31.6 GiB"), 409, "not enough memory"),
        (
            OSError(28, "No space left on device", "/a/edits.jsonl"),
            409,
            "the disk is full, or your quota is used up (/a/ed",
        ),
        (OSError(30, "Read-only file system", "/a/edits.jsonl"), 409, "/a/edits.jsonl: Read-only file system"),
        (KeyError("x"), 500, "error in mocap"),
    ],
)
def test_an_error_is_told_with_who_is_at_fault(error, status, told):
    """In one line, and the page answers the next request."""

    def fails(_):
        raise error

    made = page([task("/fails", Query, fails), task("/works", Query, lambda _: PlainTextResponse("whole"))])
    with TestClient(Guard(made, host=HOST, token=TOKEN), base_url=f"http://{HOST}") as client:
        answer = client.get(f"/{TOKEN}/fails")
        assert (answer.status_code, told in answer.json()["said"]) == (status, True), answer.text
        assert ("error in mocap" in answer.json()["said"]) == (status == 500)
        assert client.get(f"/{TOKEN}/works").text == "whole"


def test_the_body_is_what_was_sent(guarded):
    """A body in parts is whole before the application sees it."""
    _, client = guarded
    parts = (json.dumps({"number": 2.5})[i : i + 3].encode() for i in range(0, 20, 3))
    assert client.post(f"/{TOKEN}/change", content=parts, headers=ORIGIN).text == "2.5"
