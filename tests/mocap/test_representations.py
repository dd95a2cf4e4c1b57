"""What a notebook prints of each object: a few lines, whatever arrays it holds."""

import dataclasses
import inspect
from collections.abc import Mapping
from contextlib import suppress

import pytest

from mocap.errors import MocapError
from mocap.results.tracked import Tracked
from tests.mocap.rerun.flapping import make_run

MOST = 1500
"""Characters: twenty lines of a terminal."""


@pytest.fixture(scope="module")
def result():
    return Tracked.of(make_run(n_frames=60))


def objects(one, path="res"):
    """Every object of ours that can be reached by public attributes, one of each class, with how it is reached."""
    found = {}

    def walk(value, path):
        kind = type(value)
        if kind.__module__.partition(".")[0] in ("mocap", "eal"):
            if kind in found:
                return
            found[kind] = path, value
            names = {f.name for f in dataclasses.fields(value)} if dataclasses.is_dataclass(value) else set()
            for name in dir(kind):
                static = inspect.getattr_static(kind, name)
                if name[0] != "_" and type(static).__name__ in ("property", "cached_property") and name != "moments":
                    names.add(name)
            for name in sorted(names):
                with suppress(MocapError, ValueError):  # what this run has no data for
                    walk(getattr(value, name), f"{path}.{name}")
        inside = list(value.values()) if isinstance(value, Mapping) else value
        if isinstance(inside, list | tuple):
            for part in inside[:3]:
                walk(part, f"{path}[...]")

    walk(one, path)
    return found


def test_no_object_prints_its_arrays(result):
    """Markers, kinematics, plots, joints, potentials and what they are made of: each in at most 1500 characters."""
    found = objects(result)
    assert {"Tracked", "Kinematics", "Quantity", "Plots", "MarkerTracks"} <= {kind.__name__ for kind in found}
    long = {path: len(repr(value)) for path, value in found.values() if len(repr(value)) > MOST}
    assert not long


def test_a_result_shows_itself(result):
    """Numbers, a picture of the animal, and lines to go on with, each of which runs; names are text."""
    named = dataclasses.replace(result, name="<b>x</b>")
    page = named._repr_html_()
    assert "<b>x</b>" not in page.replace("<b>&lt;b&gt;", "")
    assert "data:image/png;base64," in page
    assert len(page) < 200_000
    assert "res.plot.over_time" in page
    assert "of the points measured" in page
