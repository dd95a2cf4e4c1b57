"""Models of other programs as skeletons: what is fixed to what follows from the geometry that the model states."""

import numpy as np
import pytest

from mocap.cli.main import explain
from mocap.errors import SkeletonError
from mocap.skeleton_files import read_skeleton
from mocap.skeleton_models import MODELS, model_skeleton

OSIM = """<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40000"><Model name="wing">
<BodySet><objects>
 <Body name="hand"><mass>0.003</mass><mass_center>0 0.03 0</mass_center></Body>
 <Body name="arm"><mass>0.010</mass><mass_center>0 0.04 0</mass_center></Body>
 <Body name="trunk"><mass>0.2</mass><mass_center>0 0 0</mass_center></Body>
</objects></BodySet>
<JointSet><objects>
 <{pin} name="wrist"><socket_parent_frame>arm_end</socket_parent_frame>
  <socket_child_frame>/bodyset/hand</socket_child_frame>
  <coordinates><Coordinate name="bend"><range>-0.5 1.5</range></Coordinate></coordinates>
  <frames><PhysicalOffsetFrame name="arm_end"><socket_parent>/bodyset/arm</socket_parent>
   <translation>0  0.08 0</translation><orientation>0 0 0.3</orientation></PhysicalOffsetFrame></frames></{pin}>
 <FreeJoint name="root"><socket_parent_frame>/ground</socket_parent_frame>
  <socket_child_frame>/bodyset/trunk</socket_child_frame><coordinates>{six}</coordinates></FreeJoint>
 <CustomJoint name="shoulder"><socket_parent_frame>/bodyset/trunk</socket_parent_frame>
  <socket_child_frame>/bodyset/arm</socket_child_frame>
  <coordinates><Coordinate name="raise"><range>-1 1</range></Coordinate></coordinates>
  <SpatialTransform>
   <TransformAxis name="rotation1"><coordinates>raise</coordinates><axis>1 0 0</axis></TransformAxis>
   <TransformAxis name="rotation2"><coordinates></coordinates><axis>0 1 0</axis></TransformAxis>
   <TransformAxis name="rotation3"><coordinates></coordinates><axis>0 0 1</axis></TransformAxis>
   <TransformAxis name="translation1"><coordinates>raise</coordinates><axis>1 0 0</axis>
    <SimmSpline><x>-1 1</x><y>0.01 0.03</y></SimmSpline></TransformAxis>
   <TransformAxis name="translation2"><coordinates></coordinates><axis>0 1 0</axis>
    <Constant><value>0.05</value></Constant></TransformAxis>
   <TransformAxis name="translation3"><coordinates></coordinates><axis>0 0 1</axis></TransformAxis>
  </SpatialTransform></CustomJoint>
</objects></JointSet>
<ForceSet><objects><HuntCrossleyForce::ContactParametersSet name="of OpenSim, and no XML"/></objects></ForceSet>
{markers}
</Model></OpenSimDocument>
""".replace("{six}", "".join(f'<Coordinate name="q{i}"/>' for i in range(6)))
MARKERS = {
    "keel": ("trunk", "0 -0.02 0"),
    "neck": ("trunk", "0 0.06 0"),
    "rump": ("trunk", "0.01 -0.06 0"),
    "shoulder": ("trunk", "0.02 0.05 0"),  # where the splines put the joint with the arm down
    "wrist": ("hand", "0 0 0"),
    "tip": ("hand", "0 0.06 0"),
}


def osim(path, markers=MARKERS, pin="PinJoint"):
    made = "".join(
        f'<Marker name="{name}"><socket_parent_frame>/bodyset/{body}</socket_parent_frame>'
        f"<location>{at}</location></Marker>"
        for name, (body, at) in markers.items()
    )
    text = OSIM.replace("{pin}", pin).replace("{markers}", f"<MarkerSet><objects>{made}</objects></MarkerSet>")
    path.write_text(text, encoding="utf-8")
    return path


