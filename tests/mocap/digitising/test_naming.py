"""Names of one frame: what contradicts them, and what two dots in one say of a place."""

import numpy as np
import pytest
from scipy.sparse.csgraph import shortest_path

from mocap.digitising.meeting import Lengths, reaches, violated
from mocap.digitising.motion import State
from mocap.digitising.naming import Named, name_dots, seen_from
from mocap.digitising.observer import Observer
from tests.mocap.digitising.test_errors import EYES, matrices

CHAIN = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [0.03, 0.04, 0.0], [0.03, 0.04, 0.05], [0.07, 0.04, 0.05]])
ENDS = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])


def chain():
    """Bones of 30, 40, 50 and 40 mm."""
    return Lengths(ENDS, np.linalg.norm(CHAIN[1:] - CHAIN[:-1], axis=1), np.full(4, 5e-4))


def test_reaches_are_shortest_paths():
    """Of a graph with a cycle and a part of its own: those that SciPy finds."""
    ends = np.array([[0, 1], [1, 2], [2, 3], [0, 3], [3, 4], [5, 6]])
    length_m = np.array([0.3, 0.4, 0.2, 0.1, 0.5, np.nan])
    graph = np.zeros((7, 7))
    graph[tuple(ends[:5].T)] = length_m[:5]
    want = shortest_path(graph, directed=False)
    np.fill_diagonal(want, np.inf)
    np.testing.assert_allclose(reaches(Lengths(ends, length_m, np.full(6, 1e-3)), 7), want)


def test_markers_farther_apart_than_bones_are_long_contradict():
    """A chain is possible; its third marker 60 mm away contradicts neighbours by bones and others by reach."""
    cov = np.repeat(1e-8 * np.eye(3)[None], 5, axis=0)
    bones = chain()
    farthest = reaches(bones, 5)
    assert not len(violated(CHAIN, cov, bones, farthest))
    assert not len(violated(np.where(np.arange(5)[:, None] == 4, CHAIN[3] - [0.04, 0, 0], CHAIN), cov, bones, farthest))
    moved = CHAIN + 0.0
    moved[2] -= [0.0, 0.06, 0.12]
    pairs = [tuple(pair) for pair in violated(moved, cov, bones, farthest).tolist()]
    assert {(1, 2), (2, 3), (0, 2), (2, 4)} == set(pairs)
    # what is hardly known contradicts nothing
    assert not len(violated(moved, 1e6 * cov * np.eye(5)[2][:, None, None] + cov, bones, farthest))


@pytest.mark.parametrize("wrong", [1, 2, 3])
def test_the_wrong_name_is_lost_not_those_that_it_contradicts(wrong):
    """One marker of the chain has another's dots, and surprises less than its neighbours do: it alone is unnamed."""
    cameras = matrices()
    at = CHAIN + 0.0
    at[wrong] -= [0.0, 0.05, 0.12]
    dots, _ = seen_from(cameras, at)
    # neighbours are predicted 2 mm off, the wrong one where its dots are
    state = at + np.where(np.arange(5)[:, None] == wrong, 0.0, 0.002)
    cov = np.repeat(np.diag(np.repeat([4e-6, 1e-6, 1e-6], 3))[None], 5, axis=0)
    observer = Observer(cameras, chain(), np.full(4, 10), np.zeros(5, dtype=bool), length_m=0.2, sd_px=0.3)
    x = np.concatenate([state, np.zeros((5, 6))], axis=1)
    named, _ = observer.observed(
        dots, np.full(dots.shape[:2], 0.3), np.full(dots.shape, np.nan), State(x, cov), owner=np.full((4, 5), -1)
    )
    np.testing.assert_array_equal(named.rays, np.where(np.arange(5) == wrong, 0, 4))


def test_lengths_do_not_follow_a_wrong_name():
    """Of 40 measurements of which 4 are twice as long the length is right to 3 %: each counts as three deviations."""
    observer = Observer(matrices(), chain(), np.full(4, 10), np.zeros(5, dtype=bool), length_m=0.2)
    cov = np.repeat(1e-8 * np.eye(3)[None], 5, axis=0)
    rays, nothing = np.full(5, 4), np.zeros((4, 5), dtype=bool)
    for frame in range(40):
        at = CHAIN + 0.0
        at[4] += [0.04 * (5 <= frame < 9), 0, 0]
        observer.measure_bones(Named(np.zeros((4, 5), dtype=np.int64), at, cov, rays < 0, np.ones(5), rays, nothing))
    assert observer.lengths.length_m[3] == pytest.approx(0.04, rel=0.03)
    assert observer.lengths.sd_m[3] < 0.05 * 0.04


def test_two_dots_in_one_are_no_place_of_either():
    """Rays that meet in a dot 4 px from where another marker without a dot is: a quarter of 6 px for a deviation.

    Where the other marker is elsewhere, the same rays are as sure as dots are.
    """
    cameras = matrices()
    to_eye = EYES[0] / np.linalg.norm(EYES[0])
    sideways = np.cross(to_eye, [0.0, 0.0, 1.0])
    # 0.3 m nearer to the first camera, 2 m away: beside the first marker in its picture alone
    places = np.array([[0.0, 0.0, 0.0], 0.3 * to_eye + 0.0069 * sideways / np.linalg.norm(sideways)])
    uv, _ = seen_from(cameras, places)
    assert np.linalg.norm(uv[0, 1] - uv[0, 0]) == pytest.approx(4.0, abs=0.2)
    dots = np.where(np.arange(4)[:, None, None] < 2, uv[:, :1], np.nan)
    cov = np.repeat(1e-4 * np.eye(3)[None], 2, axis=0)
    known = np.array([[0, -1], [0, -1], [-1, -1], [-1, -1]])
    options = {"sd_px": np.full((4, 1), 0.3), "reach_px": 6.0, "clicked_dots": known}
    sure = name_dots(cameras, dots, places + np.array([[0, 0, 0], [0, 0, 0.2]]), cov, guessed=known >= 0, **options)
    assert not sure.merged.any()
    assert across(cameras[0], sure) == pytest.approx(0.3, rel=0.1)
    found = name_dots(cameras, dots, places, cov, guessed=known >= 0, **options)
    np.testing.assert_array_equal(found.merged, [[True, False], [False, False], [False, False], [False, False]])
    assert across(cameras[0], found) == pytest.approx(6.0 / 4, rel=0.1)
    # what a person clicked is as sure as a dot
    assert not name_dots(cameras, dots, places, cov, guessed=known < 0, **options).merged.any()


def across(camera, named):
    """Standard deviation in pixels of the first marker along the picture's rows."""
    _, jacobian = seen_from(camera[None], named.xyz_m)
    return np.sqrt(jacobian[0, 0, 0] @ named.cov_m2[0] @ jacobian[0, 0, 0])
