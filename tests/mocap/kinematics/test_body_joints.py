"""Six coordinates of a joint between bodies: against true poses, XMALab's transforms, and a hinge."""

from dataclasses import replace

import numpy as np
import pytest
from mocap.filters.body_axes import nearest_rotation
from scipy.spatial.transform import Rotation

from mocap.errors import MocapError, SkeletonError
from mocap.io.registry import read
from mocap.kinematics import angles
from mocap.kinematics.bodies import joint_quantities, with_places
from mocap.kinematics.functional import pose_of
from mocap.measures import SEQUENCES, JointAxes, Measures
from mocap.results.exports import write_rigid_bodies
from mocap.skeleton import Skeleton, write_skeleton
from mocap.skeleton_files import read_skeleton
from tests.filters.bodies_trials import two_bodies
from tests.mocap.kinematics.body_motions import NAMES, moving, screw, skeleton
from tests.real_data import real


def six(motion, stated):
    return {one.name: one for one in joint_quantities(motion, stated, stated.body_joints[0])[0]}


def true_angles(poses, rotations):
    """(3, T) angles of true rotations in the axes of fitted poses, which they agree with on average."""
    turned = []
    for pose, rotation in zip(poses, rotations, strict=True):
        between = nearest_rotation(np.einsum("tji,tjk->ik", pose.rotation, rotation)[None])[0]
        turned.append(rotation @ between.T)
    return np.degrees(np.array(angles.euler(np.einsum("tji,tjk->tik", *turned))))


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


PLACES_M = np.random.default_rng(0).normal(size=(10, 3)) * 0.02 + np.repeat([[-0.03, 0, 0], [0.03, 0, 0]], 5, axis=0)
AXES = JointAxes(
    **{
        part: dict(zip(NAMES[5 * n : 5 * n + 5], map(tuple, PLACES_M[5 * n : 5 * n + 5]), strict=True))
        for n, part in enumerate(("parent", "child"))
    }
)
"""Both bodies have the parent's axes while the joint's angle is 0."""


def test_angular_velocities():
    """Of a screw they are the rate of its angle about z, exactly; with noise their errors are what is stated."""
    t_s = np.arange(200) / 100
    stated = skeleton(NAMES, 5, 5, measures=Measures(axes={"jaw": AXES}))
    xyz, _, angle = screw(t_s, places_m=PLACES_M)
    step = 1e-6
    speed = (screw(t_s + step, places_m=PLACES_M)[0] - screw(t_s - step, places_m=PLACES_M)[0]) / (2 * step)
    truth = np.degrees(np.stack([0 * angle, 0 * angle, 0.5 * 0.8 * 7 * np.cos(7 * t_s)]))
    exact = six(moving(xyz, t_s, NAMES, 1e-6, velocity_m_s=speed), stated)
    for axis, true in zip("xyz", truth, strict=True):
        np.testing.assert_allclose(exact[f"jaw_angular_velocity_{axis}_deg_s"].value, true, atol=1e-5)
    rng, scaled = np.random.default_rng(1), []
    for sd_m, sd_m_s in ((1e-6, 0.02), (3e-4, 1e-4), (2e-4, 0.01)):
        seen = xyz + sd_m * rng.normal(size=xyz.shape)
        fast = speed + sd_m_s * rng.normal(size=xyz.shape)
        found = six(moving(seen, t_s, NAMES, sd_m, velocity_m_s=fast, sd_m_s=sd_m_s), stated)
        columns = [found[f"jaw_angular_velocity_{axis}_deg_s"] for axis in "xyz"]
        error = np.array([one.value for one in columns]) - truth
        scaled.append(np.sqrt(np.mean((error / np.array([one.sd for one in columns])) ** 2)))
    assert min(scaled) > 0.83
    assert max(scaled) < 1.2


