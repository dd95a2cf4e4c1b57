"""Attacks on the page of ``mocap digitise --web``: a real server, asked over sockets by what is not its page.

Of each request one of these things becomes: it is refused (a status of 400 to 431, or closed where it is no HTTP), it
is answered, or there is a defect: an answer that was not allowed, an error of ours (500), no end (60 s). What is
allowed is judged here, apart from the page's own schema; what has not seen the last click may be refused (409). In the
end the page must answer its user, saved clicks must lie in the pictures, nothing but the address may be on the
terminal, and memory must not have grown by as much as one of the largest bodies, of 66 MB.
"""

import argparse
import csv
import json
import math
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from benchmarks.attack.mutants import NUMBERS, TEXT, damaged
from tests.mocap.digitising.filmed import NAMES, SIZE, video

SECONDS, FRAMES, LARGEST = 60.0, 6, 65_537_000
DEFECTS = ("let in", "refused wrongly", "error", "hang")
VERDICTS = ("refused", "answered", *DEFECTS)
LIMITS = {"camera": 3, "frame": FRAMES, "marker": len(NAMES)}
VALUES = (
    *(*NUMBERS, "NaN", "Infinity", "-Infinity", "1e308", "1e-400", "true", "false", "null", '"0"', "[]", "{}", "0.9"),
    *("[0]", "1.0", "-1", "3", "6", "7", "2147483648", "9" * 5000, "[" * 50_000, '{"a":' * 9000, "2 ", "02", "[5, 5]"),
    *("[NaN, 5]", "[5, 1e400]", "[1e300, 5]", "[true, 5]", '["5", 5]', "[5]", "[5, 5, 5]", "[0.5, 240.5]", "[321, 5]"),
)
"""What stands in place of a value of a click, as JSON has it or not."""
HOSTS = ("example.com", "localhost", "127.0.0.1.example.com", "127.0.0.2", "[::1]", "0.0.0.0", "127.1", "", "*")
METHODS = ("GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "QUATSCH")


class Page:
    """The command, and requests to it."""

    def __init__(self, folder: Path) -> None:
        """Film, start the command, and wait for its address."""
        where = video(folder / "films", FRAMES).folder
        self.saved = folder / "out" / "saved_clicks_xypts.csv"
        words = ["digitise", str(where / "films"), "--calibration", str(where / "calibration.toml"), "--fps", "100"]
        words += ["--skeleton", str(where / "skeleton.toml"), "--web", "--out", str(folder / "out")]
        self.log = folder / "log"
        with self.log.open("wb") as log:
            script = "from mocap.cli.main import main; main()"
            self.process = subprocess.Popen([sys.executable, "-c", script, *words], stderr=log, stdout=log)
        while (found := re.search(r"http://\S+/", self.log.read_text())) is None:
            time.sleep(0.2)
            if self.process.poll() is not None:
                raise RuntimeError(f"the page does not start: {self.log.read_text()}")
        url = urlsplit(found[0])
        self.host, self.path, self.port = url.netloc, url.path, int(url.port or 80)
        self.said = self.log.read_bytes()

    def ask(self, method: str, path: str, body: bytes = b"", **headers: str | None) -> int:
        """The status of an answer, 0: closed without one, -1: no end; headers of None are left out."""
        own = {"Host": self.host, "Origin": f"http://{self.host}", "Content-Length": str(len(body)), **headers}
        lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {text}" for name, text in own.items() if text is not None)]
        return self.raw("\r\n".join([*lines, "", ""]).encode("latin-1", "replace") + body)

    def raw(self, content: bytes) -> int:
        """The same for a request as it stands; what is not whole is closed by the page after 10 s."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=SECONDS) as one:
            with suppress(OSError):  # refused before all of it was sent: the answer may be there
                one.sendall(content)
            try:
                answer = one.recv(1 << 16)
            except TimeoutError:
                return -1
            except OSError:
                answer = b""
        return int(answer[9:12]) if answer.startswith(b"HTTP/1.1 ") else 0

    def seen(self) -> dict[str, Any]:
        """What a request that changes something says: what is open, and how many changes its page has seen."""
        request = f"GET {self.path}overview HTTP/1.1\r\nHost: {self.host}\r\nConnection: close\r\n\r\n"
        with socket.create_connection(("127.0.0.1", self.port), timeout=SECONDS) as one:
            one.sendall(request.encode())
            answer = b"".join(iter(lambda: one.recv(1 << 16), b""))
        return {"trial": "out", "edits": json.loads(answer.partition(b"\r\n\r\n")[2])["seen"][""]}

    def peak_kb(self) -> int:
        """The most memory that the process has held."""
        found = re.search(r"VmHWM:\s+(\d+)", Path(f"/proc/{self.process.pid}/status").read_text())
        return int(found[1]) if found else 0


Attack = Callable[[Page, np.random.Generator], tuple[int, bool | None]]
"""One request: its status, and whether it was allowed; None: it may be or not, as after damage."""


def without_token(page: Page, rng: np.random.Generator) -> tuple[int, bool | None]:
    """The token left out, changed by a letter, cut, in another place; with every method."""
    token, place = page.path.strip("/"), int(rng.integers(len(page.path) - 2))
    other = token[:place] + chr(int(rng.integers(97, 123))) + token[place + 1 :]
    roots = ("/", "//", f"/x/{token}/", f"/{token[:place]}/", f"/{other}/", f"/{token}x/")
    roots += (f"/%2e%2e/{token}/", f"/{token.swapcase()}/")
    root = str(rng.choice(roots))
    path = root + str(rng.choice(["", "overview", "place", "picture?camera=0&frame=0", f"?token={token}", "undo"]))
    headers = {"Cookie": f"token={token}", "Authorization": f"Bearer {token}"}
    return page.ask(str(rng.choice(METHODS)), path, b"{}", **headers), None if root == page.path else False


def other_pages(page: Page, rng: np.random.Generator) -> tuple[int, bool | None]:
    """Hosts and origins of other names, ports and schemes, with the token."""
    name = str(rng.choice([*HOSTS, "127.0.0.1"]))
    port = str(rng.choice(["", ":80", ":9999", f":{page.port}", f":{page.port}0"]))
    if rng.random() < 0.5:
        method, host, origin = "GET", f"{name}{port}", str(rng.choice([f"http://{page.host}", f"http://{name}{port}"]))
        return page.ask(method, f"{page.path}overview", Host=host, Origin=origin), host == page.host
    scheme = str(rng.choice(["http://", "https://", "file://", "", "null", "chrome-extension://"]))
    origin = None if scheme == "null" and rng.random() < 0.5 else f"{scheme}{name}{port}"
    method = str(rng.choice(["POST", "PUT", "DELETE", "OPTIONS"]))
    status = page.ask(method, f"{page.path}undo", json.dumps(page.seen()).encode(), Origin=origin)
    return status, allowed(status, origin == f"http://{page.host}" and method == "POST")


def allowed(status: int, may: bool) -> bool | None:
    """Whether a change may be made; of several at once all but one have not seen that one, and are refused."""
    return None if may and status == 409 else may


def is_click(text: bytes) -> bool:
    """Whether a click of this text may be saved: by the numbers alone."""
    try:
        given = json.loads(text)
    except (ValueError, RecursionError):
        return False
    if not isinstance(given, dict) or given.keys() != {*LIMITS, "uv_px", "trial", "edits"}:
        return False
    if given["trial"] != "out" or type(given["edits"]) is not int:
        return False
    if not all(type(given[key]) is int and 0 <= given[key] < limit for key, limit in LIMITS.items()):
        return False
    uv = given["uv_px"]
    if uv is None:
        return True
    if not isinstance(uv, list) or len(uv) != 2 or not all(type(x) in (int, float) for x in uv):
        return False
    return all(math.isfinite(x) and 0.5 <= x <= n + 0.5 for x, n in zip(uv, SIZE, strict=True))


def clicks(page: Page, rng: np.random.Generator) -> tuple[int, bool | None]:
    """A click one of whose values is another, or whose text is damaged."""
    good = {"camera": "0", "frame": "0", "marker": "0", "uv_px": "[5.5, 7]"}
    good |= {name: json.dumps(value) for name, value in page.seen().items()}
    if rng.random() < 0.7:
        good[str(rng.choice([*good, "more"]))] = str(rng.choice(VALUES))
    text = ("{" + ", ".join(f'"{key}": {value}' for key, value in good.items()) + "}").encode()
    text = text if rng.random() < 0.7 else damaged(text, str(rng.choice(["bits", "cut", "insert", "delete"])), rng)
    status = page.ask("POST", f"{page.path}place", text)
    return status, allowed(status, is_click(text))


def parameters(page: Page, rng: np.random.Generator) -> tuple[int, bool | None]:
    """Frames and cameras that there are not, and what is no number."""
    camera, frame = (str(rng.choice([*"0123456789", *NUMBERS, "%C2%B2", "true", "0.9", "9" * 5000])) for _ in range(2))
    more = str(rng.choice(["", "", "&marker=0"]))
    status = page.ask("GET", f"{page.path}picture?camera={camera}&frame={frame}{more}")
    if "-0.0" in (camera, frame):
        return status, None  # Pydantic takes it for the whole number 0, which is one
    return status, camera in [*"012"] and frame in [*"012345"] and not more


def damaged_requests(page: Page, rng: np.random.Generator) -> tuple[int, None]:
    """A good request as bytes, damaged as files are."""
    body = b'{"camera": 0, "frame": 0, "marker": 0, "uv_px": [5, 5]}'
    head = f"POST {page.path}place HTTP/1.1\r\nHost: {page.host}\r\nOrigin: http://{page.host}\r\n"
    lengths = (
        "Content-Length: -1",
        "Content-Length: 1e9",
        "Transfer-Encoding: chunked",
        f"Content-Length: {len(body)}",
    )
    length = str(rng.choice(lengths))
    kind = str(rng.choice([kind for kind in TEXT if kind not in ("columns", "frame", "unit")]))
    return page.raw(damaged(f"{head}{length}\r\n\r\n".encode() + body, kind, rng)), None


def large(page: Page, rng: np.random.Generator) -> tuple[int, bool]:
    """Bodies from one byte too many to the largest."""
    return page.ask("POST", f"{page.path}place", b" " * int(LARGEST * 10 ** rng.uniform(-3, 0))), False


ATTACKS: dict[str, tuple[Attack, int]] = {
    "without the token": (without_token, 1),
    "other hosts and origins": (other_pages, 1),
    "clicks": (clicks, 1),
    "parameters": (parameters, 1),
    "damaged requests": (damaged_requests, 1),
    "large bodies": (large, 50),
}
"""Kinds of attack, and one of how many cases is made of each."""


def verdict(status: int, allowed: bool | None) -> str:
    """What became of a request."""
    if status < 0:
        return "hang"
    if status >= 500:
        return "error"
    if 200 <= status < 300:
        return "let in" if allowed is False else "answered"
    return "refused wrongly" if allowed else "refused"


def run(options: argparse.Namespace) -> int:
    """Attack the page, 64 requests at once; print a table; the number of defects."""
    each, rows, broken = 10 if options.quick else options.cases // 10, [], 0
    with tempfile.TemporaryDirectory() as place:
        page = Page(Path(place))
        try:
            first = {"camera": 0, "frame": 0, "marker": 0, "uv_px": [5, 5], **page.seen()}
            page.ask("POST", f"{page.path}place", json.dumps(first).encode())
            page.ask("GET", f"{page.path}picture?camera=0&frame=0")
            before = page.peak_kb()
            for k, (name, (attack, rare)) in enumerate(ATTACKS.items()):
                with ThreadPoolExecutor(64) as many:
                    cases = [np.random.default_rng((options.seed, k, i)) for i in range(max(each // rare, 4))]
                    found = list(many.map(lambda rng, attack=attack: verdict(*attack(page, rng)), cases))
                counts = Counter(found)
                rows.append({"attack": name, "requests": len(found), **{v: counts[v] for v in VERDICTS}})
                broken += sum(counts[v] for v in DEFECTS)
            wrong = after(page, before)
        finally:
            page.process.kill()
            page.process.wait()
    print("  ".join(f"{title:>{max(len(title), 8)}}" for title in rows[0]))
    for row in rows:
        print("  ".join(f"{value:>{max(len(title), 8)}}" for title, value in row.items()))
    for text in wrong:
        print(text)
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        with (options.out / "page.csv").open("w", newline="", encoding="utf-8") as stream:
            table = csv.DictWriter(stream, rows[0])
            table.writeheader()
            table.writerows(rows)
    return broken + len(wrong)


def after(page: Page, before_kb: int) -> list[str]:
    """What is wrong when all is over."""
    wrong: list[Any] = []
    if page.ask("GET", f"{page.path}overview") != 200:
        wrong.append("the page does not answer its user")
    if (grown := page.peak_kb() - before_kb) > LARGEST / 1000:
        wrong.append(f"the process took {grown / 1000:.0f} MB more")
    if page.log.read_bytes() != page.said:
        wrong.append(f"on the terminal: {page.log.read_text()[-300:]}")
    values = np.genfromtxt(page.saved, delimiter=",", skip_header=1)
    if not (np.isnan(values) | ((values >= 0.5) & (values <= max(SIZE) + 0.5))).all():
        wrong.append("clicks outside of the pictures were saved")
    print(f"memory: {before_kb / 1000:.0f} MB, {grown / 1000:.1f} MB more at the end")
    return wrong
