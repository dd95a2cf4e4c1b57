"""The server of a page, seen from its socket: nothing waits for ever, and it ends with its command."""

import logging
import os
import re
import signal
import socket
import stat
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import httpx2
import psutil
import pytest
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from mocap.errors import MocapError
from mocap.web import server
from mocap.web.server import Behind, forwarded, served
from mocap.web.tasks import Query, page, task
from tests.mocap.digitising.filmed import video

LARGE = 64_000_000
"""More than the system keeps of an answer that is not read."""


class Nothing(Query):
    """A request that says nothing."""


def small():
    """A page with a large answer, and one that takes what is posted."""
    return page(
        [
            Route("/", lambda _: PlainTextResponse("whole")),
            Route("/large", lambda _: PlainTextResponse("x" * LARGE)),
            task("/post", Nothing, lambda _: PlainTextResponse("taken"), changes=True),
        ]
    )


@pytest.fixture
def quick(monkeypatch):
    """Limits of time that a test can wait for."""
    monkeypatch.setattr(server, "REQUEST_S", 0.5)
    monkeypatch.setattr(server, "ANSWER_S", 0.5)
    monkeypatch.setattr("mocap.web.guard.REQUEST_S", 0.5)
    monkeypatch.setattr(server.uvicorn, "Config", partial(server.uvicorn.Config, timeout_keep_alive=0.5))


def connected(address):
    url = urlsplit(address)
    return socket.create_connection((url.hostname, url.port), timeout=600)


def until_closed(one):
    """What comes until the other side closes; an error where it does not within ten minutes."""
    parts = []
    try:
        while part := one.recv(1 << 20):
            parts.append(part)
    except ConnectionError:
        pass
    return b"".join(parts)


def refused(one, data, *, most=1000, pause_s=0.05):
    """Whether the other side closes before so much was sent."""
    try:
        for _ in range(most):
            one.sendall(data)
            time.sleep(pause_s)
    except ConnectionError:
        return True
    return False


def asked(address, text, *, headers=""):
    """The answer to a request as it stands."""
    url = urlsplit(address)
    head = text.replace("PATH", url.path) + f"\r\nHost: {url.netloc}\r\nOrigin: http://{url.netloc}\r\n{headers}\r\n"
    with connected(address) as one:
        one.sendall(head.encode("latin-1"))
        return until_closed(one)


NO_REQUESTS = [
    ("POST PATHpost HTTP/1.1", "Content-Length: -1\r\n"),
    ("POST PATHpost HTTP/1.1", "Content-Length: 1e3\r\n"),
    ("POST PATHpost HTTP/1.1", "Content-Length: 1\r\nContent-Length: 2\r\n"),
    ("POST PATHpost HTTP/1.1", "Content-Length: " + "9" * 400 + "\r\n"),
    ("POST PATHpost HTTP/1.1", "Transfer-Encoding: gzip\r\n"),
    ("POST PATHpost HTTP/1.1", "Transfer-Encoding: chunked\r\n\r\nzz\r\n"),
    ("GET PATH HTTP/1.1", "Host: 127.0.0.1\r\n"),
    ("GET PATH HTTP/1.1", "X: " + "x" * 20_000 + "\r\n"),
    ("GET PATH?" + "x" * 20_000 + " HTTP/1.1", ""),
    ("GET PATH", ""),
    ("G\x00T PATH HTTP/1.1", ""),
    ("GET PATH\xc2\xb2 HTTP/1.1", ""),
    ("\x16\x03\x01\x02\x00", ""),
]


def test_what_is_no_request_is_answered(capfd):
    """With status 400; nothing is written on the terminal, and the next request finds the page."""
    with served(small()) as site, httpx2.Client() as client:
        for first, headers in NO_REQUESTS:
            assert asked(site.address, first, headers=headers).startswith(b"HTTP/1.1 4"), (first, headers)
            assert client.get(site.address).text == "whole"
    assert capfd.readouterr() == ("", "")