def test_helical_axes():
    """Those of a screw are its own: angle, pitch, direction and a point; with noise errors are what is stated."""
    t_s = np.arange(200) / 100
    stated = skeleton(NAMES, 5, 5, measures=Measures(axes={"jaw": replace(AXES, helical=True)}))
    xyz, _, angle = screw(t_s, places_m=PLACES_M)
    truth = {"angle_deg": np.degrees(angle), "shift_m": 0.01 * angle, "direction_x_1": 0, "direction_y_1": 0}
    truth |= {"direction_z_1": 1, "point_x_m": 0.01, "point_y_m": 0.02, "point_z_m": 0}
    exact = six(moving(xyz, t_s, NAMES, 1e-6), stated)
    for name, true in truth.items():
        np.testing.assert_allclose(exact[f"jaw_helical_{name}"].value, true, atol=1e-7)
    noisy = xyz + 1e-5 * np.random.default_rng(2).normal(size=xyz.shape)
    found = six(moving(noisy, t_s, NAMES, 1e-5), stated)
    scaled = [
        ((found[f"jaw_helical_{name}"].value - true) / found[f"jaw_helical_{name}"].sd) ** 2
        for name, true in truth.items()
        if name not in ("direction_z_1", "point_z_m")
    ]  # of second order
    assert 0.83 < np.sqrt(np.mean(scaled)) < 1.2


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_sequences(sequence):
    """All twelve are those of SciPy, and each column is called by its axis."""
    turned = Rotation.random(50, rng=np.random.default_rng(3))
    expected = turned.as_euler(sequence.upper())
    np.testing.assert_allclose(np.stack(angles.euler(turned.as_matrix(), sequence), axis=1), expected, atol=1e-12)
    made = two_bodies(seed=2, n_frames=40)
    stated = skeleton(NAMES, 5, 5, measures=Measures(axes={"jaw": JointAxes(sequence=sequence)}))
    found = six(moving(made.trial.xyz_m, made.trial.t_s, NAMES, 1e-4), stated)
    first, second, third = sequence
    called = (first, second, third if first != third else f"{third}2")
    assert [f"jaw_rotation_{one}_deg" in found for one in called] == [True] * 3


def test_axes_as_places_of_markers(tmp_path):
    """They are those that state them, also where other markers of the body move the mean pose, and are read back."""
    made = two_bodies(seed=3)
    motion = moving(made.trial.xyz_m, made.trial.t_s, NAMES, 1e-4)
    lines = JointAxes(parent=(("p0", "p1"), ("p0", "p2")), child=(("c0", "c1"), ("c0", "c2")), sequence="xyz")
    stated = skeleton(NAMES, 5, 5, measures=Measures(axes={"jaw": lines}))
    write_skeleton(tmp_path / "placed.toml", with_places(motion, stated))
    placed = read_skeleton(tmp_path / "placed.toml")
    assert set(placed.measures.axes["jaw"].parent) == set(NAMES[:5])
    before, after = six(motion, stated), six(motion, placed)
    assert list(before) == list(after)
    for name, one in before.items():
        np.testing.assert_allclose(after[name].value, one.value, rtol=1e-5, atol=1e-6)


def test_axes_that_contradict_the_skeleton():
    """Errors say what is expected: a marker of another body, too few places, a joint of markers, an odd sequence."""
    places = dict.fromkeys(NAMES[:3], (0.0, 0.0, 0.0))
    for axes, message in (
        (JointAxes(parent=(("p0", "c1"), ("p0", "p2")), child=(("c0", "c1"), ("c0", "c2"))), "'c1' for 'skull'"),
        (JointAxes(parent={"p0": (0.0, 0.0, 0.0)}, child=places), "axes need 3 at least"),
    ):
        with pytest.raises(SkeletonError, match=message):
            skeleton(NAMES, 5, 5, measures=Measures(axes={"jaw": axes}))
    with pytest.raises(SkeletonError, match="of a joint of three markers are directions"):
        Skeleton(markers=NAMES, joints={"k": NAMES[:3]}, measures={"axes": {"k": {"functional": "ball"}}})
    for entry, message in (
        ({"sequence": "zzy"}, "sequence must be one of xyx"),
        ({"functional": "saddle"}, "functional must be ball or hinge"),
        ({"parent": {"p0": [1.0, 2.0]}, "child": {}}, "has shape"),
        (
            {"functional": "ball", "parent": [["p0", "p1"], ["p0", "p2"]], "child": [["c0", "c1"], ["c0", "c2"]]},
            "none where",
        ),
    ):
        with pytest.raises(SkeletonError, match=message):
            skeleton(NAMES, 5, 5, measures={"axes": {"jaw": entry}})
