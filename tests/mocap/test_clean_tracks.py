"""Cleaning: what no animal could have done goes, with its reason; all else stays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mocap.datasets import PERFECT, make_bat, make_lizard

from mocap.cleaning.positions import REASONS, clean, duplicates, jumps, off_course, speed_limits, stretched
from mocap.skeleton import Bone, Skeleton
from tests.reference.cleaning import fewest_jumps


def walk(rng, n_frames, n_markers, *, step_m=0.002):
    """Smooth motion of markers a few centimetres apart."""
    t = np.arange(n_frames) * 0.01
    phase = rng.uniform(0, 2 * np.pi, (n_markers, 3))
    home = rng.uniform(-0.3, 0.3, (n_markers, 3))
    return t, home + step_m * 20 * np.sin(5 * t[:, None, None] + phase)


@given(seed=st.integers(0, 10_000), n=st.integers(3, 9))
def test_the_fewest_samples_are_rejected(seed, n):
    """On short tracks with gaps and jumps: as few rejected as trying all subsets finds, and what is left is slow."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 2, n))
    x = np.cumsum(rng.normal(0, 0.5, (n, 3)), axis=0)
    x[rng.random(n) < 0.3] += rng.normal(0, 6, 3)
    found = jumps(x[:, None], t, max_speed_m_s=np.array([1.0]), slack_m=np.array([0.1]))[:, 0]
    assert found.sum() == fewest_jumps(x, t, max_speed=1.0, slack=0.1)
    kept = np.flatnonzero(~found)
    steps = np.linalg.norm(np.diff(x[kept], axis=0), axis=1)
    assert (steps <= np.diff(t[kept]) + 0.1).all()


def test_a_burst_of_wrong_samples_goes_as_a_whole():
    """Ten frames on another animal, 1 m off: all ten are jumps, the way there and back is not the only evidence."""
    t, xyz = walk(np.random.default_rng(1), 200, 2)
    xyz[80:90, 1] += 1.0
    xyz[100:110, 1] = np.nan
    found = jumps(xyz, t, max_speed_m_s=np.full(2, 1.0), slack_m=np.zeros(2))
    expected = np.zeros((200, 2), dtype=bool)
    expected[80:90, 1] = True
    np.testing.assert_array_equal(found, expected)


def test_a_long_gap_forgives_a_long_way():
    """Speed counts the time that passed: after a second unseen a marker may be a metre off at 1 m/s."""
    t = np.arange(300) * 0.01
    xyz = np.zeros((300, 1, 3))
    xyz[200:] = 0.9
    xyz[50:200] = np.nan
    limit, slack = np.array([1.1]), np.zeros(1)
    assert not jumps(xyz, t, max_speed_m_s=limit, slack_m=slack).any()
    xyz[150:200] = 0.0
    assert jumps(xyz, t, max_speed_m_s=limit, slack_m=slack).any()


def test_without_a_limit_nothing_is_a_jump():
    """A speed that is not known rejects nothing; fewer than three samples cannot accuse each other."""
    t = np.arange(5.0)
    xyz = np.random.default_rng(2).normal(0, 100, (5, 1, 3))
    assert not jumps(xyz, t, max_speed_m_s=np.array([np.inf]), slack_m=np.zeros(1)).any()
    assert not jumps(xyz[:2], t[:2], max_speed_m_s=np.array([1e-3]), slack_m=np.zeros(1)).any()


def test_the_speed_limit_is_the_animals():
    """Six times the 90 % quantile of the speed: known for uniform motion, not moved by 3 % of jumps, in m/s."""
    t = np.arange(200) * 0.01
    xyz = np.zeros((200, 2, 3))
    xyz[:, 0, 0] = 0.5 * t
    xyz[60:66:2, 0] += 5
    xyz[9:, 1] = np.nan
    limits = speed_limits(xyz, t)
    np.testing.assert_allclose(limits, [6 * 0.5, np.nan])


def test_of_two_markers_in_one_place_the_strayed_one_goes():
    """A marker digitised on another one's place for 4 frames is the duplicate; the one at home stays."""
    _, xyz = walk(np.random.default_rng(3), 100, 3)
    xyz[40:42, 2] = xyz[40:42, 0]
    found = duplicates(xyz, np.full((100, 3), 1e-4))
    expected = np.zeros((100, 3), dtype=bool)
    expected[40:42, 2] = True
    np.testing.assert_array_equal(found, expected)


def test_markers_that_meet_are_no_duplicates():
    """Near, but further apart than their deviation: two markers; always together: one place with two names, kept."""
    _, xyz = walk(np.random.default_rng(4), 100, 2)
    xyz[50, 1] = xyz[50, 0] + [0.001, 0, 0]
    assert not duplicates(xyz, np.full((100, 2), 1e-4)).any()
    together = np.repeat(xyz[:, :1], 2, axis=1) + np.array([[0, 0, 0], [1e-6, 0, 0]])
    assert not duplicates(together, np.full((100, 2), 1e-4)).any()


def test_duplicates_without_deviations_or_in_gaps():
    """Unknown deviations accuse only exact coincidence; NaN accuses nobody."""
    _, xyz = walk(np.random.default_rng(5), 50, 2)
    xyz[10] = np.nan
    unknown = np.full((50, 2), np.nan)
    assert not duplicates(xyz, unknown).any()
    xyz[20, 1] = xyz[20, 0]
    assert duplicates(xyz, unknown).sum() == 1


