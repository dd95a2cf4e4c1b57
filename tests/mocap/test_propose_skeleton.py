"""A proposed skeleton: the true bones of animals whose skeleton is known, and a file that ``track`` takes as it is."""

import json
import re
import sys

import numpy as np
import pytest
from mocap.datasets import make_bat, make_lizard, write_recording
from mocap.filters.poses import MarkerTrial
from mocap.filters.rigid import wobble_deg
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.transform import Rotation

from mocap.cli.main import main
from mocap.errors import MocapError
from mocap.proposing.propose_skeleton import (
    SOFT,
    joint_triples,
    kept_distances,
    propose_skeleton,
    spanning_bones,
    trunk_of,
)
from mocap.reading.reading import read
from mocap.skeleton import Bone, Joint, Skeleton, skeleton_text
from mocap.skeleton_files import read_skeleton
from tests.filters.bodies_trials import two_bodies
from tests.real_data import real

NOISE_M = 3e-4


def trial(recording, seed=0):
    """The true markers with noise."""
    xyz = recording.truth.xyz_m + np.random.default_rng(seed).normal(size=recording.truth.xyz_m.shape) * NOISE_M
    return MarkerTrial(name="trial", t_s=recording.truth.t_s, xyz_m=xyz, sd_m=np.full(xyz.shape[:2], NOISE_M))


def arm(n_frames=400):
    """A body of four markers that tumbles, and an arm of two bones on it whose joints turn."""
    body = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.08, 0], [0, 0, 0.06]])
    t_s = np.arange(n_frames) / 100
    swing = np.sin(2 * np.pi * t_s[:, None] * [0.31, 0.53, 0.71, 1.3, 0.9, 0.2, 0.3, 0.5])
    turn = Rotation.from_rotvec(swing[:, :3]).as_matrix()
    shoulder, elbow = (Rotation.from_euler("z", a[:, None]).as_matrix() for a in swing[:, 3:5].T)
    upper = np.einsum("tij,j->ti", shoulder, [0.12, 0, 0])
    lower = np.einsum("tij,tjk,k->ti", shoulder, elbow, [0.09, 0, 0])
    local = np.concatenate([np.broadcast_to(body, (n_frames, 4, 3)), np.zeros((n_frames, 2, 3))], axis=1)
    local[:, 4], local[:, 5] = body[1] + upper, body[1] + upper + lower
    xyz = np.einsum("tij,tmj->tmi", turn, local) + swing[:, None, 5:]
    return MarkerTrial(name="arm", t_s=t_s, xyz_m=xyz, sd_m=np.zeros(xyz.shape[:2]))


def test_an_arm_on_a_body():
    """Body, bones and joints of a mechanism without noise are found exactly."""
    kept = kept_distances(arm())
    bones = spanning_bones(kept)
    assert {(1, 4), (4, 5)} <= set(bones)
    assert trunk_of(arm(), kept, bones) == [0, 1, 2, 3]
    assert {(b, c) for _, b, c in joint_triples(kept, bones, [0, 1, 2, 3])} == {(1, 4), (4, 5)}


def test_what_moves_most_is_no_trunk():
    """A wing's blade keeps its distances, too: shaken more than all else it is none; shaken less, it is the trunk."""
    still = np.random.default_rng(1).normal(size=(4, 3)) * 0.05
    t_s = np.arange(300) / 100
    swing = 0.05 * np.sin(2 * np.pi * 3 * t_s)[:, None, None] * [0.0, 0.0, 1.0]
    drift = 0.002 * np.cumsum(np.random.default_rng(2).normal(size=(300, 3, 3)), axis=0)
    drift = np.stack([np.convolve(one, np.ones(60) / 60, "same") for one in drift.reshape(300, 9).T], axis=1)
    blade = np.array([[0.3, 0, 0], [0.36, 0, 0], [0.3, 0.05, 0]])
    loose = still[:3] + drift.reshape(300, 3, 3)
    for moves, expected in ((blade + swing, []), (loose + swing, [0, 1, 2])):
        rigid = moves if not expected else np.broadcast_to(blade, (300, 3, 3))
        rest = loose if not expected else moves
        xyz = np.concatenate([rigid, rest], axis=1)
        one = MarkerTrial(name="wing", t_s=t_s, xyz_m=xyz, sd_m=np.zeros(xyz.shape[:2]))
        kept = kept_distances(one)
        assert trunk_of(one, kept, spanning_bones(kept)) == expected


