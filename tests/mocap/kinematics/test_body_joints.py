"""Six coordinates of a joint between bodies: against true poses, XMALab's transforms, and a hinge."""

import numpy as np
import pytest
from mocap.filters.body_axes import nearest_rotation
from mocap.filters.velocities import Motion
from scipy.spatial.transform import Rotation

from mocap.errors import MocapError
from mocap.io.registry import read
from mocap.kinematics import angles
from mocap.kinematics.bodies import joint_quantities, pose_of
from mocap.measures import JointAxes, Measures
from mocap.results.rigid_bodies import write_rigid_bodies
from mocap.skeleton import Skeleton
from tests.filters.bodies_trials import two_bodies
from tests.real_data import real

NAMES = [*(f"p{k}" for k in range(5)), *(f"c{k}" for k in range(5))]


def moving(xyz, t_s, names, sd_m):
    """Positions of independent errors; velocities are differences."""
    own = np.zeros((*xyz.shape[:2], 6, 6), dtype=np.float32)
    own[..., :3, :3] = np.eye(3) * sd_m**2
    return Motion(
        names=tuple(names),
        t_s=t_s,
        xyz_m=xyz,
        velocity_m_s=np.gradient(xyz, t_s, axis=0),
        own=own,
        pairs=np.empty((0, 2), dtype=np.int64),
        cross=np.empty((len(xyz), 0, 6, 6), dtype=np.float32),
        kept=np.ones(xyz.shape),
        measured=np.ones(xyz.shape[:2], dtype=bool),
    )


def skeleton(names, parent, child, name="jaw", **more):
    bodies = {"skull": names[:parent], "jaw": names[parent : parent + child]}
    return Skeleton(markers=names, bodies=bodies, joints={name: ("skull", "jaw")}, **more)


def six(motion, stated):
    return {one.name: one for one in joint_quantities(motion, stated, stated.body_joints[0])}


def true_angles(poses, rotations):
    """(3, T) angles of true rotations in the axes of fitted poses, which they agree with on average."""
    turned = []
    for pose, rotation in zip(poses, rotations, strict=True):
        between = nearest_rotation(np.einsum("tji,tjk->ik", pose.rotation, rotation)[None])[0]
        turned.append(rotation @ between.T)
    return np.degrees(np.array(angles.cardan(np.einsum("tji,tjk->tik", *turned))))


@pytest.mark.parametrize(("noise_m", "slip_m"), [(2e-4, 0.0), (5e-5, 3e-4)])
def test_true_poses(noise_m, slip_m):
    """Angles and translations err by rms 0.83 to 1.2 of what is stated, whether it is noise or slip that errs.

    Over four pairs of bodies; means over time do not count, as axes and origins are those of the mean pose.
    """
    scaled = []
    for seed in range(4):
        made = two_bodies(noise_m=noise_m, slip_m=slip_m, seed=seed)
        motion = moving(made.trial.xyz_m, made.trial.t_s, NAMES, noise_m)
        found = six(motion, skeleton(NAMES, 5, 5))
        poses = pose_of(motion, NAMES[:5]), pose_of(motion, NAMES[5:])
        truth = true_angles(poses, made.rotation.swapaxes(0, 1))
        for axis, true in zip("zyx", truth, strict=True):
            one = found[f"jaw_rotation_{axis}_deg"]
            error = one.value - true
            scaled.append(np.mean(((error - error.mean()) / one.sd) ** 2))
    assert 0.83 < np.sqrt(np.mean(scaled)) < 1.2


def test_without_noise_it_is_exact():
    """Rigid bodies: rotations to rounding, translations those of the child's centre, rates their derivatives."""
    made = two_bodies(noise_m=0.0, seed=1)
    motion = moving(made.xyz_m, made.trial.t_s, NAMES, 1e-6)
    found = six(motion, skeleton(NAMES, 5, 5))
    poses = pose_of(motion, NAMES[:5]), pose_of(motion, NAMES[5:])
    truth = true_angles(poses, made.rotation.swapaxes(0, 1))
    away = np.einsum("tji,tj->ti", poses[0].rotation, made.xyz_m[:, 5:].mean(axis=1) - made.xyz_m[:, :5].mean(axis=1))
    for n, (turn, shift) in enumerate(zip("zyx", "xyz", strict=True)):
        np.testing.assert_allclose(found[f"jaw_rotation_{turn}_deg"].value, truth[n], atol=1e-6)
        along = found[f"jaw_translation_{shift}_m"].value
        np.testing.assert_allclose(along, away[:, n] - away[:, n].mean(), atol=1e-9)
        rate = found[f"jaw_rotation_{turn}_rate_deg_s"].value
        np.testing.assert_allclose(rate[2:-2], np.gradient(truth[n], 0.01)[2:-2], atol=0.02 * np.abs(rate).max())