def test_markers_of_a_segment_are_a_body_or_bones_and_one_at_a_joint_is_fixed_to_both(tmp_path):
    """By hand: four markers of the trunk; the arm has only the joints at its ends, the hand its wrist and tip."""
    found = read_skeleton(osim(tmp_path / "wing.osim"))
    assert found.bodies == {"trunk": ("keel", "neck", "rump", "shoulder")}
    assert {frozenset(pair) for pair in found.rigid} == {frozenset(("shoulder", "wrist")), frozenset(("wrist", "tip"))}
    shoulder, wrist = found.joints
    assert (wrist.name, wrist.parent, wrist.centre, wrist.child) == ("wrist", "shoulder", "wrist", "tip")
    assert (shoulder.name, shoulder.centre, shoulder.child) == ("shoulder", "shoulder", "wrist")
    assert shoulder.parent == "rump"  # of the trunk's, the farthest
    assert found.trunk == ("keel", "neck", "rump", "shoulder")


def test_a_mass_is_on_the_rod_that_passes_nearest_its_centre(tmp_path):
    """The arm's is half-way along its 8 cm, the hand's along its 6 cm, the trunk's a quarter along its 8 cm."""
    parts, comments = model_skeleton(osim(tmp_path / "wing.osim"))
    masses = parts["measures"].segments
    assert {masses["arm"].start, masses["arm"].end} == {"shoulder", "wrist"}
    assert (masses["arm"].mass_g, masses["arm"].centre) == (10.0, 0.5)
    assert (masses["hand"].mass_g, masses["hand"].centre) == (3.0, 0.5)
    # the rod keel-neck passes through the trunk's centre: a quarter of the way from keel
    assert (masses["trunk"].start, masses["trunk"].end, masses["trunk"].centre) == ("keel", "neck", 0.25)
    assert comments["joint wrist"] == ["bend -29 to 86 deg"]
    assert not any("trunk" in line for line in comments[""])


@pytest.mark.parametrize("kind", ["PinJoint", "UniversalJoint", "BallJoint", "WeldJoint"])
def test_every_kind_of_joint_of_opensim_is_read(tmp_path, kind):
    """A weld makes the hand a part of the arm: shoulder, wrist and tip are then fixed to each other."""
    found = read_skeleton(osim(tmp_path / "wing.osim", pin=kind))
    names = [joint.name for joint in found.joints]
    assert names == (["shoulder"] if kind == "WeldJoint" else ["shoulder", "wrist"])
    assert (frozenset(("shoulder", "tip")) in {frozenset(pair) for pair in found.rigid}) == (kind == "WeldJoint")


def test_two_bodies_of_three_markers_have_a_joint_between_them(tmp_path):
    """A sliding joint too: its bodies do not need a centre."""
    hand = {"h1": ("hand", "0 0.01 0"), "h2": ("hand", "0.01 0.02 0"), "h3": ("hand", "0 0.05 0.01")}
    arm = {"a1": ("arm", "0.01 0.01 0"), "a2": ("arm", "0 0.02 0"), "a3": ("arm", "0 0.05 0.01")}
    found = read_skeleton(osim(tmp_path / "wing.osim", {**hand, **arm}))
    assert set(found.bodies) == {"hand", "arm"}
    assert [(j.name, j.parent, j.child) for j in found.body_joints] == [("wrist", "arm", "hand")]


def written_by_biobuddy(path):
    """The wing without its spline, as biobuddy writes it."""
    biobuddy = pytest.importorskip("biobuddy")
    model = biobuddy.BiomechanicalModelReal()

    def segment(name, parent, at, turns, mass, com):
        scs = biobuddy.SegmentCoordinateSystemReal.from_euler_and_translation(
            angles=np.zeros(3), angle_sequence="xyz", translation=np.array(at), is_scs_local=True
        )
        bounds = biobuddy.RangeOfMotion(biobuddy.Ranges.Q, [-0.5] * len(turns), [1.5] * len(turns)) if turns else None
        model.add_segment(
            biobuddy.SegmentReal(
                name=name,
                parent_name=parent,
                segment_coordinate_system=scs,
                rotations=biobuddy.Rotations(turns or None),
                q_ranges=bounds,
                inertia_parameters=biobuddy.InertiaParametersReal(
                    mass=mass, center_of_mass=np.array(com), inertia=np.eye(3) * 1e-6
                ),
            )
        )

    segment("trunk", "base", (0, 0, 0), "xyz", 0.2, (0, 0, 0))
    segment("arm", "trunk", (0.02, 0.05, 0), "x", 0.01, (0, 0.04, 0))
    segment("hand", "arm", (0, 0.08, 0), "z", 0.003, (0, 0.03, 0))
    for name, (body, at) in MARKERS.items():
        position = np.array(at.split(), dtype=float)
        model.segments[body].add_marker(biobuddy.MarkerReal(name=name, parent_name=body, position=position))
    write = {".osim": model.to_osim, ".bioMod": model.to_biomod, ".urdf": model.to_urdf}[path.suffix]
    write(str(path))
    return path


