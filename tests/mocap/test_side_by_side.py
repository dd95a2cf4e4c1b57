"""Calls side by side in processes: the same numbers in the same order, whatever happens to a process."""

import errno
import os
import re
import signal
import subprocess
import sys
import time
from functools import partial
from multiprocessing import forkserver
from pathlib import Path

import numpy as np
import psutil
import pytest
from mocap.datasets import make_bat, write_recording
from mocap.filters.anatomy import Anatomy
from mocap.filters.hidden_gaps import EACH_MARKER, Effort, hidden_gaps
from mocap.filters.models.constant_velocity import MarkerSettings

import mocap
from mocap import side_by_side
from mocap.errors import MocapError
from mocap.plots.figures import pictures
from mocap.reading.reading import read
from mocap.report.job import run_job
from mocap.side_by_side import Lost, NoProcess, call_all, opened
from mocap.tracking import learning, tracking
from tests.filters.test_gaps_in_trials import trial_of

HERE = os.getpid()
ROOT = Path(__file__).resolve().parents[2]


def square(x, *, progress=None):
    """A number squared, and which process it was."""
    if progress is not None:
        progress(1.0)
    return x**2, os.getpid()


def dies_elsewhere(parent, *, progress=None):  # noqa: ARG001
    """Kills its process, unless that is the parent."""
    if os.getpid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)
    return "here"


def refuses(*, progress=None):  # noqa: ARG001
    """Raises."""
    raise MocapError("not so")


def test_calls_keep_their_order_and_leave_this_process():
    """Five on two processes take as long as three: with one or two of them ended a third of the time is over."""
    told: list[float] = []
    with mocap.processes(2):
        found = call_all([partial(square, x) for x in range(5)], told.append)
    assert [value for value, _ in found] == [0, 1, 4, 9, 16]
    assert HERE not in {process for _, process in found}
    assert told == sorted(told)
    assert sorted(set(told)) == pytest.approx([1 / 3, 2 / 3, 1.0])
    told.clear()
    assert {process for _, process in call_all([partial(square, x) for x in range(2)], told.append)} == {HERE}
    assert told == [0.5, 1.0]


def test_a_call_whose_process_dies_is_made_here():
    with mocap.processes(2):
        found = call_all([partial(square, 3), partial(dies_elsewhere, HERE)])
        assert found[0][0] == 9
        assert found[1] == "here"
        assert call_all([partial(square, 1), partial(square, 2)])[1][0] == 4  # and the next ones have processes again


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere processes are started afresh")
def test_what_processes_are_forked_from_dies():
    """Before the first call, and between two: it is started anew."""
    with mocap.processes(2):
        for x in (3, 4):
            os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)
            assert call_all([partial(square, 1), partial(square, x)])[1][0] == x**2


def test_no_process_can_be_started(monkeypatch):
    """Calls are made here; who wants them made elsewhere is told."""

    def exhausted(*_, **__):
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(side_by_side.Worker, "started", exhausted)
    with mocap.processes(2):
        assert call_all([partial(square, 1), partial(square, 2)]) == [(1, HERE), (4, HERE)]
    with opened(2) as pool, pytest.raises(NoProcess, match="see whether memory is left"):
        list(pool.each({"a": partial(square, 1)}))


def misbehaves(way, counter, *, progress=None):
    """Does what no call should; the file counts how often."""
    with counter.open("a") as stream:
        stream.write("x")
    if progress is not None:
        progress("begun")
    if way == "hangs":
        re.match("(a+)+$", "a" * 64 + "b")  # keeps Python's lock
    if way == "takes memory":
        np.ones(1 << 28)  # 2 GB
        time.sleep(60)
    if way == "exits":
        sys.exit(3)
    if way == "raises what cannot be read":
        raise Unreadable(1, 2)
    os.kill(os.getpid(), signal.SIGKILL)


class Unreadable(Exception):
    """Its pickle names one argument and it takes two."""

    def __init__(self, one, two):
        """With both."""
        super().__init__(one + two)


@pytest.mark.parametrize(
    ("way", "why", "times"),
    [("hangs", "time", 1), ("takes memory", "memory", 2), ("dies", "died", 2)],
)
def test_what_a_call_does_to_its_process_is_told_of_it_alone(tmp_path, way, why, times):
    """Those beside it, and after it, are made; it is made again where another time may go better."""
    if way == "takes memory" and not os.path.exists("/proc/self/statm"):
        pytest.skip("no memory is told here")
    counter, told = tmp_path / "counter", []
    calls = {"bad": partial(misbehaves, way, counter), **{i: partial(square, i) for i in range(4)}}
    limits = {"bad": 1.0}  # of 2^64 steps in vain
    with opened(2, most_bytes=1e9) as pool:
        found = dict(pool.each(calls, limit_s=lambda name: limits.get(name, 300.0) if way == "hangs" else 300.0,
                               hear=lambda *said: told.append(said[1:])))  # fmt: skip
    assert {name: future.result()[0] for name, future in found.items() if name != "bad"} == {i: i**2 for i in range(4)}
    assert isinstance(lost := found["bad"].exception(), Lost)
    assert lost.why == why
    assert len(counter.read_text()) == times
    assert told.count(("bad", "begun")) == times


