"""Records over time are cut, spread and joined by the axes that their fields declare."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from eal.arrays import Array
from eal.over_time import OverTime, Time, at_frames

T, C = 7, 2


@dataclass(frozen=True, eq=False)
class Part:
    """A record that others hold."""

    name: str
    seen: Annotated[Array, Time(1)]


@dataclass(frozen=True, eq=False)
class Whole:
    """All kinds of fields."""

    fixed: Array
    t_s: OverTime[Array]
    maybe: OverTime[Array | None]
    tables: OverTime[Mapping[str, Array]]
    from_the_end: Annotated[Array, Time(-2)]
    parts: tuple[Part, ...]
    by_name: Mapping[str, Part]
    words: tuple[str, ...] = ("a", "b")


def whole() -> Whole:
    part = Part("left", np.arange(C * T, dtype=float).reshape(C, T))
    t_s, other = np.arange(float(T)), Part("right", part.seen + 100)
    scores = np.arange(2.0 * T * 3).reshape(2, T, 3)
    return Whole(np.arange(3), t_s, None, {"offsets": 10 * t_s}, scores, (part, other), {"same": part})


def test_all_arrays_over_time_are_cut_and_no_others():
    """In the record, in mappings and in the records that it holds, along their own axes."""
    found, given = at_frames(whole(), slice(2, 5)), whole()
    np.testing.assert_array_equal(found.t_s, [2, 3, 4])
    np.testing.assert_array_equal(found.fixed, given.fixed)
    np.testing.assert_array_equal(found.tables["offsets"], [20, 30, 40])
    np.testing.assert_array_equal(found.from_the_end, given.from_the_end[:, 2:5])
    np.testing.assert_array_equal(found.parts[1].seen, given.parts[1].seen[:, 2:5])
    np.testing.assert_array_equal(found.by_name["same"].seen, given.parts[0].seen[:, 2:5])
    assert found.maybe is None
    assert found.words == ("a", "b")


def test_frames_of_which_nothing_is_known_are_nan():
    """An index spreads a part over the frames of the whole."""
    found = at_frames(whole(), np.array([-1, 0, 1, -1]))
    np.testing.assert_array_equal(found.t_s, [np.nan, 0, 1, np.nan])
    np.testing.assert_array_equal(found.parts[0].seen[:, [0, 3]], np.nan)
    np.testing.assert_array_equal(found.from_the_end[:, 1:3], whole().from_the_end[:, :2])
