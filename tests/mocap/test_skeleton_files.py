"""Skeletons: read, written, checked against each other and against recordings."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap.errors import SkeletonError
from mocap.skeleton import BodyJoint, Bone, Joint, Skeleton, write_skeleton
from mocap.skeleton_files import read_skeleton

TEXT = st.text(st.characters(exclude_categories=("C",)), min_size=1, max_size=10)
JOINT = TEXT.filter(lambda name: not name.startswith(".") and not set(name) & set("/\\"))


@st.composite
def skeletons(draw):
    markers = tuple(draw(st.lists(TEXT, min_size=3, max_size=6, unique=True)))
    one = st.sampled_from(markers)
    ends = st.lists(one, min_size=2, max_size=2, unique=True)
    three = st.lists(one, min_size=3, max_size=3, unique=True)
    return Skeleton(
        name=draw(TEXT),
        markers=markers,
        bones=tuple(
            Bone(a=a, b=b, rigid=r) for (a, b), r in draw(st.lists(st.tuples(ends, st.booleans()), max_size=4))
        ),
        joints=tuple(
            Joint(name=name, parent=a, centre=b, child=c)
            for name, (a, b, c) in draw(st.dictionaries(JOINT, three, max_size=3)).items()
        ),
        bodies={draw(TEXT): draw(st.permutations(markers))} if draw(st.booleans()) else {},
        trunk=tuple(draw(st.lists(one, max_size=3))),
        aliases=draw(st.dictionaries(TEXT, one, max_size=3)),
        max_speed_m_s=draw(st.none() | st.floats(1e-3, 1e3)),
    )


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("skeleton")


@given(skeleton=skeletons())
def test_skeletons_come_back(scratch, skeleton):
    """Writing and reading is the identity, with quotes, dots, brackets and letters of any script in the names."""
    write_skeleton(scratch / "s.toml", skeleton)
    assert read_skeleton(scratch / "s.toml") == skeleton


def test_the_documented_file_reads_as_documented(tmp_path):
    """The example of the documentation, key by key; the name is the file's where none is given."""
    (tmp_path / "bat.toml").write_text(
        'markers = ["shoulder", "elbow", "wrist"]\nbones = [["shoulder", "elbow"], ["elbow", "wrist", "soft"]]\n'
        'trunk = ["shoulder"]\nmax_speed_m_s = 20.0\n[joints]\nelbow = ["shoulder", "elbow", "wrist"]\n'
        '[aliases]\npt1 = "shoulder"\n'
    )
    assert read_skeleton(tmp_path / "bat.toml") == Skeleton(
        name="bat",
        markers=("shoulder", "elbow", "wrist"),
        bones=(Bone(a="shoulder", b="elbow"), Bone(a="elbow", b="wrist", rigid=False)),
        joints=(Joint(name="elbow", parent="shoulder", centre="elbow", child="wrist"),),
        trunk=("shoulder",),
        aliases={"pt1": "shoulder"},
        max_speed_m_s=20.0,
    )


def test_bodies_and_their_joints(tmp_path):
    """A joint of two names is one between two bodies, in a file as in Python; it comes back as it was written."""
    beads = ["s1", "s2", "s3", "j1", "j2", "j3", "j4"]
    stated = Skeleton(
        name="jaw",
        markers=beads,
        bodies={"cranium": beads[:3], "mandible": beads[3:]},
        joints={"jaw": ("cranium", "mandible"), "tip": ("s1", "j1", "j2")},
    )
    assert stated.bodies["mandible"] == ("j1", "j2", "j3", "j4")
    assert stated.body_joints == (BodyJoint(name="jaw", parent="cranium", child="mandible"),)
    assert stated.joints == (Joint(name="tip", parent="s1", centre="j1", child="j2"),)
    write_skeleton(tmp_path / "jaw.toml", stated)
    assert 'jaw" = ["cranium", "mandible"]' in (tmp_path / "jaw.toml").read_text()
    assert read_skeleton(tmp_path / "jaw.toml") == stated


