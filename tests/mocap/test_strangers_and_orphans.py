"""Long commands as others on the computer see them, and what is left of one that is killed: the real commands."""

import json
import os
import re
import signal
import socket
import stat
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest
from mocap.datasets import make_bat, write_recording

import mocap
from tests.mocap.digitising.filmed import video

pytestmark = pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="sockets are listed in /proc")

COMMAND = "if __name__ == '__main__': from mocap.cli.main import main; main()"
SOON_S = 300.0
"""Work has begun by then, on a computer that others load, too."""
LEFT_S = 10.0
"""What a command started has ended by then, when it has."""
LISTENS = "0A"
"""The state of a TCP socket that listens, in /proc/net/tcp."""
ACCEPTS = 0x10000
"""The flag of a Unix socket that listens, in /proc/net/unix."""
NOBODY = 65534


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Two of a simulated bat, each with its calibration and skeleton."""
    folder = tmp_path_factory.mktemp("flights")
    for seed in (1, 2):
        write_recording(make_bat(seed=seed, n_frames=120, n_cameras=3), folder / f"t{seed}", others=False)
    return folder


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    return video(tmp_path_factory.mktemp("films"), 3).folder


class Running:
    """A command, all that it starts, and what it said."""

    def __init__(self, log, *words, **environment):
        """Start it."""
        self.log = log
        variables = {**os.environ, "OMP_NUM_THREADS": "1", "MOCAP_JOBS": "2", **environment}
        with log.open("wb") as said:
            line = [sys.executable, "-c", COMMAND, *map(str, words)]
            self.process = subprocess.Popen(line, stdout=said, stderr=said, env=variables)

    def tree(self):
        """The command and all that it started."""
        with suppress(psutil.NoSuchProcess):
            own = psutil.Process(self.process.pid)
            return [own, *own.children(recursive=True)]
        return []

    def until(self, what):
        """Wait until something is so; what that gives."""
        end = time.monotonic() + SOON_S
        while not (found := what()):
            assert self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < end, self.log.read_text()
            time.sleep(0.1)
        return found

    def address(self):
        """Of its page."""
        return self.until(lambda: re.search(r"http://(127\.0\.0\.1:(\d+))/([\w-]+)/", self.log.read_text()))


@contextmanager
def running(log, *words, **environment):
    """A command, and nothing of it at the end."""
    command = Running(log, *words, **environment)
    started = []
    try:
        yield command
        started = command.tree()
    finally:
        for process in {*started, *command.tree()}:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        command.process.wait(60)


def inodes(process):
    """Of the sockets that a process has open."""
    found = set()
    with suppress(OSError):
        for entry in os.scandir(f"/proc/{process.pid}/fd"):
            with suppress(OSError):
                found |= set(re.findall(r"socket:\[(\d+)\]", os.readlink(entry.path)))
    return found


def listening(processes):
    """The ports that processes listen at, of any address, and their Unix sockets ("" where one has no file)."""
    own = set().union(*map(inodes, processes))
    ports, files = set(), set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            cells = line.split()
            if cells[3] == LISTENS and cells[9] in own:
                ports.add((table, cells[1].split(":")[0], int(cells[1].split(":")[1], 16)))
    for line in Path("/proc/net/unix").read_text().splitlines()[1:]:
        cells = line.split()
        if int(cells[3], 16) & ACCEPTS and cells[6] in own:
            files.add(cells[7] if len(cells) > 7 else "")
    return ports, files


def arguments(processes):
    """All that anybody can read of processes in /proc."""
    found = []
    for process in processes:
        with suppress(psutil.NoSuchProcess, psutil.AccessDenied):
            found.append(" ".join(process.cmdline()))
    return "\n".join(found)


def only_ours(files):
    """Whether no other user reaches these Unix sockets: each lies in a folder of this user alone."""
    return all(
        file.startswith("/") and stat.S_IMODE(Path(file).parent.stat().st_mode) == 0o700
        for file in files
        if not file.startswith("/") or Path(file).exists()
    )


def asked(port, text):
    """What a port answers to a text."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as one:
        one.sendall(text.encode())
        answer = one.recv(1 << 16)
        while b"Connection: close" in text.encode() and (more := one.recv(1 << 16)):
            answer += more
        return answer.decode("latin-1")


