"""The mass matrix of a tree of segments and the forces of its motions, beside MuJoCo's and beside energies."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mocap.filters.anatomy import masses_of
from mocap.filters.bodies import Bodies, cloud, rod, rod_masses
from mocap.filters.tree import Tree, left_jacobian, turning_on
from scipy.spatial.transform import Rotation

STORED = json.loads((Path(__file__).parents[1] / "reference" / "mujoco_tree.json").read_text())
AXES = ([np.eye(3), np.eye(3), np.eye(3)], [np.eye(3), np.eye(3)[1:2], np.eye(3)[:2]])


def stored_bodies(axes):
    """The tree of the stored numbers with some of the freedoms of its three ball joints."""
    tree = Tree(
        parent=np.array(STORED["parents"]),
        joint_m=np.array(STORED["joint_m"]),
        axes=np.concatenate(axes),
        joint=np.repeat(np.arange(3), [len(one) for one in axes]),
        segment=np.zeros(1, dtype=int),
        place_m=np.zeros((1, 3)),
    )
    parts = {key: np.array(STORED[key]) for key in ("mass_kg", "centre_m", "inertia_kg_m2")}
    return Bodies(tree=tree, **parts)


def to_mujoco(bodies, turn, angles):
    """(15, 6 + F) from our velocities to MuJoCo's: the root's in the world, joints' turns in the child's axes."""
    out = np.zeros((15, bodies.freedoms))
    out[:3, :3], out[3:6, 3:6] = turn, np.eye(3)
    vectors = bodies.tree.turns(angles[None])[0]
    for j, vector in enumerate(vectors):
        mine = bodies.tree.joint == j
        out[6 + 3 * j : 9 + 3 * j, 6:][:, mine] = left_jacobian(-vector) @ bodies.tree.axes[mine].T
    return out


def test_mass_matrix_is_mujocos():
    """``mj_fullM`` of a free root with three ball joints, read in our velocities, to the digits that were stored."""
    bodies = stored_bodies(AXES[0])
    for case in STORED["cases"]:
        root, *joints = Rotation.from_quat(np.array(case["quaternions_wxyz"]), scalar_first=True)
        angles = np.concatenate([one.as_rotvec() for one in joints])
        to = to_mujoco(bodies, root.as_matrix(), angles)
        expected = to.T @ np.array(case["mass"]) @ to
        np.testing.assert_allclose(bodies.mass(angles[None])[0], expected, rtol=1e-9, atol=1e-9)


def test_fewer_freedoms_are_columns_of_more():
    """A hinge is a ball of which one coordinate moves: M(q) and forces are those of the balls along their columns."""
    balls, fewer = (stored_bodies(axes) for axes in AXES)
    keep = np.concatenate([np.arange(6), 6 + np.array([0, 1, 2, 4, 6, 7])])
    rng = np.random.default_rng(0)
    angles, velocity, acceleration = (rng.normal(size=(3, n)) for n in (6, 12, 12))
    wide = [np.zeros((3, n)) for n in (9, 15, 15)]
    wide[0][:, keep[6:] - 6] = angles
    wide[1][:, keep], wide[2][:, keep] = velocity, acceleration
    np.testing.assert_allclose(fewer.mass(angles), balls.mass(wide[0])[:, keep][:, :, keep], atol=1e-12)
    np.testing.assert_allclose(fewer.force(angles, velocity, acceleration), balls.force(*wide)[:, keep], atol=1e-12)


def test_forces_of_a_motion_are_mujocos():
    """``mj_inverse``: the same motion, its velocities and accelerations read in MuJoCo's."""
    bodies = stored_bodies(AXES[0])
    for case in STORED["cases"]:
        root, *joints = Rotation.from_quat(np.array(case["quaternions_wxyz"]), scalar_first=True)
        turn, vectors = root.as_matrix(), np.array([one.as_rotvec() for one in joints])
        to = to_mujoco(bodies, turn, vectors.ravel())
        velocity = np.linalg.solve(to, case["velocity"])
        # d/dt of J_l(-q) q', that is minus the left one of the inverse motion
        rates = velocity[6:].reshape(3, 3)
        bent = np.concatenate([np.zeros(6), -turning_on(-vectors, -rates).ravel()])
        acceleration = np.linalg.solve(to, np.array(case["acceleration"]) - bent)
        found = bodies.force(vectors.reshape(1, -1), velocity[None], acceleration[None])[0]
        np.testing.assert_allclose(found, to.T @ np.array(case["force"]), rtol=1e-9, atol=1e-9)


