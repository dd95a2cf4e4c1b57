"""Groups of trials compared: closed forms, and laws of permutation that hold whatever the trials are."""

from functools import partial
from itertools import combinations

import numpy as np
import pytest

from eal import GaussianKernel, compare
from eal.comparison import compare_all
from eal.splits import judge, shift_interval, two_groups
from tests.swings import draw


def swings(rng, count, *, posture=90.0, range_deg=40.0, effect=4.0):
    """Trials of a joint that swings, in degrees; each has a posture of its own, the animal effect."""
    return draw(rng, count, posture=(posture, effect), reach=(range_deg, 0.0))


def test_distance_is_that_of_the_gram_matrices(rng):
    """|T_a - T_b|^2 = mean K^2 within a + within b - 2 between, each trial counting alike; rest as computed apart."""
    a, b = swings(rng, 5), swings(rng, 4, posture=100.0)
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
    """Shifted by 10 degrees; stretched twice about the mean, four times the variance; overlap in closed form."""
    a = swings(rng, 6)
    moved = compare(a, [trial + 10.0 for trial in a])
    assert moved.shift == pytest.approx(10.0)
    assert moved.shift_interval[0, 0] < 10.0 < moved.shift_interval[0, 1]
    assert moved.variance_ratio == pytest.approx(1.0)
    assert moved.variance_of == "within trials"
    low, high = moved.range_a[0]
    assert moved.overlap == pytest.approx((high - low - 10.0) / (high - low + 10.0))
    stretched = compare(a, [np.mean(trial) + 2.0 * (trial - np.mean(trial)) for trial in a])
    assert stretched.shift == pytest.approx(0.0, abs=1e-9)
    assert stretched.variance_ratio == pytest.approx(4.0)
    assert stretched.variance_p == pytest.approx(2 / 924)
    assert stretched.overlap == pytest.approx(0.5, abs=0.02)


def test_intervals_are_of_trials_not_of_frames(rng):
    """The interval of the shift is of so many trials: frames given thrice change nothing."""
    a, b = swings(rng, 6), swings(rng, 6)
    kernel = GaussianKernel(1e-3)
    thrice = ([np.repeat(x, 3, axis=0) for x in group] for group in (a, b))
    one, three = compare(a, b, kernel=kernel), compare(*thrice, kernel=kernel)
    np.testing.assert_allclose(three.shift_interval, one.shift_interval, atol=1e-4)  # pivots are accurate to 1e-6
    assert three.p_value == pytest.approx(one.p_value, abs=0.01)


def test_groups_exchanged_give_the_same_verdict(rng):
    a, b = swings(rng, 5), swings(rng, 5, range_deg=44.0)
    there, back = compare(a, b, kernel=GaussianKernel(1e-3)), compare(b, a, kernel=GaussianKernel(1e-3))
    assert there.p_value == pytest.approx(back.p_value)
    assert there.shift == pytest.approx(-back.shift)
    assert there.variance_ratio == pytest.approx(1.0 / back.variance_ratio)


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
    """No p at most 0.05 is possible; of 3 (1/35 against 4) the spread is not known."""
    with pytest.raises(
        ValueError, match=rf"^{n_a} and {n_b} trials are too few to judge: .* {splits} splits allow"
    ) as e:
        compare(swings(rng, n_a), swings(rng, n_b))
    assert "\n" not in str(e.value)
    with pytest.raises(ValueError, match=r"4 and 3 trials .* 0.029, and the spread of fewer than 4 is not known"):
        compare(swings(rng, 4), swings(rng, 3))


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


def different(rng, count, draw_a, draw_b, animals=None):
    """Shares of draws of the null with p <= 0.05."""
    return np.mean([compare(draw_a(rng), draw_b(rng), animals=animals).p_value <= 0.05 for _ in range(count)])


@pytest.mark.parametrize(
    ("draw_a", "draw_b", "animals"),
    [
        (partial(swings, count=4, effect=9.0), partial(swings, count=12, effect=3.0), None),
        (partial(swings, count=4), partial(swings, count=48), ([*"wxyz"], [f"b{i // 4}" for i in range(48)])),
    ],
    ids=["spread", "trials"],
)
def test_units_known_unequally_are_not_called_different(draw_a, draw_b, animals):
    """The same movement, a few units that vary more: of 20 draws at most 4 (5 % and 3 standard errors).

    Not divided by the spread of each split 8 of 20 were.
    """
    assert different(np.random.default_rng(5), 20, draw_a, draw_b, animals) <= 4 / 20


