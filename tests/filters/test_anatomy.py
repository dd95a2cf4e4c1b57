"""Limbs, sides, and potentials of relative joint coordinates."""

import numpy as np
import pytest
from mocap.datasets.bat_skeleton import bat_skeleton
from mocap.datasets.lizards import lizard_skeleton
from mocap.filters.anatomy import Anatomy, Limb, anatomy_of, counterparts, reflection
from mocap.filters.models.base import TrialSet
from mocap.filters.models.pose import PoseSettings
from mocap.filters.poses import MarkerTrial
from scipy.spatial.transform import Rotation


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("elbow_l", "elbow_r"),
        ("elbL", "elbR"),
        ("LElbow", "RElbow"),
        ("left elbow", "right elbow"),
        ("Left_Elbow", "Right_Elbow"),
        ("l_elbow", "r_elbow"),
        ("hind.L.toe", "hind.R.toe"),
    ],
)
def test_sides_are_told_by_name(left, right):
    """However a file writes left and right; what has no counterpart is its own."""
    assert counterparts(["skull", left, "tail", right, "elbow"]) == (0, 3, 2, 1, 4)


def test_names_that_only_look_like_sides_are_none():
    """An l or r within a word, or a side whose other is not there, is no side."""
    names = ["tail", "tair", "rostrum", "lostrum", "elbow_l", "knee_r"]
    assert counterparts(names) == tuple(range(6))


def test_limbs_of_the_twins():
    """Each marker is in one limb; the bat's wings and the lizard's arms are pairs (its legs hang on its own pelvis)."""
    for skeleton, paired in ((bat_skeleton(), 2), (lizard_skeleton(), 2)):
        anatomy = anatomy_of(skeleton.markers, skeleton.trunk, skeleton.rigid)
        limbs = anatomy.limbs
        children = [child for limb in limbs for child in limb.children]
        assert len(children) == len(set(children))
        assert not set(children) & set(anatomy.trunk)
        both = [limb for limb in limbs if anatomy.mirrored(limb) is not None]
        assert len(both) == paired
        for limb in both:
            other = anatomy.mirrored(limb)
            assert other is not None
            assert {skeleton.markers[m] for m in other.children} in [
                {skeleton.markers[m] for m in x.children} for x in both
            ]
            assert all(skeleton.markers[m].endswith(("_l", "_r")) for m in limb.children)


def test_relative_joint_coordinates():
    """They are the differences of neighbours; a closed ring of bones is cut, not walked for ever."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=(5, 3))
    limb = Limb((3, 4), (1, 3))
    np.testing.assert_allclose((limb.map(5) @ x.ravel()).reshape(2, 3), [x[3] - x[1], x[4] - x[3]])
    turn = Rotation.random(rng=rng).as_matrix()
    np.testing.assert_allclose(
        (limb.map(5, turn) @ x.ravel()).reshape(2, 3), [(x[3] - x[1]) @ turn, (x[4] - x[3]) @ turn]
    )
    ring = Anatomy((0,), ((0, 1), (1, 2), (2, 3), (3, 1)))
    assert [sorted(limb.children) for limb in ring.limbs] == [[1, 2, 3]]


def test_a_reflection_is_found():
    """That of SciPy's rotation applied to a mirrored body, for noise-free pairs; a lopsided body is missed by much."""
    rng = np.random.default_rng(1)
    left = rng.normal(loc=(0, 3, 0), size=(6, 3))
    pose = np.concatenate([left, left * [1, -1, 1]]) @ Rotation.random(rng=rng).as_matrix()
    mirror = [*range(6, 12), *range(6)]
    turn, missed = reflection(pose, mirror)
    assert missed < 1e-12
    assert np.linalg.det(turn) == pytest.approx(-1)
    centre = pose.mean(axis=0)
    np.testing.assert_allclose((pose - centre) @ turn, pose[mirror] - centre, atol=1e-12)
    assert reflection(rng.normal(size=(12, 3)), mirror)[1] > 0.3


