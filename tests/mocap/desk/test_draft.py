"""What becomes of a skeleton that is drawn: names, sides, and what the page does not show."""

from dataclasses import replace

import numpy as np
import pytest

import mocap
from mocap.desk.draft import Draft
from mocap.errors import MocapError
from mocap.sides import other_side
from mocap.skeleton import Skeleton, mirrored
from mocap.skeleton_files import read_skeleton

NAMES = ("p1", "p2", "p3", "p4", "x", "tail")
KNOWN = Skeleton(
    markers=["a", "b", "c", "d", "x"],
    aliases={"p1": "a", "p2": "b", "p3": "c", "p4": "d"},
    bones=[("a", "b"), ("b", "c", "soft")],
    bodies={"head": ("a", "b", "c")},
    joints={"b": ("a", "b", "c"), "d": ("b", "c", "d")},
    trunk=["a", "b"],
    measures={
        "up": "x",
        "strokes": {"wing": ["a", "d"]},
        "axes": {"b": {"parent": [["a", "b"], ["a", "c"]], "child": [["b", "c"], ["b", "a"]]}},
    },
    max_speed_m_s=3.0,
)


@pytest.fixture
def draft(tmp_path):
    xyz = np.cumsum(np.random.default_rng(0).normal(size=(20, len(NAMES), 3)), axis=0)
    recording = mocap.from_arrays(xyz, names=list(NAMES), fps=100)
    return Draft(trial="t", recording=recording, skeleton=KNOWN, path=tmp_path / "s" / "t.toml")


def drawn(draft, **more):
    info = draft.info() | more
    return {key: info[key] for key in ("names", "bones", "trunk", "joints")}


def test_what_is_opened_and_saved_unchanged_is_the_same(draft):
    """Points by number and back: the same skeleton in the file; the point that it has not stays out."""
    assert draft.info()["names"] == ["a", "b", "c", "d", "x", ""]
    draft.save(draft.changed(**drawn(draft)))
    found = read_skeleton(draft.path)
    for part in ("markers", "bones", "trunk", "joints", "bodies", "aliases", "measures", "max_speed_m_s"):
        assert getattr(found, part) == getattr(KNOWN, part), part


def test_names_are_followed_by_all_that_uses_them(draft):
    """Bodies, strokes and axes have the new name; the direction of the world that is called as a marker stays."""
    draft.save(draft.changed(**drawn(draft, names=["snout", "b", "c", "d", "y", "tail"])))
    found = read_skeleton(draft.path)
    assert found.markers == ("snout", "b", "c", "d", "y", "tail")
    assert found.aliases["p1"] == "snout"
    assert found.bodies == {"head": ("snout", "b", "c")}
    assert found.measures.strokes == {"wing": ("snout", "d")}
    assert found.measures.axes["b"].parent == (("snout", "b"), ("snout", "c"))
    assert found.measures.up == "x"
    assert found.trunk == ("snout", "b")


def test_joints_that_are_called_as_their_points_follow_them(draft):
    """Also those of two points, as they are proposed, and their axes; one that has a name of its own keeps it."""
    joints = {"b": (0, 1, 2), "b_c": (0, 1, 2), "knee": (1, 2, 3), "c": (1, 2, 3), "d": (2, 3, 4)}
    draft.save(draft.changed(**drawn(draft, joints=joints)))
    names = ["a", "elbow", "wrist", "c", "x", ""]
    draft.save(draft.changed(**drawn(draft, names=names)))
    found = read_skeleton(draft.path)
    assert [joint.name for joint in found.joints] == ["elbow", "elbow_wrist", "knee", "wrist", "d"]
    assert [joint.centre for joint in found.joints] == ["elbow", "elbow", "wrist", "wrist", "c"]
    assert list(found.measures.axes) == ["elbow"]


def test_axes_go_with_their_joint(draft):
    """A joint that is no longer ticked: its axes would be of nothing, and the file of nobody."""
    draft.save(draft.changed(**drawn(draft, joints={"d": (1, 2, 3)})))
    found = read_skeleton(draft.path)
    assert [joint.name for joint in found.joints] == ["d"]
    assert not found.measures.axes


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"names": ["a", "a", "c", "d", "x", ""]}, "twice"),
        ({"names": ["a", "b", "", "d", "x", ""]}, "not in its markers"),
        ({"names": ["a"]}, "1 names came for 6 points"),
        ({"bones": [[0, 0, True]]}, "a marker twice"),
        ({"joints": {"../b": (0, 1, 2)}}, "cannot name a file"),
    ],
)
def test_what_is_no_skeleton_is_refused(draft, more, said):
    """The skeleton's own error; what was there stays, and nothing is written."""
    with pytest.raises(MocapError, match=said):
        draft.save(draft.changed(**drawn(draft, **more)))
    assert draft.skeleton is KNOWN
    assert not draft.path.exists()


