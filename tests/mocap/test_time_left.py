"""The time that is said to be left of a whole, beside what was left: traces of real runs, processor seconds."""

from contextlib import contextmanager
from functools import partial
from itertools import groupby, pairwise

import pytest
from mocap.datasets import make_bat
from mocap.filters.hidden_gaps import EACH_MARKER, Effort
from mocap.filters.model import TUNED
from mocap.filters.models.base import in_turn, shares, with_effort
from typer.testing import CliRunner

from docs import build
from mocap.cli import design_joint
from mocap.cli.main import app
from mocap.progress import Stages, as_one
from mocap.recording import of_points
from mocap.side_by_side import call_all
from mocap.tracking.learning import learn_from

DESIGN = (
    (11.3, "shape the truss", 0.083),
    (18.2, "shape the truss", 0.17),
    (20.7, "shape the truss", 0.25),
    (25.3, "shape the truss", 0.33),
    (30.2, "shape the truss", 0.50),
    (54.5, "shape the truss", 1.0),
    (58.5, "shape the parts", 1.0),
    (61.3, "check", 0.1),
    (84.7, "check", 0.88),
    (87.9, "check", 1.0),
    (93.0, "write", 1.0),
)
"""``mocap design-joint out/demo --joint elbow_l``, on a computer that six people shared."""


@pytest.mark.parametrize(("trace", "seconds"), [(DESIGN, design_joint.SECONDS)], ids=["design-joint"])
def test_what_is_left_is_said_within_a_third(trace, seconds):
    """Of what was left, or 5 % of the whole where that is more."""
    shares = []
    tell = as_one(lambda name, share: shares.append((name, share)), "the whole", seconds)
    for _, stage, share in trace:
        tell(stage, share)
    assert {name for name, _ in shares} == {"the whole"}
    whole = trace[-1][0]
    for (spent, *_), (_, share) in zip(trace, shares, strict=True):
        left = spent * (1 / share - 1)
        assert left == pytest.approx(whole - spent, rel=1 / 3, abs=0.05 * whole), (spent, share)


def test_a_stage_that_is_not_in_the_list_moves_nothing():
    """Nor does it fail; stages of the site have each their time."""
    shares = []
    tell = as_one(lambda _, share: shares.append(share), "the whole", {"a": 1.0, "b": 3.0})
    for stage, share in (("a", 0.5), ("c", 0.9), ("a", 1.0), ("b", 0.5)):
        tell(stage, share)
    assert shares == [0.125, 0.25, 0.625]
    assert min(build.SECONDS.values()) > 0


def half_and_whole(*, progress):
    """A call that tells twice how far it is."""
    progress(0.5)
    progress(1.0)


@pytest.mark.parametrize("caller", [in_turn, call_all])
def test_a_call_counts_for_the_time_that_it_takes(caller):
    """One of four times the effort is four fifths of both; calls that say nothing count alike."""
    for efforts, wanted in (((4.0, 1.0), [0.4, 0.8, 0.9, 1.0]), ((None, None), [0.25, 0.5, 0.75, 1.0])):
        said = []
        calls = [partial(half_and_whole) if e is None else with_effort(partial(half_and_whole), e) for e in efforts]
        caller(calls, said.append)
        assert said == pytest.approx(wanted)
    assert shares(None, [1.0, 2.0]) == [None, None]


LEARN = ((14.6, 0.0), (15.7, 0.018), (20.6, 0.285), (25.9, 0.542), (31.3, 0.748), (37.0, 1.0))
"""Share of the hidden gaps that is filled, of ``mocap learn`` of three flights; settings were begun at 10.7 s."""


def test_learning_says_what_is_left_within_a_third():
    """Settings, which tell nothing while they are learned, count for the time that they take."""
    for second, filled in LEARN:
        spent, whole = second - 10.7, 37.0 - 10.7
        share = TUNED + (1 - TUNED) * filled
        assert spent * (1 / share - 1) == pytest.approx(whole - spent, rel=1 / 3, abs=0.05 * whole), second


@pytest.mark.parametrize("known", [True, False])
def test_learning_tells_each_stage_from_its_begin_to_its_end(known):
    """Two, in order; each grows from 0 to 1, the first by recordings where their number is known."""
    flights = [make_bat(seed=seed, n_frames=40, n_cameras=2) for seed in (0, 1)]
    read = [of_points(one.truth, one.skeleton, name=f"f{k}") for k, one in enumerate(flights)]
    told, effort = [], Effort(validated=1, times=1)
    stages = Stages(tell=lambda *said: told.append(said))
    learn_from(read if known else iter(read), effort=effort, models=(EACH_MARKER, EACH_MARKER), stages=stages)
    shares_of = {stage: [share for _, share in some] for stage, some in groupby(told, lambda one: one[0])}
    assert [*shares_of] == ["read, triangulate, clean", "learn, fill hidden gaps"] == [*stages.seconds]
    first, second = shares_of.values()
    assert first == ([0.0, 0.5, 1.0, 1.0] if known else [0.0, 1.0])
    assert all(later >= earlier for earlier, later in pairwise(second))
    assert (second[0], second[-1]) == (0.0, 1.0)
    assert TUNED in second


@pytest.mark.parametrize(
    ("command", "stage"),
    [
        (("track", "--fit-lens", "--out", "out"), "read, estimate the lens"),
        (("track", "--out", "out"), "read"),
        (("skeleton",), "read"),
        (("learn", "--out", "a.npz"), "read"),
    ],
)
def test_what_is_read_before_the_work_begins_is_told(monkeypatch, command, stage):
    """Before the file is opened: a large one is read, and its lens estimated, for a while."""
    told = []

    @contextmanager
    def heard():
        yield lambda *said: told.append(said)

    monkeypatch.setattr(f"mocap.cli.{command[0]}.progress", heard)
    assert CliRunner().invoke(app, [*command, "no_such_file.csv"]).exit_code
    assert told == [(stage, 0.0)]