@pytest.mark.usefixtures("quick")
def test_a_head_that_does_not_come_is_given_up():
    """Nothing, a part, or a byte now and then: the connection is closed, also after a request before it."""
    with served(small()) as site:
        path, host = urlsplit(site.address).path, urlsplit(site.address).netloc
        before = f"GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n"
        with ExitStack() as every:  # each waits for its end, all at once
            ones = []
            for sent in ("", "G", "GET PATH HTTP/1.1\r\nHost: x\r\n", "GET PATH HTTP/1.1\r\nX: x"):
                for text in (sent, before + sent):
                    ones.append(every.enter_context(connected(site.address)))
                    ones[-1].sendall(text.replace("PATH", path).encode())
            for one in ones:
                until_closed(one)
        with connected(site.address) as one:
            assert refused(one, b"x")


@pytest.mark.usefixtures("quick")
def test_a_body_that_does_not_come_is_answered():
    """A length that is not kept: 408, and the connection is closed."""
    with served(small()) as site:
        path, host = urlsplit(site.address).path, urlsplit(site.address).netloc
        head = f"POST {path}post HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nContent-Length: 2\r\n\r\n{{"
        with connected(site.address) as one:
            one.sendall(head.encode())
            assert until_closed(one).startswith(b"HTTP/1.1 408")


