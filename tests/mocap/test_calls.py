"""Wrong calls of the public functions: one line, with what to write instead."""

import inspect
import io

import numpy as np
import pytest

import mocap
from mocap.errors import MocapError
from mocap.progress import bars

XYZ = np.random.default_rng(0).normal(0, 0.1, (40, 3, 3))
VERBS = [name for name in mocap.__all__ if inspect.isfunction(getattr(mocap, name))]


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: mocap.track(XYZ, fps=100), "mocap.track(mocap.from_arrays(xyz, fps=...))"),
        (lambda: mocap.track("a.csv", fps=100), "mocap.track(mocap.read('a.csv', fps=...))"),
        (lambda: mocap.learn(XYZ, fps=100), "mocap.learn([mocap.from_arrays(xyz, fps=...), ...])"),
        (lambda: mocap.track(mocap.from_arrays(XYZ, fps=1), models="eal"), "did you mean `model`?"),
        (lambda: mocap.read("a.csv", skelton="b.toml"), "did you mean `skeleton`?"),
        (lambda: mocap.read(), "'tracks'"),
        (lambda: mocap.from_arrays(XYZ, rate=3), "expected mocap.from_arrays(xyz, names=, fps="),
        (lambda: mocap.read("a.csv", "b.csv"), "expected mocap.read(tracks, fps=, unit="),
    ],
)
def test_an_argument_of_another_function_is_told_where_it_belongs(call, told):
    with pytest.raises(TypeError) as caught:
        call()
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("given", [3, 2.5, object(), b"x"])
def test_every_argument_of_another_kind_is_named(given):
    """Those of paths, of units, seeds and progress: in every public function that has one of these names."""
    named = {"folder", "unit", "seed", "progress", "path", "cameras", "out"}
    for verb in VERBS:
        takes = inspect.signature(getattr(mocap, verb)).parameters
        needed = {
            n: XYZ for n, p in takes.items() if p.default is p.empty and p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)
        }
        for name in named & set(takes):
            if (name, type(given)) in {("seed", int), ("cameras", bytes)}:
                continue  # right, or read as an array
            with pytest.raises(MocapError) as caught:
                getattr(mocap, verb)(**needed | {name: given})
            assert "expected" in str(caught.value), (verb, name)


def test_progress_is_shown_on_a_terminal_alone(monkeypatch):
    """Of a script's stage a bar; of a log's nothing at all."""
    recording = mocap.from_arrays(XYZ, fps=100, unit="m")

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    for stream, shown in ((Terminal(), True), (io.StringIO(), False)):
        monkeypatch.setattr("sys.stderr", stream)
        monkeypatch.setenv("TERM", "xterm")
        with bars() as tell:
            tell("a stage", 0.5)
        assert ("a stage" in stream.getvalue()) == shown
        before = len(stream.getvalue())
        mocap.track(recording, model="constant_velocity", validate=False)
        assert (len(stream.getvalue()) > before) == shown
    mocap.track(recording, model="constant_velocity", validate=False, progress=lambda *_: None)
    assert stream.getvalue() == ""