ASK = """
import socket, sys
one = socket.create_connection(("127.0.0.1", int(sys.argv[1])), timeout=30)
one.sendall(sys.argv[2].encode())
sys.stdout.write(one.recv(1 << 16).decode("latin-1"))
"""


def asked_by_another(port, text):
    """The same as another user of the computer."""
    line = ["/usr/bin/env", "python3", "-c", ASK, str(port), text]
    done = subprocess.run(line, capture_output=True, text=True, timeout=60, user=NOBODY, cwd="/", check=True)
    return done.stdout


def refuses_strangers(page):
    """Nothing is answered to who lacks the token, comes by another name, or is another user."""
    host, port, token = page[1], int(page[2]), page[3]
    strangers = {
        "no token": f"GET / HTTP/1.1\r\nHost: {host}\r\n\r\n",
        "a path": f"GET /overview HTTP/1.1\r\nHost: {host}\r\n\r\n",
        "another token": f"GET /{token[::-1]}/ HTTP/1.1\r\nHost: {host}\r\n\r\n",
        "another name": f"GET /{token}/ HTTP/1.1\r\nHost: evil.example\r\n\r\n",
        "another origin": f"POST /{token}/end HTTP/1.1\r\nHost: {host}\r\nOrigin: http://evil.example\r\n"
        "Content-Length: 2\r\n\r\n{}",
    }
    for who, text in strangers.items():
        assert asked(port, text).startswith("HTTP/1.1 403 "), who
        assert "recordings" not in asked(port, text)
    if os.getuid() == 0:
        assert asked_by_another(port, strangers["no token"]).startswith("HTTP/1.1 403 ")
    assert asked(port, f"GET /{token}/overview HTTP/1.1\r\nHost: {host}\r\n\r\n").startswith("HTTP/1.1 200 ")


def words_of(flights, tmp_path, name):
    """The command of that name, with work for long enough."""
    first, *_ = sorted(flights.glob("t1/*_xypts.csv"))
    second, *_ = sorted(flights.glob("t2/*_xypts.csv"))
    stem = str(first).removesuffix("_xypts.csv")
    read = ["--calibration", f"{stem}_dltCoefs.csv", "--profile", f"{stem}_camera_profile.txt"]
    read += ["--skeleton", f"{stem}_skeleton.toml", "--fps", 240]
    return {
        "track": ["track", first, *read, "--out", tmp_path / "out"],
        "learn": ["learn", first, second, *read, "--out", tmp_path / "model.npz"],
        "batch": ["batch", flights, "--fps", 240, "--jobs", 2, "--out", tmp_path / "out"],
        "desk": ["desk", flights, "--fps", 240, "--jobs", 2, "--out", tmp_path / "out"],
    }[name]


def begin(command, name):
    """Wait until a command works in processes of its own (of the desk: after Track); where its page is."""
    page = command.address() if name == "desk" else None
    if page is not None:
        head = f"Host: {page[1]}\r\nOrigin: http://{page[1]}\r\n"
        overview = asked(int(page[2]), f"GET /{page[3]}/overview HTTP/1.1\r\n{head}Connection: close\r\n\r\n")
        seen = json.loads(overview.partition("\r\n\r\n")[2])["seen"][""]
        body = json.dumps({"trial": "", "edits": seen})
        head = f"POST /{page[3]}/track HTTP/1.1\r\n{head}Content-Length: {len(body)}\r\n\r\n"
        assert " 200 " in asked(int(page[2]), head + body)
    worked = {"track": 3, "learn": 3, "batch": 3, "desk": 4}[
        name
    ]  # those they are forked from, and two, and the desk's
    busy = lambda: [one for one in command.tree()[1:] if sum(one.cpu_times()[:2]) > 0.3]  # noqa: E731
    command.until(lambda: len(quietly(busy)) >= worked)
    return page


