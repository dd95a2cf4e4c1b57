"""A profile by stage: every moment counts once, in the stage in which it is spent."""

import time

import pytest

from benchmarks.stages import as_lines, by_stage, reference_s


class Clock:
    """Processor time that passes where it is told to: a real one also runs while others use the machine's caches."""

    now = 0.0

    def __call__(self):
        """Seconds."""
        return Clock.now


def spin(seconds):
    """Use the processor for a while."""
    Clock.now += seconds


def inner(seconds):
    """A stage."""
    spin(seconds)


def outer(seconds, *, again=False):
    """A stage that calls another one, and itself."""
    spin(seconds)
    inner(seconds)
    if again:
        outer(seconds)


def test_each_moment_counts_once(monkeypatch):
    """0.12 s in the outer stage (called twice, once by itself), 0.12 in the inner, 0.06 elsewhere."""
    monkeypatch.setattr(time, "process_time", Clock())

    def job():
        spin(0.06)
        outer(0.06, again=True)

    found = by_stage(job, {"outer": (outer,), "inner": (inner,), "none": (reference_s,)})
    seconds = {stage: found[stage][0] for stage in found}
    assert seconds == pytest.approx({"outer": 0.12, "inner": 0.12, "none": 0.0, "rest": 0.06, "all": 0.3}, abs=1e-9)
    assert found["outer"][1] == found["inner"][1] == 2
    lines = as_lines("job", found, 0.01).splitlines()
    assert len(lines) == 5  # without the stage that did not run
    assert lines[-1].split()[-2:] == ["100%", f"{seconds['all'] / 0.01:.1f}"]


def test_the_reference_loop_takes_time():
    """It is long enough to be timed and short enough to be made each time."""
    assert 1e-3 < reference_s() < 5