def test_the_wing_of_a_real_bat_is_no_trunk():
    """Of two flights: tip, wrist and fifth digit are a stiff blade in one; in the other three calm points are found."""
    folder = real("bat_windtunnel_dltdv8", "derived_csv", "FE404_F2")
    one = read(folder / "FE404_F2_xypts.csv", calibration=folder / "FE404_F2_dltCoefs.csv", fps=700)
    assert propose_skeleton(one).skeleton.trunk == ()
    other = real("bat_windtunnel_dltdv8", "078A3", "F4", "carollia_2April2021_078A3m_trial4_dvProject.mat")
    assert set(propose_skeleton(read(other, fps=700)).skeleton.trunk) == {"pt7", "pt10", "pt12"}


def test_bones_are_a_minimum_spanning_forest():
    """As many edges and the same weight as SciPy's tree over the pairs that vary little."""
    kept = kept_distances(trial(make_lizard(seed=3, n_frames=200)))
    weight = kept.length_m * (1 + (kept.varies / SOFT) ** 2)
    allowed = np.where(kept.varies <= SOFT, weight, 0.0)
    tree = minimum_spanning_tree(np.nan_to_num(allowed))
    bones = spanning_bones(kept)
    assert len(bones) == tree.nnz
    np.testing.assert_allclose(sum(weight[bone] for bone in bones), tree.sum(), rtol=1e-12)


def test_the_wobble_is_that_of_rotations():
    """A rigid body has none, however it turns; one whose third marker swings by an angle wobbles by a share of it."""
    rng = np.random.default_rng(0)
    body = rng.normal(size=(4, 3))
    turns = Rotation.random(50, random_state=1).as_matrix()
    xyz = np.einsum("tij,nj->tni", turns, body) + rng.normal(size=(50, 1, 3))
    assert wobble_deg(xyz) < 1e-6
    noisy = xyz + rng.normal(size=xyz.shape) * 0.05
    extent = np.linalg.svd(body - body.mean(axis=0), compute_uv=False)[1] / 2  # of four markers
    left = 0.05 * np.sqrt((12 - 6) / 12)  # six of twelve coordinates are taken up by the motion
    np.testing.assert_allclose(wobble_deg(noisy), np.degrees(left / extent), rtol=0.15)  # 300 degrees of freedom: 4 %
    assert wobble_deg(xyz[:19]) == np.inf


@pytest.mark.parametrize(("make", "kind"), [(make_bat, "points"), (make_lizard, "pixels")])
def test_known_skeletons_are_found(tmp_path, make, kind):
    """Of a bat's 33 bones and a lizard's 23 nine in ten are true ones, the trunk is central, and most joints are there.

    The shortest bones are some times the noise, and of a chain without limbs (neck, back, tail) the trunk may be either
    end: its joints then bear the other end's name.
    """
    recording = make(seed=3, n_frames=300)
    truth = recording.skeleton
    files = write_recording(recording, tmp_path, others=True)
    cameras = {"calibration": files["coefficients"], "profile": files["profile"]} if kind == "pixels" else {}
    found = propose_skeleton(read(files[kind], fps=recording.fps, **cameras)).skeleton
    true_bones = {frozenset((bone.a, bone.b)) for bone in truth.bones}
    bones = {frozenset((bone.a, bone.b)) for bone in found.bones}
    assert len(bones) == len(truth.markers) - 1
    assert len(bones & true_bones) >= 0.9 * len(bones)
    axial = {m for m in truth.markers if not any(word in m for word in ("elbow", "wrist", "d3", "d4", "d5", "ankle"))}
    assert len(found.trunk) >= 3
    assert set(found.trunk) <= axial
    joints = {(joint.centre, joint.child) for joint in found.joints}
    true_joints = {(joint.centre, joint.child) for joint in truth.joints}
    assert len(joints & true_joints) >= 0.75 * len(true_joints)