def quietly(look):
    """What is seen of processes, of which one may have ended meanwhile."""
    try:
        return look()
    except psutil.NoSuchProcess:
        return []


@pytest.mark.parametrize("name", ["track", "learn", "batch"])
def test_who_works_for_itself_listens_to_nobody_and_leaves_nothing(flights, tmp_path, name):
    """While it works no port is open; killed at once it leaves no process, and nothing that is taken for its result."""
    with running(tmp_path / "log", *words_of(flights, tmp_path, name)) as command:
        begin(command, name)
        for _ in range(5):
            ports, files = listening(command.tree())
            assert not ports
            assert only_ours(files), files
            time.sleep(0.2)
        started = command.tree()[1:]
        command.process.kill()
        left = psutil.wait_procs(started, timeout=LEFT_S)[1]
        assert not [one for one in left if one.status() != psutil.STATUS_ZOMBIE]
    killed = command.process.returncode == -signal.SIGKILL
    assert not killed or not (tmp_path / "model.npz").exists()
    for report in (tmp_path / "out").rglob("report.json"):  # a quick computer has ended a trial
        if ".mocap-partial" not in str(report):
            mocap.load(report.parent)


BROWSER = """#!/bin/sh
echo "$@" > {0}/given
cp "${{1#file://}}" {0}/page
stat -c %a "${{1#file://}}" > {0}/mode
"""


def test_the_desk_and_who_tracks_for_it(flights, tmp_path):
    """One port, which refuses strangers; the secret is in no argument; killed at once it leaves no process."""
    script = tmp_path / "browser"
    script.write_text(BROWSER.format(tmp_path))
    script.chmod(0o755)
    with running(tmp_path / "log", *words_of(flights, tmp_path, "desk"), BROWSER=str(script)) as command:
        page = begin(command, "desk")
        command.until(lambda: (tmp_path / "mode").exists() and (tmp_path / "mode").read_text())
        for _ in range(5):
            ports, files = listening(command.tree())
            assert ports == {("tcp", "0100007F", int(page[2]))}
            assert only_ours(files), files
            assert page[3] not in arguments(command.tree())
            time.sleep(0.2)
        refuses_strangers(page)
        assert page[3] not in (tmp_path / "given").read_text()
        assert page[0] in (tmp_path / "page").read_text()
        assert (tmp_path / "mode").read_text() == "600\n"
        started = command.tree()[1:]
        command.process.kill()
        left = psutil.wait_procs(started, timeout=LEFT_S)[1]
        assert not [one for one in left if one.status() != psutil.STATUS_ZOMBIE]


def test_a_desk_that_is_ended_while_it_tracks(flights, tmp_path):
    """SIGTERM: it says why it ended, without a traceback, and nothing is left."""
    with running(tmp_path / "log", *words_of(flights, tmp_path, "desk"), BROWSER="true") as command:
        begin(command, "desk")
        started = command.tree()[1:]
        command.process.terminate()
        assert command.process.wait(SOON_S) == 0
        left = psutil.wait_procs(started, timeout=LEFT_S)[1]
        assert not [one for one in left if one.status() != psutil.STATUS_ZOMBIE]
    said = (tmp_path / "log").read_text()
    assert "The desk ended (SIGTERM); what was corrected and tracked is in" in said
    assert "Traceback" not in said


def test_the_page_of_digitise(films, tmp_path):
    """One port, which refuses strangers; SIGTERM ends it with a reason, and without a traceback."""
    words = ["digitise", films / "films", "--calibration", films / "calibration.toml", "--skeleton"]
    words += [films / "skeleton.toml", "--fps", "100", "--web", "--out", tmp_path / "out"]
    with running(tmp_path / "log", *words) as command:
        page = command.address()
        ports, files = listening(command.tree())
        assert ports == {("tcp", "0100007F", int(page[2]))}
        assert only_ours(files)
        assert page[3] not in arguments(command.tree())
        refuses_strangers(page)
        command.process.send_signal(signal.SIGTERM)
        assert command.process.wait(SOON_S) == 0
    said = (tmp_path / "log").read_text()
    assert "The page ended (SIGTERM)" in said
    assert "Traceback" not in said