def walker(seed, frames=240):
    """A trunk of four markers and a leg on each side, which swing by one angle each; each recording another stretch."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / 100
    trunk = np.array([[0.1, 0.02, 0], [0.1, -0.02, 0], [-0.1, 0.02, 0], [-0.1, -0.02, 0.03]])
    parts = [np.tile(trunk, (frames, 1, 1))]
    for side, phase in ((1, 0.0), (-1, np.pi)):
        angle = 0.5 * np.sin(7 * t + phase + rng.uniform(0, 6))
        knee = np.stack([0.08 * np.sin(angle), np.full(frames, 0.05 * side), -0.08 * np.cos(angle)], axis=1)
        bent = angle - 0.4 - 0.3 * np.cos(7 * t + phase)
        foot = knee + np.stack([0.07 * np.sin(bent), 0 * t, -0.07 * np.cos(bent)], axis=1)
        parts += [knee[:, None], foot[:, None]]
    xyz = np.concatenate(parts, axis=1) + 2e-4 * rng.normal(size=(frames, 8, 3))
    return MarkerTrial(name=str(seed), t_s=t, xyz_m=xyz, sd_m=np.full((frames, 8), 2e-4))


NAMES = ("a", "b", "c", "d", "knee_l", "foot_l", "knee_r", "foot_r")
BONES = (("a", "knee_l"), ("knee_l", "foot_l"), ("b", "knee_r"), ("knee_r", "foot_r"))


@pytest.mark.rare
@pytest.mark.parametrize("potential", ["limbs", "limb motion"])
def test_limbs_hold_the_pose(potential):
    """A potential a leg, learned from both: it reads differences of the model's own markers and velocities.

    Samples are twice the frames; a leg that is bent as none ever was is pulled back.
    """
    anatomy = anatomy_of(NAMES, NAMES[:4], BONES)
    trials = TrialSet([walker(1), walker(2)], anatomy)
    settings = PoseSettings(ranks=(4,), potential=potential, regression=0.0)
    model = settings.fit(trials).motion
    assert model.name == "eal"
    assert [limb.children for limb in anatomy.limbs] == [(4, 5), (6, 7)]
    assert len(model.potentials) == 2
    rng, n = np.random.default_rng(3), 2 * model.rank
    state = np.zeros(model.size)
    state[: model.rank] = 0.01 * rng.normal(size=model.rank)
    state[model.parts[2]] = 1e-3 * rng.normal(size=24)
    state[model.rank : n] = rng.normal(size=model.rank)
    body = (model.subspace.mean + model.subspace.basis @ state[: model.rank] + state[model.parts[2]]).reshape(-1, 3)
    speed = (model.subspace.basis @ state[model.rank : n]).reshape(-1, 3)
    for limb, held in zip(anatomy.limbs, model.potentials, strict=True):
        q = held.mean + held.on_shape @ state[:n] + held.on_residual @ state[model.parts[2]]
        away = np.diff(body[[limb.parents[0], *limb.children]], axis=0).ravel()
        unit = np.linalg.norm(away) / np.linalg.norm(q[:6])
        np.testing.assert_allclose(unit * q[:6], away, rtol=1e-9)
        moving = np.diff(speed[[limb.parents[0], *limb.children]], axis=0).ravel()
        if potential == "limb motion":
            assert np.linalg.norm(q[6:]) == pytest.approx(np.linalg.norm(moving) * model_tau(settings, trials) / unit)
        else:
            assert len(q) == 6
        assert 1.6 * 480 < len(held.samples) <= 960
        inside, outside = held.samples[::20], 3 * held.samples[::20] + 2
        assert np.linalg.norm(held.gradient(outside), axis=1).min() > np.median(
            np.linalg.norm(held.gradient(inside), axis=1)
        )


def model_tau(settings, trials):
    """The time that makes velocities as large as shapes, over the frames that are learned from."""
    _, shapes = trials.shapes(settings.ranks)
    z, rate = np.concatenate(shapes.z), np.concatenate(shapes.rate)
    return pytest.approx(np.sqrt(z.var(axis=0).sum() / rate.var(axis=0).sum()), rel=0.05).expected


@pytest.mark.rare
def test_without_limbs_the_whole_pose_is_held():
    """Where the skeleton names no bones that leave the trunk."""
    trials = TrialSet([walker(1, 120)], Anatomy((0, 1, 2, 3)))
    model = PoseSettings(ranks=(3,), regression=0.0).fit(trials).motion
    (held,) = model.potentials
    assert held.on_shape.shape == (6, 6)
    assert not held.on_residual.any()