def test_the_power_of_the_forces_is_the_growth_of_the_energy():
    """dT/dt = v . force by differences of v^T M v / 2 along a motion: (1e-5)^2 of its third derivative."""
    bodies = stored_bodies(AXES[1])
    rng = np.random.default_rng(1)
    angles, velocity, acceleration = (rng.normal(size=(5, n)) for n in (6, 12, 12))
    along = acceleration.copy()
    along[:, :3] -= np.cross(velocity[:, 3:6], velocity[:, :3])  # components along axes that turn
    h = 1e-5

    def kinetic(s):
        return bodies.kinetic(angles + s * velocity[:, 6:] + s**2 / 2 * acceleration[:, 6:], velocity + s * along)

    power = np.sum(velocity * bodies.force(angles, velocity, acceleration), axis=1)
    np.testing.assert_allclose((kinetic(h) - kinetic(-h)) / (2 * h), power, rtol=1e-6, atol=1e-6)


def test_two_thin_rods_are_the_double_pendulum():
    """M(q) of two rods on hinges, by hand: (m1/3 + m2) l1^2, m2 l1 l2 cos(b) / 2, m2 l2^2 / 3, b the bend between."""
    length, mass = (0.3, 0.2), (0.7, 0.4)
    way = [np.array([one, 0, 0]) for one in length]
    parts = [rod(m, w) for m, w in zip(mass, way, strict=True)]
    tree = Tree(
        parent=np.array([0, 1]),
        joint_m=np.array([[0.0, 0, 0], way[0]]),
        axes=np.array([[0.0, 0, 1.0], [0, 0, 1.0]]),
        joint=np.array([0, 1]),
        segment=np.zeros(1, dtype=int),
        place_m=np.zeros((1, 3)),
    )
    thin = [m * far**2 / 12 * np.diag([0, 1.0, 1.0]) for m, far in zip(mass, length, strict=True)]
    bodies = Bodies(
        tree=tree,
        mass_kg=np.array([1.0, *mass]),
        centre_m=np.array([np.zeros(3), *(centre for centre, _ in parts)]),
        inertia_kg_m2=np.array([np.eye(3), *thin]),
    )
    bend = 0.8
    found = bodies.mass(np.array([[0.3, bend]]))[0, 6:, 6:]
    outer = mass[1] * length[1] ** 2 / 3
    both = outer + mass[1] * length[0] * length[1] * np.cos(bend) / 2
    whole = (mass[0] / 3 + mass[1]) * length[0] ** 2 + 2 * both - outer
    np.testing.assert_allclose(found, [[whole, both], [both, outer]], rtol=1e-12)
    for (_, inertia), m, far in zip(parts, mass, length, strict=True):  # a cylinder, ten times as long as wide
        radius = far / 10
        across = m * (far**2 / 12 + radius**2 / 4)
        np.testing.assert_allclose(inertia, np.diag([m * radius**2 / 2, across, across]), atol=1e-15)


def test_a_cloud_of_balls_has_their_inertia():
    """Two balls on an axis: 2/5 m r^2 about it, and m d^2 more across it."""
    centre, inertia = cloud(3.0, np.array([[1.0, 0, 0], [3.0, 0, 0]]), 0.5)
    np.testing.assert_allclose(centre, [2.0, 0, 0])
    np.testing.assert_allclose(inertia, np.diag([0.3, 3.3, 3.3]), atol=1e-15)


def test_turns_grow_as_differences_say():
    """J_l(v) u and its growth along v + s u, near 0 (series) and far from it: central differences, (1e-5)^2."""
    v, u = np.array([0.05, 0.04, 0.02]), np.array([1.0, 2.0, 3.0])
    for far in (0.0, 1.0, 1.6, 10.0, 40.0):
        ahead, back = (left_jacobian(far * v + s * u) @ u for s in (1e-5, -1e-5))
        np.testing.assert_allclose(turning_on(far * v, u), (ahead - back) / 2e-5, atol=1e-8)


def test_what_is_no_body_is_refused():
    bodies = stored_bodies(AXES[0])
    with pytest.raises(ValueError, match="mass_kg must be above 0"):
        replace(bodies, mass_kg=np.array([1.0, 0.0, 1.0, 1.0]))
    with pytest.raises(ValueError, match="3 segments must have shape"):
        replace(bodies, centre_m=np.zeros((3, 3)))


def test_masses_are_those_stated_spread_over_the_bones_between():
    """An arm of 30 g over 0.3 and 0.2 m: 18 and 12 g; the finger gets the least density; one bone keeps its centre."""
    names = ["s", "e", "w", "t"]
    bones = [(0, 1), (1, 2), (2, 3)]
    lengths = np.array([0.3, 0.2, 0.1])
    mass, centre, stated = rod_masses(bones, lengths, masses_of(names, [("s", "w", 0.03, 0.5)]))
    assert stated
    np.testing.assert_allclose(mass, [0.018, 0.012, 0.006])
    _, centre, _ = rod_masses(bones, lengths, masses_of(names, [("e", "s", 0.001, 0.4)]))
    np.testing.assert_allclose(centre, [0.6, 0.5, 0.5])
    mass, _, stated = rod_masses(bones, lengths, [])
    assert not stated
    assert mass.sum() == pytest.approx(1.0)