def beads(tmp_path, named):
    """A table of two simulated bodies, the recording of it."""
    xyz = two_bodies((4, 5)).trial.xyz_m
    header = ",".join(f"{name}_{axis}" for name in named for axis in "xyz")
    np.savetxt(tmp_path / "beads.csv", xyz.reshape(len(xyz), -1), delimiter=",", header=header, comments="")
    return read(tmp_path / "beads.csv", fps=100, unit="m")


def test_one_joint_between_two_bodies(tmp_path):
    """Two bodies by what their markers' names share, one joint, and none at a bead; the file reads as that."""
    named = [*(f"skull_{k}" for k in "abcd"), *(f"Jaw{k}" for k in range(1, 6))]
    found = propose_skeleton(beads(tmp_path, named))
    assert found.skeleton.bodies == {"skull": tuple(named[:4]), "Jaw": tuple(named[4:])}
    assert {frozenset((j.parent, j.child)) for j in found.skeleton.body_joints} == {frozenset(("skull", "Jaw"))}
    assert found.skeleton.joints == ()
    assert all(("Jaw" in bone.a) == ("Jaw" in bone.b) for bone in found.skeleton.bones)
    assert re.search(r'"Jaw" = \[.*keep their places to 0\.0\d+ mm, noise', found.text)


def test_names_that_share_nothing(tmp_path):
    """Bodies are numbered then."""
    assert set(propose_skeleton(beads(tmp_path, "abcdefghi")).skeleton.bodies) == {"body_1", "body_2"}


def test_the_jaw_of_a_macaque():
    """Five x-ray beads in each of two bones: two bodies and the joint between them."""
    found = propose_skeleton(read(real("xromm_macaque_jaw", "3dpts.csv"), fps=100, unit="mm")).skeleton
    lower, skull = ([m for m in found.markers if m.lower().startswith(word)] for word in ("lower", "skull"))
    assert found.bodies == {"lower": tuple(lower), "Skull": tuple(skull)}
    assert [(joint.parent, joint.child) for joint in found.body_joints] == [("Skull", "lower")]
    assert found.joints == ()


def test_the_file_is_the_skeleton(tmp_path):
    """What is written is read as the skeleton that was proposed, and written without its comments the same."""
    recording = make_bat(seed=3, n_frames=150)
    files = write_recording(recording, tmp_path, others=True)
    found = propose_skeleton(read(files["points"], fps=recording.fps))
    path = tmp_path / "found.toml"
    written = [(found.text, "utf-8"), (skeleton_text(found.skeleton), "utf-8"), (found.text, "utf-16")]
    for text, encoding in (*written, ("# Flügel\n" + found.text, "cp1252")):  # > of PowerShell and of cmd on Windows
        path.write_bytes(text.replace("\n", "\r\n").encode(encoding))
        assert read_skeleton(path) == found.skeleton
    for word in ("mm, varies by", "bends from", "read it, correct it"):
        assert word in found.text


def test_names_that_are_no_toml(tmp_path):
    """Quotes and slashes in names neither break the file nor make a joint that is no file name."""
    odd = ['a"b', "c'd", "e\\", "f/../g", ".h", "# i"]
    skeleton = Skeleton(
        name=odd[0],
        markers=tuple(odd),
        bones=(Bone(a=odd[0], b=odd[1]), Bone(a=odd[1], b=odd[2], rigid=False)),
        joints=(Joint(name="j]", parent=odd[0], centre=odd[1], child=odd[2]),),
        trunk=tuple(odd[3:]),
    )
    path = tmp_path / "odd.toml"
    path.write_text(skeleton_text(skeleton, comments={"joint j]": ["x"], "bones": ["y"]}), encoding="utf-8", newline="")
    assert read_skeleton(path) == skeleton
    moving = arm()
    text = ",".join(f'"{name}_{axis}"'.replace('a"b', 'a""b').replace("\n", "") for name in odd for axis in "xyz")
    rows = "\n".join(",".join(map(repr, row.ravel().tolist())) for row in moving.xyz_m)
    (tmp_path / "odd.csv").write_text(f"{text}\n{rows}\n", encoding="utf-8")
    found = propose_skeleton(read(tmp_path / "odd.csv", fps=100))
    path.write_text(found.text, encoding="utf-8", newline="")
    assert read_skeleton(path) == found.skeleton
    assert len(found.skeleton.joints) == 2