def test_axes_that_markers_state():
    """A hinge about a stated axis: one angle is its own, the others are 0; a mirror image named right has the same."""
    t_s = np.arange(100) / 100
    bent = np.radians(30) * np.sin(2 * np.pi * t_s)
    base = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    lower = np.einsum("tij,mj->tmi", Rotation.from_rotvec(bent[:, None] * [0, 0, 1]).as_matrix(), base)
    xyz = np.concatenate([np.broadcast_to(base, (100, 4, 3)), lower - np.array([0, 0, 2])], axis=1)
    names = list("abcdefgh")
    axes = JointAxes(parent=(("a", "b"), ("a", "c")), child=(("e", "f"), ("e", "g")))
    for name, turned in (("knee_l", xyz), ("knee_r", xyz * [1, -1, 1])):
        stated = skeleton(names, 4, 4, name=name, measures=Measures(axes={name: axes}))
        found = six(moving(turned, t_s, names, 1e-6), stated)
        np.testing.assert_allclose(found[f"{name}_rotation_z_deg"].value, np.degrees(bent), atol=1e-6)
        for axis in "xy":
            np.testing.assert_allclose(found[f"{name}_rotation_{axis}_deg"].value, 0, atol=1e-6)
        np.testing.assert_allclose(found[f"{name}_translation_z_m"].value, -2, atol=1e-9)


def test_the_jaw_of_a_macaque():
    """Angles of the beads are those of XMALab's transforms to 0.1 degrees RMS; 93 % and more are inside."""
    points = read(real("xromm_macaque_jaw", "3dpts.csv")).points
    rigid = read(real("xromm_macaque_jaw", "rbt.csv")).tables["transforms"][..., :3, :3]
    names = list(points.names)
    xyz = 1e-2 * np.roll(points.xyz_m, 5, axis=1)
    names = names[5:] + names[:5]
    motion = moving(xyz, np.arange(len(xyz)) / 100, names, 1e-6)
    found = six(motion, skeleton(names, 5, 5))
    truth = true_angles((pose_of(motion, names[:5]), pose_of(motion, names[5:])), (rigid[:, 1], rigid[:, 0]))
    columns = [found[f"jaw_rotation_{axis}_deg"] for axis in "zyx"]
    error = np.array([one.value for one in columns]) - truth
    error -= error.mean(axis=1, keepdims=True)
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert np.mean(np.abs(error) < 1.96 * np.array([one.sd for one in columns])) > 0.93


def test_transforms_in_the_format_of_xmalab(tmp_path):
    """They are read back as they were, a frame without three markers as missing; without bodies there are none."""
    made = two_bodies(seed=1, n_frames=60)
    xyz = made.trial.xyz_m.copy()
    xyz[7, :3] = np.nan
    motion = moving(xyz, made.trial.t_s, NAMES, 1e-4)
    write_rigid_bodies(motion, skeleton(NAMES, 5, 5), tmp_path / "rigid.csv")
    found = read(tmp_path / "rigid.csv")
    assert (found.format, found.names) == ("xmalab-rigid-bodies", ("skull", "jaw"))
    transforms = found.tables["transforms"]
    assert np.isnan(transforms[7, 0]).all()
    assert np.isfinite(transforms[np.arange(60) != 7]).all()
    pose = pose_of(motion, NAMES[5:])
    np.testing.assert_allclose(transforms[:, 1, :3, :3], pose.rotation, atol=1e-11)
    np.testing.assert_allclose(transforms[:, 1, :3, 3], pose.position_m, atol=1e-11)
    with pytest.raises(MocapError, match="states no rigid bodies: name their markers"):
        write_rigid_bodies(motion, Skeleton(markers=NAMES), tmp_path / "none.csv")
