"""Rigid bodies that files state: their markers, and the axes of their joints."""

import numpy as np
import pytest
from scipy.io import savemat

import mocap
from mocap.errors import FormatError
from mocap.io.registry import read
from mocap.io.xmalab import BODY_ENTRIES
from mocap.kinematics import angles
from mocap.kinematics.bodies import joint_quantities
from mocap.skeleton_files import read_skeleton
from tests.filters.bodies_trials import two_bodies
from tests.mocap.kinematics.body_motions import moving
from tests.real_data import real

NAMES = [*(f"head {k}" for k in range(4)), *(f"trunk {k}" for k in range(5)), "wand"]
MEMBERS = {"head": tuple(NAMES[:4]), "trunk": tuple(NAMES[4:9])}
ACS = ["rxx", "rxy", "rxz", "rx0", "ryx", "ryy", "ryz", "ry0", "rzx", "rzy", "rzz", "rz0", "tx", "ty", "tz", "t1"]


@pytest.fixture
def made():
    """Simulated bodies of four and five markers, one marker that is of neither, and (T, 2, 4, 4) their transforms."""
    found = two_bodies((4, 5), noise_m=1e-4, n_frames=120, seed=4)
    stray = np.random.default_rng(1).normal(size=(120, 1, 3)) * 0.05
    transforms = np.zeros((120, 2, 4, 4))
    transforms[..., :3, :3], transforms[..., :3, 3] = found.rotation, found.joint_m[:, None]
    transforms[..., 3, 3] = 1
    return np.concatenate([found.trial.xyz_m, stray], axis=1), transforms, found.places_m


def points_tsv(path, xyz_mm):
    head = [
        f"NO_OF_FRAMES\t{len(xyz_mm)}", "NO_OF_CAMERAS\t8", f"NO_OF_MARKERS\t{len(NAMES)}", "FREQUENCY\t100",
        "NO_OF_ANALOG\t0", "ANALOG_FREQUENCY\t0", "DESCRIPTION\t--", "TIME_STAMP\t2025-01-01", "DATA_INCLUDED\t3D",
        "MARKER_NAMES\t" + "\t".join(NAMES),
    ]  # fmt: skip
    rows = ["\t".join(f"{v:.4f}" for v in row.ravel()) for row in xyz_mm]
    path.write_text("\n".join([*head, *rows]) + "\n")
    return path


def bodies_tsv(path, transforms, *, titles=True, bodies=("head", "trunk"), numbered=True):
    head = [
        f"NO_OF_FRAMES\t{len(transforms)}", "NO_OF_CAMERAS\t8", "NO_OF_BODIES\t2", "FREQUENCY\t100", "NO_OF_ANALOG\t0",
        "ANALOG_FREQUENCY\t0", "DESCRIPTION\t--", "TIME_STAMP\t2025-01-01", "DATA_INCLUDED\t6D",
        "BODY_NAMES\t" + "\t".join(bodies),
    ]  # fmt: skip
    each = ["X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual", *(f"Rot[{k}]" for k in range(9)), ""]
    each = [*(f"{body} {each[0]}" if k == 0 else one for body in bodies for k, one in enumerate(each))]
    rows = []
    for t, frame in enumerate(transforms):
        row = [f"{t + 1}", f"{t / 100:.5f}"] if numbered else []
        for pose in frame:
            turn = pose[:3, :3].T.ravel()
            row += [*(f"{1000 * v:.4f}" for v in pose[:3, 3]), "0", "0", "0", "0.1", *(f"{v:.7f}" for v in turn), ""]
        rows.append("\t".join(row))
    shown = ["\t".join([*(["Frame", "Time"] if numbered else []), *each])] if titles else []
    path.write_text("\n".join([*head, *shown, *rows]) + "\n")
    return path


def transforms_csv(path, transforms, names, entries=BODY_ENTRIES, joint="_"):
    header = ",".join(f"{name}{joint}{entry}" for name in names for entry in entries)
    rows = np.swapaxes(transforms, 2, 3).reshape(len(transforms), -1)
    np.savetxt(path, rows, "%.10g", ",", header=header, comments="")
    return path


