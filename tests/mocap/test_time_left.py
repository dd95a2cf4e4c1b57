"""The time that is said to be left of a whole, beside what was left: traces of real runs, processor seconds."""

from functools import partial

import pytest
from mocap.filters.models.base import in_turn, shares, with_effort

from docs import build
from mocap.cli import design_joint
from mocap.progress import as_one
from mocap.side_by_side import call_all

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
