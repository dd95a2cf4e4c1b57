"""Frames that move with a marker's neighbours."""

import numpy as np
import pytest
from mocap.filters.models.delayed_poses import Neighbours, body_itself
from scipy.spatial.transform import Rotation

WHICH = np.array([True, True, False, True, True])


def segment(rng, n=40, bend=0.0):
    """A rigid body of five markers that turns and moves at will, (n, 5, 3), with its motion; bent where wanted."""
    shape = 0.03 * np.array([[1, 1, 1], [1, -1, -1], [0.5, 0.5, 0], [-1, 1, -1], [-1, -1, 1.0]])
    turn = Rotation.from_rotvec(rng.normal(0, 0.6, (n, 3)))
    poses = np.stack([t.apply(shape) for t in turn]) + rng.normal(0, 0.1, (n, 1, 3))
    return poses + rng.normal(0, bend, poses.shape)


@pytest.mark.parametrize("seed", range(5))
def test_a_marker_of_a_rigid_segment_rests_among_its_neighbours(seed):
    """It turns by a radian and moves by 100 mm; seen from the others it stays within what the firmness leaves, 1 mm."""
    poses = segment(np.random.default_rng(seed))
    near = Neighbours.of(WHICH, poses, np.full(4, 0.01))
    rest = near.frames(poses).to_body(poses[:, [2]])[:, 0]
    assert rest.std(axis=0).max() < 1e-3 < 0.03 < poses[:, 2].std(axis=0).min()


@pytest.mark.parametrize("seed", range(5))
def test_frames_are_those_of_weighted_procrustes_analysis(seed, monkeypatch):
    """Without firmness: scipy's solution of Wahba's problem with the same weights; the origin is their mean."""
    monkeypatch.setattr("mocap.filters.models.delayed_poses.FIRM", 0.0)
    rng = np.random.default_rng(seed)
    poses = segment(rng, bend=0.002)
    near = Neighbours.of(WHICH, poses, rng.uniform(0.01, 0.03, 4))
    assert near.weight.sum() == pytest.approx(1.0)
    found = near.frames(poses)
    for i, pose in enumerate(poses[:, WHICH]):
        np.testing.assert_allclose(found.position_m[i], near.weight @ pose, atol=1e-12)
        expected, _ = Rotation.align_vectors(pose - near.weight @ pose, near.shape, weights=near.weight)
        np.testing.assert_allclose(found.rotation[i], expected.as_matrix(), atol=1e-9)


def test_what_keeps_its_distance_weighs_most():
    """Of two neighbours that move apart from the marker by 1 and by 10 mm the first weighs some thousand times more."""
    poses = segment(np.random.default_rng(0))
    weight = Neighbours.of(WHICH, poses, np.array([0.001, 0.01, 0.01, 0.01])).weight
    assert 1e3 < weight[0] / weight[1] < 1e4


def test_neighbours_on_a_line_do_not_spin():
    """How a line turns about itself is not told: the frame turns no further than the line does, by noise as little."""
    rng = np.random.default_rng(1)
    line = np.linspace(-0.05, 0.05, 4)[:, None] * [1.0, 0.0, 0.0]
    angle = 0.3 * np.sin(np.linspace(0, 6, 60))
    turn = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0])
    poses = np.insert(np.stack([t.apply(line) for t in turn]), 2, 0.0, axis=1) + rng.normal(0, 1e-4, (60, 5, 3))
    near = Neighbours.of(WHICH, poses, np.full(4, 0.01))
    relative = Rotation.from_matrix(np.array(near.frames(poses).rotation)) * turn.inv()
    assert np.linalg.norm((relative[0].inv() * relative).as_rotvec(), axis=1).max() < 0.1


def test_the_body_itself_changes_nothing():
    """Points are where they were."""
    points = np.random.default_rng(2).normal(size=(3, 5, 3))
    np.testing.assert_array_equal(body_itself(3).to_body(points), points)
