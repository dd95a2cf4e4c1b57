"""BVH, read back by forward kinematics that is written here from the format's description alone."""

import numpy as np
import pytest

from mocap.errors import MocapError
from mocap.results.bvh import write_bvh
from mocap.results.tracked import Tracked
from mocap.skeleton import Skeleton
from tests.mocap.rerun.flapping import make_run


def turn(axis, deg):
    c, s = np.cos(np.deg2rad(deg)), np.sin(np.deg2rad(deg))
    i, j = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}[axis]
    out = np.eye(3)
    out[i, i] = out[j, j] = c
    out[j, i], out[i, j] = s, -s
    return out


def forward(text, *, positions=True):
    """Names, (T, J, 3) positions and the frame time; joints at their offsets unless their positions are read."""
    words, joints, stack, i = text.split(), [], [], 0
    while words[i] != "MOTION":
        word = words[i]
        if word in ("ROOT", "JOINT"):
            joints.append({"name": words[i + 1], "parent": stack[-1] if stack else None})
            stack.append(len(joints) - 1)
        elif word == "End":
            stack.append(None)
        elif word == "OFFSET" and stack[-1] is not None:
            joints[stack[-1]]["offset"] = np.array(words[i + 1 : i + 4], dtype=float)
        elif word == "CHANNELS":
            joints[stack[-1]]["channels"] = words[i + 2 : i + 2 + int(words[i + 1])]
        elif word == "}":
            stack.pop()
        i += 1
    n_frames, step = int(words[i + 2]), float(words[i + 5])
    table = np.array(words[i + 6 :], dtype=float).reshape(n_frames, -1)
    out = np.zeros((n_frames, len(joints), 3))
    for t, row in enumerate(table):
        at, placed = 0, []
        for j, joint in enumerate(joints):
            offset, rotation = joint["offset"].copy(), np.eye(3)
            for channel in joint["channels"]:
                if channel.endswith("position"):
                    if positions or joint["parent"] is None:
                        offset["XYZ".index(channel[0])] = row[at]
                else:
                    rotation = rotation @ turn(channel[0], row[at])
                at += 1
            if joint["parent"] is None:
                placed.append((offset, rotation))
            else:
                x, r = placed[joint["parent"]]
                placed.append((x + r @ offset, r @ rotation))
            out[t, j] = placed[-1][0]
    return [j["name"] for j in joints], out, step


@pytest.fixture(scope="module")
def run():
    return make_run(n_frames=30, n_joints=0, n_cameras=0)


@pytest.fixture(scope="module")
def text(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("bvh") / "a.bvh"
    Tracked.of(run).export_kinematics(path)
    return path.read_text()


def kept(run, names):
    """The last marker has no position in the first five frames."""
    markers = run.tracks
    return markers.xyz_m[5:, [markers.names.index(name) for name in names]]


def test_positions_are_those_of_the_markers(run, text):
    """To the six decimals of a centimetre that the file has, through a dozen rotations of bones up to 10 cm long."""
    names, x_cm, step = forward(text)
    assert set(names) == set(run.skeleton.markers)
    np.testing.assert_allclose(x_cm, 100 * kept(run, names), atol=2e-5)
    assert step == pytest.approx(1 / 250)


def test_rotations_alone_give_the_angles(run, text):
    """A program that leaves bones rigid shows the same angle at a joint whose two segments are a chain."""
    names, x_cm, _ = forward(text, positions=False)
    truth = kept(run, names)
    assert np.abs(x_cm / 100 - truth).max() > 1e-4  # the bones' noise: rigid bones are elsewhere

    def included(x, three):
        a, b, c = (x[:, names.index(name)] for name in three)
        u, v = a - b, c - b
        return np.rad2deg(np.arccos((u * v).sum(1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)))

    three = ("L_shoulder", "L_elbow", "L_wrist")
    np.testing.assert_allclose(included(x_cm, three), included(truth, three), atol=1e-3)
    assert np.ptp(included(truth, three)) > 5


def test_parts_that_no_bone_joins_hang_on_the_root(run, tmp_path):
    bones = tuple(b for b in run.skeleton.bones if "neck" not in (b.a, b.b) and "rump" not in (b.a, b.b))
    parts = Skeleton(name="parts", markers=run.skeleton.markers, bones=bones)
    write_bvh(run.tracks, parts, tmp_path / "a.bvh")
    names, x_cm, _ = forward((tmp_path / "a.bvh").read_text())
    assert (tmp_path / "a.bvh").read_text().count("ROOT") == 1
    np.testing.assert_allclose(x_cm, 100 * kept(run, names), atol=2e-5)


def test_without_bones_there_is_no_tree(run, tmp_path):
    with pytest.raises(MocapError, match="no bones"):
        write_bvh(run.tracks, Skeleton(name="dots", markers=run.skeleton.markers), tmp_path / "a.bvh")
