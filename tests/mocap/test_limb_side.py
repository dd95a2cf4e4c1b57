"""The limb's own plane: which side of it a joint is on."""

import numpy as np
from mocap.filters.body_axes import BodyFrames

from mocap.joints import joint_variables
from mocap.records import MarkerTracks, Status
from mocap.skeleton import Joint, Skeleton


def limb(bend_rad: np.ndarray, turn_rad: np.ndarray) -> np.ndarray:
    """(T, 2) limb coordinates of an arm that bends in a plane which turns about its upper part."""
    n = len(bend_rad)
    parent, centre = np.tile([-1.0, 0, 0], (n, 1)), np.zeros((n, 3))
    across = np.stack([np.zeros(n), np.cos(turn_rad), np.sin(turn_rad)], axis=1)
    child = np.cos(bend_rad)[:, None] * [1.0, 0, 0] + np.sin(bend_rad)[:, None] * across
    xyz = np.stack([parent, centre, child], axis=1)
    tracks = MarkerTracks(
        names=("a", "b", "c"),
        t_s=np.arange(n) / 100,
        xyz_m=xyz,
        cov_m2=np.zeros((n, 3, 3, 3)),
        status=np.full((n, 3), Status.MEASURED),
    )
    skeleton = Skeleton(
        name="arm", markers=("a", "b", "c"), joints=(Joint(name="b", parent="a", centre="b", child="c"),)
    )
    frames = BodyFrames(rotation=np.tile(np.eye(3), (n, 1, 1)), position_m=np.zeros((n, 3)))
    return joint_variables(tracks, skeleton, frames)["joint_limb"][:, 0]


def test_a_plane_that_turns_right_round_keeps_the_side():
    """The bend stays 60 degrees while the limb's plane turns by 300: q = (cos, sin) of the bend throughout."""
    n = 400
    q = limb(np.full(n, np.pi / 3), np.linspace(0, 5.2, n))
    np.testing.assert_allclose(q, np.tile([0.5, np.sqrt(3) / 2], (n, 1)), atol=1e-12)  # rounding of unit vectors


def test_a_joint_that_bends_over_straight_changes_sign():
    """Bent from +40 to -40 degrees in a fixed plane the second coordinate is sin of the bend, through zero."""
    bend = np.linspace(0.7, -0.7, 201)
    q = limb(bend, np.full(201, 0.3))
    sign = np.sign(q[0, 1])
    np.testing.assert_allclose(q, np.stack([np.cos(bend), sign * np.sin(bend)], axis=1), atol=1e-12)