def test_calls_that_are_stopped_end_alone(tmp_path):
    """One that is being made and one that waits: neither is made again, and the others are made."""
    told = []
    calls = {"bad": partial(misbehaves, "hangs", tmp_path / "counter"), "waits": partial(square, 1)}
    calls |= {"last": partial(square, 2)}
    with opened(1) as pool:
        found = dict(pool.each(calls, hear=lambda *said: told.append(said[1:]),
                               stopped=lambda name: bool(told) and name in ("bad", "waits")))  # fmt: skip
    assert [found[name].exception().why for name in ("bad", "waits")] == ["stopped", "stopped"]
    assert found["last"].result()[0] == 4
    assert (tmp_path / "counter").read_text() == "x"


@pytest.mark.parametrize(("way", "text"), [("exits", "SystemExit: 3"), ("raises what cannot be read", "Unreadable: 3")])
def test_a_call_ends_no_process(tmp_path, way, text):
    """Not by an exit, and not by an error that cannot be sent as it is."""
    with opened(1) as pool:
        calls = {"bad": partial(misbehaves, way, tmp_path / "counter"), "where": partial(square, 1)}
        found = {name: future for name, future in pool.each(calls)}
        (again,) = (future for _, future in pool.each({"where": partial(square, 1)}))
    with pytest.raises(RuntimeError, match=text):
        found["bad"].result()
    assert found["where"].result() == again.result()  # the same process


PARENT = """
import sys, time, re
from functools import partial
from mocap.side_by_side import opened
from tests.mocap.test_side_by_side import misbehaves
from pathlib import Path
if __name__ == "__main__":
    with opened(2) as pool:
        list(pool.each({i: partial(misbehaves, "hangs", Path(sys.argv[1]) / str(i)) for i in range(2)}))
"""


def test_no_process_outlives_its_parent(tmp_path):
    """Killed while its calls hang with Python's lock: ten seconds later there is none."""
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, script, tmp_path], env=environment) as parent:
        end = time.monotonic() + 300
        while not all((tmp_path / name).exists() for name in "01"):
            assert parent.poll() is None
            assert time.monotonic() < end
            time.sleep(0.05)
        children = psutil.Process(parent.pid).children(recursive=True)
        assert len(children) >= 3
        parent.kill()
    left = psutil.wait_procs(children, timeout=10)[1]
    assert not [child for child in left if child.status() != psutil.STATUS_ZOMBIE]


def test_errors_are_those_of_the_call():
    with mocap.processes(2), pytest.raises(MocapError, match="not so"):
        call_all([partial(square, 1), refuses])
    with pytest.raises(MocapError, match="give 1 or more"), mocap.processes(0):
        pass


def test_hidden_gaps_are_filled_to_the_same_bits():
    gaps = hidden_gaps(
        [trial_of(3), trial_of(4)], Anatomy((0, 1, 2, 3)), np.random.default_rng(0), effort=Effort(validated=2, times=1)
    )
    (here,) = gaps.fill([EACH_MARKER])
    with mocap.processes(2):
        (there,) = gaps.fill([EACH_MARKER], call_all)
    np.testing.assert_array_equal(here.error_m, there.error_m)
    np.testing.assert_array_equal(here.variance, there.variance)


def test_a_result_is_written_by_two_processes_as_by_one(monkeypatch, tmp_path):
    monkeypatch.setattr("mocap.plots.figures.pictures", pictures)  # as the other process builds them
    bat = make_bat(seed=3, n_frames=40, n_cameras=3)
    files = write_recording(bat, tmp_path / "in")
    recording = read(files["pixels"], calibration=files["coefficients"], skeleton=files["skeleton"], fps=bat.fps)
    run, _ = run_job(recording, model="constant_velocity", validated=False)
    result = mocap.Tracked.of(run)
    result.save(tmp_path / "one")
    with mocap.processes(2):
        result.save(tmp_path / "two")
    one, two = (
        {p.relative_to(f): p for p in f.rglob("*") if p.is_file()} for f in (tmp_path / "one", tmp_path / "two")
    )
    assert one.keys() == two.keys()
    for name in ("markers.csv", "kinematics.csv", "report.json", "cycles.csv"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_learning_and_tracking_leave_their_calls_to_the_processes(monkeypatch, tmp_path):
    """A fold for each of two flights; with a learned model each of its two models, and a fold of the recording."""
    made = []

    def counted(calls, progress=None):
        made.append(len(calls))
        return call_all(calls, progress)

    for room in (learning, tracking):
        monkeypatch.setattr(room, "call_all", counted)
    flights = []
    for seed in (1, 2):
        bat = make_bat(seed=seed, n_frames=40, n_cameras=3)
        files = write_recording(bat, tmp_path / str(seed))
        camera = {"calibration": files["coefficients"], "profile": files["profile"]}
        flights.append(read(files["pixels"], skeleton=files["skeleton"], fps=bat.fps, **camera))
    effort = Effort(validated=2, times=1)
    learned = learning.learn_from(flights, models=(EACH_MARKER, MarkerSettings()), effort=effort)
    assert made == [2]
    run_job(flights[1], learned=learned, validated=False)
    assert made == [2, 3]