@pytest.mark.parametrize("end", [".osim", ".bioMod"])
def test_what_biobuddy_writes_is_the_skeleton_that_was_made_by_hand(tmp_path, end):
    """The same wing by an independent writer: bones, bodies, joints and masses, but for the names of segments."""
    by_hand = read_skeleton(osim(tmp_path / "wing.osim"))
    found = read_skeleton(written_by_biobuddy(tmp_path / f"other{end}"))
    assert set(found.markers) == set(by_hand.markers)
    assert {frozenset(pair) for pair in found.rigid} == {frozenset(pair) for pair in by_hand.rigid}
    assert set(found.bodies.values()) == set(by_hand.bodies.values())
    ends = {(j.parent, j.centre, j.child) for j in found.joints}
    assert ends == {(j.parent, j.centre, j.child) for j in by_hand.joints}
    masses = {(s.mass_g, s.centre) for s in found.measures.segments.values()}
    assert masses == {(s.mass_g, s.centre) for s in by_hand.measures.segments.values()}


URDF = """<robot name="leg"><link name="hip"/><link name="thigh"><inertial><mass value="0.2"/>
<origin xyz="0 0 -0.02" rpy="0.1 0 0"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><mesh filename="package://not/there.stl"/></geometry></visual></link>
<link name="shank"/><link name="toe"/>
<joint name="swing" type="continuous"><parent link="hip"/><child link="thigh"/><origin xyz="0 0 -0.1"/></joint>
<joint name="knee" type="revolute"><parent link="thigh"/><child link="shank"/><origin xyz="0 0 -0.08"/>
<axis xyz="0 0.6 0.8"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="shank"/><child link="toe"/><origin xyz="0 0 -0.05"/></joint></robot>
"""
MJCF = """<mujoco><compiler angle="degree"/><default><default class="knee"><joint range="-57 115"/></default></default>
<worldbody><body name="hip"><freejoint/><geom size="0.01" mass="0.001"/>
<body name="thigh" pos="0 0 -0.1"><joint name="swing" type="ball"/><geom size="0.001" mass="0.2" pos="0 0 -0.02"/>
<body name="shank" pos="0 0 -0.08"><joint name="knee" class="knee" axis="0 .6 .8"/><geom size="0.01" mass="0.001"/>
{sites}<body name="toe" pos="0 0 -0.05"/></body></body></body></worldbody></mujoco>
"""


@pytest.mark.parametrize(("name", "text"), [("leg.urdf", URDF), ("leg.xml", MJCF.replace("{sites}", ""))])
def test_a_model_without_markers_has_the_centres_of_its_joints(tmp_path, name, text):
    """Links, and the end of the chain, which is welded on; joints of any axis, no meshes needed."""
    pytest.importorskip("mujoco")
    path = tmp_path / name
    path.write_text(text)
    parts, comments = model_skeleton(path)
    assert parts["markers"] == ["hip", "thigh", "shank", "toe"]
    assert {frozenset(pair) for pair in parts["bones"]} == {
        frozenset(pair) for pair in (("hip", "thigh"), ("thigh", "shank"), ("shank", "toe"))
    }
    assert parts["joints"] == {"swing": ("hip", "thigh", "shank"), "knee": ("thigh", "shank", "toe")}
    assert comments["joint knee"][0] == "knee -57 to 115 deg"
    thigh = parts["measures"].segments["thigh"]
    assert (thigh.mass_g, {thigh.start, thigh.end}) == (200.0, {"thigh", "shank"})
    assert thigh.centre == pytest.approx(0.25 if thigh.start == "thigh" else 0.75)