def points_csv(path, xyz):
    header = ",".join(f"{name}_{axis}" for name in NAMES for axis in "XYZ")
    np.savetxt(path, xyz.reshape(len(xyz), -1), "%.10g", ",", header=header, comments="")
    return path


@pytest.mark.parametrize("numbered", [True, False])
def test_bodies_of_qualisys(tmp_path, made, numbered):
    """A 6D export beside the 3D one: markers of each body, and their places in its axes are the simulated ones."""
    xyz, transforms, places = made
    transforms = transforms.copy()
    transforms[5, 0, :3] = 0.0  # as QTM writes a body that it did not find
    files = (
        points_tsv(tmp_path / "walk.tsv", 1e3 * xyz),
        bodies_tsv(tmp_path / "walk_6D.tsv", transforms, numbered=numbered),
    )
    assert np.isnan(read(files[1]).tables["transforms"][5, 0]).all()
    found = mocap.read(files)
    assert found.skeleton.bodies == MEMBERS
    shown = np.array([found.source.bodies["trunk"][name] for name in MEMBERS["trunk"]])
    np.testing.assert_allclose(shown, places[4:], atol=1e-4)
    if not numbered:
        return
    proposed = mocap.propose_skeleton(found).skeleton
    assert proposed.bodies == MEMBERS
    (axes,) = proposed.measures.axes.values()
    assert set(axes.parent) | set(axes.child) == set(NAMES[:9])
    with pytest.raises(FormatError, match=r"walk_6D\.tsv: BODY_NAMES has 2 bodies, the titles have 0 of X"):
        read(bodies_tsv(tmp_path / "walk_6D.tsv", transforms, titles=False))


def test_bodies_in_a_matlab_file_of_qualisys(tmp_path, made):
    """One file holds the trajectories and the bodies."""
    xyz, transforms, _ = made
    data = np.zeros((len(NAMES), 4, len(xyz)))
    data[:, :3] = 1e3 * xyz.transpose(1, 2, 0)
    bodies = {
        "Bodies": 2,
        "Name": np.array(["head", "trunk"], dtype=object),
        "Positions": 1e3 * transforms[..., :3, 3].transpose(1, 2, 0),
        "Rotations": np.swapaxes(transforms[..., :3, :3], 2, 3).reshape(len(xyz), 2, 9).transpose(1, 2, 0),
    }
    labelled = {"Labels": np.array(NAMES, dtype=object), "Data": data, "Count": len(NAMES)}
    trial = {"Frames": len(xyz), "FrameRate": 100.0, "Trajectories": {"Labeled": labelled}, "RigidBodies": bodies}
    savemat(tmp_path / "walk.mat", {"walk": trial})
    assert mocap.read(tmp_path / "walk.mat").skeleton.bodies == MEMBERS
    savemat(tmp_path / "cut.mat", {"walk": trial | {"RigidBodies": bodies | {"Rotations": np.zeros((2, 9, 7))}}})
    with pytest.raises(FormatError, match=r"cut\.mat: RigidBodies is not as Qualisys"):
        read(tmp_path / "cut.mat")


def test_bodies_of_motive(tmp_path):
    """Markers are of the body that they are named after, also where another's name begins alike."""
    bodies = ["box", "box 2"]
    markers = [f"{body}:Marker{k}" for body in bodies for k in range(1, 5)] + ["boxer1"]
    columns = [
        ("Rigid Body", b, w, a) for b in bodies for w, axes in (("Rotation", "XYZW"), ("Position", "XYZ")) for a in axes
    ]
    columns += [("Marker", name, "Position", axis) for name in markers for axis in "XYZ"]
    kinds, names, what, axes = zip(*columns, strict=True)
    head = [
        "Format Version,1.23,Take Name,Take 1,Take Notes,,Export Frame Rate,120.0,Length Units,Meters",
        "", ",Type," + ",".join(kinds), ",Name," + ",".join(names), ",ID," + ",".join(names), ",," + ",".join(what),
        "Frame,Time (Seconds)," + ",".join(axes),
    ]  # fmt: skip
    values = np.random.default_rng(2).normal(size=(5, len(columns)))
    rows = [f"{t},{t / 120:.6f}," + ",".join(f"{v:.6f}" for v in row) for t, row in enumerate(values)]
    (tmp_path / "take.csv").write_text("\n".join([*head, *rows]) + "\n")
    assert mocap.read(tmp_path / "take.csv").skeleton.bodies == {
        body: tuple(markers[4 * n : 4 * n + 4]) for n, body in enumerate(bodies)
    }