def rigid_triangle(n_frames):
    """Three markers on one rigid body that moves slowly, all bones rigid."""
    t = np.arange(n_frames) * 0.01
    shape = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    return shape + np.stack([0.2 * t, 0.05 * np.sin(t), 0 * t], axis=1)[:, None], np.array([[0, 1], [1, 2], [2, 0]])


def test_the_end_that_more_bones_accuse_goes():
    """One marker of a rigid triangle moved by half a bone: two bones accuse it, one each other: it alone goes."""
    xyz, bones = rigid_triangle(60)
    xyz[30, 1] += [0.05, 0.03, 0.06]
    expected = np.zeros((60, 3), dtype=bool)
    expected[30, 1] = True
    np.testing.assert_array_equal(stretched(xyz, bones), expected)


def test_more_bones_outweigh_the_course():
    """A marker wrong for so long that it keeps its own course is still the one that two bones accuse."""
    xyz, bones = rigid_triangle(60)
    xyz[25:34, 2] += [-0.03, 0.08, 0.05]
    expected = np.zeros((60, 3), dtype=bool)
    expected[25:34, 2] = True
    np.testing.assert_array_equal(stretched(xyz, bones), expected)


def test_of_two_ends_the_one_off_its_course_goes():
    """With a single bone both ends are accused alike; the one that left its own way is rejected."""
    xyz, bones = rigid_triangle(60)
    for end in (0, 1):
        moved = xyz.copy()
        moved[30, end] += [0.0, 0.0, 0.09]
        found = stretched(moved, bones[:1])
        assert found.sum() == 1
        assert found[30, end]


def test_soft_tissue_is_not_a_stretched_bone():
    """A fifth of the length is skin; a bone seen in fewer than ten frames has no length; no bones, no verdict."""
    xyz, bones = rigid_triangle(60)
    xyz[30, 1, 0] += 0.02
    assert not stretched(xyz, bones).any()
    xyz[30, 1, 0] += 1
    assert stretched(xyz, bones).any()
    xyz[:30, 1] = xyz[39:, 1] = np.nan
    assert not stretched(xyz, bones).any()
    assert not stretched(xyz, np.zeros((0, 2), dtype=int)).any()


def test_off_course_by_hand():
    """The distance from the median of the four neighbours in time; zero where there is none."""
    xyz = np.zeros((7, 1, 3))
    xyz[3] = [0, 3, 4]
    assert off_course(xyz)[3, 0] == 5
    assert off_course(xyz)[2, 0] == 0
    alone = np.full((7, 1, 3), np.nan)
    alone[3] = 1
    assert not off_course(alone).any()


@pytest.mark.parametrize("make", [make_bat, make_lizard])
def test_clean_twins_lose_nothing(make):
    """The truth of both twins, a bat that flaps and a lizard that walks: not one sample is rejected."""
    recording = make(n_frames=240, digitiser=PERFECT)
    xyz, names = recording.truth.xyz_m, recording.truth.names
    found = clean(xyz, np.full(xyz.shape[:2], 1e-4), recording.truth.t_s, recording.skeleton, names)
    assert {reason: int(mask.sum()) for reason, mask in found.rejected.items()} == dict.fromkeys(
        ("jump", "duplicate", "bone_length"), 0
    )
    assert set(found.rejected) | {"rays_miss", "likelihood", "contradicted"} == set(REASONS)


def test_each_fault_has_its_reason_and_only_one():
    """A marker 3 m off is a jump; one on another's place a jump or a duplicate; a sample has one reason, the first."""
    recording = make_bat(n_frames=120, digitiser=PERFECT)
    names = recording.truth.names
    xyz = recording.truth.xyz_m.copy()
    xyz[30, 0] += 3.0
    near = int(np.argmin(np.linalg.norm(xyz[60] - xyz[60, 2], axis=1) + np.eye(len(names))[2]))
    xyz[60, 2] = xyz[60, near]
    found = clean(xyz, np.full(xyz.shape[:2], 1e-4), recording.truth.t_s, recording.skeleton, names)
    assert found.rejected["jump"][30, 0]
    assert found.any[60, [2, near]].sum() == 1
    assert not found.rejected["bone_length"].any()
    assert sum(mask.astype(int) for mask in found.rejected.values()).max() == 1
    assert found.any.sum() == 2


def test_a_stated_speed_limit_counts():
    """The skeleton's limit holds where it is below the derived one."""
    t, xyz = walk(np.random.default_rng(6), 100, 2)
    skeleton = Skeleton(
        name="s", markers=("a", "b"), bones=(Bone(a="a", b="b", rigid=False),), joints=(), max_speed_m_s=0.01
    )
    found = clean(xyz, np.zeros((100, 2)), t, skeleton, ("a", "b"))
    np.testing.assert_array_equal(found.max_speed_m_s, [0.01, 0.01])
    assert found.rejected["jump"].any()


def test_a_marker_never_seen_is_no_trouble():
    """All NaN, one frame, one marker: nothing to reject, nothing to warn of."""
    skeleton = Skeleton(name="s", markers=("a",), bones=(), joints=())
    for n_frames in (1, 30):
        found = clean(
            np.full((n_frames, 1, 3), np.nan),
            np.full((n_frames, 1), np.nan),
            np.arange(float(n_frames)),
            skeleton,
            ("a",),
        )
        assert not found.any.any()