def test_a_proposal_keeps_names(draft):
    """Points at constant distances (two, turning about each other) are a bone, called as they were called."""
    t = np.arange(200) / 100
    turn = np.stack([np.cos(9 * t), np.sin(9 * t), 0 * t], axis=-1)
    rng = np.random.default_rng(0)
    other = np.cumsum(rng.normal(size=(200, 3)), axis=0)
    xyz = np.stack([0.1 * turn, -0.1 * turn, other], axis=1)
    xyz = xyz + 1e-4 * rng.normal(size=xyz.shape)
    recording = mocap.from_arrays(xyz, names=["p1", "p2", "p3"], fps=100)
    made = Draft(trial="t", recording=recording, skeleton=recording.skeleton, path=draft.path)
    made.propose(**drawn(made, names=["left", "right", "p3"]))
    assert [{bone.a, bone.b} for bone in made.skeleton.bones] == [{"left", "right"}]
    assert made.info()["names"] == ["left", "right", "p3"]


WINGED = ("back", "top", "side_l", "side_r", "tip_l", "tip_r")


def winged(folder, *, beats, way_m=0.3):
    """A trunk of four points that flies along x, and two wings that beat so often; drawn, without measures."""
    t = np.arange(200)
    body = np.array([[-0.05, 0, 0], [0.05, 0, 0.01], [0, 0.03, 0], [0, -0.03, 0]])
    angle = 0.8 * np.sin(2 * np.pi * beats * t / len(t))
    wing = 0.1 * np.column_stack([0 * t, np.cos(angle), np.sin(angle)])
    way = way_m / len(t) * t[:, None] * [1, 0, 0]
    parts = [*(way + b for b in body), way + body[2] + wing, way + body[3] + wing * [1, -1, 1]]
    xyz = np.stack(parts, axis=1) + np.random.default_rng(0).normal(0, 1e-4, (len(t), 6, 3))
    recording = mocap.from_arrays(xyz, names=[f"p{k}" for k in range(6)], fps=100)
    skeleton = replace(recording.skeleton, measures={"up": "z"})
    made = Draft(trial="t", recording=recording, skeleton=skeleton, path=folder / "s.toml")
    bones = [[0, 1, True], [0, 2, True], [0, 3, True], [2, 4, True], [3, 5, True]]
    return made, drawn(made, names=list(WINGED), bones=bones, trunk=[0, 1, 2, 3])


def test_measures_are_added_to_what_is_drawn(tmp_path):
    """Strokes of wings that beat, their span, and axes of the trunk that strokes need; all are there after saving.

    Bones, trunk and joints stay as they were drawn. What is stated stays: a second time nothing is added.
    """
    made, sketch = winged(tmp_path, beats=8)
    said = made.measure(**sketch)
    measures = made.skeleton.measures
    assert measures.strokes == {"tip_l": ("side_l", "tip_l"), "tip_r": ("side_r", "tip_r")}
    assert (measures.forward, measures.left) == (("back", "top"), ("side_r", "side_l"))
    assert set(measures.distances["span"]) == {"tip_l", "tip_r"}
    assert said == "added forward, left, distances, strokes: check them"
    assert len(made.skeleton.bones) == 5
    assert ["forward", "forward", "back, top"] in made.info()["measures"]
    assert "nothing was added" in made.measure(**drawn(made))
    made.save(made.changed(**drawn(made), dropped=[["forward", "forward"], ["strokes", "tip_l"]]))
    found = read_skeleton(made.path).measures
    assert (found.forward, found.left, list(found.strokes)) == (None, ("side_r", "side_l"), ["tip_r"])


def test_measures_that_nothing_shows_are_not_added(tmp_path):
    """Still wings; an animal that stays where it is, whose front nothing tells; no trunk."""
    made, sketch = winged(tmp_path, beats=0)
    assert "nothing was added" in made.measure(**sketch)
    assert not made.skeleton.measures.strokes
    made, sketch = winged(tmp_path, beats=8, way_m=0.0)
    assert "strokes need forward of the trunk" in made.measure(**sketch)
    assert made.skeleton.measures.forward is None
    with pytest.raises(MocapError, match=r"trunk: draw its points \(t\)"):
        made.measure(**(sketch | {"trunk": []}))


def test_both_sides_have_what_one_has():
    """Bones, joints and bodies across; what is there, has no twin, or no side, stays as it is."""
    markers = ["hip", "knee_l", "knee_r", "L_toe", "R_toe", "wing_l"]
    one = Skeleton(
        markers=markers,
        bones=[("hip", "knee_l"), ("knee_l", "L_toe", "soft"), ("hip", "wing_l"), ("knee_r", "hip")],
        joints={"knee": ("hip", "knee_l", "L_toe"), "wing_l": ("knee_l", "hip", "wing_l")},
    )
    both = mirrored(one)
    added = [(bone.a, bone.b, bone.rigid) for bone in both.bones[4:]]
    assert added == [("knee_r", "R_toe", False)]
    (joint,) = both.joints[2:]
    assert (joint.name, joint.parent, joint.centre, joint.child) == ("knee_right", "hip", "knee_r", "R_toe")
    assert mirrored(both) == both


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("elbow_l", "elbow_r"),
        ("L_elbow", "R_elbow"),
        ("leftKnee", "rightKnee"),
        ("LeftKnee", "RightKnee"),
        ("tail", "tail"),
    ],
)
def test_names_of_the_other_side(name, other):
    """In the same style, and back."""
    assert (other_side(name), other_side(other)) == (other, name)
