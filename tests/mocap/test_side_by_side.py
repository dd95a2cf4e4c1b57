"""Calls side by side in processes: the same numbers in the same order, whatever happens to a process."""

import errno
import os
import signal
import sys
from functools import partial
from multiprocessing import forkserver

import numpy as np
import pytest
from mocap.datasets import make_bat, write_recording
from mocap.filters.anatomy import Anatomy
from mocap.filters.hidden_gaps import EACH_MARKER, Effort, hidden_gaps
from mocap.filters.models.constant_velocity import MarkerSettings

import mocap
from mocap import side_by_side
from mocap.errors import MocapError
from mocap.pipeline import learning, tracking
from mocap.pipeline.job import run_job
from mocap.pipeline.reading import read
from mocap.plots.figures import pictures
from mocap.side_by_side import call_all
from tests.filters.test_gaps_in_trials import trial_of

HERE = os.getpid()


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
    told: list[float] = []
    with mocap.processes(2):
        found = call_all([partial(square, x) for x in range(5)], told.append)
    assert [value for value, _ in found] == [0, 1, 4, 9, 16]
    assert HERE not in {process for _, process in found}
    assert told == [0.2, 0.4, 0.6, 0.8, 1.0]
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
    """Calls are made here."""

    def exhausted(*_, **__):
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    with mocap.processes(2), monkeypatch.context() as patch:
        patch.setattr(side_by_side.ProcessPoolExecutor, "submit", exhausted)
        assert call_all([partial(square, 1), partial(square, 2)]) == [(1, HERE), (4, HERE)]


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
