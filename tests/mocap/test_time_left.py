"""The time that is said to be left of a whole, beside what was left: traces of real runs, processor seconds."""

import pytest

from docs import build
from mocap.cli import design_joint
from mocap.progress import as_one

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