def test_bodies_of_xmalab(tmp_path, made):
    """Rigid bodies state markers; a coordinate system that stands still is within the bone that it is named after."""
    xyz, transforms, places = made
    points = points_csv(tmp_path / "3dpts.csv", 1e2 * xyz)
    scaled = transforms.copy()
    scaled[..., :3, 3] *= 1e2
    rigid = transforms_csv(tmp_path / "rbt.csv", scaled, ("head", "trunk"))
    within = np.eye(4)
    within[:3, :3], within[:3, 3] = angles.segment_frame(np.array([[1.0, 2, 3]]), np.array([[0.0, 1, 0]]))[0], [1, 2, 3]
    acs = transforms_csv(tmp_path / "HEAD_acs_tm.csv", np.tile(within, (3, 1, 1, 1)), ["data"], ACS, ".")
    found = mocap.read([points, rigid, acs], fps=100, unit="cm")
    assert found.skeleton.bodies == MEMBERS
    for body, part in (("head", slice(0, 4)), ("trunk", slice(4, 9))):
        expected = places[part] if body == "trunk" else (places[part] - 0.01 * within[:3, 3]) @ within[:3, :3]
        np.testing.assert_allclose([*found.source.bodies[body].values()], expected, atol=1e-4)
    acs.rename(tmp_path / "Cranium_acs_tm.csv")
    with pytest.raises(FormatError, match=r"rename it after its rigid body \(head_acs_tm\.csv, trunk_acs_tm\.csv\)"):
        mocap.read([points, rigid, tmp_path / "Cranium_acs_tm.csv"], fps=100, unit="cm")
    wrong = transforms_csv(tmp_path / "mm.csv", transforms * 1e3, ("head", "trunk"))
    with pytest.raises(
        FormatError, match=r"mm\.csv: no three markers of 3dpts\.csv keep their places in the body 'head'"
    ):
        mocap.read([points, wrong], fps=100, unit="cm")


def test_the_axes_of_a_macaque(tmp_path):
    """In the authors' axes angles and translations are those of their transforms, to 0.1 degrees and 0.2 mm RMS."""
    files = [real("xromm_macaque_jaw", name) for name in ("3dpts.csv", "rbt.csv")]
    truth = []
    for body, column, name in (("Skull", 1, "Cranium"), ("Jaw", 0, "Mandible")):
        source = real("xromm_macaque_jaw", f"{name}_acs_tm.csv")
        copy = tmp_path / f"{body}_acs_tm.csv"
        copy.write_bytes(source.read_bytes())
        files.append(copy)
        truth.append(read(files[1]).tables["transforms"][:, column] @ read(copy).tables["transforms"][0, 0])
    recording = mocap.read(files, fps=250, unit="cm")
    (tmp_path / "jaw.toml").write_text(mocap.propose_skeleton(recording).text)
    skeleton = read_skeleton(tmp_path / "jaw.toml")
    data = recording.data
    names = data["keypoint"].values.tolist()
    motion = moving(data["position"].values, data["time"].values, names, 1e-6)
    found = {one.name: one.value for one in joint_quantities(motion, skeleton, skeleton.body_joints[0])[0]}
    relative = np.linalg.inv(truth[0]) @ truth[1]
    turned = np.array([found[f"Skull_Jaw_rotation_{axis}_deg"] for axis in "zyx"])
    assert np.sqrt(np.mean((turned - np.degrees(angles.euler(relative[:, :3, :3]))) ** 2)) < 0.1
    shifted = np.stack([found[f"Skull_Jaw_translation_{axis}_m"] for axis in "xyz"], axis=1)
    assert np.sqrt(np.mean((shifted - 0.01 * relative[:, :3, 3]) ** 2)) < 2e-4
