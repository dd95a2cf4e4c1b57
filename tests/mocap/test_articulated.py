"""The animal as segments and joints: types of known linkages, what is not determined, and the MJCF file of it."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from mocap.filters.joint_types import articulation, undetermined
from scipy.spatial.transform import Rotation

from mocap.errors import MocapError
from mocap.records import marker_tracks
from mocap.results.mjcf import mjcf_text
from mocap.results.osim import osim_text
from mocap.skeleton import Bone, Skeleton
from mocap.tracking.tracking import of_tracks

NAMES = ("a", "b", "c", "shoulder", "elbow", "wrist", "tip")
LENGTHS = (0.3, 0.25, 0.1)
SKELETON = Skeleton(
    name="arm",
    markers=NAMES,
    bones=(Bone(a="shoulder", b="elbow"), Bone(a="elbow", b="wrist"), Bone(a="wrist", b="tip")),
    trunk=("a", "b", "c", "shoulder"),
)


def arm(*, n=200, wrist=(0.0, 0.0), elbow_deg=50.0, swing_rad=0.5, slip=0.0, seed=0):
    """An arm of a ball, a hinge and a wrist of two angles (amplitudes in degrees), on a trunk that turns."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 4 * np.pi, n)
    ball = Rotation.from_rotvec(np.stack([0.6 * np.sin(t), 0.4 * np.cos(t), 0.5 * np.sin(0.5 * t)], axis=1))
    bend = np.radians(elbow_deg) + swing_rad * np.sin(1.3 * t)
    fore = ball * Rotation.from_rotvec(bend[:, None] * [0, 0, 1.0])
    hand = fore * Rotation.from_rotvec(np.radians(wrist[0]) * np.sin(0.7 * t + 1)[:, None] * [0, 0, 1.0])
    hand = hand * Rotation.from_rotvec(np.radians(wrist[1]) * np.cos(1.7 * t)[:, None] * [0, 1.0, 0])
    along = np.array([1.0, 0, 0])
    body = np.zeros((n, 7, 3))
    body[:, 0], body[:, 1], body[:, 2], body[:, 3] = (0, 0, 0), (-0.3, 0.1, 0), (-0.2, -0.2, 0.1), (0, 0.2, 0)
    body[:, 4] = body[:, 3] + LENGTHS[0] * ball.apply(along)
    body[:, 5] = body[:, 4] + (LENGTHS[1] + slip * np.sin(t))[:, None] * fore.apply(along)
    body[:, 6] = body[:, 5] + LENGTHS[2] * hand.apply(along)
    turn = Rotation.from_rotvec(np.stack([0.2 * t, 0.1 * t, 0.3 * np.sin(t)], axis=1)).as_matrix()
    xyz = np.einsum("tij,tmj->tmi", turn, body + rng.normal(0, 2e-4, body.shape))
    return xyz, turn


def found(**options):
    xyz, turn = arm(**options)
    return articulation(NAMES, xyz, np.full(xyz.shape[:2], 2e-4), turn, trunk=SKELETON.trunk, bones=SKELETON.rigid)


@pytest.mark.parametrize(
    ("wrist", "kind"), [((0.0, 0.0), "fixed"), ((30.0, 0.0), "hinge"), ((30.0, 25.0), "universal")]
)
def test_types_of_joints_are_those_of_the_linkage(wrist, kind):
    """A ball at the shoulder, a hinge at the elbow, and of the wrist what it has; lengths to 1 %, freedoms summed."""
    joints = found(wrist=wrist)
    assert [j.kind for j in joints] == ["ball", "hinge", kind]
    assert sum(j.freedoms for j in joints) == 4 + {"fixed": 0, "hinge": 1, "universal": 2}[kind]
    np.testing.assert_allclose([j.length_m for j in joints], LENGTHS, rtol=0.01)
    assert max(j.length_sd for j in joints) < 0.01


def test_what_samples_do_not_determine_is_said():
    """The hand's turn about its axis never shows; the upper arm's only where the elbow bends."""
    bent, straight = undetermined(found(wrist=(30.0, 25.0), elbow_deg=70.0)), undetermined(found(elbow_deg=5.0))
    assert any("not determined" in s and "wrist to tip" in s for s in bent)
    assert not any("shoulder to elbow" in s for s in bent)
    assert any("poorly determined" in s and "shoulder to elbow" in s for s in straight)


def test_a_bone_that_changes_length_is_doubted_with_its_number():
    """A wrist marker that slides by 30 mm along the forearm of 250 mm: sd of a sine 8.5 %."""
    joints = found(slip=0.03)
    assert joints[1].length_sd == pytest.approx(0.03 / np.sqrt(2) / 0.25, rel=0.05)
    doubted = [s for s in undetermined(joints) if "stated as rigid" in s]
    assert len(doubted) == 1
    assert "elbow-wrist" in doubted[0]
    assert "8.5%" in doubted[0]


def test_where_a_bone_is_doubted_and_a_limb_straight():
    """By 5 % of its length, and below 15 degrees; a joint moves from 10; 20 frames are two independent ones."""
    steady, slips = ([*undetermined(found(slip=share * np.sqrt(2) * LENGTHS[1]))] for share in (0.042, 0.058))
    assert not any("stated as rigid" in s for s in steady)
    assert any("stated as rigid" in s for s in slips)
    assert [found(elbow_deg=deg, swing_rad=0.0)[0].straight for deg in (12.5, 17.5)] == [1.0, 0.0]
    assert [found(wrist=(deg, 0.0))[2].kind for deg in (4.3, 5.8)] == ["fixed", "hinge"]  # 8.5 and 11.5 degrees
    assert (len(found(n=19)), len(found(n=20))) == (0, 3)