def test_long_trials_count_more_than_short_ones():
    """Weights are 1 over the variance between trials and their own: pieces of a cycle count less than ten cycles."""
    rng = np.random.default_rng(2)
    mixed = [trial[: 150 if i % 2 else 8] for i, trial in enumerate(swings(rng, 12, effect=0.5))]
    whole = compare(mixed, swings(rng, 8, effect=0.5))
    short = compare(mixed[::2], swings(rng, 8, effect=0.5))
    width, width_short = (float(np.ptp(one.shift_interval)) for one in (whole, short))
    assert width < 0.5 * width_short / np.sqrt(2.0)  # twice as many that count alike would take a factor of sqrt 2 off


def test_the_interval_of_a_shift_is_the_test_turned_round(rng):
    """Moved by an end of the interval a group is at the verge of what the same splits reject."""
    a, b = (rng.normal(0.0, s, n) for s, n in ((1.0, 6), (1.0, 6)))
    splits = two_groups(np.arange(12) < 6, np.ones(12), rng)
    x = np.concatenate([a, b])
    middle, *ends = shift_interval(splits, x, 0.95)
    wider = judge(splits, np.outer(x - x.mean(), x - x.mean()), 0.95).wider
    for at, inside in zip(ends, (1.0, -1.0), strict=True):
        end = middle + (at - middle) / wider
        for step, kept in ((0.02, True), (-0.02, False)):
            x = np.concatenate([a, b - end - inside * step])
            x -= x.mean()
            statistic = judge(splits, np.outer(x, x), 0.95).statistic
            assert (np.mean(statistic >= statistic[0] * (1 - 1e-9)) > 0.05) == kept


def test_moments_of_splits_are_those_of_the_groups(rng):
    """Distance, trace, and degrees of freedom of some splits, as the groups' own means and covariances have them."""
    x = rng.standard_normal((11, 3))
    splits = two_groups(np.arange(11) < 4, np.ones(11), rng)
    apart, trace = splits.distances(x @ x.T)
    f1, f2 = splits.freedom(x @ x.T)
    for i in (0, 7, 200):
        member = splits.mean[0][i] > 0
        assert member.sum() == 4
        parts = [np.cov(x[m].T) / m.sum() for m in (member, ~member)]
        v = parts[0] + parts[1]
        assert apart[i] == pytest.approx(np.sum((x[member].mean(0) - x[~member].mean(0)) ** 2))
        assert trace[i] == pytest.approx(np.trace(v))
        assert f1[i] == pytest.approx(np.trace(v) ** 2 / np.trace(v @ v))
        below = np.trace(parts[0] @ parts[0]) / 3 + np.trace(parts[1] @ parts[1]) / 6
        assert f2[i] == pytest.approx(np.trace(v) ** 2 / below)


def test_frames_not_seen_at_one_end_do_not_move_the_joint():
    """70 % of the frames above 115 degrees hidden: the mean moves by less than 1.5 degrees, and not by 8."""
    rng = np.random.default_rng(8)
    a, b = swings(rng, 8), swings(rng, 8)
    hidden = [np.where((x > 115.0) & (rng.random(x.shape) < 0.7), np.nan, x) for x in b]
    found, whole = compare(a, hidden), compare(a, b)
    assert found.shift == pytest.approx(whole.shift, abs=1.5)
    assert found.unseen[1] > 0.15
    assert found.left_out == (0.0, 0.0)
    alone = compare(a, [x[np.isfinite(x)] for x in hidden])
    assert alone.shift[0] < whole.shift[0] - 5.0


def test_a_phase_that_one_side_never_saw_is_left_out_of_both(rng):
    """All frames above 115 degrees hidden in b: both sides lose them, and the reader is told."""
    a, b = swings(rng, 8), swings(rng, 8)
    found = compare(a, [np.where(x > 115.0, np.nan, x) for x in b])
    assert 0.1 < found.left_out[0] < 0.5
    assert 0.1 < found.left_out[1] < 0.5
    assert any(line.startswith("left out: ") for line in found.lines())


def test_the_largest_of_several_joints_is_judged():
    """Six joints of one kind: of 12 draws at most 3 have any p of all <= 0.05; more have a p alone."""
    rng, any_alone, any_of_all = np.random.default_rng(3), 0, 0
    for _ in range(12):
        groups = {str(i): (swings(rng, 5), swings(rng, 5)) for i in range(6)}
        found = compare_all(groups)
        any_alone += min(one.p_value for one in found.values()) <= 0.05
        any_of_all += min(one.p_of_all for one in found.values()) <= 0.05
    assert any_of_all <= 3  # 5 % and three standard errors
    assert any_alone > any_of_all


def test_a_joint_that_differs_is_found_among_others(rng):
    groups = {str(i): (swings(rng, 8), swings(rng, 8)) for i in range(4)}
    groups["moved"] = (swings(rng, 8), swings(rng, 8, posture=100.0))
    found = compare_all(groups)
    assert found["moved"].p_of_all <= 0.05
    assert found["moved"].p_of_all >= found["moved"].p_value
    assert "for all joints at once" in " ".join(found["0"].lines())