M = 'markers = ["a", "b", "c"]\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("markers = [", "not a readable TOML file"),
        ("bones = []\n", "'markers' is missing"),
        (M + "colour = 1\n", "unknown key 'colour': a skeleton has .*markers"),
        (M + 'bones = [["a", "d"]]\n', "bone a-d uses marker 'd', which is not in its markers"),
        (M + 'bones = [["a"]]\n', r'a bone is \["a", "b"\]'),
        (M + 'bones = ["ab"]\n', r'a bone is \["a", "b"\]'),
        (M + 'bones = [["a", "b", "hard"]]\n', r'a bone is \["a", "b"\]'),
        (M + 'trunk = ["x"]\n', "trunk uses marker 'x'"),
        (
            M + '[joints]\nj = ["a", "b"]\n',
            "joint 'j' is between two names, and 'a' is none of its bodies .it has none",
        ),
        (M + '[joints]\nj = ["a"]\n', "joint 'j' is"),
        (M + '[bodies]\ntop = ["a", "b", "b"]\n', "body 'top' has 2 different markers, and needs at least 3"),
        (M + '[bodies]\ntop = ["a", "b", "d"]\n', "body top uses marker 'd', which is not in its markers"),
        (M + '[bodies]\ntop = ["a", "b", "c"]\nlow = ["c", "b", "a"]\n', "'c' is in the bodies 'top' and 'low'"),
        (M + '[bodies]\ntop = "abc"\n', "body 'top' is a list of markers"),
        (M + "bodies = 3\n", "expected a table .bodies."),
        (M + '[bodies]\ntop = ["a", "b", "c"]\n[joints]\nj = ["top", "top"]\n', "joins 'top' to itself"),
        (M + '[joints]\nj = ["a", "b", "x"]\n', "joint j uses marker 'x'"),
        (M + '[aliases]\npt1 = "x"\n', "aliases uses marker 'x'"),
        ('markers = ["a", "a"]\n', "marker 'a' appears twice"),
        (M + 'max_speed_m_s = "fast"\n', "fast"),
        (M + "max_speed_m_s = -1.0\n", "max_speed_m_s"),
        (M + "max_speed_m_s = nan\n", "max_speed_m_s"),
        ("markers = []\n", "markers is empty"),
        ('markers = "abc"\n', "markers is .abc., expected a list of text"),
        (M + 'trunk = "a"\n', "trunk is .a., expected a list of text"),
        (M + "joints = 3\n", "s.toml"),
        (M + "bones = 3\n", "s.toml"),
    ],
)
def test_broken_skeletons(tmp_path, text, message):
    """Every broken skeleton is refused with the file and what is wrong, in one line."""
    (tmp_path / "s.toml").write_text(text)
    with pytest.raises(SkeletonError, match=message) as caught:
        read_skeleton(tmp_path / "s.toml")
    assert str(tmp_path / "s.toml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_skeleton_that_is_not_there(tmp_path):
    """A missing file, or one that is no text, is named."""
    with pytest.raises(SkeletonError, match=r"none\.toml: cannot be read: No such file or directory$"):
        read_skeleton(tmp_path / "none.toml")
    (tmp_path / "s.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SkeletonError, match="not a readable TOML file"):
        read_skeleton(tmp_path / "s.toml")


def test_markers_of_a_recording():
    """A recording may have more markers than the skeleton, not fewer; the message lists what it has and what to do."""
    skeleton = Skeleton(name="s", markers=("a", "b"), bones=(), joints=(), aliases={"pt1": "a"})
    assert skeleton.for_markers(["b", "z", "a"]) is skeleton
    with pytest.raises(
        SkeletonError, match=r"'s' has marker 'b', but x\.csv has a, z: correct the name, or map .*aliases"
    ):
        skeleton.for_markers(["a", "z"], source="x.csv")
    assert skeleton.renamed(["pt1", "b", "pt9"]) == ("a", "b", "pt9")


def test_what_is_written_is_toml_for_everybody(tmp_path):
    """Another reader finds the same values under the documented keys."""
    skeleton = Skeleton(
        name="s", markers=("a", "b"), bones=(Bone(a="a", b="b", rigid=False),), joints=(), max_speed_m_s=3.0
    )
    write_skeleton(tmp_path / "s.toml", skeleton)
    table = tomllib.loads((tmp_path / "s.toml").read_text())
    assert table == {
        "name": "s",
        "markers": ["a", "b"],
        "bones": [["a", "b", "soft"]],
        "trunk": [],
        "max_speed_m_s": 3.0,
        "joints": {},
        "aliases": {},
    }