def test_the_mjcf_file_has_the_mean_pose_and_the_bones(tracked_arm):
    """Forward kinematics of the XML alone, all joints at 0: bones of the median lengths along the mean directions.

    Bending its elbow by hand moves what hangs on it and nothing else.
    """
    root = ElementTree.fromstring(mjcf_text(tracked_arm))
    assert root.tag == "mujoco"
    assert root.find("compiler").get("angle") == "radian"
    at_rest, bent = sites(root, {}), sites(root, {"elbow_wrist": 0.7})
    for (a, b), length in zip((("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "tip")), LENGTHS, strict=True):
        for pose in (at_rest, bent):
            assert np.linalg.norm(pose[b] - pose[a]) == pytest.approx(length, rel=0.01)
    markers = tracked_arm.tracks
    body = np.einsum("tji,tmj->tmi", arm()[1], markers.xyz_m)
    way = (body[:, 4] - body[:, 3]).mean(axis=0)
    pair = at_rest["b"] - at_rest["a"], (body[:, 1] - body[:, 0]).mean(axis=0)  # axes differ by one rotation
    assert (at_rest["elbow"] - at_rest["shoulder"]) @ pair[0] == pytest.approx(
        way / np.linalg.norm(way) * LENGTHS[0] @ pair[1], abs=3e-3
    )
    np.testing.assert_allclose(bent["elbow"], at_rest["elbow"], atol=1e-12)
    assert np.linalg.norm(bent["wrist"] - at_rest["wrist"]) > 0.05
    masses = [float(g.get("mass")) for g in root.iter("geom") if g.get("type") == "capsule"]
    np.testing.assert_allclose(masses, np.array(LENGTHS) / sum(LENGTHS), rtol=0.01)


def test_mujoco_reads_it(tracked_arm):
    """Where MuJoCo is installed: 6 + 4 degrees of freedom, and its forward kinematics at rest is that of the XML."""
    mujoco = pytest.importorskip("mujoco")
    text = mjcf_text(tracked_arm)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.nv == 10
    for name, at in sites(ElementTree.fromstring(text), {}).items():
        np.testing.assert_allclose(data.site(name).xpos, at, atol=1e-9)


def test_no_trunk_no_file(tracked_arm):
    with pytest.raises(MocapError, match="names no trunk"):
        mjcf_text(replace(tracked_arm, skeleton=replace(SKELETON, trunk=())))


def sites(root, angles):
    """Places of all sites of an MJCF tree, hinges turned by given angles."""
    out = {}

    def walk(body, turn, at):
        for joint in body.findall("joint"):
            if joint.get("name") in angles:
                axis = np.array(joint.get("axis").split(), dtype=float)
                axis = axis / np.linalg.norm(axis)
                turn = turn @ Rotation.from_rotvec(angles[joint.get("name")] * axis).as_matrix()
        for site in body.findall("site"):
            out[site.get("name")] = at + turn @ np.array(site.get("pos").split(), dtype=float)
        for part in body.findall("body"):
            walk(part, turn, at + turn @ np.array(part.get("pos").split(), dtype=float))

    walk(root.find("worldbody"), np.eye(3), np.zeros(3))
    return out


@pytest.fixture(scope="module")
def tracked_arm():
    """A run of the arm as if it had been tracked without error."""
    xyz, _ = arm()
    t_s = np.arange(len(xyz)) / 200.0
    cov = np.broadcast_to(4e-8 * np.eye(3), (*xyz.shape, 3))
    return of_tracks(marker_tracks(NAMES, t_s, xyz, cov_m2=cov), SKELETON, name="arm", model="constant_velocity")


def test_the_opensim_model_is_the_animal_of_the_mjcf_file(tracked_arm):
    """Markers in the pose at rest, masses and kinds of joints are those of the other file; frames are orthonormal."""
    model = ElementTree.fromstring(osim_text(tracked_arm)).find("Model")
    other = ElementTree.fromstring(mjcf_text(tracked_arm))
    frames = {f.get("name"): f for f in model.iter("PhysicalOffsetFrame")}
    rest = {"/bodyset/trunk": np.zeros(3)}
    for joint in model.find("JointSet/objects"):
        ends = [frames[joint.findtext(f"socket_{end}_frame")] for end in ("parent", "child")]
        if joint.tag == "FreeJoint":
            continue
        assert ends[0].findtext("orientation") == ends[1].findtext("orientation")  # at rest nothing is turned
        at = np.array(ends[0].findtext("translation").split(), dtype=float)
        rest[ends[1].findtext("socket_parent")] = rest[ends[0].findtext("socket_parent")] + at
    places = {
        m.get("name"): rest[m.findtext("socket_parent_frame")] + np.array(m.findtext("location").split(), dtype=float)
        for m in model.iter("Marker")
    }
    expected = {}

    def walk(body, start):
        here = start + np.array(body.get("pos").split(), dtype=float)
        for site in body.findall("site"):
            expected[site.get("name")] = here + np.array(site.get("pos").split(), dtype=float)
        for inner in body.findall("body"):
            walk(inner, here)

    walk(other.find("worldbody/body"), np.zeros(3))
    assert set(places) == set(expected)
    for name, at in places.items():
        np.testing.assert_allclose(at, expected[name], atol=1e-7)
    masses = {b.get("name"): float(b.findtext("mass")) for b in model.iter("Body")}
    assert masses == {g.get("name"): float(g.get("mass")) for g in other.iter("geom")}
    kinds = {"ball": "BallJoint", "hinge": "PinJoint"}
    for body in other.iter("body"):
        turns = [joint.get("type") for joint in body.findall("joint")]
        if len(turns) == 1:
            assert model.find(f"JointSet/objects/*[@name='{body.get('name')}_joint']").tag == kinds[turns[0]]