def test_sites_of_mjcf_are_markers(tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "leg.xml"
    path.write_text(MJCF.replace("{sites}", '<site name="knee_dot"/><site name="ankle_dot" pos="0 0 -.05"/>'))
    found = read_skeleton(path)
    assert found.markers == ("knee_dot", "ankle_dot")
    assert found.rigid == (("knee_dot", "ankle_dot"),)


def broken(text):
    """A file cut short, of other content, empty, with one tag changed, and as bytes."""
    return [text[: len(text) // 2], "marker,x,y,z\n1,2,3,4\n", "", text.replace("name=", "nom="), "\x00\xff" * 99]


@pytest.mark.parametrize("end", sorted(MODELS))
@pytest.mark.parametrize("way", range(5))
def test_a_file_that_is_no_model_is_refused_in_one_line(tmp_path, end, way):
    if end != ".osim":
        pytest.importorskip("biobuddy" if end == ".biomod" else "mujoco")
    text = {
        ".osim": osim(tmp_path / "w.osim").read_text(),
        ".urdf": URDF,
        ".biomod": "version 4\nsegment a\nname= 1 mass\nendsegment",
    }
    path = tmp_path / f"broken{end}"
    path.write_text(broken(text.get(end, MJCF.replace("{sites}", "")))[way], encoding="utf-8")
    with pytest.raises(SkeletonError) as caught:
        read_skeleton(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_entities_are_not_expanded(tmp_path):
    path = osim(tmp_path / "w.osim")
    path.write_text('<!DOCTYPE a [<!ENTITY b "bbbb">]>' + path.read_text().split("?>", 1)[1])
    with pytest.raises(SkeletonError, match="entities"):
        read_skeleton(path)


@pytest.mark.parametrize("end", [".bioMod", ".urdf"])
def test_without_the_extra_its_name_is_told(tmp_path, monkeypatch, capsys, end):
    monkeypatch.setattr("eal.needs.find_spec", lambda _: None)
    path = tmp_path / f"leg{end}"
    path.write_text(URDF)
    with pytest.raises(ImportError, match=r"pip install .*\[models\]") as caught:
        read_skeleton(path)
    assert explain(caught.value) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_a_recording_is_tracked_with_a_model(tmp_path, mocap):
    """From the command line: angles at the model's joints, and the skeleton as a file to correct."""
    rng = np.random.default_rng(1)
    at = np.array([MARKERS[name][1].split() for name in MARKERS], dtype=float)
    at[-2:] += at[3]  # the hand beside the trunk, its parts at their distances
    xyz = at + rng.normal(0, 1e-4, (60, len(at), 3))
    columns = [f"{name}_{axis}" for name in MARKERS for axis in "xyz"]
    rows = [",".join(columns), *(",".join(f"{value:.6f}" for value in row) for row in xyz.reshape(60, -1))]
    (tmp_path / "trial.csv").write_text("\n".join(rows) + "\n")
    model = osim(tmp_path / "wing.osim")
    code, _, said = mocap(
        "track", tmp_path / "trial.csv", "--fps", 100, "--unit", "m", "--skeleton", model, "--out", tmp_path / "out"
    )
    assert code == 0, said
    head = (tmp_path / "out" / "kinematics.csv").read_text().split("\n", 1)[0]
    assert "wrist" in head
    assert mocap("skeleton", model, "--out", tmp_path / "wing.toml")[0] == 0
    assert read_skeleton(tmp_path / "wing.toml") == read_skeleton(model)
    model = osim(tmp_path / "other.osim", {"nose": ("trunk", "0 0 0"), **MARKERS})
    code, _, said = mocap("track", tmp_path / "trial.csv", "--fps", 100, "--skeleton", model, "--out", tmp_path / "no")
    assert code == 1
    assert "'nose'" in said
    assert f"mocap skeleton {model} >" in said
