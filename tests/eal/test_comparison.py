"""Groups of trials compared: closed forms, and laws of permutation that hold whatever the trials are."""

from itertools import combinations

import numpy as np
import pytest

from eal import GaussianKernel, compare
from tests.swings import draw


def swings(rng, count, *, posture=90.0, range_deg=40.0, effect=4.0):
    """Trials of a joint that swings, in degrees; each has a posture of its own, the animal effect."""
    return draw(rng, count, posture=(posture, effect), reach=(range_deg, 0.0))


def test_distance_is_that_of_the_gram_matrices(rng):
    """|T_a - T_b|^2 = mean K^2 within a + within b - 2 between, each trial counting alike; rest as computed apart."""
    a, b = swings(rng, 5), swings(rng, 4, posture=100.0)
    a[0] = a[0][:40]
    kernel = GaussianKernel(1e-3)
    gram = np.array([[np.mean(kernel.gram(x, y) ** 2) for y in (*a, *b)] for x in (*a, *b)])
    share = np.array([1 / 5] * 5 + [-1 / 4] * 4)
    found = compare(a, b, kernel=kernel, q=[[80.0], [120.0]])
    assert found.distance == pytest.approx(np.sqrt(share @ gram @ share), rel=1e-4)
    assert (found.splits, found.least_p) == (126, 1 / 126)
    time_b = np.mean([np.mean(kernel.gram(found.q, trial) ** 2, axis=1) for trial in b], axis=0)
    np.testing.assert_allclose(found.time_b, time_b, rtol=1e-9)


def test_no_more_splits_than_one_in_twenty_are_real(rng):
    """The law of permutation: of all 70 ways to split eight trials at most 3 have p <= 0.05, or a map that differs.

    Exact, for any trials at all; here the frames of a trial are as alike as those of an animal are. Two groups that are
    exchanged are judged alike: half of the ways are enough.
    """
    trials = swings(rng, 8)
    found = [
        compare([trials[i] for i in chosen], [trials[i] for i in range(8) if i not in chosen])
        for chosen in combinations(range(8), 4)
        if 0 in chosen
    ]
    assert 2 * sum(one.p_value <= 0.05 for one in found) <= 3
    assert 0 < 2 * sum(one.p_value <= 0.1 for one in found) <= 7
    assert 2 * sum(one.differs.any() for one in found) <= 3


def test_effects_are_those_that_were_made(rng):
    """Shifted by 10 degrees; stretched twice about the median, a quarter of the stiffness; overlap in closed form."""
    a = swings(rng, 6)
    moved = compare(a, [trial + 10.0 for trial in a])
    assert moved.shift == pytest.approx(10.0)
    assert moved.shift_interval[0, 0] < 10.0 < moved.shift_interval[0, 1]
    assert moved.stiffness == pytest.approx(1.0)
    low, high = moved.range_a[0]
    assert moved.overlap == pytest.approx((high - low - 10.0) / (high - low + 10.0))
    stretched = compare(a, [np.median(trial) + 2.0 * (trial - np.median(trial)) for trial in a])
    assert stretched.shift == pytest.approx(0.0, abs=1e-9)
    assert stretched.stiffness == pytest.approx(0.25)
    assert stretched.overlap == pytest.approx(0.5, abs=0.02)


def test_intervals_are_of_trials_not_of_frames(rng):
    """The interval of the shift is Student's for so many trials: frames given thrice change nothing."""
    a, b = swings(rng, 6), swings(rng, 6)
    one, three = compare(a, b), compare([np.repeat(x, 3, axis=0) for x in a], [np.repeat(x, 3, axis=0) for x in b])
    np.testing.assert_allclose(three.shift_interval, one.shift_interval, atol=1e-9)
    assert three.p_value == pytest.approx(one.p_value, abs=0.01)


def test_groups_exchanged_give_the_same_verdict(rng):
    a, b = swings(rng, 5), swings(rng, 5, range_deg=44.0)
    there, back = compare(a, b, kernel=GaussianKernel(1e-3)), compare(b, a, kernel=GaussianKernel(1e-3))
    assert there.p_value == pytest.approx(back.p_value)
    assert there.shift == pytest.approx(-back.shift)
    assert there.stiffness == pytest.approx(1.0 / back.stiffness)


def test_a_range_that_changes_by_one_sd_between_trials_is_found(rng):
    """Eight trials against eight: at least 8 of 10 draws (``docs/experiments/comparison.md``: 96 % of 200)."""
    found = [compare(swings(rng, 8), swings(rng, 8, range_deg=44.0)).p_value <= 0.05 for _ in range(10)]
    assert sum(found) >= 8


def test_animals_are_permuted_whole(rng):
    """Two animals of six trials each are two units and judge nothing; one that is in both groups changes its sides."""
    a, b = swings(rng, 6), swings(rng, 6, posture=120.0)
    with pytest.raises(ValueError, match="1 and 1 animals are too few to judge: the least p that their 2 splits"):
        compare(a, b, animals=(["bat"] * 6, ["owl"] * 6))
    before = swings(rng, 8, effect=5.0)
    after = [trial + 3.0 for trial in before]
    pairs = compare(before, after, animals=(list("abcdefgh"), list("abcdefgh")))
    assert (pairs.unit, pairs.splits, pairs.least_p) == ("sides of animals", 256, 2 / 256)
    assert pairs.p_value <= 0.05
    np.testing.assert_allclose(pairs.shift_interval, [[3.0, 3.0]])
    assert compare(before, after).p_value > pairs.p_value  # the animals' own postures hide it
    with pytest.raises(ValueError, match="'b' is in both and 'a' in one"):
        compare(before[:2], after[:2], animals=(["a", "b"], ["b", "b"]))


@pytest.mark.parametrize(("n_a", "n_b", "splits"), [(3, 3, 20), (1, 18, 19), (2, 4, 15)])
def test_too_few_trials_are_refused_in_one_line(n_a, n_b, splits, rng):
    """No p at most 0.05 is possible; with one more (4 against 3: 1/35) it is."""
    with pytest.raises(
        ValueError, match=rf"^{n_a} and {n_b} trials are too few to judge: .* {splits} splits allow"
    ) as e:
        compare(swings(rng, n_a), swings(rng, n_b))
    assert "\n" not in str(e.value)
    assert compare(swings(rng, 4), swings(rng, 3)).least_p == pytest.approx(1 / 35)


@pytest.mark.parametrize(
    ("a", "message"),
    [([], "a has no trials"), (np.zeros((9, 1)), "a must be trials"), ([np.zeros((9, 2))] * 4, "equal coordinates")],
)
def test_what_is_no_trials_is_refused(a, message, rng):
    with pytest.raises(ValueError, match=message):
        compare(a, swings(rng, 4))


@pytest.mark.parametrize("d", [1, 2])
def test_the_map_is_drawn(d, rng):
    """Of one coordinate as lines, of two as maps."""
    trials = [np.hstack([x] * d) for x in swings(rng, 8)]
    axes = compare(trials[:4], trials[4:], names=["a", "b"][:d], units=["°"] * d).plot()
    assert axes[1].get_xlabel() == "a (°)"


def test_three_coordinates_have_no_map(rng):
    trials = [np.hstack([x] * 3) for x in swings(rng, 8)]
    with pytest.raises(ValueError, match="a comparison of 3 coordinates has no map"):
        compare(trials[:4], trials[4:]).plot()
