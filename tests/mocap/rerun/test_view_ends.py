"""A viewer serves a recording no longer than the command that opened it lives."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from io import BytesIO

import pytest
from flapping import make_run

from mocap.rerun import guardian
from mocap.rerun.record import write_recording
from mocap.rerun.viewer import HOST, Viewer


@pytest.fixture(scope="module")
def rrd(tmp_path_factory):
    path = tmp_path_factory.mktemp("ends") / "recording.rrd"
    write_recording(make_run(n_frames=5, n_cameras=1, n_joints=0), path)
    return path


@pytest.fixture
def viewing(rrd):
    """``mocap view --web`` in a group of its own, and the ports that it serves on."""
    # a test run in the background ignores some signals, and its children inherit that
    heard = "for n in ('SIGINT', 'SIGHUP'): signal.signal(getattr(signal, n), signal.SIG_DFL)\n" * (os.name == "posix")
    ctrl_c = "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    start = f"import signal\n{heard}{ctrl_c}from mocap.cli.main import main\nmain()"
    command = [sys.executable, "-c", start, "view", str(rrd), "--web"]
    environment = {**os.environ, "BROWSER": "true"}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stderr is not None
    address = process.stderr.readline()
    ports = [int(port) for port in re.findall(r"127\.0\.0\.1(?::|%3A)(\d+)", address)]
    assert len(ports) == 2, address
    assert all(is_open(port) for port in ports)
    yield process, ports
    process.kill()
    process.wait()
    process.stderr.close()


def is_open(port: int) -> bool:
    try:
        socket.create_connection((HOST, port), timeout=600).close()
    except OSError:
        return False
    return True


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("how", ["kill the group", "terminate", "interrupt"])
def test_it_ends_with_its_command(viewing, how):
    """Killed with its group, without a chance to tidy up; and by signals that ask it to end.

    However long that takes on a busy machine: a server that goes on meets the time limit of all tests.
    """
    process, ports = viewing
    if how == "terminate":
        os.kill(process.pid, signal.SIGTERM)
    else:
        os.killpg(process.pid, signal.SIGINT if how == "interrupt" else signal.SIGKILL)
    while any(is_open(port) for port in ports):
        time.sleep(0.05)
    process.wait()
    if how in ("terminate", "interrupt"):
        assert process.returncode == 0


def test_its_own_end_is_passed_on():
    """The exit code of a command that ends by itself, and the number of the signal that ended it."""
    command = [sys.executable, "-c", "raise SystemExit(3)"]
    ended = guardian.started(command, environment=os.environ, output=subprocess.DEVNULL)
    assert ended.wait() == 3
    guardian.end(ended)
    if sys.platform != "win32":
        command = [sys.executable, "-c", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"]
        killed = guardian.started(command, environment=os.environ, output=subprocess.DEVNULL)
        assert killed.wait() == 128 + signal.SIGKILL
        guardian.end(killed)


def test_what_does_not_listen_is_killed():
    """A command that ignores the request to end ends all the same, after a while."""
    stubborn = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print(flush=True); time.sleep(1e6)"
    reading, writing = os.pipe()
    with open(reading) as said:
        with open(writing, "wb") as end:
            running = guardian.started([sys.executable, "-c", stubborn], environment=os.environ, output=end)
        said.readline()
        guardian.end(running)
    assert running.returncode in (128 + signal.SIGKILL, 1) if sys.platform != "win32" else True


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_signal_that_another_thread_gets_ends_the_wait():
    """As the system gives it on a busy machine; a sleep in waitpid would go on."""

    def heard(*_):
        raise InterruptedError

    before = signal.signal(signal.SIGUSR1, heard)
    command = [sys.executable, "-c", "import time; time.sleep(1e6)"]
    process = guardian.started(command, environment=os.environ, output=subprocess.DEVNULL)
    viewer = Viewer(process=process, url=None, sink="", messages=BytesIO())
    try:
        threading.Timer(0.3, lambda: signal.pthread_kill(threading.get_ident(), signal.SIGUSR1)).start()
        with pytest.raises(InterruptedError):
            viewer.wait()
    finally:
        signal.signal(signal.SIGUSR1, before)
        viewer.close()
