"""A result with another skeleton: names that its aliases give, without tracking again."""

import numpy as np
import pandas as pd
import pytest

import mocap
from mocap.errors import SkeletonError
from mocap.skeleton import Joint, Skeleton


@pytest.fixture(scope="module")
def result():
    """Three points of an arm that bends, numbered as a file numbers them."""
    t_s = np.arange(60) / 100
    bend = 0.6 + 0.4 * np.sin(2 * np.pi * 2 * t_s)
    elbow = np.stack([0.1 * np.cos(t_s), 0.1 * np.sin(t_s), 0 * t_s], axis=1)
    tip = elbow + 0.08 * np.stack([np.cos(t_s + bend), np.sin(t_s + bend), 0 * t_s], axis=1)
    xyz = np.stack([np.zeros((60, 3)), elbow, tip], axis=1) + np.random.default_rng(1).normal(size=(60, 3, 3)) * 1e-4
    return mocap.track(mocap.from_arrays(xyz, names=["pt1", "pt2", "pt3"], fps=100, unit="m"), validate=False)


def skeleton(names, **aliases):
    """An elbow among three points."""
    joint = Joint(name="elbow_l", parent=names[0], centre=names[1], child=names[2])
    return Skeleton(name="arm", markers=tuple(names), joints=(joint,), aliases=aliases)


NAMED = {"pt1": "shoulder", "pt2": "elbow", "pt3": "tip"}


def test_aliases_name_the_points_of_a_result(result):
    """Values are those of the numbered points to the bit; columns have the names."""
    numbered = result.with_skeleton(skeleton(list(NAMED)))
    named = result.with_skeleton(skeleton(list(NAMED.values()), **NAMED))
    assert named.names == tuple(NAMED.values())
    assert list(named.markers["keypoint"].values) == list(NAMED.values())
    angle = named.kinematics["elbow_l_flexion_deg"]
    np.testing.assert_array_equal(angle.value, numbered.kinematics["elbow_l_flexion_deg"].value)
    np.testing.assert_array_equal(angle.sd, numbered.kinematics["elbow_l_flexion_deg"].sd)
    np.testing.assert_array_equal(named.kinematics["tip_speed_m_s"].value, numbered.kinematics["pt3_speed_m_s"].value)


def test_the_command_takes_aliases_too(result, tmp_path, mocap):
    """``mocap kinematics`` with a skeleton that names points, as where they are tracked."""
    result.save(tmp_path / "run")
    table = "\n".join(f'{old} = "{new}"' for old, new in NAMED.items())
    names = ", ".join(f'"{name}"' for name in NAMED.values())
    (tmp_path / "arm.toml").write_text(
        f'name = "arm"\nmarkers = [{names}]\n[joints]\nelbow = [{names}]\n[aliases]\n{table}\n'
    )
    code, _, err = mocap("kinematics", tmp_path / "run", "--skeleton", tmp_path / "arm.toml", "--out", tmp_path / "k")
    assert code == 0, err
    found = pd.read_csv(tmp_path / "k" / "kinematics.csv")
    assert {"elbow_flexion_deg", "tip_speed_m_s"} <= set(found)


def test_two_points_of_one_name_are_refused(result):
    """And a name that the result lacks."""
    with pytest.raises(SkeletonError, match="tip"):
        result.with_skeleton(skeleton(["pt1", "pt2", "tip"], pt3="tip", pt2="tip"))
    with pytest.raises(SkeletonError, match="wrist"):
        result.with_skeleton(skeleton(["pt1", "pt2", "wrist"]))