def test_what_no_skeleton_comes_from(tmp_path):
    """One marker is no skeleton; markers that fly apart have no bones, which is said."""
    rng = np.random.default_rng(0)
    way = np.cumsum(np.cumsum(rng.normal(size=(200, 4, 3)), axis=0), axis=0)
    way *= np.array([2e-4, 3e-5, 1e-4, 1e-5])[:, None]
    for count in (1, 3, 4):
        titles = ",".join(f"m{m}_{axis}" for m in range(count) for axis in "xyz")
        rows = "\n".join(",".join(map(repr, row.ravel().tolist())) for row in way[:, :count])
        (tmp_path / f"{count}.csv").write_text(f"{titles}\n{rows}\n")
    with pytest.raises(MocapError, match="shows 1 marker;"):
        propose_skeleton(read(tmp_path / "1.csv", fps=100))
    found = propose_skeleton(read(tmp_path / "4.csv", fps=100))
    assert (found.skeleton.bones, found.skeleton.trunk, found.skeleton.joints) == ((), (), ())
    assert "No three markers move together as one rigid body" in found.text
    assert '"m3", "m1" and "m2" accelerate least of all' in found.text
    few = propose_skeleton(read(tmp_path / "3.csv", fps=100))
    assert "No three markers move together" in few.text
    assert "accelerate least" not in few.text
    assert 'Markers without a bone: "m0", "m1", "m2", "m3"' in found.text


@pytest.fixture
def mocap(monkeypatch, capfdbinary):
    def run(*arguments: object) -> tuple[int, bytes, str]:
        monkeypatch.setattr(sys, "argv", ["mocap", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            main()
        out, err = capfdbinary.readouterr()
        return int(stopped.value.code or 0), out, err.decode()

    return run


def test_track_takes_the_proposal_of_a_real_bat(mocap, tmp_path):
    """Mocap skeleton > bat.toml, then mocap track --skeleton bat.toml; without one the report says what is missing."""
    tracks = real("bat_windtunnel_dltdv8", "derived_csv", "078A3_F5", "078A3_F5_xyzpts.csv")
    code, out, err = mocap("skeleton", tracks, "--fps", 700)
    assert code == 0, err
    assert "proposed: 15 markers" in err
    path = tmp_path / "bat.toml"
    path.write_bytes(out)
    skeleton = read_skeleton(path)
    assert len(skeleton.markers) == 15
    assert skeleton.joints
    quick = ["--fps", 700, "--model", "constant_velocity", "--no-validate"]
    code, out, err = mocap("track", tracks, "--skeleton", path, *quick, "--out", tmp_path / "with")
    assert code == 0, err
    assert (tmp_path / "with" / "potentials").is_dir()
    with_joints = json.loads((tmp_path / "with" / "report.json").read_text())
    assert not any("mocap skeleton" in finding for finding in with_joints["findings"])
    short = tmp_path / "short_xyzpts.csv"
    titles, *rows = tracks.read_text().splitlines(keepends=True)
    short.write_text(titles + "".join([row for row in rows if set(row.strip().split(",")) != {"NaN"}][:60]))
    code, out, err = mocap("track", short, *quick, "--out", tmp_path / "without")
    assert code == 0, err
    assert not (tmp_path / "without" / "potentials").exists()
    assert not (tmp_path / "without" / "potentials").exists()
    findings = json.loads((tmp_path / "without" / "report.json").read_text())["findings"]
    assert any("mocap skeleton" in finding and "give it as `skeleton`" in finding for finding in findings)


def test_a_skeleton_is_written_where_it_is_wanted(mocap, tmp_path, monkeypatch):
    """--out writes what is printed otherwise, and what is there is not replaced unasked."""
    files = write_recording(make_lizard(seed=3, n_frames=150), tmp_path / "in", others=True)
    path = tmp_path / "out" / "lizard.toml"
    code, out, err = mocap("skeleton", files["points"], "--fps", 100, "--out", path)
    assert (code, out) == (0, b""), err
    code, out, _ = mocap("skeleton", files["points"], "--fps", 100)
    assert out == path.read_bytes()
    monkeypatch.setattr("mocap.proposing.propose_skeleton.propose_skeleton", None)  # it is refused before the work
    code, _, err = mocap("skeleton", files["points"], "--fps", 100, "--out", path)
    assert code == 1
    assert "--force" in err
