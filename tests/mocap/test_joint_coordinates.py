"""Relative joint coordinates against explicit geometry."""

import numpy as np
import pytest
from mocap.filters.body_axes import BodyFrames
from scipy.spatial.transform import Rotation

from mocap.joints import FRAMES, joint_variables
from mocap.records import MarkerTracks, Status
from mocap.skeleton import Joint, Skeleton

SKELETON = Skeleton(
    name="arm",
    markers=("shoulder", "elbow", "wrist"),
    joints=(Joint(name="elbow", parent="shoulder", centre="elbow", child="wrist"),),
)


def arm(bend_rad, *, tilt=0.0):
    """An arm of 0.3 and 0.25 m in a plane of the body, bent by angles; (T, 3, 3) in body axes."""
    t = len(bend_rad)
    xyz = np.zeros((t, 3, 3))
    xyz[:, 1] = [0.3, 0, 0]
    xyz[:, 2] = xyz[:, 1] + 0.25 * np.stack([np.cos(bend_rad), np.sin(bend_rad), np.zeros(t)], axis=1)
    return xyz @ Rotation.from_euler("xyz", [tilt, 0.3, 0.2]).as_matrix().T


def tracked(body, rng, sd=1e-3):
    """The arm carried by a body that turns and moves; its tracks and body frames."""
    rotation = Rotation.random(len(body), rng=rng).as_matrix()
    position = rng.normal(size=(len(body), 3))
    xyz = np.einsum("tij,tmj->tmi", rotation, body) + position[:, None]
    tracks = MarkerTracks(
        names=SKELETON.markers,
        t_s=np.arange(len(body)) * 0.01,
        xyz_m=xyz,
        cov_m2=np.broadcast_to(sd**2 * np.eye(3), (*xyz.shape[:2], 3, 3)),
        status=np.where(np.isnan(xyz[..., 0]), Status.MISSING, Status.MEASURED),
    )
    return tracks, BodyFrames(rotation=rotation, position_m=position)


def test_world_and_body_are_differences():
    """The child minus its centre, in the world's axes and in the body's, whatever the body does."""
    body = arm(np.linspace(0.3, 2.0, 20))
    tracks, frames = tracked(body, np.random.default_rng(1))
    found = joint_variables(tracks, SKELETON, frames)
    assert tuple(found) == (*(f"joint_{frame}" for frame in FRAMES), "joint_sd")
    np.testing.assert_allclose(found["joint_world"][:, 0], tracks.xyz_m[:, 2] - tracks.xyz_m[:, 1], atol=1e-12)
    np.testing.assert_allclose(found["joint_body"][:, 0], body[:, 2] - body[:, 1], atol=1e-12)


@pytest.mark.parametrize("tilt", [0.0, 1.0, 2.5])
def test_the_limbs_plane_holds_the_bend(tilt):
    """Elbow at the origin, first axis along shoulder to elbow: 0.25 (cos, +-sin) of the bend, one sign throughout.

    However the plane lies in the body, and however the body turns: these coordinates are the angle of the joint.
    """
    bend = np.linspace(-0.7, 2.0, 40)
    tracks, frames = tracked(arm(bend, tilt=tilt), np.random.default_rng(2))
    found = joint_variables(tracks, SKELETON, frames)
    for frame in ("limb", "plane"):
        q = found[f"joint_{frame}"][:, 0]
        np.testing.assert_allclose(q[:, 0], 0.25 * np.cos(bend), atol=1e-9)
        sign = np.sign(q[-1, 1])
        np.testing.assert_allclose(sign * q[:, 1], 0.25 * np.sin(bend), atol=1e-9)


def test_a_straight_arm_has_coordinates():
    """Exactly straight, the limb's plane is undefined and the coordinates are not: (length, 0)."""
    bend = np.r_[np.full(5, 0.8), 0.0, np.full(5, 0.8)]
    tracks, frames = tracked(arm(bend), np.random.default_rng(3))
    np.testing.assert_allclose(joint_variables(tracks, SKELETON, frames)["joint_limb"][5, 0], [0.25, 0], atol=1e-9)


def test_what_is_not_seen_has_no_coordinates():
    """NaN where a marker of the joint is missing; a joint never seen is NaN throughout; deviations likewise."""
    body = arm(np.linspace(0.3, 2.0, 20))
    body[4, 2] = np.nan
    body[7, 0] = np.nan
    tracks, frames = tracked(body, np.random.default_rng(4), sd=2e-3)
    found = joint_variables(tracks, SKELETON, frames)
    for name in FRAMES:
        missing = np.isnan(found[f"joint_{name}"][:, 0]).any(axis=1)
        expected = {4} if name in ("world", "body", "plane") else {4, 7}
        assert set(np.flatnonzero(missing)) == expected
    assert np.flatnonzero(np.isnan(found["joint_sd"][:, 0])).tolist() == [4]
    assert found["joint_sd"][0, 0] == pytest.approx(2e-3 * np.sqrt(2))
    tracks, frames = tracked(np.full_like(body, np.nan), np.random.default_rng(5))
    assert all(np.isnan(q).all() for q in joint_variables(tracks, SKELETON, frames).values())


def test_no_joints():
    """A skeleton without joints has empty tracks of the right shapes."""
    tracks, frames = tracked(arm(np.ones(3)), np.random.default_rng(6))
    bare = Skeleton(name="bare", markers=SKELETON.markers)
    found = joint_variables(tracks, bare, frames)
    assert {name: q.shape for name, q in found.items()} == {
        "joint_world": (3, 0, 3),
        "joint_body": (3, 0, 3),
        "joint_plane": (3, 0, 2),
        "joint_limb": (3, 0, 2),
        "joint_sd": (3, 0),
    }