@pytest.mark.usefixtures("quick")
def test_an_answer_that_is_not_read_is_given_up():
    """The connection is closed before all of it is through."""
    with served(small()) as site:
        path, host = urlsplit(site.address).path, urlsplit(site.address).netloc
        with connected(site.address) as one:
            one.sendall(f"GET {path}large HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
            assert refused(one, b"x")
            assert len(until_closed(one)) < LARGE


def test_one_connection_too_many_is_refused(monkeypatch):
    """With status 503; when the others are closed, the page answers again."""
    monkeypatch.setattr(server, "CONNECTIONS", 4)
    with served(small()) as site:
        idle = [connected(site.address) for _ in range(4)]
        with connected(site.address) as one:
            assert until_closed(one).startswith(b"HTTP/1.1 503")
        for one in idle:
            one.close()
        while (answer := httpx2.get(site.address)).status_code == 503:
            time.sleep(0.05)
        assert answer.text == "whole"


def test_pages_do_not_know_each_other():
    """Each has a token of its own."""
    with served(small()) as one, served(small()) as other:
        tokens = [urlsplit(site.address).path.strip("/") for site in (one, other)]
        assert len(set(tokens)) == 2
        assert all(re.fullmatch(r"[\w-]{43}", token) for token in tokens)  # 256 bits
        assert httpx2.get(one.address.replace(*tokens)).status_code == 403


def test_the_token_is_in_no_log(caplog):
    """Whatever level is set: of answers, refusals and errors."""
    caplog.set_level(logging.DEBUG)
    with served(small()) as site:
        for path in ("", "post", "nowhere", "../x", "?" + "x" * 20_000):
            httpx2.get(site.address + path)
        token = urlsplit(site.address).path.strip("/")
        server_lines = [record.getMessage() for record in caplog.records if not record.name.startswith("http")]
    assert token not in "\n".join(server_lines)


def test_a_port_that_is_taken_is_an_error():
    """In one line, with what to do."""
    with served(small()) as site:
        port = urlsplit(site.address).port
        with pytest.raises(MocapError, match=f"`port`: {port} cannot be used"), served(small(), port=port):
            pass
    with served(small(), port=port) as site:  # free again at once
        assert httpx2.get(site.address).text == "whole"


def test_work_that_goes_on_does_not_hold_up_the_end():
    """A task that does not end is left behind."""
    begun, forever = threading.Event(), threading.Event()

    def work(_):
        begun.set()
        forever.wait()
        return PlainTextResponse("")

    with served(page([task("/", Nothing, work)])) as site, connected(site.address) as one:
        url = urlsplit(site.address)
        one.sendall(f"GET {url.path} HTTP/1.1\r\nHost: {url.netloc}\r\n\r\n".encode())
        assert begun.wait(600)
    forever.set()


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    return video(tmp_path_factory.mktemp("page"), 3).folder


COMMAND = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # as a shell has it, however the tests were started
from mocap.cli.main import main
main()
"""
CHILD = """
import os, sys
from starlette.responses import PlainTextResponse
from starlette.routing import Route
from mocap.web.server import Behind, forwarded, served
from mocap.web.tasks import page
with served(page([Route("/", lambda _: PlainTextResponse("whole"))])) as site:
    print(site.address, os.getpid(), file=sys.stderr, flush=True)
    site.wait(idle_s=float(sys.argv[1]) if len(sys.argv) > 1 else None)
print("ended:", site.why, file=sys.stderr, flush=True)
"""
PARENT = "import subprocess, sys; subprocess.call([sys.executable, '-c', sys.argv[1]])"


def started(*words):
    """A process of Python that serves a page, and the address it wrote."""
    process = subprocess.Popen([sys.executable, "-c", *words], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    line = process.stderr.readline()
    found = re.search(r"http://127\.0\.0\.1:\d+/[\w-]+/", line)
    assert found, line
    return process, found[0]


def gone(address):
    """Wait until nothing listens there."""
    while True:
        try:
            connected(address).close()
        except OSError:
            return
        time.sleep(0.1)


def test_the_page_stays_when_its_parent_ends():
    """As of ``nohup``, ``setsid``, a notebook: it is ended by a signal, and says so, without a traceback."""
    process, address = started(PARENT, CHILD)
    try:
        process.kill()
        process.wait(60)
        time.sleep(1.5)  # it was looked for twice a second
        assert httpx2.get(address).text == "whole"
        (child,) = [one for one in psutil.process_iter(["cmdline"]) if CHILD in (one.info["cmdline"] or ())]
        child.terminate()
        assert process.stderr.read() == "ended: SIGTERM\n"  # to its end
        gone(address)
    finally:
        process.kill()
        process.communicate(timeout=60)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_ends_the_page_unless_it_is_ignored(name):
    """It is told which; a page that is started with the signal ignored, as by ``nohup``, goes on."""
    ignored = f"import signal\nsignal.signal(signal.{name}, signal.SIG_IGN)\n"
    default = f"import signal\nsignal.signal(signal.{name}, signal.SIG_DFL)\n"
    for script, ends in ((default + CHILD, True), (ignored + CHILD, False)):
        process, address = started(script)
        try:
            process.send_signal(getattr(signal, name))
            if ends:
                assert process.wait(60) == 0
                assert process.stderr.read() == f"ended: {name}\n"
            else:
                time.sleep(1.0)
                assert httpx2.get(address).text == "whole"
        finally:
            process.kill()
            process.communicate(timeout=60)


@pytest.mark.parametrize("ends", ["SIGTERM", "its button End"])
def test_a_signal_gives_up_what_the_page_is_prepared_with(ends):
    """What is imported before the page waits is not gone on with; the button, which no signal is, waits for it."""
    prepared = "import time\nfor _ in range(20):\n    time.sleep(0.1)\nprint('prepared', file=sys.stderr)\n"
    script = CHILD.replace("    site.wait(", textwrap.indent(prepared, "    ") + "    site.wait(")
    process, address = started(script)
    try:
        if ends == "SIGTERM":
            process.terminate()
        else:
            httpx2.post(address + "end", headers={"Origin": address.rsplit("/", 2)[0]})
        assert process.wait(60) == 0
        assert process.stderr.read() == ("" if ends == "SIGTERM" else "prepared\n") + f"ended: {ends}\n"
    finally:
        process.kill()
        process.communicate(timeout=60)


def test_the_button_ends_the_page():
    """Of the page alone: not by what only reads, and not from another one."""
    process, address = started(CHILD)
    try:
        host = address.rsplit("/", 2)[0]
        assert httpx2.get(address + "end").status_code == 404
        assert httpx2.post(host + "/end", headers={"Origin": host}).status_code == 403
        assert httpx2.post(address + "end", headers={"Origin": "http://example.com"}).status_code == 403
        assert process.poll() is None
        assert httpx2.post(address + "end", headers={"Origin": host}).json() == {"said": "ended"}
        assert process.wait(60) == 0
        assert process.stderr.read() == "ended: its button End\n"
    finally:
        process.kill()
        process.communicate(timeout=60)


def test_an_idle_page_ends_where_that_is_asked_for():
    """So long after its last request; one of a stranger is none."""
    process, address = started(CHILD, "2")
    try:
        begun = time.monotonic()
        while time.monotonic() - begun < 4:
            assert httpx2.get(address).text == "whole"
            time.sleep(0.2)
        host = address.rsplit("/", 2)[0]
        end = time.monotonic() + 60
        with suppress(httpx2.TransportError):
            while time.monotonic() < end:
                assert httpx2.get(host + "/").status_code == 403
                time.sleep(0.2)
        assert process.wait(60) == 0
        assert process.stderr.read() == "ended: no request came for 2 s\n"
    finally:
        process.kill()
        process.communicate(timeout=60)


def test_what_goes_on_without_a_request_is_not_idle():
    """It ends when that does."""
    looks = iter([True, True, False])
    with served(page([])) as site:
        assert site.wait(idle_s=0.01, works=lambda: next(looks)) == "no request came for 0.01 s"
    assert not list(looks)


@pytest.mark.skipif(os.name != "posix", reason="Windows has other rights")
def test_a_browser_is_forwarded_by_a_file_of_this_user():
    """What the browser gets as an argument holds no secret; the file is gone at the end."""
    with forwarded("http://127.0.0.1:1/secret/") as link:
        path = Path(urlsplit(link).path)
        assert "secret" not in link
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
        assert 'content="0; url=http://127.0.0.1:1/secret/"' in path.read_text()
    assert not path.exists()


@pytest.mark.rare
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from /proc")
def test_a_large_post_takes_no_memory_and_ctrl_c_ends_the_command(films, tmp_path):
    """1.5 GB, declared or in chunks, with the token: refused, and what the process holds at most stays as it was.

    Within 8 MB: the guard keeps 64 kB, asyncio reads 256 kB at once, h11 16 kB. At Ctrl-C it ends in order: exit 0.
    """
    words = ["digitise", films / "films", "--calibration", films / "calibration.toml", "--skeleton"]
    words += [films / "skeleton.toml", "--fps", "100", "--web", "--out", tmp_path / "out"]
    process, address = started(COMMAND, *map(str, words))
    try:
        httpx2.get(address + "overview")
        before = peak_kb(process)
        url, body = urlsplit(address), b" " * 1_000_000
        host = f"Host: {url.netloc}\r\nOrigin: http://{url.netloc}\r\n"
        for length, part in (
            ("Content-Length: 1500000000", body),
            ("Transfer-Encoding: chunked", b"f4240\r\n" + body + b"\r\n"),
        ):
            with connected(address) as one:
                one.sendall(f"POST {url.path}click HTTP/1.1\r\n{host}{length}\r\n\r\n".encode())
                assert refused(one, part, most=1500, pause_s=0)
            assert httpx2.get(address + "overview").status_code == 200
            assert peak_kb(process) - before < 8_000, length
        assert httpx2.get(address + "open?trial=").json()["n_frames"] == 3
        process.send_signal(signal.SIGINT)
        assert process.wait(600) == 0
        gone(address)
    finally:
        process.kill()
        process.communicate()


def peak_kb(process):
    found = re.search(r"VmHWM:\s+(\d+)", Path(f"/proc/{process.pid}/status").read_text())
    assert found
    return int(found[1])


def test_a_page_is_there_before_what_answers_it():
    """What is asked for meanwhile is answered when that is there; the page itself is read once and goes on."""
    first = Route("/", lambda _: PlainTextResponse("starting"))
    behind = Behind(first)
    with served(behind) as site, ThreadPoolExecutor(1) as other, httpx2.Client(base_url=site.address) as browser:
        waits = other.submit(browser.get, "number")
        assert browser.get("").text == "starting"
        assert not waits.done()
        behind.becomes(page([Route("/number", lambda _: PlainTextResponse("7"))]))
        assert waits.result(10).text == "7"
        assert browser.get("").status_code == 404  # the application has no page of its own


def test_the_desk_is_shown_before_anything_is_imported_that_takes_long():
    """numpy, pandas and all that stands on them come after the address."""
    late = ("numpy", "pandas", "xarray", "cv2", "pydantic")
    before = "import mocap.cli.main, mocap.cli.desk, mocap.desk.shell, mocap.web.server, sys; "
    found = f"print([name for name in {late} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", before + found], capture_output=True, text=True).stdout == "[]\n"
